"""Any robot: model and recordings are matched by name, and what cannot be matched is said."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace
from typing import TYPE_CHECKING, cast

import numpy as np
import pytest
import robot_arm

from jammkle_gap import BadRecordingError
from jammkle_gap.mujoco.bags import run_of_bag
from jammkle_gap.mujoco.changes import scale_contact_time
from jammkle_gap.mujoco.corrected import corrected_of
from jammkle_gap.mujoco.diagnosing import matched
from jammkle_gap.mujoco.library import groups_of, robot_library
from jammkle_gap.mujoco.runs import (
    AXES,
    BadRobotError,
    Quantity,
    Sense,
    Track,
    read_map,
    run_of_arrays,
    run_of_csv,
)
from jammkle_gap.mujoco.simulator import RobotSimulator, scale_of
from jammkle_gap.mujoco.windows import recordings_of, repeats_of
from jammkle_sim.physics.engine import mujoco

if TYPE_CHECKING:
    from pathlib import Path

    from jammkle_gap import Recording
    from jammkle_gap.mujoco.robot import Robot
    from jammkle_gap.mujoco.runs import Run
    from jammkle_gap.mujoco.simulator import Machine


@pytest.fixture(scope="module")
def recorded() -> robot_arm.Samples:
    return robot_arm.samples(1)


@pytest.mark.parametrize("form", ["trajectory", "now", "array", "states"])
def test_bags_hold_the_same_however_they_are_commanded(tmp_path: Path, recorded: robot_arm.Samples, form: str) -> None:
    """Trajectories, bare numbers and joint states command the same motion, and bags are as arrays."""
    model = robot_arm.write_model(tmp_path)
    bag = robot_arm.write_bag(tmp_path / "bag", recorded, form)
    (run,), robot = matched(model, [bag])
    assert [each.joint for each in robot.drives] == list(robot_arm.JOINTS)
    for joint in robot_arm.JOINTS:
        asked = run.commands[joint, Quantity.POSITION].at(recorded["time_s"] + 1e-4)
        assert np.allclose(asked[1:], recorded[f"command.{joint}.position"][1:], atol=1e-3)
        assert np.allclose(run.measured[joint, Quantity.EFFORT].values, recorded[f"{joint}.effort"])


def test_joint_states_of_several_topics_are_asked_for(tmp_path: Path, recorded: robot_arm.Samples) -> None:
    """Where two topics hold the same joints, the map says which; what it names is there."""
    model = robot_arm.write_model(tmp_path)
    bag = robot_arm.write_bag(tmp_path / "bag", recorded, second="/arm/joint_states")
    with pytest.raises(BadRecordingError, match=r"joint yaw twice, on /arm/joint_states, /joint_states; name one"):
        matched(model, [bag])
    with pytest.raises(BadRecordingError, match="joint states on /arm/joint_states, /joint_states; name one"):
        matched(model, [bag], {"states": "/leg/joint_states"})
    (run,), _ = matched(model, [bag], {"states": "arm/joint_states"})
    assert np.allclose(run.measured["elbow", Quantity.EFFORT].values, recorded["elbow.effort"])


def test_csv_holds_the_same(tmp_path: Path, recorded: robot_arm.Samples) -> None:
    """A CSV file with the same columns is the same run."""
    run = run_of_csv(robot_arm.write_csv(tmp_path / "run.csv", recorded))
    assert np.allclose(run.measured["elbow", Quantity.POSITION].values, recorded["elbow.position"])
    assert np.allclose(run.commands["elbow", Quantity.POSITION].at(recorded["time_s"][:-1] + 1e-3),
                       recorded["command.elbow.position"][:-1])  # fmt: skip
    marked = tmp_path / "excel.csv"
    marked.write_bytes(b"\xef\xbb\xbf" + (tmp_path / "run.csv").read_bytes())
    assert run_of_csv(marked).measured.keys() == run.measured.keys()
    marked.write_text("t,elbow.position\n0.0,1.0\n")
    with pytest.raises(BadRecordingError, match=r"no column time_s among t, elbow\.position"):
        run_of_csv(marked)


def test_csv_has_each_column_once(tmp_path: Path, recorded: robot_arm.Samples) -> None:
    """Of two columns of one name nobody knows which counts."""
    file = robot_arm.write_csv(tmp_path / "run.csv", {**recorded, " elbow.position": recorded["yaw.position"]})
    with pytest.raises(BadRecordingError, match=r"elbow\.position is there more than once"):
        run_of_csv(file)


@pytest.mark.parametrize(
    ("row", "said"),
    [
        ("0.05,1.0,", "line 7 has 3 cells, and the first one 2"),
        ("0.05", "line 7 has 1 cells, and the first one 2"),
        (",1.0", "times that do not rise, or are no numbers"),
        ("nan,1.0", "times that do not rise, or are no numbers"),
        ("0.05,one", "could not convert string to float: 'one'"),
    ],
)
def test_csv_with_a_bad_row_is_refused(tmp_path: Path, row: str, said: str) -> None:
    """By its line, or by what is wrong with it."""
    rows = [f"{0.01 * k:.2f},{np.sin(0.1 * k)}" for k in range(30)]
    rows[5] = row
    (tmp_path / "run.csv").write_text("\n".join(["time_s,pan.position", *rows]))
    with pytest.raises(BadRecordingError, match=said):
        run_of_csv(tmp_path / "run.csv")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("gains: {elbow: {kp: true}}", "gains of elbow: kp is 'True'; it must be a number"),
        ("joints: {elbow: {sign: yes}}", "joint elbow: sign is 'True'; it must be a number"),
        ("noise: {position: on}", "noise: position is 'True'; it must be a number"),
    ],
)
def test_map_takes_no_word_for_a_number(tmp_path: Path, text: str, said: str) -> None:
    """YAML reads yes and no as true and false, and those are no 1 and 0."""
    (tmp_path / "map.yaml").write_text(f"model: arm.xml\n{text}\n")
    with pytest.raises(BadRobotError, match=said):
        read_map(tmp_path / "map.yaml")


def test_map_turns_names_signs_zeros_and_units(tmp_path: Path, recorded: robot_arm.Samples) -> None:
    """What is recorded by another name, sign, zero and in degrees is the model's again."""
    strange = dict(recorded)
    for key in ("{}.position", "command.{}.position"):
        strange[key.format("bow")] = -np.degrees(strange.pop(key.format("elbow")) - 0.2)
        for other in ("yaw", "shoulder"):
            strange[key.format(other)] = np.degrees(strange[key.format(other)])
    strange["bow.effort"] = -strange.pop("elbow.effort")
    given = {"joints": {"bow": {"model": "elbow", "sign": -1, "offset": 0.2}}, "units": "degrees"}
    (run,), robot = matched(robot_arm.write_model(tmp_path), [robot_arm.run("one", strange)], given)
    assert robot.joints == robot_arm.JOINTS
    for quantity in ("position", "effort"):
        found = run.measured["elbow", Quantity(quantity)].values
        assert np.allclose(found, recorded[f"elbow.{quantity}"])


def refusal(folder: Path, run: Run, given: dict[str, object] | None = None, actuators: str = robot_arm.SERVOS) -> str:
    """Return what is said of a run that cannot be used."""
    model = robot_arm.write_model(folder, actuators)
    with pytest.raises((BadRobotError, BadRecordingError)) as error:
        cut(*matched(model, [run], given))
    assert "\n" not in str(error.value)
    return str(error.value)


def cut(runs: list[Run], robot: Robot) -> list[Recording]:
    """Return what is compared of runs."""
    return recordings_of(robot, runs, 2.0, 20.0)[0]


def test_what_cannot_be_matched_is_named(tmp_path: Path, recorded: robot_arm.Samples) -> None:
    """A joint by another name, degrees, a controller that nobody described, a robot that stands: one line each."""
    renamed = {key.replace("elbow", "elbow_joint"): values for key, values in recorded.items()}
    assert "joints: {elbow_joint: elbow}" in refusal(tmp_path, robot_arm.run("one", renamed))
    degrees = {key: np.degrees(values) if "position" in key else values for key, values in recorded.items()}
    assert "units: degrees" in refusal(tmp_path, robot_arm.run("one", degrees))
    run = robot_arm.run("one", recorded, without=("effort",))
    assert "gains: {yaw: {kp: ..., kd: ...}}" in refusal(tmp_path, run, actuators=robot_arm.MOTORS)
    still = {key: np.round(values, 0) * 0.0 if key != "time_s" else values for key, values in recorded.items()}
    assert "nothing moves" in refusal(tmp_path, robot_arm.run("one", still))
    still = {key: 1e-4 * np.sin(values) if key != "time_s" else values for key, values in recorded.items()}
    assert "nothing moves" in refusal(tmp_path, robot_arm.run("one", still))
    run = robot_arm.run("one", recorded, without=("effort", "commands"))
    assert "neither commands" in refusal(tmp_path, run)
    assert "'kq'" in refusal(tmp_path, run, {"gains": {"yaw": {"kq": 1}}})
    assert "names joint wrist" in refusal(tmp_path, run, {"gains": {"wrist": {"kp": 1}}})
    assert "states is [1, 2]; it must be one topic" in refusal(tmp_path, run, {"states": [1, 2]})
    assert "joints is ['yaw']; it must be a table" in refusal(tmp_path, run, {"joints": ["yaw"]})
    assert "yaw is 'nan'; it must be a number" in refusal(tmp_path, run, {"torque_constants": {"yaw": float("nan")}})


def test_units_that_only_commands_or_times_have_are_named(tmp_path: Path, recorded: robot_arm.Samples) -> None:
    """Commands in degrees, times in milliseconds: one line each, with what would be right; and then it is."""
    asked = {key: np.degrees(values) if key.startswith("command") else values for key, values in recorded.items()}
    run = robot_arm.run("one", asked, without=("effort",))
    assert "moves by 0.0" in refusal(tmp_path, run)
    assert "commands: {units: degrees}" in refusal(tmp_path, run)
    runs, robot = matched(robot_arm.write_model(tmp_path), [run], {"commands": {"units": "degrees"}})
    assert worst_left(robot, cut(runs, robot)) < 1.5
    late = {**recorded, "time_s": 1000.0 * recorded["time_s"]}
    with pytest.raises(BadRecordingError, match=r"10 s between positions of joint yaw.*times in seconds"):
        robot_arm.run("one", late)


FED = """
<mujoco model="pendulum">
  <compiler angle="radian"/><option timestep="0.002" integrator="implicitfast"/>
  <worldbody><body name="rod"><inertial pos="0.3 0 0" mass="2" diaginertia="0.01 0.01 0.01"/>
    <joint name="hip" axis="0 1 0" damping="0.1"/></body></worldbody>
  <actuator><motor name="hip" joint="hip"/></actuator>
</mujoco>"""


@pytest.mark.parametrize("fed", [True, False])
def test_efforts_beside_positions_are_fed_forward(tmp_path: Path, *, fed: bool) -> None:
    """A controller adds commanded efforts to its own; a model without them sags."""
    file = tmp_path / "pendulum.xml"
    file.write_text(FED)
    model = mujoco.MjModel.from_xml_path(str(file))
    data, rows = mujoco.MjData(model), []
    time_s = 0.002 * np.arange(2000)
    wave = 0.5 * np.sin(4.0 * time_s) * np.minimum(time_s, 1.0)
    for command in wave:
        effort = -2.0 * 9.81 * 0.3 * np.cos(command)
        rows.append((data.qpos[0], command, effort))
        data.ctrl[0] = 40.0 * (command - data.qpos[0]) - 2.0 * data.qvel[0] + effort
        mujoco.mj_step(model, data)
    position, command, effort = np.array(rows).T
    position += np.random.default_rng(1).normal(0.0, 1e-4, len(position))
    asked = {"hip.position": command, **({"hip.effort": effort} if fed else {})}
    run = run_of_arrays("one", time_s, {"hip.position": position}, asked)
    runs, robot = matched(file, [run], {"gains": {"hip": {"kp": 40, "kd": 2}}})
    left = worst_left(robot, cut(runs, robot))
    assert left < 3.0 if fed else left > 100.0
    if fed:  # a motor that gives less gives less of what is fed forward, too
        (compared,) = cut(runs, robot)
        simulator = RobotSimulator(robot, robot_library(robot, [compared]).changes)
        weak = simulator(compared, {"torque_constant_hip.scale": 0.8})["hip/position"]
        sag = float(np.mean(weak - simulator(compared, {})["hip/position"]))
        assert sag == pytest.approx(0.2 * float(-effort.mean()) / (0.8 * 40.0), rel=0.1)


def test_map_that_says_what_cannot_be_is_refused(tmp_path: Path, recorded: robot_arm.Samples) -> None:
    """Each names what was said, and what may be."""
    run = robot_arm.run("one", recorded)
    for given, said in (
        ({"joints": {"elbwo": {"sign": -1}}}, "joint elbwo, which no recording has; they have: yaw, shoulder, elbow"),
        ({"joints": {"elbow": "lock"}}, "takes joint elbow for lock, which the model has not; write one of"),
        ({"joints": {"yaw": "elbow", "elbow": "elbow"}}, "joints yaw and elbow of one are both 'elbow' of the model"),
        ({"joints": {"yaw": "elbow"}}, "joints yaw and elbow of one are both 'elbow' of the model"),
        ({"gains": {"elbow": {"kp": -3}}}, "kp -3 and kd 0 must be at least 0"),
        ({"gains": {"elbow": 100}}, "are '100'; write {kp: ..., kd: ...}"),
        ({"base": "hold"}, "base 'hold' must be one of held, free, measured"),
        ({"noise": {"pos": 0.1}}, "noise: 'pos' must be one of position, velocity, effort"),
        ({"noise": {"position": "small"}}, "noise: position is 'small'; it must be a number"),
        ({"noise": {"position": -1.0}}, "noise: position -1 must be more than 0"),
        ({"torque_constants": {"shoulder": 0}}, "torque_constants: that of shoulder must not be 0"),
        ({"joints": 5}, "joints is 5; it must be a table, NAME: VALUE a line"),
        ({"joints": {"elbow": 3}}, "joint elbow is 3; it must be a table"),
        ({"joints": {"elbow": {"sign": "left"}}}, "joint elbow: sign is 'left'; it must be a number"),
        ({"commands": {"order": "elbow"}}, "order is 'elbow'; it must be a list of joints"),
        ({"sensors": {"imu": {"sign": 1}}}, "sensor imu has no site"),
    ):
        assert said in refusal(tmp_path, run, given)


def test_readings_that_stop_are_no_motion(tmp_path: Path, recorded: robot_arm.Samples) -> None:
    """No window lies over a hole; a stamp of another age is refused, and so is a hole in what is taken as a whole."""
    hole = (recorded["time_s"] < 2.4) | (recorded["time_s"] > 3.3)
    broken = {key: values[hole] for key, values in recorded.items()}
    runs, robot = matched(robot_arm.write_model(tmp_path), [robot_arm.run("one", broken)])
    compared, _ = recordings_of(robot, runs, 1.0, 20.0)
    assert compared[0].inputs.starts_s == pytest.approx((0.2, 1.2, 4.2))
    with pytest.raises(BadRecordingError, match=r"stop for 0.91 s at 2.39 s; cut it there"):
        cut(*matched(robot_arm.write_model(tmp_path), [robot_arm.run("one", broken, without=("commands",))]))
    aged = {**recorded, "time_s": np.append(recorded["time_s"][0], recorded["time_s"][1:] + 1.7e9)}
    with pytest.raises(BadRecordingError, match=r"stop for 1.7e\+09 s"):
        robot_arm.run("one", aged)


def test_efforts_that_a_driver_fills_in_are_left_out(tmp_path: Path, recorded: robot_arm.Samples) -> None:
    """Zeros are no measurement; where nothing else is known they are none at all."""
    zeros = {key: 0.0 * values if key.endswith(".effort") else values for key, values in recorded.items()}
    _, robot = matched(robot_arm.write_model(tmp_path), [robot_arm.run("one", zeros)])
    assert robot.efforts == ()
    assert "efforts that never change are left out: yaw, shoulder, elbow" in robot.notes
    assert "nor efforts of any joint" in refusal(tmp_path, robot_arm.run("one", zeros, without=("commands",)))


def test_joint_of_a_tendon_is_offered_as_measured(tmp_path: Path, recorded: robot_arm.Samples) -> None:
    """A finger that is commanded and that only a tendon moves has a way out."""
    winch = robot_arm.SERVOS.replace('<position name="elbow" joint="elbow" kp="60" kv="2.5"/>', "")
    model = robot_arm.write_model(tmp_path, f'{winch}<motor name="winch" tendon="cable"/>')
    model.write_text(model.read_text().replace("<actuator>", CABLE))
    run = robot_arm.run("one", recorded, without=("effort",))
    with pytest.raises(BadRobotError, match=r"if a tendon moves it write 'joints: {elbow: measured}'"):
        matched(model, [run])
    _, robot = matched(model, [run], {"joints": {"elbow": "measured"}})
    assert robot.prescribed == ("elbow",)
    (tmp_path / "empty.csv").write_text("time_s,elbow.position\n")
    with pytest.raises(BadRecordingError, match=r"empty\.csv holds no samples"):
        run_of_csv(tmp_path / "empty.csv")


def test_joints_that_joint_states_cannot_have_are_held_and_named(tmp_path: Path, recorded: robot_arm.Samples) -> None:
    """A joint without a name and a ball joint do not swing in silence."""
    model = robot_arm.write_model(tmp_path)
    hung = """<body pos="0 0 0.2"><joint axis="0 1 0"/><geom size="0.05" mass="1"/>
      <body pos="0 0 0.1"><joint type="ball"/><geom size="0.05" mass="1"/></body></body><body name="upper">"""
    model.write_text(model.read_text().replace('<body name="upper">', hung))
    _, robot = matched(model, [robot_arm.run("one", recorded)])
    assert robot.locked == ("body_1_joint_1",)
    assert any("locked where it has them" in note and "body_1_joint_1" in note for note in robot.notes)
    assert any("ball joints are held" in note and "body_2_joint_1" in note for note in robot.notes)
    assert not (robot.model.jnt_type == int(mujoco.mjtJoint.mjJNT_BALL)).any()


def test_controller_is_estimated_from_efforts(tmp_path: Path, recorded: robot_arm.Samples) -> None:
    """Gains that nobody gave come from recorded efforts, and the notes say so."""
    model = robot_arm.write_model(tmp_path, robot_arm.MOTORS)
    _, robot = matched(model, [robot_arm.run("one", recorded)])
    assert robot.estimated == robot_arm.JOINTS
    assert any("nobody described the controller of joint shoulder" in note for note in robot.notes)
    assert float(robot.model.actuator("shoulder").gainprm[0]) == pytest.approx(120.0, rel=0.1)
    given = {"gains": {name: {"kp": 50, "kd": 2} for name in robot_arm.JOINTS}}
    _, robot = matched(model, [robot_arm.run("one", recorded)], given)
    assert float(robot.model.actuator("shoulder").gainprm[0]) == 50.0
    assert not robot.model.actuator("shoulder").forcelimited[0]


def test_motor_keeps_its_torque_limit_under_a_controller(tmp_path: Path, recorded: robot_arm.Samples) -> None:
    """A range of controls of a motor is a range of torques, whatever commands it then."""
    limited = robot_arm.MOTORS.replace('joint="elbow"', 'joint="elbow" gear="2" ctrlrange="-3 4" forcerange="-5 3.5"')
    given = {"gains": {name: {"kp": 50, "kd": 2} for name in robot_arm.JOINTS}}
    model = robot_arm.write_model(tmp_path, limited)
    model.write_text(model.read_text().replace('angle="radian"', 'angle="radian" autolimits="true"'))
    _, robot = matched(model, [robot_arm.run("one", recorded)], given)
    assert robot.model.actuator("elbow").forcerange.tolist() == [-6.0, 7.0]


def test_gripper_that_nobody_commands_moves_as_measured(tmp_path: Path, recorded: robot_arm.Samples) -> None:
    """A joint without commands is where it was measured, the others feel it, and the notes say so."""
    some = {key: values for key, values in recorded.items() if key != "command.elbow.position"}
    runs, robot = matched(robot_arm.write_model(tmp_path), [robot_arm.run("one", some)])
    assert robot.prescribed == ("elbow",)
    assert robot.joints == ("yaw", "shoulder")
    assert any(note.startswith("moved as measured") and "elbow" in note for note in robot.notes)
    compared = cut(runs, robot)
    assert all(not signal.name.startswith("elbow") for signal in compared[0].signals)
    assert worst_left(robot, compared) < 1.5
    given = {"joints": {"elbow": "locked"}}
    runs, robot = matched(robot_arm.write_model(tmp_path), [robot_arm.run("one", some)], given)
    assert worst_left(robot, cut(runs, robot)) > 10.0
    given = {"joints": {"elbow": "measured"}}
    runs, robot = matched(robot_arm.write_model(tmp_path), [robot_arm.run("one", recorded)], given)
    assert robot.prescribed == ("elbow",)
    assert worst_left(robot, cut(runs, robot)) < 1.5


def worst_left(robot: Robot, recordings: list[Recording]) -> float:
    """Return the largest root mean square of measured less nominal over the signals, in noise."""
    made = [RobotSimulator(robot, {})(each, {}) for each in recordings]
    return max(
        float(np.sqrt(np.mean(np.square((signal.values - own[signal.name]) / scale_of(signal)))))
        for each, own in zip(recordings, made, strict=True)
        for signal in each.signals
    )


def test_stamps_of_two_clocks_are_set_together_and_said(tmp_path: Path, recorded: robot_arm.Samples) -> None:
    """Commands that are stamped an hour ahead are those of the same motion, and the notes say so."""
    bag = robot_arm.write_bag(tmp_path / "bag", recorded, "trajectory", ahead_s=3600.0)
    (run,), _ = matched(robot_arm.write_model(tmp_path), [bag])
    asked = run.commands["elbow", Quantity.POSITION].at(recorded["time_s"] + 1e-4)
    assert np.allclose(asked[1:], recorded["command.elbow.position"][1:], atol=1e-3)
    (note,) = [each for each in run.notes if "/arm/joint_trajectory" in each]
    assert "clock" in note
    assert "\n" not in note


def test_bag_whose_clock_was_set_back_is_refused(tmp_path: Path, recorded: robot_arm.Samples) -> None:
    """Its log mixes what was recorded before and after that."""
    time_s = recorded["time_s"]
    back = {**recorded, "time_s": np.where(time_s > np.median(time_s), time_s - 0.5, time_s)}
    bag = robot_arm.write_bag(tmp_path / "bag", back)
    with pytest.raises(BadRecordingError, match=r"cannot be put in order: the log of .* goes back by 0\.4"):
        matched(robot_arm.write_model(tmp_path), [bag])


@pytest.mark.parametrize(("form", "noted"), [("array", "3 of "), ("now", "trajectories")])
def test_what_is_no_number_is_left_out_and_noted(
    tmp_path: Path, recorded: robot_arm.Samples, form: str, noted: str
) -> None:
    """NaN among readings and commands is counted; of an interface that never reads anything nothing is said."""
    spoiled = {name: values.copy() for name, values in recorded.items()}
    spoiled["elbow.position"][10:15] = np.nan
    spoiled["command.elbow.position"][20:23] = np.nan
    spoiled["shoulder.effort"][:] = np.nan
    (run,), _ = matched(robot_arm.write_model(tmp_path), [robot_arm.write_bag(tmp_path / "bag", spoiled, form)])
    count = len(recorded["time_s"])
    assert len(run.measured["elbow", Quantity.POSITION].values) == count - 5
    assert ("shoulder", Quantity.EFFORT) not in run.measured
    assert np.isfinite(run.commands["elbow", Quantity.POSITION].values).all()
    assert f"5 of {count} readings of elbow (position) are no numbers: left out" in run.notes
    assert [note for note in run.notes if note.startswith(noted) and "elbow" in note and "no numbers" in note]
    assert not [note for note in run.notes if "shoulder (effort)" in note]


CHAINED = """
  <tendon><fixed name="cable"><joint joint="elbow" coef="0.1"/></fixed></tendon>
  <equality><connect name="strut" body1="tool" body2="world" anchor="0 0 0" active="false"/></equality>
  <actuator><motor name="winch" tendon="cable"/>"""


def test_closed_chains_and_tendons_are_named(tmp_path: Path, recorded: robot_arm.Samples) -> None:
    """What no effect acts on stands in the notes, by its name in the model."""
    model = robot_arm.write_model(tmp_path)
    model.write_text(model.read_text().replace("<actuator>", CHAINED))
    _, robot = matched(model, [robot_arm.run("one", recorded)])
    assert any("closed chains" in note and "strut" in note for note in robot.notes)
    assert any("actuators on tendons" in note and "winch" in note for note in robot.notes)


def made(folder: Path, samples: robot_arm.Samples, search_s: float = 20.0) -> tuple[Robot, RobotSimulator, list]:
    """Return a matched robot, its simulator with every effect, and what is compared of a run."""
    runs, robot = matched(robot_arm.write_model(folder), [robot_arm.run("one", samples)])
    compared, _ = recordings_of(robot, runs, 2.0, search_s)
    offer = robot_library(robot, compared)
    return robot, RobotSimulator(robot, offer.changes), compared


CHANGES = {
    "friction_elbow.torque": (0.5, lambda model: model.dof_frictionloss.__setitem__(2, 0.5)),
    "damping_elbow.coefficient": (0.6, lambda model: model.dof_damping.__setitem__(2, 0.9)),
    "armature_yaw.inertia": (0.08, lambda model: model.dof_armature.__setitem__(0, 0.13)),
}


@pytest.mark.parametrize("key", [None, "delay.time", "payload.mass", *CHANGES])
def test_simulator_with_the_effect_is_the_machine(tmp_path: Path, key: str | None) -> None:
    """With the machine's own effect what is left is noise, in every window; without it more."""
    change = CHANGES[key][1] if key in CHANGES else None
    if key == "payload.mass":
        change = lambda model: model.body_mass.__setitem__(4, model.body_mass[4] + 0.4)  # noqa: E731
    samples = exact(change, 0.04 if key == "delay.time" else 0.0)
    _, simulator, compared = made(tmp_path, samples)
    values = {} if key is None else {key: {"delay.time": 0.04, "payload.mass": 0.4}.get(key) or CHANGES[key][0]}
    for signal in compared[0].signals:
        left = signal.values - simulator(compared[0], values)[signal.name]
        noise = robot_arm.STEP_RAD if signal.unit == "rad" else robot_arm.NOISE_N_M
        assert float(np.sqrt(np.mean(left**2))) < 1.5 * noise, signal.name
    if key is not None:
        without = simulator(compared[0], {})
        worst = max(
            float(np.sqrt(np.mean((each.values - without[each.name]) ** 2))) / noise_of(each.unit)
            for each in compared[0].signals
        )
        assert worst > 3.0


def noise_of(unit: str) -> float:
    return robot_arm.STEP_RAD if unit == "rad" else robot_arm.NOISE_N_M


def exact(change: robot_arm.Change | None, late_s: float) -> robot_arm.Samples:
    """Return samples of a machine whose constants are those of the model."""

    def undone(model: mujoco.MjModel) -> None:
        robot_arm.exactly(model)
        if change is not None:
            change(model)

    return robot_arm.samples(3, undone, late_s=late_s)


def test_windows_start_from_what_was_measured(tmp_path: Path, recorded: robot_arm.Samples) -> None:
    """Windows are taken where the robot travels most, and what is compared is only theirs."""
    _, simulator, compared = made(tmp_path, recorded, search_s=4.0)
    motion = compared[0].inputs
    assert len(motion.starts_s) == 2
    assert all(signal.time_s[-1] < 4.0 for signal in compared[0].signals)
    assert set(simulator(compared[0], {})) == {signal.name for signal in compared[0].signals}


def test_joint_that_stands_has_the_noise_of_the_others(tmp_path: Path, recorded: robot_arm.Samples) -> None:
    """The encoder of a joint that is held shows no noise. It is said; alone in its unit, it is refused."""
    still = {
        "yaw.position": np.zeros_like(recorded["time_s"]),
        "command.yaw.position": np.zeros_like(recorded["time_s"]),
    }
    _, _, (compared,) = made(tmp_path, {**recorded, **still})
    moves = [compared.signal(f"{joint}/position") for joint in ("shoulder", "elbow")]
    assert scale_of(compared.signal("yaw/position")) == max(scale_of(each) for each in moves)
    assert compared.notes == (
        "yaw/position never changes: its noise is taken for the largest in its unit, unless the map gives it",
    )
    runs, robot = matched(tmp_path / "arm.xml", [robot_arm.run("still", {**recorded, **still})])
    flat = {("wrist", Sense.FORCE): tuple(Track(recorded["time_s"], 0.0 * recorded["time_s"]) for _ in AXES)}
    with pytest.raises(BadRecordingError, match=r"wrist/force.x never changes .* give it in the map"):
        recordings_of(replace(robot, senses=tuple(flat)), [replace(runs[0], sensed=flat)], 2.0, 20.0)


GEARED = """
    <motor name="winch" tendon="cable"/>
    <position name="yaw" jointinparent="yaw" kp="0.6" kv="0.03" gear="10" forcerange="-8 6"/>
    <position name="shoulder" joint="shoulder" kp="120" kv="5" gear="-1"/>
    <position name="elbow" joint="elbow" kp="60" kv="2.5"/>
"""
CABLE = '<tendon><fixed name="cable"><joint joint="elbow" coef="0.1"/></fixed></tendon><actuator>'


def test_gear_of_an_actuator_changes_nothing_but_its_numbers(tmp_path: Path, recorded: robot_arm.Samples) -> None:
    """Commands are of the joint, whatever the gear; the corrected model has the gear, and the right actuator."""
    _, plain, (compared,) = made(tmp_path, recorded)
    model = robot_arm.write_model(tmp_path, GEARED)
    model.write_text(model.read_text().replace("<actuator>", CABLE))
    _, robot = matched(model, [robot_arm.run("one", recorded)])
    simulator = RobotSimulator(robot, robot_library(robot, [compared]).changes)
    without, geared = plain(compared, {}), simulator(compared, {})
    for signal in compared.signals:
        assert geared[signal.name] == pytest.approx(without[signal.name], abs=1e-6), signal.name
    values = {"position_gain_yaw.scale": 0.7}
    corrected = corrected_of(robot, simulator.machine(values), values, tmp_path)
    yaw = robot_arm.mujoco.MjModel.from_xml_string(corrected.xml).actuator("yaw")
    assert (yaw.gear[0], yaw.gainprm[0], yaw.biasprm[1]) == pytest.approx((10.0, 0.42, -0.42))
    assert yaw.forcerange == pytest.approx([-8.0, 6.0])


BALL = """
<mujoco><worldbody>
  <geom name="floor" type="plane" size="1 1 1" solimp="0.9 0.9 0.001" solref="SOLREF"/>
  <body pos="0 0 0.1"><freejoint/><geom size="0.1" mass="1" solimp="0.9 0.9 0.001" solref="SOLREF"/></body>
</worldbody></mujoco>"""


@pytest.mark.parametrize("solref", ["0.02 1", "-2500 -100"])
def test_body_sinks_deeper_into_a_floor_that_gives(solref: str) -> None:
    """Twice the time of a contact is a quarter of its stiffness, however the model says it: four times as deep."""
    depths_m = []
    for scale in (1.0, 2.0):
        model = robot_arm.mujoco.MjModel.from_xml_string(BALL.replace("SOLREF", solref))
        scale_contact_time(cast("Machine", SimpleNamespace(model=model)), [scale])
        data = robot_arm.mujoco.MjData(model)
        robot_arm.mujoco.mj_step(model, data, 2000)
        depths_m.append(0.1 - float(data.qpos[2]))
    assert depths_m[1] == pytest.approx(4.0 * depths_m[0], rel=0.15)


def test_joints_of_one_kind_share_effects(tmp_path: Path, recorded: robot_arm.Samples) -> None:
    """All joints share an effect, those with the same rotor another, and each has its own."""
    robot, simulator, _ = made(tmp_path, recorded)
    groups = groups_of(robot, robot_arm.JOINTS)
    assert groups == {"": robot_arm.JOINTS, "_yaw_to_shoulder": ("yaw", "shoulder")}
    assert {"friction", "friction_yaw_to_shoulder", "friction_elbow"} <= set(simulator.changes)


def test_repeats_are_known_by_their_commands(tmp_path: Path, recorded: robot_arm.Samples) -> None:
    """An earlier run with the same commands is a reference; one with others is refused."""
    runs, robot = matched(
        robot_arm.write_model(tmp_path), [robot_arm.run("one", recorded), robot_arm.run("other", robot_arm.samples(9))]
    )
    compared, _ = recordings_of(robot, runs[:1], 2.0, 20.0)
    assert repeats_of(robot, compared, runs[:1])[0].setting == compared[0].setting
    with pytest.raises(BadRecordingError, match="was not commanded as any of one"):
        repeats_of(robot, compared, runs[1:])


def test_bag_without_joint_states_is_refused(tmp_path: Path, recorded: robot_arm.Samples) -> None:
    """A bag of commands alone says which topic is missing; one whose commands are elsewhere, where they are."""
    bag = robot_arm.write_bag(tmp_path / "bag", recorded, "array")
    with pytest.raises(BadRobotError, match="it may have: topic, order, quantity"):
        matched(robot_arm.write_model(tmp_path), [bag], {"commands": {"topics": "/arm"}})
    (tmp_path / "map.yaml").write_text("model: arm.xml\nnoise: {q: 1e-3}\nnoise: {q: 2e-3}\n")
    with pytest.raises(BadRobotError, match="'noise' stands in line 2 and again in line 3"):
        read_map(tmp_path / "map.yaml")
    with pytest.raises(BadRecordingError, match=r"holds no commands on /leg, but on: /arm/commands"):
        matched(robot_arm.write_model(tmp_path), [bag], {"commands": {"topic": "leg"}})
    assert run_of_bag(bag, matched(robot_arm.write_model(tmp_path), [bag])[1].given, robot_arm.JOINTS).notes


URDF = """
<robot name="one"><link name="base"/>
  <link name="arm"><inertial><origin xyz="0.2 0 0"/><mass value="2"/>
    <inertia ixx="0.002" iyy="0.027" izz="0.027" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="elbow" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" effort="50" velocity="5"/><dynamics damping="0.5"/></joint>
</robot>"""


def test_urdf_gets_the_controller_of_the_map(tmp_path: Path) -> None:
    """A URDF has no actuators: a joint that is commanded gets the PD controller that the map describes."""
    file = tmp_path / "arm.urdf"
    file.write_text(URDF)
    time_s = np.arange(0.0, 3.0, 0.01)
    angle = {"elbow.position": 0.5 * np.sin(3.0 * time_s)}
    run = run_of_arrays("one", time_s, angle, angle)
    with pytest.raises(BadRobotError, match="the model has none for it"):
        matched(file, [run])
    runs, robot = matched(file, [run], {"gains": {"elbow": {"kp": 60, "kd": 2}}})
    (compared,), _ = recordings_of(robot, runs, 2.0, 20.0)
    made = RobotSimulator(robot, {})(compared, {})["elbow/position"]
    assert 0.01 < float(np.abs(made - compared.signal("elbow/position").values).max()) < 0.2


def test_numbers_without_names_are_the_joints_of_a_urdf(tmp_path: Path, recorded: robot_arm.Samples) -> None:
    """In its order, as it has no actuators."""
    link = '<link name="{0}"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
    link += '</inertial></link><joint name="{0}" type="continuous"><parent link="{1}"/><child link="{0}"/></joint>'
    links = [link.format(name, before) for before, name in pairwise(("base", *robot_arm.JOINTS))]
    file = tmp_path / "arm.urdf"
    file.write_text(f'<robot name="arm"><link name="base"/>{"".join(links)}</robot>')
    bag = robot_arm.write_bag(tmp_path / "bag", recorded, "array")
    (run,), _ = matched(file, [bag], {"gains": {joint: {"kp": 60, "kd": 2} for joint in robot_arm.JOINTS}})
    assert {joint for joint, _ in run.commands} == set(robot_arm.JOINTS)


def sensed(folder: Path, samples: robot_arm.Samples) -> dict[str, np.ndarray]:
    """Return what the sensors at the wrist of a model would read of motion and commands, by signal."""
    runs, robot = matched(
        robot_arm.write_model(folder, wrist=True), [robot_arm.run("one", {**samples, **robot_arm.at_rest(samples)})]
    )
    (compared,), _ = recordings_of(robot, runs, 2.0, 20.0)
    made = RobotSimulator(robot, {})(compared, {})
    return {name: values for name, values in made.items() if name.startswith("wrist/")}


def test_sensors_at_sites_feel_the_weight_and_the_motion(tmp_path: Path, recorded: robot_arm.Samples) -> None:
    """A force sensor reads the tool's mass times what an IMU on it reads, about gravity; a gyro the joints' rates."""
    felt = sensed(tmp_path, recorded)
    acceleration, force, rate = (
        np.linalg.norm([felt[f"wrist/{sense.value}.{axis}"] for axis in AXES], axis=0)
        for sense in (Sense.ACCELERATION, Sense.FORCE, Sense.RATE)
    )
    assert float(np.median(acceleration)) == pytest.approx(9.81, rel=0.2)
    assert float(np.median(force / acceleration)) == pytest.approx(0.2, rel=0.05)
    moving = np.gradient(recorded["yaw.position"], recorded["time_s"])
    assert 0.5 * np.abs(moving).max() < rate.max() < 5.0 * np.abs(moving).max()


@pytest.mark.parametrize(
    ("effect", "value", "signal", "moved"),
    [
        ("force_offset_wrist.z", 0.5, "wrist/force.z", 0.5),
        ("acceleration_scale_wrist.scale", 1.1, "wrist/acceleration.z", None),
        ("mounting_wrist.y", 0.1, "wrist/angular_velocity.x", None),
    ],
)
def test_errors_of_sensors_change_their_readings_alone(
    tmp_path: Path, recorded: robot_arm.Samples, effect: str, value: float, signal: str, moved: float | None
) -> None:
    """Zero, scale and mounting change what a sensor reads, and no joint."""
    runs, robot = matched(
        robot_arm.write_model(tmp_path, wrist=True), [robot_arm.run("one", {**recorded, **robot_arm.at_rest(recorded)})]
    )
    (compared,), _ = recordings_of(robot, runs, 2.0, 4.0)
    offer = robot_library(robot, [compared])
    simulator = RobotSimulator(robot, offer.changes)
    plain, changed = simulator(compared, {}), simulator(compared, {effect: value})
    difference = changed[signal] - plain[signal]
    assert float(np.abs(difference).max()) > 0.01
    if moved is not None:
        assert np.allclose(difference, moved)
    assert np.array_equal(changed["elbow/position"], plain["elbow/position"])


def test_bag_says_where_its_sensors_are(tmp_path: Path, recorded: robot_arm.Samples) -> None:
    """An IMU whose frame is no site of the model is left out by name; the map says where it is."""
    bag = robot_arm.write_bag(tmp_path / "bag", recorded, imu_frame="imu_link")
    model = robot_arm.write_model(tmp_path, wrist=True)
    _, robot = matched(model, [bag])
    assert not robot.senses
    assert any("sensors: {imu_link: SITE}" in note for note in robot.notes)
    (run,), robot = matched(model, [bag], {"sensors": {"imu_link": {"site": "wrist", "sign": -1}}})
    assert set(robot.senses) == {("wrist", Sense.ACCELERATION), ("wrist", Sense.RATE)}
    assert np.allclose(run.sensed["wrist", Sense.ACCELERATION][2].values, -9.81)
    plain = robot_arm.write_bag(tmp_path / "plain", robot_arm.samples(2))
    _, robot = matched(model, [bag, plain], {"sensors": {"imu_link": "wrist"}})
    assert not robot.senses
    assert any("at wrist are left out, as not all recordings" in note for note in robot.notes)
    with pytest.raises(BadRobotError, match="at site tip, which the model has not; it has: wrist"):
        matched(model, [bag], {"sensors": {"imu_link": "tip"}})


def test_tolerances_of_the_map_are_constants(tmp_path: Path, recorded: robot_arm.Samples) -> None:
    """What the map gives a tolerance is fitted beside every effect, within four standard deviations of the model."""
    model, run = robot_arm.write_model(tmp_path), robot_arm.run("one", recorded)
    runs, robot = matched(model, [run], {"tolerances": {"damping": 0.2, "mass": 0.1}})
    compared, _ = recordings_of(robot, runs, 2.0, 20.0)
    offer = robot_library(robot, compared)
    constants = {each.name: each for each in offer.constants}
    assert constants["elbow/damping"].sigma == 0.2
    assert constants["elbow/damping"].maximum == pytest.approx(1.8)
    assert constants["tool/mass"].sigma == 0.1
    assert "elbow/armature" not in constants
    machine = RobotSimulator(robot, offer.changes).machine({"elbow/damping": 1.5, "damping_elbow.coefficient": 0.1})
    assert float(machine.model.dof_damping[2]) == pytest.approx(1.5 * 0.3 + 0.1)
    with pytest.raises(BadRobotError, match="friction 2 must be a share"):
        matched(model, [run], {"tolerances": {"friction": 2}})
    with pytest.raises(BadRobotError, match="'kp'; it may have: mass, length"):
        matched(model, [run], {"tolerances": {"kp": 0.1}})


def test_steps_of_a_command_count_by_when_they_come() -> None:
    """The mean about a time has of a step what lies behind it: half where it falls on the time itself."""
    track = Track(np.array([0.0, 1.0, 1.0, 2.0]), np.array([0.0, 0.0, 4.0, 4.0]))
    assert track.mean_about(np.array([0.5, 0.95, 1.0, 1.05, 2.5]), 0.2) == pytest.approx([0.0, 1.0, 2.0, 3.0, 4.0])
    ramp = Track(np.array([0.0, 2.0]), np.array([1.0, 5.0]))
    assert ramp.mean_about(np.array([-1.0, 0.0, 1.0, 2.0]), 1.0) == pytest.approx([1.0, 1.25, 3.0, 4.75])
