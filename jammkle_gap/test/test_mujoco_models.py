"""Models as others write them: what their compiler options, ranges, gears and names make of a diagnosis."""

from __future__ import annotations

import struct
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np
import pytest
from mujoco import rollout

from jammkle_gap.core.data import BadRecordingError
from jammkle_gap.mujoco.bags import _by_name, _played, _Trajectory
from jammkle_gap.mujoco.corrected import corrected_of
from jammkle_gap.mujoco.diagnosing import matched
from jammkle_gap.mujoco.library import groups_of, robot_library
from jammkle_gap.mujoco.runs import BASE_COLUMNS, BadRobotError, Quantity, Run, Sense, read_map, run_of_arrays
from jammkle_gap.mujoco.simulator import RobotSimulator, _Windows
from jammkle_gap.mujoco.windows import recordings_of

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from numpy.typing import NDArray

    from jammkle_gap.core.data import Recording
    from jammkle_gap.mujoco.robot import Robot

TIMES_S = 0.01 * np.arange(800)
ASKED = 0.6 * np.sin(np.outer(TIMES_S, [2.3, 3.1]))
SERVOS = '<position name="pan" joint="pan" kp="8" kv=".3"/><position name="tilt" joint="tilt" kp="8" kv=".3"/>'
TILT = SERVOS.partition("/>")[2]
INERTIA = 'diaginertia=".001 .001 .001"'


def model(
    folder: Path, actuators: str = SERVOS, *, compiler: str = "", base: str = "", beyond: str = "", pan: str = ""
) -> Path:
    """Write a camera that pans and tilts on a plate, and return its file."""
    file = folder / "camera.xml"
    file.write_text(f"""<mujoco><compiler angle="radian" {compiler}/>
      <option timestep="0.002" integrator="implicitfast"/>
      <worldbody><body name="plate" pos="0 0 .1">{base}<inertial pos="0 0 0" mass="2" {INERTIA}/>
        <body name="yoke" pos="0 0 .2"><inertial pos="0 0 .03" mass=".4" {INERTIA}/>
          <joint name="pan" axis="0 0 1" damping=".02" armature=".004" {pan}/>
          <body name="camera" pos="0 0 .08"><inertial pos=".06 0 .01" mass=".5" {INERTIA}/>
            <joint name="tilt" axis="0 1 0" damping=".02" armature=".004"/><site name="lens" pos=".1 0 0"/>{beyond}
      </body></body></body></worldbody><actuator>{actuators}</actuator></mujoco>""")
    return file


def recorded(columns: Mapping[str, NDArray[np.float64]] | None = None, pan: NDArray[np.float64] = ASKED[:, 0]) -> Run:
    """Return a run that follows its commands, pan among them, with other columns in place of its own or beside them."""
    noise = np.random.default_rng(0).normal(0.0, 2e-4, ASKED.shape)
    own = {f"{joint}.position": ASKED[:, k] + noise[:, k] for k, joint in enumerate(("pan", "tilt"))}
    return run_of_arrays(
        "run", TIMES_S, {**own, **(columns or {})}, {"pan.position": pan, "tilt.position": ASKED[:, 1]}
    )


def compared(file: Path, run: Run, given: Mapping[str, Any] | None = None) -> tuple[Robot, Recording, RobotSimulator]:
    """Return a robot, what is compared of a run, and the simulator with all effects."""
    runs, robot = matched(file, [run], given)
    recordings, _ = recordings_of(robot, runs, 2.0, 15.0)
    return robot, recordings[0], RobotSimulator(robot, robot_library(robot, recordings).changes)


def test_a_locked_joint_stays_where_the_model_has_it(tmp_path: Path) -> None:
    """Also where that is beyond its range, as with robots whose zero is no pose that they can take."""
    knee = f'<body name="shank" pos=".1 0 0"><inertial pos=".05 0 -.02" mass=".3" {INERTIA}/>{{}}</body>'
    joint = '<joint name="knee" axis="0 1 0" range="0.5 2.5"/>'
    found = []
    for beyond in (knee.format(joint), knee.format("")):
        _, recording, simulator = compared(model(tmp_path, beyond=beyond), recorded())
        found.append(simulator(recording, {}))
    assert np.abs(found[0]["tilt/position"] - found[1]["tilt/position"]).max() < 1e-6


@pytest.mark.parametrize("compiler", ['fusestatic="true"', 'settotalmass="5.8"', ""])
@pytest.mark.parametrize("base", ["<freejoint/>", ""])
def test_corrected_model_has_the_mass_in_the_body_that_was_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, compiler: str, base: str
) -> None:
    """Whatever becomes of bodies that stand, or of all masses, as the model is compiled."""
    monkeypatch.chdir(tmp_path)  # MuJoCo logs there that an option is deprecated
    file = model(tmp_path, compiler=compiler, base=base)
    robot, _, simulator = compared(file, recorded())
    values = {"mass_camera.scale": 1.6}
    (tmp_path / "out").mkdir()
    corrected = corrected_of(robot, simulator.machine(values), values, tmp_path / "out")
    (tmp_path / "out" / "camera.xml").write_text(corrected.xml)
    made, own = (mujoco.MjModel.from_xml_path(str(each)) for each in (tmp_path / "out" / "camera.xml", file))
    for name, factor in (("yoke", 1.0), ("camera", 1.6)):
        assert made.body(name).mass[0] == pytest.approx(factor * own.body(name).mass[0])


def test_corrected_model_finds_the_assets_of_the_model(tmp_path: Path) -> None:
    """Height fields too, and meshes of an attached model, which are beside that one."""
    (tmp_path / "parts" / "shapes").mkdir(parents=True)
    corners, faces = np.vstack([np.zeros(3), 0.05 * np.eye(3)]), ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3))
    triangles = b"".join(struct.pack("<12fH", 0, 0, 0, *corners[list(face)].ravel(), 0) for face in faces)
    (tmp_path / "parts" / "shapes" / "m.stl").write_bytes(bytes(80) + struct.pack("<I", len(faces)) + triangles)
    (tmp_path / "h.bin").write_bytes(struct.pack("ii", 4, 4) + np.linspace(0, 1, 16, dtype=np.float32).tobytes())
    (tmp_path / "parts" / "part.xml").write_text(
        '<mujoco model="part"><compiler meshdir="shapes"/><asset><mesh name="m" file="m.stl"/></asset>'
        '<worldbody><body name="part"><geom type="mesh" mesh="m" density="8000"/></body></worldbody></mujoco>'
    )
    file = model(tmp_path, beyond='<frame><attach model="part" body="part" prefix="p_"/></frame>')
    assets = '<asset><model name="part" file="parts/part.xml"/><hfield name="h" file="h.bin" size="1 1 .1 .1"/></asset>'
    ground = '<worldbody><geom type="hfield" hfield="h" pos="0 0 -2"/>'
    file.write_text(file.read_text().replace("<worldbody>", f"{assets}{ground}"))
    robot, _, simulator = compared(file, recorded())
    (tmp_path / "out").mkdir()
    corrected = corrected_of(robot, simulator.machine({}), {}, tmp_path / "out")
    (tmp_path / "out" / "camera.xml").write_text(corrected.xml)
    assert mujoco.MjModel.from_xml_path(str(tmp_path / "out" / "camera.xml")).nmesh == 1


def test_a_base_that_turns_round_is_compared_with_itself(tmp_path: Path) -> None:
    """A yaw beyond half a turn is the same as measured, and no error of the start."""
    file = model(tmp_path, base='<freejoint name="root"/>')
    own = mujoco.MjModel.from_xml_path(str(file))
    own.opt.gravity[:] = 0.0
    data, rows = mujoco.MjData(own), []
    data.qvel[5] = 1.0
    for asked in ASKED:
        rows.append(data.qpos.copy())
        data.ctrl[:] = asked
        mujoco.mj_step(own, data, 5)
    file.write_text(file.read_text().replace("<option", '<option gravity="0 0 0"'))
    poses = np.array(rows)
    poses[:, 7:] += np.random.default_rng(1).normal(0.0, 1e-4, (len(poses), 2))
    names = [*(f"base.{each}" for each in BASE_COLUMNS), "pan.position", "tilt.position"]
    _, recording, simulator = compared(file, recorded(dict(zip(names, poses.T, strict=True))), {"base": "free"})
    assert recording.signal("base/yaw").values.max() > np.pi
    left = recording.signal("base/yaw").values - simulator(recording, {})["base/yaw"]
    assert np.abs(left).max() < 2e-3


def test_what_is_moved_as_measured_moves_by_the_clock_of_the_readings(tmp_path: Path) -> None:
    """With a clock that runs 0.5 % fast, a joint without a drive is where it was measured, to the last window."""
    share = 0.005
    times_s = 0.01 * np.arange(6000)
    real_s = times_s / (1.0 + share)
    asked = {"tilt.position": 0.6 * np.sin(3.1 * times_s)}
    measured = {"pan.position": 0.5 * np.sin(2.3 * real_s), "tilt.position": 0.6 * np.sin(3.1 * real_s)}
    run = run_of_arrays("run", times_s, measured, asked)
    file = model(tmp_path, TILT)
    robot, recording, simulator = compared(file, run, {"joints": {"pan": "measured"}, "noise": {"position": 2e-4}})
    windows = _Windows(simulator.machine({"clock_skew.rate": share}), recording.inputs)
    states, _ = rollout.rollout(robot.model, mujoco.MjData(robot.model), windows.starts(), windows.controls())
    begins_s = recording.inputs.starts_s[-1] / (1.0 + share) - 0.2
    at_s = begins_s + windows.step_s * np.arange(1, windows.count + 1)
    place = 1 + int(robot.model.joint("pan").qposadr[0])
    assert begins_s > 10.0
    assert np.abs(states[-1, :, place] - 0.5 * np.sin(2.3 * at_s)).max() < 1e-3


@pytest.mark.parametrize("where", ["forcerange", "actuatorfrcrange"])
def test_no_effort_is_above_the_limit_of_its_drive(tmp_path: Path, where: str) -> None:
    """Set points in stairs ask for more than the limit, of the actuator or of the joint, and it is not exceeded."""
    limit = 'VALUE="-1 1"'.replace("VALUE", where)
    of_drive, of_joint = (limit, "") if where == "forcerange" else ("", limit)
    servos = f'<position name="pan" joint="pan" kp="800" kv="8" {of_drive}/>{TILT}'
    stairs = 0.6 * np.sin(2.3 * np.floor(TIMES_S / 0.1) * 0.1)
    run = recorded({"pan.effort": np.random.default_rng(2).normal(0.0, 0.01, len(TIMES_S))}, stairs)
    _, recording, simulator = compared(model(tmp_path, servos, pan=of_joint), run)
    assert np.abs(simulator(recording, {})["pan/effort"]).max() == pytest.approx(1.0, abs=1e-9)


def test_a_limit_that_was_found_does_not_widen_one_of_the_model(tmp_path: Path) -> None:
    """A range that is not the same on both sides keeps its own; a gear that turns round turns it round."""
    servos = f'<position name="pan" joint="pan" kp="8" kv=".3" forcerange="-1 5"/>{TILT}'
    robot, _, simulator = compared(model(tmp_path, servos), recorded())
    machine = simulator.machine({"torque_limit_pan.torque": 3.0})
    assert machine.model.actuator(robot.drives[0].actuator).forcerange.tolist() == [-1.0, 3.0]
    servos = f'<motor name="pan" joint="pan" gear="-2" ctrlrange="-1 5"/>{TILT}'
    robot, _, _ = compared(model(tmp_path, servos), recorded(), {"gains": {"pan": {"kp": 8, "kd": 0.3}}})
    assert robot.model.actuator(robot.drives[0].actuator).forcerange.tolist() == [-10.0, 2.0]


def test_names_and_gains_that_do_not_go_together(tmp_path: Path) -> None:
    """An actuator may have the name of another joint; positions are not followed without kp."""
    servos = '<position name="tilt" joint="pan" kp="8" kv=".3"/>'
    robot, _, _ = compared(model(tmp_path, servos), recorded(), {"gains": {"tilt": {"kp": 8, "kd": 0.3}}})
    assert [each.joint for each in robot.drives] == ["pan", "tilt"]
    with pytest.raises(BadRobotError, match="commanded by position, and its gains in the map have no kp"):
        compared(model(tmp_path), recorded(), {"gains": {"pan": {"kd": 0.3}}})


def test_degrees_are_of_angles_alone(tmp_path: Path) -> None:
    """A slide keeps its metres where the map says that angles are in degrees."""
    lift = f'<body name="tray" pos=".1 0 0"><inertial pos="0 0 0" mass=".1" {INERTIA}/>'
    lift += '<joint name="lift" type="slide" axis="0 0 1"/></body>'
    degrees = {"pan.position": np.degrees(ASKED[:, 0]), "tilt.position": np.degrees(ASKED[:, 1])}
    run = run_of_arrays("run", TIMES_S, {**degrees, "lift.position": 0.3 + 0.01 * ASKED[:, 0]}, degrees)
    (found,), _ = matched(model(tmp_path, beyond=lift), [run], {"units": "degrees"})
    assert found.measured["lift", Quantity.POSITION].values.max() == pytest.approx(0.306, abs=1e-3)
    assert found.measured["pan", Quantity.POSITION].values.max() == pytest.approx(0.6, abs=1e-3)


def test_a_joint_that_stands_gets_bounds_of_a_real_one(tmp_path: Path) -> None:
    """A gripper that holds still has no scale of its own: bounds are finite, and no effect divides by zero."""
    grip = f'<body name="finger" pos=".1 0 0"><inertial pos="0 0 0" mass=".05" {INERTIA}/>'
    grip += '<joint name="grip" type="slide" axis="1 0 0"/></body>'
    servos = f'{SERVOS}<position name="grip" joint="grip" kp="500" kv="20"/>'
    nothing = np.zeros(len(TIMES_S))
    asked = {"pan.position": ASKED[:, 0], "tilt.position": ASKED[:, 1], "grip.position": nothing}
    run = run_of_arrays("run", TIMES_S, asked, asked)
    runs, robot = matched(model(tmp_path, servos, beyond=grip), [run], {"noise": {"position": 2e-4}})
    recordings, _ = recordings_of(robot, runs, 2.0, 15.0)
    (coefficient,) = robot_library(robot, recordings).effects.effect("damping_grip").parameters
    assert 0.0 < coefficient.maximum < 1e5


@pytest.mark.parametrize("rubs", [0.0, 0.5])
@pytest.mark.parametrize("by", ["drive", "effort"])
def test_a_joint_may_rub_as_much_as_was_seen_to_act_on_it(tmp_path: Path, rubs: float, by: str) -> None:
    """A pan that carries no load takes 0.03 N m to move. Its bound is as if friction were none, or above it."""
    rate = np.gradient(ASKED[:, 0], TIMES_S)
    friction = rubs * np.tanh(20.0 * rate)
    if by == "drive":
        position = ASKED[:, 0] - (0.3 * rate + friction) / 8.0
        _, recording, simulator = compared(model(tmp_path), recorded({"pan.position": position}))
    else:
        efforts = {"pan.effort": friction + 1e-3 * np.sin(50.0 * TIMES_S), "tilt.effort": 0.3 * np.cos(ASKED[:, 1])}
        run = recorded(efforts)
        _, recording, simulator = compared(model(tmp_path), replace(run, commands={}))
    (torque,) = robot_library(simulator.robot, [recording]).effects.effect("friction_pan").parameters
    if rubs:
        assert 1.2 * rubs < torque.maximum < 3.0 * rubs
    else:
        assert 0.01 < torque.maximum < 0.2


def test_two_groups_of_motors_by_one_name_are_both_offered(tmp_path: Path) -> None:
    """Of an arm whose joints have a name and a number, the strong first ones and the weak last ones."""
    file, names = tmp_path / "arm.xml", [f"panda_joint{k}" for k in range(1, 6)]
    chain = "".join(
        f'<body pos="0 0 .1"><inertial pos="0 0 .05" mass=".5" {INERTIA}/>'
        f'<joint name="{name}" axis="0 {k % 2} {(k + 1) % 2}"/>'
        for k, name in enumerate(names)
    )
    servos = "".join(
        f'<position name="{name}" joint="{name}" kp="50" kv="1" forcerange="-{limit} {limit}"/>'
        for name, limit in zip(names, (87, 87, 87, 12, 12), strict=True)
    )
    file.write_text(f"<mujoco><worldbody>{chain}{'</body>' * 5}</worldbody><actuator>{servos}</actuator></mujoco>")
    columns = {f"{name}.position": np.roll(ASKED[:, 0], 50 * k) for k, name in enumerate(names)}
    _, robot = matched(file, [run_of_arrays("run", TIMES_S, columns, columns)])
    assert sorted(groups_of(robot, robot.joints).values()) == sorted([tuple(names), tuple(names[:3]), tuple(names[3:])])


def test_columns_that_are_seldom_filled_count_where_they_are(tmp_path: Path) -> None:
    """A sensor and odometry that come less often than joint states, as in a table with empty cells."""
    sparse = np.where(np.arange(len(TIMES_S)) % 10, np.nan, 1.0)
    force = {f"lens.force.{axis}": sparse for axis in "xyz"}
    assert [len(axis.values) for axis in recorded(force).sensed["lens", Sense.FORCE]] == [80, 80, 80]
    base = {f"base.{name}": (1.0 if name == "qw" else 0.0) * sparse for name in BASE_COLUMNS}
    robot, _, _ = compared(model(tmp_path, base="<freejoint/>"), recorded(base), {"base": "measured"})
    assert len(robot.prescribed) == 6
    with pytest.raises(BadRecordingError, match="has columns of base of shapes"):
        recorded({**base, "base.x": np.zeros(3)})


def test_windows_keep_off_holes_in_odometry(tmp_path: Path) -> None:
    """As off those in joint states: the base is not known where nobody measured it."""
    away = np.where((TIMES_S > 2.0) & (TIMES_S < 3.5), np.nan, 1.0)
    base = {f"base.{name}": (1.0 if name == "qw" else 0.0) * away for name in BASE_COLUMNS}
    _, recording, _ = compared(model(tmp_path, base="<freejoint/>"), recorded(base), {"base": "measured"})
    motion = recording.inputs
    assert all(start_s + motion.window_s <= 2.0 or start_s - 0.2 >= 3.5 for start_s in motion.starts_s)


def test_trajectories_are_played_on_from_how_fast_the_one_before_was() -> None:
    """A ramp that is streamed is a ramp; a first point at time zero counts with its velocity."""
    streamed = [_Trajectory(0.1 * k, np.array([0.1]), np.array([[0.1 * (k + 1), 1.0]])) for k in range(20)]
    at_s = np.linspace(0.5, 1.9, 300)
    assert np.abs(_played(streamed, 0.0).at(at_s) - at_s).max() < 1e-6
    whole = _Trajectory(0.0, np.array([0.0, 0.1, 0.2]), np.array([[0.0, 1.0], [0.1, 1.0], [0.2, 1.0]]))
    assert _played([whole], 0.0).at(np.array([0.02, 0.08])) == pytest.approx([0.02, 0.08])


def test_two_sensors_with_one_frame_are_named_in_the_map() -> None:
    """Raw and filtered readings of one IMU are not mixed: the map names one of the topics, or none is compared."""
    rows = [(0.01 * k, 0.0, 0.0, 9.81) for k in range(5)]
    sensed = {(topic, "imu", Sense.ACCELERATION): rows for topic in ("/imu/data", "/imu/data_raw")}
    found, (note,) = _by_name(sensed, read_map({}))
    assert not found
    assert "name one in the map (sensors: {/imu/data: SITE})" in note
    found, notes = _by_name(sensed, read_map({"sensors": {"/imu/data": "lens"}}))
    assert list(found) == [("/imu/data", Sense.ACCELERATION)]
    assert not notes


def test_an_effect_of_all_joints_and_one_of_each_act_together(tmp_path: Path) -> None:
    """A pair of both adds up, also where the second is next to nothing."""
    robot, _, simulator = compared(model(tmp_path), recorded())
    both = simulator.machine({"encoder_offset.offset": 0.05, "encoder_offset_pan.offset": 1e-9})
    assert both.offset == pytest.approx({"pan": 0.05, "tilt": 0.05})
    both = simulator.machine({"encoder_scale.scale": 1.02, "encoder_scale_pan.scale": 1.03})
    assert both.scale == pytest.approx({"pan": 1.02 * 1.03, "tilt": 1.02})
    gain = robot.model.actuator("pan").gainprm[0]
    assert both.model.actuator("pan").gainprm[0] == pytest.approx(1.02 * 1.03 * gain)


def test_windows_do_not_know_what_was_commanded_in_the_one_before(tmp_path: Path) -> None:
    """Stepped one after the other, with friction in proportion to the load, each begins with its own set point."""
    _, recording, simulator = compared(model(tmp_path), recorded())
    motion = recording.inputs
    size = {"load_friction_pan.share": 0.3}
    other = motion.set_points.copy()
    other[: int((motion.starts_s[1] - 0.3) / motion.step_s)] += 0.3
    changed = replace(recording, inputs=replace(motion, set_points=other))
    second = recording.signal("pan/position").time_s >= motion.window_s
    made = [simulator(each, size)["pan/position"][second] for each in (recording, changed)]
    assert np.abs(made[0] - made[1]).max() < 1e-6


KNEE = f"""<body name="shank" pos=".1 0 0"><inertial pos=".05 0 -.02" mass=".3" {INERTIA}/>
  <joint name="knee" axis="0 1 0" damping=".02"/></body>"""


@pytest.mark.parametrize("loaded", [False, True])
def test_drives_hold_no_weight_where_there_is_none_of_them(tmp_path: Path, *, loaded: bool) -> None:
    """All of it where a drive is; a joint that swings freely hangs on, also in the corrected model."""
    swung = 0.3 * np.cos(4.0 * TIMES_S) + 1e-4 * np.random.default_rng(1).normal(size=TIMES_S.size)
    run = recorded({"knee.position": swung})
    robot, _, simulator = compared(model(tmp_path, beyond=KNEE), run)
    assert [each.joint for each in robot.drives] == ["pan", "tilt"]
    values = {"gravity_compensation.share": 1.0}
    machine = simulator.machine(values)
    made = machine.model
    if loaded:
        made = mujoco.MjModel.from_xml_string(corrected_of(robot, machine, values, tmp_path).xml)
    data = mujoco.MjData(made)
    mujoco.mj_forward(made, data)
    held = data.qfrc_actuator + data.qfrc_passive
    knee, tilt = (int(made.joint(name).dofadr[0]) for name in ("knee", "tilt"))
    assert held[tilt] == pytest.approx(data.qfrc_bias[tilt], rel=1e-6)
    assert abs(data.qfrc_bias[knee]) > 0.1
    assert held[knee] == pytest.approx(0.0, abs=1e-6)


def test_what_holds_weight_is_not_offered_where_a_base_is_free(tmp_path: Path) -> None:
    """It would float."""
    for base, offered in (("held", True), ("free", False)):
        robot, recording, _ = compared(model(tmp_path, base="<freejoint/>"), recorded(), {"base": base})
        assert ("gravity_compensation" in {each.name for each in robot_library(robot, [recording]).effects}) is offered


def test_an_actuator_without_a_gear_is_refused(tmp_path: Path) -> None:
    servo = '<position name="pan" joint="pan" kp="8" kv=".3" gear="0"/>'
    with pytest.raises(BadRobotError, match=r"joint pan has a gear of 0, .*; give it another one"):
        matched(model(tmp_path, servo + TILT), [recorded()])


def test_commands_by_other_names_are_named_and_may_be_mapped(tmp_path: Path) -> None:
    """All of them are refused, some are noted; a map says which joints they are, beside readings by their names."""
    run, file = recorded(), model(tmp_path)

    def commanded(**names: str) -> Run:
        return replace(run, commands={(names[joint], each): track for (joint, each), track in run.commands.items()})

    both, one = commanded(pan="arm/pan", tilt="arm/tilt"), commanded(pan="pan", tilt="arm/tilt")
    with pytest.raises(BadRobotError, match="but commands of arm/pan, arm/tilt; say which is which in a map"):
        matched(file, [both])
    _, robot = matched(file, [one])
    assert any("left out: arm/tilt" in note for note in robot.notes)
    (made,), robot = matched(file, [both], {"joints": {"arm/pan": "pan", "arm/tilt": "tilt"}})
    assert [each.joint for each in robot.drives] == ["pan", "tilt"]
    assert made.commands.keys() == run.commands.keys()


@pytest.mark.parametrize(("limits", "noted"), [("-.6 .6", False), ("-.2 1", True), ("-1 .5", True)])
def test_a_joint_that_is_read_beyond_its_range_is_noted(tmp_path: Path, limits: str, *, noted: bool) -> None:
    """The simulation stops there, and that would be taken for physics."""
    _, robot = matched(model(tmp_path, pan=f'range="{limits}"'), [recorded()])
    assert any("joint pan reads -0.6 to 0.6, beyond the model's range" in note for note in robot.notes) is noted
