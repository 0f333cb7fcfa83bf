"""The corrected model in a user's own loop: with its modifier it is the machine that the simulator makes of it."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import robot_arm

from jammkle_gap import BadRobotError, Modifier
from jammkle_gap.mujoco.corrected import closing_of, corrected_of
from jammkle_gap.mujoco.diagnosing import matched
from jammkle_gap.mujoco.library import robot_library
from jammkle_gap.mujoco.nonideal import TEXT_NAME
from jammkle_gap.mujoco.runs import AXES, Sense
from jammkle_gap.mujoco.simulator import FORWARD_FROM_S, LEAD_S, RobotSimulator, run
from jammkle_gap.mujoco.windows import recordings_of
from jammkle_sim.physics.engine import mujoco

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from jammkle_gap import Recording
    from jammkle_gap.mujoco.simulator import Machine

STEP_S = 0.002
"""Of the arm's model."""
LENGTH_S, SETTLED_S = 2.5, 0.8
GIVEN = {name: {"kp": kp, "kd": kd} for name, kp, kd in (("yaw", 60, 3), ("shoulder", 120, 5), ("elbow", 60, 2.5))}
GEARED = """
    <position name="yaw" joint="yaw" kp="0.6" kv="0.03" gear="10" forcerange="-8 6"/>
    <position name="shoulder" joint="shoulder" kp="120" kv="5" gear="-1"/>
    <motor name="elbow" joint="elbow" gear="5" ctrlrange="-1 1" ctrllimited="true" forcerange="-2 2"/>
"""
WHEELS = """
    <velocity name="yaw" joint="yaw" kv="3"/><velocity name="shoulder" joint="shoulder" kv="20"/>
    <position name="elbow" joint="elbow" kp="60" kv="2.5"/>
"""


def commanded(*, fed: bool = False, sensors: bool = False) -> dict[str, np.ndarray]:
    """Return a motion of the arm with what was asked for, and what is fed forward, and of sensors, where wanted."""
    found = robot_arm.samples(1, duration_s=LENGTH_S + 2.0 * LEAD_S)
    time_s = found["time_s"]
    for joint in robot_arm.JOINTS:
        if fed:
            found[f"command.{joint}.velocity"] = np.gradient(found[f"command.{joint}.position"], time_s)
            found[f"command.{joint}.effort"] = 2.0 * np.sin(4.0 * time_s)
    if sensors:
        found |= robot_arm.at_rest(found)
    return found


def arm(
    folder: Path, samples: Mapping[str, np.ndarray], actuators: str, given: Any
) -> tuple[RobotSimulator, Recording]:
    """Return the simulator of the arm with all that it is offered, and what was recorded: one window from the start."""
    file = robot_arm.write_model(folder, actuators, wrist=True)
    runs, robot = matched(file, [robot_arm.run("one", samples)], given)
    (recording,), _ = recordings_of(robot, runs, LENGTH_S, LENGTH_S)
    changes = robot_library(robot, [recording]).changes
    motion = recording.inputs
    still = replace(motion, position=0.0 * motion.position, velocity=0.0 * motion.velocity, sensitivity={})
    return RobotSimulator(robot, changes), replace(recording, inputs=still)


def without(xml: str, *left_out: str) -> str:
    """Return a corrected model whose text says nothing of some keys."""
    spec = mujoco.MjSpec.from_string(xml)
    (text,) = (each for each in spec.texts if each.name == TEXT_NAME)
    said = json.loads(text.data)
    text.data = json.dumps({key: value for key, value in said.items() if key not in left_out})
    assert set(left_out) <= set(said)
    return spec.to_xml()


def played(xml: str, samples: Mapping[str, np.ndarray], machine: Machine) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Play what was asked for with the corrected model, as a user would; return stamps and readings by signal."""
    model = mujoco.MjModel.from_xml_string(xml)
    data, modifier = mujoco.MjData(model), Modifier(model)
    for joint in robot_arm.JOINTS:  # where the simulator starts: positions are read as 0
        data.joint(joint).qpos[0] = -machine.read_position(joint, 0.0, 0.0) / machine.scale.get(joint, 1.0)
    asked = {key[len("command.") :]: values for key, values in samples.items() if key.startswith("command.")}
    stamps, rows = [], []
    for k in range(round((LENGTH_S + LEAD_S) / STEP_S)):
        stamps.append(modifier.stamp_s(data))
        row = {f"{joint}/position": value for joint, value in modifier.positions(data).items()}
        row |= {f"{joint}/effort": value for joint, value in modifier.efforts(data).items()}
        for signal, values in modifier.sensors(data).items():
            row |= {f"{signal}.{axis}": value for axis, value in zip(AXES, values, strict=True)}
        rows.append(row)
        point = k // round(1.0 / robot_arm.RATE_HZ / STEP_S)
        sent = {
            quantity: {
                joint: values[point]
                for joint in robot_arm.JOINTS
                if (values := asked.get(f"{joint}.{quantity}")) is not None
            }
            for quantity in ("position", "velocity", "effort")
        }
        rates = {joint: value for joint, value in sent["velocity"].items() if joint in sent["position"]}
        modifier.control(data, sent["velocity"] | sent["position"], rates, sent["effort"])
        mujoco.mj_step(model, data)
    return np.array(stamps), {name: np.array([row[name] for row in rows]) for name in rows[0]}


def apart(
    recording: Recording,
    made: Mapping[str, np.ndarray],
    stamps: np.ndarray,
    read: Mapping[str, np.ndarray],
    within_s: float = STEP_S,
) -> float:
    """Return how far readings of a loop are from the simulator's, in what they change by within a step of the model.

    Between the readings a step before and a step after (`within_s`) it is 0. The unit is the largest change in a step.
    """
    worst = 0.0
    for signal in recording.signals:
        # Starts that are not the same are forgotten by then, and the simulator has not run much farther.
        at_s = signal.time_s + LEAD_S
        known = (at_s > SETTLED_S) & (at_s < stamps[-1] - within_s)
        shifts = np.linspace(-within_s, within_s, 2 * round(within_s / STEP_S) + 1)
        own = np.array([np.interp(at_s[known] + shift_s, stamps, read[signal.name]) for shift_s in shifts])
        expected = made[signal.name][known]
        off = np.maximum(expected - own.max(axis=0), own.min(axis=0) - expected)
        worst = max(worst, float(off.max() / np.sqrt(np.square(np.diff(read[signal.name])).mean())))
    return worst


ENTRIES: dict[str, dict[str, float]] = {
    "delay_s": {"delay.time": 0.037},
    "arrival_s": {"commands/arrival": 0.005},
    "effort_delay_s": {"efforts/arrival": 0.008},
    "effort_delay_s ahead": {"efforts/arrival": -0.01, "delay.time": 0.02},
    "clock_rate": {"clock_skew.rate": 0.01},
    "set_point_lag_s": {"set_point_lag_elbow.time": 0.05},
    "forward_share": {"velocity_feed_forward_elbow.share": 0.8, "delay.time": 0.03},
    "slack": {"backlash_elbow.width": 0.04},
    "compliance": {"compliance_elbow.compliance": 0.3},
    "offset": {"encoder_offset_elbow.offset": 0.08},
    "reading_offset": {"reading_offset_elbow.offset": 0.08},
    "scale": {"encoder_scale_elbow.scale": 1.04},
    "effort_scale": {"torque_constant_elbow.scale": 0.8},
    "stribeck": {"stribeck_elbow.torque": 0.6, "stribeck_elbow.speed": 0.2},
    "load_friction": {"load_friction_elbow.share": 0.6},
    "sensor_offset": {"force_offset_wrist.z": 0.5},
    "sensor_scale": {"acceleration_scale_wrist.scale": 1.1},
    "sensor_turn": {"mounting_wrist.y": 0.15},
}
"""By what MJCF cannot say, effects and constants that make a machine with it."""
WITHIN = 0.3
"""Changes in a step by which the loop may be beside the simulator's readings of a step earlier or later."""
LOOSER = 1.0
"""The same with a clock of another rate, as readings then fall between steps, where efforts jump with set points; and
with all entries together."""
BESIDE = 0.75
"""What must be missed by at least where an entry is left out."""


@pytest.fixture(scope="module")
def sensing(tmp_path_factory: pytest.TempPathFactory) -> tuple[RobotSimulator, Recording, dict[str, np.ndarray]]:
    """Return the arm with servos and with sensors at its wrist, and its motion."""
    samples = commanded(sensors=True)
    return *arm(tmp_path_factory.mktemp("arm"), samples, robot_arm.SERVOS, None), samples


@pytest.mark.parametrize("entry", ENTRIES)
def test_loop_is_the_machine_of_the_simulator(sensing: Any, tmp_path: Path, entry: str) -> None:
    """What the simulator reads of a machine is read in the loop within a step, and not where the entry is left out."""
    simulator, recording, samples = sensing
    machine = simulator.machine(ENTRIES[entry])
    xml, made = corrected_of(simulator.robot, machine, {}, tmp_path).xml, run(machine, recording)
    limit = LOOSER if entry == "clock_rate" else WITHIN
    assert apart(recording, made, *played(xml, samples, machine)) < limit
    assert apart(recording, made, *played(without(xml, entry.partition(" ")[0]), samples, machine)) > BESIDE


def test_all_together_are_the_machine(sensing: Any, tmp_path: Path) -> None:
    """Entries do not disturb each other."""
    simulator, recording, samples = sensing
    alone = ("effort_delay_s ahead", "clock_rate")
    values = {key: value for entry, each in ENTRIES.items() if entry not in alone for key, value in each.items()}
    machine = simulator.machine(values)
    corrected = corrected_of(simulator.robot, machine, values, tmp_path)
    assert set(corrected.rest) == {entry.partition(" ")[0] for entry in ENTRIES} - {"clock_rate"}
    assert apart(recording, run(machine, recording), *played(corrected.xml, samples, machine)) < LOOSER


def test_rate_that_is_fed_forward_without_a_delay_comes_late(sensing: Any, tmp_path: Path) -> None:
    """The simulator knows the set points to come, and a loop does not: it is within 10 ms of the simulator's."""
    simulator, recording, samples = sensing
    machine = simulator.machine({"velocity_feed_forward_elbow.share": 0.8})
    made = run(machine, recording)
    xml = corrected_of(simulator.robot, machine, {}, tmp_path).xml
    late_s = 0.5 * FORWARD_FROM_S + STEP_S
    assert apart(recording, made, *played(xml, samples, machine), late_s) < 1.0
    assert apart(recording, made, *played(without(xml, "forward_share"), samples, machine), late_s) > 10.0


LIMITED = {"torque_limit_shoulder.torque": 4.0, "backlash_elbow.width": 0.03}
FILTERED = robot_arm.MOTORS.replace('motor name="yaw"', 'general dyntype="filter" dynprm="0.05" name="yaw"')


@pytest.mark.parametrize(
    ("actuators", "given"),
    [
        (robot_arm.MOTORS, {"gains": GIVEN}),
        (robot_arm.MOTORS, None),
        ("", {"gains": GIVEN}),
        (GEARED, {"gains": {"elbow": GIVEN["elbow"]}}),
        (FILTERED, {"gains": GIVEN}),
    ],
    ids=["motors", "estimated", "none", "geared", "filtered"],
)
def test_controller_outside_of_the_model_drives_its_motor(tmp_path: Path, actuators: str, given: Any) -> None:
    """Its gains drive the motor of a joint, whatever its gear, or one that is added; torque keeps within the limit."""
    samples = commanded()
    simulator, recording = arm(tmp_path, samples, actuators, given)
    machine = simulator.machine(LIMITED)
    corrected = corrected_of(simulator.robot, machine, {}, tmp_path)
    stamps, read = played(corrected.xml, samples, machine)
    assert apart(recording, run(machine, recording), stamps, read) < WITHIN
    assert np.abs(read["shoulder/effort"]).max() == pytest.approx(4.0)
    model = mujoco.MjModel.from_xml_string(corrected.xml)
    assert (model.nu, model.actuator("elbow").biasprm[1]) == (3, 0.0)
    assert model.actuator("shoulder").forcerange == pytest.approx([-4.0, 4.0])
    assert "elbow" in corrected.gains


@pytest.mark.parametrize(("actuators", "fed"), [(GEARED, False), (GEARED, True), (WHEELS, False)])
def test_drives_of_all_kinds_take_set_points_of_joints(tmp_path: Path, actuators: str, *, fed: bool) -> None:
    """Positions with and without a gear, velocities and efforts fed forward, and velocities alone."""
    samples = commanded(fed=fed)
    if actuators == WHEELS:
        for joint in ("yaw", "shoulder"):
            asked = samples.pop(f"command.{joint}.position")
            samples[f"command.{joint}.velocity"] = np.gradient(asked, samples["time_s"])
    given = {"gains": {"elbow": GIVEN["elbow"]}} if actuators == GEARED else None
    simulator, recording = arm(tmp_path, samples, actuators, given)
    machine = simulator.machine({"delay.time": 0.03, "encoder_scale_yaw.scale": 1.04})
    xml, made = corrected_of(simulator.robot, machine, {}, tmp_path).xml, run(machine, recording)
    assert apart(recording, made, *played(xml, samples, machine)) < WITHIN
    assert apart(recording, made, *played(without(xml, "delay_s", "scale"), samples, machine)) > BESIDE
    for quantity in ("velocity", "effort") if fed else ():
        unfed = {key: values for key, values in samples.items() if not key.endswith(f".{quantity}")}
        assert apart(recording, made, *played(xml, unfed, machine)) > BESIDE


def test_model_that_says_nothing_lets_everything_through() -> None:
    """Without the text `ctrl` is the set point, of a motor its torque, and readings are MuJoCo's."""
    servo, motor = 'position name="yaw" joint="yaw" kp="60" kv="3"', 'motor name="yaw" joint="yaw" gear="4"'
    actuators = robot_arm.SERVOS.replace(servo, motor)
    model = mujoco.MjModel.from_xml_string(robot_arm.MODEL.replace("ACTUATORS", actuators))
    data, modifier = mujoco.MjData(model), Modifier(model)
    assert modifier.drives == robot_arm.JOINTS
    modifier.control(data, {"yaw": 2.0, "elbow": 0.4})
    assert data.ctrl == pytest.approx([0.5, 0.0, 0.4])
    mujoco.mj_step(model, data)
    assert list(modifier.positions(data).values()) == data.qpos.tolist()
    assert modifier.efforts(data)["yaw"] == 2.0
    assert modifier.stamp_s(data) == data.time
    assert modifier.sensors(data) == {}


def test_time_that_goes_back_begins_anew(sensing: Any, tmp_path: Path) -> None:
    """A run after a reset is as the first was: nothing of that is left in delays, lags and friction."""
    simulator, _, _ = sensing
    values = {key: value for entry in ("delay_s", "set_point_lag_s", "slack", "stribeck", "effort_delay_s")
              for key, value in ENTRIES[entry].items()}  # fmt: skip
    xml = corrected_of(simulator.robot, simulator.machine(values), values, tmp_path).xml
    model = mujoco.MjModel.from_xml_string(xml)
    data, modifier = mujoco.MjData(model), Modifier(model)
    found = []
    for _ in range(2):
        mujoco.mj_resetData(model, data)
        for k in range(100):
            modifier.control(data, {"elbow": 0.3 + 0.001 * k})
            mujoco.mj_step(model, data)
        found.append((modifier.positions(data), modifier.efforts(data)))
    assert found[0] == found[1]


def test_set_points_that_cannot_be_are_refused() -> None:
    """A joint that has no drive is named, with those that have one; so is a set point that is no number."""
    modifier = Modifier(model := mujoco.MjModel.from_xml_string(robot_arm.MODEL.replace("ACTUATORS", robot_arm.SERVOS)))
    with pytest.raises(BadRobotError, match=r"joint wrist, which has no drive .* may be of: yaw, shoulder, elbow"):
        modifier.control(mujoco.MjData(model), {"wrist": 0.1})
    with pytest.raises(BadRobotError, match="of joint yaw is nan, which must be finite"):
        modifier.control(mujoco.MjData(model), {"yaw": float("nan")})


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('{"delay_s": 0.1', "Expecting"),
        ("[1, 2]", "cannot be used"),
        ('{"lateness": 0.1}', "the key 'lateness'; it may have: delay_s, arrival_s"),
        ('{"delay_s": "long"}', "delay_s is 'long', which must be a number, finite"),
        ('{"slack": {"elbow": -0.1}}', "slack of elbow is -0.1, which must be a number, at least 0"),
        ('{"scale": {"elbow": 0.0}}', "scale of elbow is 0.0, which must be a number, above 0"),
        ('{"slack": {"wrist": 0.1}}', "slack names joint wrist, which the model has not; it has: yaw, shoulder"),
        ('{"slack": 0.1}', "cannot be used"),
        ('{"stribeck": {"elbow": [0.1]}}', "stribeck of elbow is [0.1], which must have 2 numbers"),
        ('{"stribeck": {"elbow": [0.1, 0.0]}}', "must be above 0"),
        ('{"sensor_scale": {"tip/force": 1.1}}', "sensor_scale names site tip, which the model has not; it has: none"),
        ('{"gains": {"elbow": {"kp": 3.0}}}', "'kd'"),
    ],
)
def test_damaged_text_is_refused_in_one_line(text: str, said: str) -> None:
    """The line says what is wrong with it, and what to do."""
    spec = mujoco.MjSpec.from_string(robot_arm.MODEL.replace("ACTUATORS", robot_arm.SERVOS))
    spec.add_text(name=TEXT_NAME, data=text)
    with pytest.raises(BadRobotError) as error:
        Modifier(spec.compile())
    assert said in str(error.value)
    assert str(error.value).startswith("text jammkle of the model cannot be used: ")
    assert str(error.value).endswith("load the corrected model as it was written, or delete this text in it")
    assert "\n" not in str(error.value)


def test_closing_reads_the_file_alone(tmp_path: Path) -> None:
    """A delay and gains that only the text says close the gap of the file that has them."""
    model = robot_arm.write_model(tmp_path, robot_arm.MOTORS)
    runs, robot = matched(model, [robot_arm.run("one", robot_arm.samples(1, late_s=0.04))], {"gains": GIVEN})
    compared, _ = recordings_of(robot, runs, 2.0, 20.0)
    machine = RobotSimulator(robot, robot_library(robot, compared).changes).machine({"delay.time": 0.04})
    file = tmp_path / "corrected.xml"
    file.write_text(corrected_of(robot, machine, {}, tmp_path).xml)
    closing = closing_of(replace(robot, given=replace(robot.given, gains={})), file, runs, compared)
    assert all(each.corrected < 0.3 * each.nominal for each in closing)
    assert any("was corrected before" in note for note in matched(file, runs, {"gains": GIVEN})[1].notes)
    spec = mujoco.MjSpec.from_file(str(file))
    again = corrected_of(replace(robot, file=file), RobotSimulator(robot, {}).machine({}), {}, tmp_path)
    assert (len(spec.texts), again.xml.count(TEXT_NAME), "delay_s" in again.xml) == (1, 1, False)


def test_delay_of_a_robot_without_commands_is_of_its_positions(tmp_path: Path) -> None:
    """Where efforts alone are known, positions come late, in the loop and when the file is tried."""
    samples = robot_arm.samples(4, duration_s=3.0, smooth=True)
    runs, robot = matched(robot_arm.write_model(tmp_path), [robot_arm.run("one", samples, without=("commands",))])
    (recording,), _ = recordings_of(robot, runs, 2.0, 20.0)
    machine = RobotSimulator(robot, {}).machine({})
    machine.delay_s = 0.02
    made = run(machine, recording)
    file = tmp_path / "corrected.xml"
    file.write_text(corrected_of(robot, machine, {}, tmp_path).xml)
    same = replace(recording, signals=tuple(replace(each, values=made[each.name]) for each in recording.signals))
    for each in closing_of(robot, file, runs, [same]):
        assert each.corrected < 0.1 * each.nominal
    model = mujoco.MjModel.from_xml_path(str(file))
    data, modifier = mujoco.MjData(model), Modifier(model)
    angles = []
    for _ in range(50):
        angles.append(data.joint("elbow").qpos[0])
        modifier.control(data, {"elbow": 0.5})
        mujoco.mj_step(model, data)
    assert modifier.positions(data)["elbow"] == pytest.approx(angles[-round(0.02 / STEP_S)])
    assert modifier.efforts(data)["elbow"] == data.qfrc_actuator[2]


def test_sensors_that_were_compared_are_in_the_model(sensing: Any, tmp_path: Path) -> None:
    """A site gets those that the model has not, behind its own."""
    simulator, _, _ = sensing
    xml = corrected_of(simulator.robot, simulator.machine({}), {}, tmp_path).xml
    model = mujoco.MjModel.from_xml_string(xml)
    assert set(Modifier(model).sensors(mujoco.MjData(model))) == {f"wrist/{sense.value}" for sense in Sense}
    file = tmp_path / "arm.xml"
    file.write_text(xml)
    again = corrected_of(replace(simulator.robot, file=file), simulator.machine({}), {}, tmp_path).xml
    assert mujoco.MjModel.from_xml_string(again).nsensor == len(Sense)
