"""Bags of driven rigs: any course, speed and number of pulls, with standard types alone; the course by its readings."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from jammkle_common import names
from jammkle_common.bags.run_sheet import RunSheet
from jammkle_gap.ankle.bag import Bag, Samples
from jammkle_gap.ankle.inputs import course_of, reading_noise_m
from jammkle_gap.ankle.recording import bag_of_run, recording_of
from jammkle_gap.core.data import BadRecordingError
from jammkle_sim.rigs.catalogue import RIGS, run_rig
from jammkle_sim.rigs.replay import Course, following
from recorded import SIMULATOR, run, worst_gap

CHANNEL = names.PERONEAL_RIGHT
PULLS = Course(np.array([0.0, 1.2, 1.6, 1.9, 2.3, 2.9, 3.6]), np.array([0.0, 0.0, 0.016, 0.004, 0.012, 0.012, 0.0]))
"""Two pulls of different length and speed, a hold, and a slow way back."""


def foreign(bag: Bag, *, later_s: float = 1.7e9, noise_m: float = 0.0) -> Bag:
    """Return what another recorder makes of a run: standard types, wall clock, a scale with noise."""
    topics = {}
    for name, each in bag.topics.items():
        if name == names.TENDON_STATES.name:
            continue
        columns = dict(each.columns)
        if name == names.JOINT_STATES.name:
            draw = np.random.default_rng(1)
            slide = columns["carriage/position"]
            columns["carriage/position"] = slide + noise_m * draw.standard_normal(len(slide))
        topics[name] = Samples(each.log_s + later_s, each.stamp_s + later_s, columns)
    return Bag("foreign", topics, RunSheet("", {"channel": CHANNEL}) if bag.sheet.rig == "tensile" else RunSheet())


def pulled(course: Course, **options: object) -> Bag:
    """Pull a tendon along a course of its own; the rig's own programme lasts 4.1 s."""
    chosen = {"vacuum_pa": 50e3, "speed_m_s": 0.016, "channel": CHANNEL, **options}
    made = RIGS["tensile"].options(**chosen)
    return bag_of_run(
        run_rig("tensile", made, lambda _: None, lambda: False, lambda rig: following(rig, course)), "pull"
    )


@pytest.mark.parametrize("noise_m", [0.0, 5e-6])
def test_a_pull_of_any_course_is_run_again_to_its_noise(noise_m: float) -> None:
    """Several pulls in one bag, by somebody else's recorder, with nothing known of them but rig and channel."""
    recording = recording_of(foreign(pulled(PULLS), noise_m=noise_m), "tensile")
    assert worst_gap(recording) < 1.5
    assert "carriage/position" not in {each.name for each in recording.signals}
    force = recording.signal("load_cell/force_z")
    by_default = run("tensile", vacuum_pa=50e3, speed_m_s=0.016).topics["load_cell/wrench"]
    default_n = np.interp(force.time_s, by_default.time_s, by_default.column("force_z_n"))
    assert np.abs(default_n - force.values).max() > 20.0


def test_the_channel_that_the_tendon_hangs_on_is_that_of_the_run_sheet() -> None:
    """The simulated tendon stiffens with that channel, and with no other."""
    assert worst_gap(recording_of(foreign(pulled(PULLS)), "tensile", {"channel": CHANNEL})) < 1.5
    assert worst_gap(recording_of(foreign(pulled(PULLS)), "tensile", {"channel": names.ACHILLES})) > 20.0


@pytest.mark.parametrize("foot", ["jammed", "unjammed"])
def test_a_slip_test_follows_its_carriage(foot: str) -> None:
    """Another speed and way than the rig's own, unsaid: until it slides, bins of 50 ms lie at their noise."""
    bag = foreign(bag_of_run(run("slip", foot=foot, speed_m_s=0.03, descent_m=0.05)), noise_m=3e-6)
    recording = recording_of(bag, "slip", {"foot": foot})
    simulated = SIMULATOR(recording, {})
    for name in ("load_cell/force_z", "load_cell/force_x", "ankle_pitch/position"):
        signal = recording.signal(name)
        before = (signal.time_s > 1.2) & (signal.time_s < 2.3)
        residual = (signal.values - simulated[name])[before]
        bins = residual[: len(residual) // 10 * 10].reshape(-1, 10).mean(axis=1)
        assert np.sqrt(np.mean(bins**2)) < 2.0 * signal.deviation, name


def test_times_count_alike_however_early_a_recorder_was_switched_on() -> None:
    """The first motion comes when the rig's own programme has it: repeats lie over each other."""
    plain = recording_of(foreign(pulled(PULLS)), "tensile")
    bag = foreign(pulled(PULLS), later_s=5e8)
    early = {}
    for name, each in bag.topics.items():
        first = each.stamp_s[0] - 0.01 * np.arange(300, 0, -1)
        if name in {names.PUMP_DUTY.name, *(topic.name for topic in names.SOLENOIDS.values())}:
            early[name] = each
            continue
        columns = {key: np.concatenate((np.full(300, values[0]), values)) for key, values in each.columns.items()}
        early[name] = Samples(np.concatenate((first, each.log_s)), np.concatenate((first, each.stamp_s)), columns)
    long = recording_of(Bag("long", early, bag.sheet), "tensile")
    moved_s = [float(np.interp(0.008, each.inputs.course.position_m[:4], each.inputs.course.time_s[:4]))
               for each in (plain, long)]  # fmt: skip
    assert moved_s[0] == pytest.approx(moved_s[1], abs=0.003)
    for channel, line in plain.inputs.commands.solenoids.items():
        assert long.inputs.commands.solenoids[channel].changes().time_s == pytest.approx(
            line.changes().time_s, abs=0.003
        )
    assert worst_gap(long) < 1.5


def test_a_recording_may_begin_in_the_middle_of_a_pull() -> None:
    """The crosshead starts where it was, with the pressures of then; what was before is said to be unknown."""
    bag = foreign(pulled(PULLS))
    late = {name: each.chosen(each.stamp_s > 1.7e9 + 1.5) if "data" not in each.columns else each
            for name, each in bag.topics.items()}  # fmt: skip
    recording = recording_of(Bag("late", late, bag.sheet), "tensile")
    assert recording.inputs.course.start_m == pytest.approx(PULLS.at(np.array([1.502]))[0], abs=1e-4)
    assert any("stretched by 12.1 mm as the recording begins" in note for note in recording.notes)
    simulated = SIMULATOR(recording, {})
    name = names.PRESSURES[CHANNEL].name
    assert np.abs(simulated[name] - recording.signal(name).values).max() < 500.0


def test_a_carriage_that_was_not_recorded_must_be_described() -> None:
    """Refused with the topic to record and the options that stand in for it."""
    bag = foreign(pulled(PULLS))
    blind = Bag("blind", {k: v for k, v in bag.topics.items() if k != names.JOINT_STATES.name})
    with pytest.raises(
        BadRecordingError, match=r"how the carriage of rig 'tensile' was driven; record 'carriage' .*run.yaml"
    ):
        recording_of(blind, "tensile")
    known = recording_of(blind, "tensile", {"extension_m": 0.01, "speed_m_s": 0.01})
    assert known.inputs.course is None


def test_a_crosshead_far_from_any_tendon_is_another_rig() -> None:
    """A slide 30 cm up was none; one line that names value, limit and way out."""
    bag = foreign(pulled(PULLS))
    joints = bag.topics[names.JOINT_STATES.name]
    columns = {"carriage/position": joints.columns["carriage/position"] + 0.3}
    high = {**bag.topics, names.JOINT_STATES.name: dataclasses.replace(joints, columns=columns)}
    with pytest.raises(BadRecordingError, match=r"within 0.2 m .* is at 0.316 m; name the rig .* with --rig"):
        recording_of(dataclasses.replace(bag, topics=high), "tensile")


def test_a_late_encoder_saw_the_pull_late() -> None:
    """Effects of the sensor that saw the motion change when it was: the force then comes sooner than it is read."""
    recording = recording_of(pulled(PULLS))
    nominal, late = SIMULATOR(recording, {}), SIMULATOR(recording, {"joint_delay.delay_s": 0.02})
    time_s = recording.signal("load_cell/force_z").time_s
    rising = (time_s > 1.25) & (time_s < 1.55)
    sooner = np.interp(time_s, time_s - 0.02, nominal["load_cell/force_z"])
    assert np.abs(late["load_cell/force_z"] - sooner)[rising].max() < 0.2
    assert np.array_equal(late["manifold/pressure"], nominal["manifold/pressure"])


def test_two_publishers_may_share_the_joint_states() -> None:
    """One knows the carriage, the other the ankle: what a message lacks is no missing number."""
    bag = bag_of_run(run("slip", foot="unjammed", speed_m_s=0.05))
    joints = bag.topics[names.JOINT_STATES.name]
    odd = np.arange(len(joints.stamp_s)) % 2 == 1
    lacking = {name: odd if name.startswith("carriage") else ~odd for name in joints.columns}
    shared = dataclasses.replace(joints, lacking=lacking)
    recording = recording_of(dataclasses.replace(bag, topics={**bag.topics, names.JOINT_STATES.name: shared}))
    assert recording.inputs.course is not None
    pitch = recording.signal("ankle_pitch/position")
    assert set(pitch.time_s) <= set(joints.stamp_s[odd])


TIME_S = np.arange(0.0, 8.0, 0.002)
PULLS_M = np.interp(TIME_S, [1.0, 2.0004, 3.0, 4.0, 5.0, 5.5, 6.0], [0.0, 0.02, 0.0, 0.01, 0.0, 0.02, 0.0])
"""Three pulls, of which two are as long and one is twice as fast."""
BIN = 10
"""Readings in 20 ms."""


def read(course_m: np.ndarray, noise_m: float, step_m: float, seed: int = 0) -> np.ndarray:
    """Return what a scale reads."""
    noisy = course_m + noise_m * np.random.default_rng(seed).standard_normal(len(course_m))
    return np.round(noisy / step_m) * step_m if step_m else noisy


def binned(values: np.ndarray) -> np.ndarray:
    """Return means over bins."""
    return values[: len(values) // BIN * BIN].reshape(-1, BIN).mean(axis=1)


@pytest.mark.parametrize(("noise_m", "step_m"), [(0.0, 0.0), (3e-6, 2.5e-6), (2e-5, 0.0), (0.0, 5e-5), (2e-5, 5e-5)])
def test_steady_pulls_come_out_far_below_the_noise_of_a_reading(noise_m: float, step_m: float) -> None:
    """Whatever scale: lines of a second know a place a hundred readings better, and turns stay sharp."""
    course = course_of(TIME_S, read(PULLS_M, noise_m, step_m))
    off_m = course.at(TIME_S) - PULLS_M
    assert np.sqrt(np.mean(off_m**2)) < max(0.2 * np.hypot(noise_m, step_m / np.sqrt(12.0)), 3e-6)
    assert np.abs(off_m).max() < 1e-4
    assert len(course.time_s) < 30


@pytest.mark.parametrize("noise_m", [3e-6, 2e-5])
def test_a_course_that_bends_all_the_time_is_no_worse_than_its_readings(noise_m: float) -> None:
    """A sine has no straight stretch: over 20 ms its course is about as good as the mean of the readings."""
    sine_m = 0.01 * np.sin(2.0 * np.pi * np.clip(TIME_S - 1.0, 0.0, 5.0))
    readings_m = read(sine_m, noise_m, 0.0)
    course = course_of(TIME_S, readings_m)
    off_m = binned(course.at(TIME_S) - sine_m)
    assert off_m.std() < 1.5 * binned(readings_m - sine_m).std() + 2e-6


def test_a_later_course_is_the_same_course_later() -> None:
    """Shifting the times shifts the corners; raising the readings raises them."""
    readings_m = read(PULLS_M, 2e-5, 0.0)
    course, later = course_of(TIME_S, readings_m), course_of(TIME_S + 3.0, readings_m + 0.1)
    assert later.time_s == pytest.approx(course.time_s + 3.0, abs=1e-6)
    assert later.position_m == pytest.approx(course.position_m + 0.1, abs=1e-8)


def test_the_noise_of_a_scale_is_told_from_its_readings() -> None:
    """Motion does not count, neither does a scale that only ever reads whole steps."""
    assert reading_noise_m(read(PULLS_M, 2e-5, 0.0)) == pytest.approx(2e-5, rel=0.1)
    assert reading_noise_m(read(PULLS_M, 0.0, 5e-5)) == pytest.approx(5e-5 / np.sqrt(12.0))


def test_a_carriage_that_stands_still_has_no_corners() -> None:
    """Noise makes none."""
    for seed in range(20):
        course = course_of(TIME_S, read(np.full(len(TIME_S), 0.3), 2e-5, 0.0, seed))
        assert np.ptp(course.position_m) < 1e-5


@pytest.mark.parametrize("count", [1, 2, 5, 9])
def test_a_few_readings_are_a_course(count: int) -> None:
    """However few there are."""
    course = course_of(TIME_S[:count], PULLS_M[500 : 500 + count])
    assert np.abs(course.at(TIME_S[:count]) - PULLS_M[500 : 500 + count]).max() < 1e-4
