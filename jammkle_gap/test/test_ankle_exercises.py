"""Bags of exercises: read, run again from what the shank's sensors measured, and refused where those are missing."""

from __future__ import annotations

import dataclasses
import re
from typing import TYPE_CHECKING

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jammkle_common import names
from jammkle_common.bags.definitions import MessageDefinitions, share_folders
from jammkle_common.constants import STANDARD_GRAVITY_M_S2
from jammkle_gap.ankle.bag import Samples
from jammkle_gap.ankle.effects import apply_effects
from jammkle_gap.ankle.problem import ankle_problem
from jammkle_gap.ankle.recording import bag_of_run, load_recordings, recording_of
from jammkle_gap.ankle.repeats import difference, group_of
from jammkle_gap.ankle.shank import ShankMotion, moved_as_read
from jammkle_gap.core.data import BadRecordingError
from jammkle_sim.commands.bag import write_bags
from jammkle_sim.rigs.catalogue import EXERCISES, RIGS, run_rig
from recorded import SIMULATOR, run, worst_gap

if TYPE_CHECKING:
    from pathlib import Path

    from jammkle_gap import Recording

SHORT: dict[str, dict[str, object]] = {
    "cycle": {"jam_time_s": 0.6, "vent_time_s": 0.4},
    "press": {"way_time_s": 0.3},
    "shake": {"sweep_s": 2.0},
    "tilt": {"hold_s": 0.9},
}


def exercised(name: str) -> Recording:
    """Read a short exercise."""
    return recording_of(bag_of_run(run(name, **SHORT[name])))


def made_by(name: str, **values: float) -> Recording:
    """Read a short exercise of an ankle with an effect."""
    given = {key.replace("__", "."): value for key, value in values.items()}
    options = RIGS[name].options(**SHORT[name])

    def change(rig: object) -> object:
        return apply_effects(rig, ankle_problem().library, given)  # type: ignore[arg-type]

    return recording_of(bag_of_run(run_rig(name, options, lambda _: None, lambda: False, change)))  # type: ignore[arg-type]


def gaps(recording: Recording) -> dict[str, float]:
    """Root mean square of measured less nominal, in noise and rounding of the sensors, by signal."""
    simulated = SIMULATOR(recording, {})
    return {
        each.name: float(np.sqrt(np.mean(((each.values - simulated[each.name]) / each.deviation) ** 2)))
        for each in recording.signals
    }


@pytest.mark.parametrize("name", EXERCISES)
def test_a_nominal_exercise_lies_at_its_noise(name: str) -> None:
    """Played back from the IMU, and a press from heights, every signal comes out again within its noise.

    The load cell feels what the IMU's noise moves a corner on hard ground by: it may have twice its own.
    """
    recording = exercised(name)
    without_cell = [each for each in recording.signals if not each.name.startswith("load_cell")]
    assert worst_gap(dataclasses.replace(recording, signals=tuple(without_cell))) < 1.3
    assert worst_gap(recording) < 2.5


@pytest.mark.parametrize("name", EXERCISES)
def test_a_bag_on_disk_is_the_same_recording(name: str, tmp_path: Path) -> None:
    """Written and read again: the same signals, commands and motion."""
    write_bags({"": run(name, **SHORT[name])}, tmp_path / "bag", "/", MessageDefinitions(share_folders()))
    (read,) = load_recordings(tmp_path / "bag")
    straight = exercised(name)
    assert {each.name for each in read.signals} == {each.name for each in straight.signals}
    for signal in read.signals:
        assert signal.values == pytest.approx(straight.signal(signal.name).values, rel=1e-5, abs=1e-5)
    assert read.inputs.shank.readings == pytest.approx(straight.inputs.shank.readings)
    assert not difference(read, straight)


@pytest.mark.parametrize(
    ("name", "values", "signal", "least"),
    [
        ("shake", {"ankle_joint_friction__coulomb_n_m": 0.02}, "ankle_pitch/position", 3.0),
        ("press", {"jamming_friction__scale": 0.5}, "load_cell/force_z", 3.0),
        ("cycle", {"line_leak_achilles__conductance_dm3_s_bar": 0.003}, "achilles/pressure", 3.0),
        ("tilt", {"imu_offset__x_m_s2": 0.5}, "imu/specific_force_x", 3.0),
        ("tilt", {"gyro_offset__y_rad_s": 0.02}, "imu/angular_velocity_y", 5.0),
    ],
)
def test_an_effect_leaves_a_gap_where_it_acts(name: str, values: dict[str, float], signal: str, least: float) -> None:
    """What the nominal simulator does not have is left over, in the signal that feels it, above what noise leaves."""
    assert gaps(made_by(name, **values))[signal] > least * max(gaps(exercised(name))[signal], 0.3)


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("shake", {"ankle_joint_friction__coulomb_n_m": 0.02}),
        ("shake", {"imu_misalignment__roll_rad": 0.1}),
        ("shake", {"imu_delay__delay_s": 0.01}),
        ("shake", {"joint_delay__delay_s": 0.09}),
        ("press", {"joint_delay__delay_s": 0.09}),
        ("tilt", {"imu_offset__x_m_s2": 0.5}),
        ("press", {"jamming_friction__scale": 0.5}),
    ],
)
def test_the_true_effect_closes_it(name: str, values: dict[str, float]) -> None:
    """With the effect in it the simulator comes back to the noise: also where the IMU errs, which guides the shank."""
    recording = made_by(name, **values)
    given = {key.replace("__", "."): value for key, value in values.items()}
    simulated = SIMULATOR(recording, given)
    for each in recording.signals:
        if each.name.startswith(("ankle_", "imu")):
            left = (each.values - simulated[each.name]) / each.deviation
            assert np.sqrt(np.mean(left**2)) < 1.5, each.name


def test_what_is_measured_late_drives_the_run_otherwise() -> None:
    """Without references such effects are simulated; a late pressure changes what is read of the run alone."""
    sensing = ankle_problem().sensing
    assert sensing is not None
    left = sensing.without_references().effects
    assert {"joint_delay", "imu_delay", "sensor_delay", "clock_skew"}.isdisjoint(left)
    assert {"joint_delay", "pressure_delay"} <= sensing.effects
    assert "pressure_delay" in left


def test_a_shank_that_trembles_at_rest_moves_and_its_gyro_s_zero_does_not() -> None:
    """Of a hand that trembles by 20 mrad/s at 5 Hz, read by a gyro that is 10 mrad/s off, the shank has the tremor."""
    time_s = np.arange(0.0, 3.0, 0.005)
    tremor_rad_s = 0.02 * np.sin(2.0 * np.pi * 5.0 * time_s)
    readings = np.zeros((len(time_s), 6))
    readings[:, 2], readings[:, 3] = STANDARD_GRAVITY_M_S2, 0.01 + tremor_rad_s
    motion = ShankMotion(time_s, readings)
    assert motion.still.min() > 0.9
    rig, _ = RIGS["tilt"].build(RIGS["tilt"].options(**SHORT["tilt"]))
    moved = moved_as_read(rig, motion)
    rate_rad_s = moved.guide[200:-200, 10]
    assert np.mean(rate_rad_s) == pytest.approx(0.0, abs=5e-4)
    assert np.std(rate_rad_s) == pytest.approx(0.02 / np.sqrt(2.0), rel=0.03)


def test_what_is_driven_is_not_compared() -> None:
    """The IMU of a shake is an input alone, that of a tilt is compared; the height of a press is no signal."""
    assert not any(each.name.startswith("imu") for each in exercised("shake").signals)
    assert any(each.name.startswith("imu") for each in exercised("tilt").signals)
    assert "carriage/position" not in {each.name for each in exercised("press").signals}


def test_phases_are_rest_and_motion() -> None:
    """A tilt rests in its poses and moves between them; its pressures have phases of their own."""
    recording = exercised("tilt")
    moved = [phase.name for phase in recording.phases if "ankle_pitch/position" in phase.signals]
    assert moved.count("still") >= 10
    assert set(moved) == {"still", "moving"}
    assert {"evacuating", "holding"} <= {phase.name for phase in recording.phases}


def test_a_recorder_that_was_switched_on_early_changes_nothing() -> None:
    """Times count from the first command: 2 s of stillness before are cut off."""
    given = bag_of_run(run("shake", **SHORT["shake"]))
    topics = {name: dataclasses.replace(each, log_s=each.log_s + 100.0, stamp_s=each.stamp_s + 100.0)
              for name, each in given.topics.items()}  # fmt: skip
    imu = topics[names.IMU.name]
    before_s = 98.0 + 0.001 * np.arange(2000)
    still = {name: np.concatenate((np.full(2000, values[0]), values)) for name, values in imu.columns.items()}
    stamps = np.concatenate((before_s, imu.stamp_s))
    topics[names.IMU.name] = Samples(stamps, stamps, still)
    late = recording_of(dataclasses.replace(given, topics=topics, simulated=False))
    assert not difference(late, exercised("shake"))
    assert late.signals[0].time_s[0] == pytest.approx(exercised("shake").signals[0].time_s[0], abs=0.01)


def moved(recording: Recording, time_s: np.ndarray, readings: np.ndarray) -> Recording:
    """Return a recording of a shank that moved otherwise."""
    inputs = dataclasses.replace(recording.inputs, shank=ShankMotion(time_s, readings))
    return dataclasses.replace(recording, inputs=inputs)


@pytest.mark.parametrize("name", ["shake", "tilt"])
def test_what_a_hand_does_again_is_no_repeat(name: str) -> None:
    """A servo's motion is, a little late, larger and read askew; one that is slower, or backwards, is none."""
    recording = exercised(name)
    shank, random = recording.inputs.shank, np.random.default_rng(1)
    turn = Rotation.from_euler("xyz", [0.1, -0.1, 0.2]).as_matrix()
    askew = np.hstack([shank.readings[:, :3] @ turn, 1.1 * shank.readings[:, 3:] @ turn])
    again = moved(recording, shank.time_s + 0.07, askew + random.normal(0.0, 0.02, askew.shape))
    assert difference(recording, again) == ""
    slower = moved(recording, 1.3 * shank.time_s, shank.readings)
    backwards = moved(recording, shank.time_s, shank.readings[::-1])
    for other in (slower, backwards):
        assert difference(recording, other).startswith("the shank turns otherwise, by")
    nobody_knows = dataclasses.replace(recording, inputs=dataclasses.replace(recording.inputs, shank=None))
    assert "in one alone" in difference(recording, nobody_knows)


def test_runs_that_moved_otherwise_share_no_signatures() -> None:
    """A shake in pitch alone is another group than one in pitch and roll, as a leg without abduction makes it."""
    recording = exercised("shake")
    motion = recording.inputs.shank
    flat = dataclasses.replace(motion, readings=motion.readings * np.array([1.0, 0.0, 1.0, 0.0, 1.0, 0.0]))
    other = dataclasses.replace(recording, inputs=dataclasses.replace(recording.inputs, shank=flat))
    assert group_of(recording) != group_of(other)
    assert recording.inputs.key != other.inputs.key


@pytest.mark.parametrize(
    ("name", "topic", "column", "message"),
    [
        ("shake", names.IMU.name, None, "record imu/data, of an IMU on the shank"),
        ("press", names.JOINT_STATES.name, "carriage/position", "record 'carriage' in joint_states"),
    ],
)
def test_a_motion_that_nobody_knows_is_refused(name: str, topic: str, column: str | None, message: str) -> None:
    """Without the IMU, or over the ground without the height, there is nothing to run again."""
    given = bag_of_run(run(name, **SHORT[name]))
    topics = dict(given.topics)
    if column is None:
        del topics[topic]
    else:
        kept = {key: values for key, values in topics[topic].columns.items() if key != column}
        topics[topic] = dataclasses.replace(topics[topic], columns=kept)
    with pytest.raises(BadRecordingError, match=message):
        recording_of(dataclasses.replace(given, topics=topics))


@pytest.mark.parametrize(
    ("name", "sensor", "lost_s"),
    [
        ("shake", names.IMU.name, (0.8, 1.0)),
        ("shake", names.IMU.name, (1.5, 99.0)),
        ("shake", names.IMU.name, (0.0105, 99.0)),
        ("press", names.CARRIAGE_JOINT, (0.5, 1.2)),
    ],
)
def test_a_motion_with_a_gap_is_refused(name: str, sensor: str, lost_s: tuple[float, float]) -> None:
    """It is an input of the simulator, and is not guessed: in the middle, to the end, and all but a few samples."""
    given = bag_of_run(run(name, **SHORT[name]))
    topics = dict(given.topics)
    topic = names.IMU.name if sensor == names.IMU.name else names.JOINT_STATES.name
    lost = (topics[topic].stamp_s >= lost_s[0]) & (topics[topic].stamp_s <= lost_s[1])
    if sensor == topic:
        topics[topic] = topics[topic].chosen(~lost)
    else:  # others go on in the messages that lack it
        topics[topic] = dataclasses.replace(topics[topic], lacking={f"{sensor}/position": lost})
    with pytest.raises(BadRecordingError, match=f"holds nothing of {sensor}, which says how it moved") as refused:
        recording_of(dataclasses.replace(given, topics=topics))
    (begin_s,) = re.findall(r"between (\S+) and", str(refused.value))
    assert float(begin_s) == pytest.approx(lost_s[0], abs=0.01)
