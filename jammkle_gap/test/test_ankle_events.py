"""Releases, touch-downs and slides: when they happen, by whatever sensor, and how often in a bag."""

from __future__ import annotations

import dataclasses
from functools import lru_cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation  # type: ignore[import-untyped]  # carries no types

from jammkle_common import names
from jammkle_common.constants import STANDARD_GRAVITY_M_S2
from jammkle_gap.ankle.alignment import (
    BREAKAWAY,
    REBOUND,
    SLIDE_ONSET,
    TOUCH_DOWN,
    AnkleAlignment,
    falls_of_imu,
    falls_of_slide,
    jolt_s,
    onset_s,
    touch_downs_s,
)
from jammkle_gap.ankle.bag import Bag, Samples
from jammkle_gap.ankle.recording import bag_of_run, recording_of, recordings_of
from jammkle_gap.ankle.repeats import with_settings
from jammkle_gap.ankle.sensors import SensorSet, selected
from jammkle_gap.core.data import BadRecordingError, Recording
from recorded import SIMULATOR, run

RELEASE_S = 1.0
FALL_S = float(np.sqrt(2.0 * 0.05 / STANDARD_GRAVITY_M_S2))
"""Fall of 50 mm; the foot turns a little on the way, which moves its lowest point by half a millimetre."""
DROPS = (("drop", {"foot": "jammed"}), ("drop", {"foot": "unjammed"}), ("landing", {}), ("landing", {"jam": "before"}))
FORCES = ("specific_force_x", "specific_force_y", "specific_force_z")


@lru_cache(maxsize=8)
def imu_of(case: int) -> tuple[np.ndarray, np.ndarray]:
    """Return times and specific force of a run."""
    rig, options = DROPS[case]
    samples = bag_of_run(run(rig, **options)).topics["imu/data"]
    return samples.stamp_s, np.column_stack([samples.columns[name] for name in FORCES])


def worn(force: np.ndarray, seed: int, noise: float, bias: float, turn_deg: float, limit: float) -> np.ndarray:
    """Return what a poor, badly mounted accelerometer reads."""
    draw = np.random.default_rng(seed)
    axis, offset = draw.standard_normal((2, 3))
    turned = Rotation.from_rotvec(np.radians(turn_deg) * axis / np.linalg.norm(axis)).apply(force)
    read = turned + bias * offset / np.linalg.norm(offset) + noise * draw.standard_normal(force.shape)
    return np.clip(read, -limit, limit)


@pytest.mark.parametrize("case", range(len(DROPS)))
def test_a_fall_is_seen_by_imu_and_slide(case: int) -> None:
    """Both see release and touch-down where they are, within two samples."""
    rig, options = DROPS[case]
    joints = bag_of_run(run(rig, **options)).topics["joint_states"]
    for falls in (falls_of_imu(*imu_of(case)), falls_of_slide(joints.stamp_s, joints.columns["carriage/position"])):
        assert len(falls) == 1
        assert falls[0].release_s == pytest.approx(RELEASE_S, abs=0.0015)
        assert falls[0].touch_down_s == pytest.approx(RELEASE_S + FALL_S, abs=0.0025)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, len(DROPS) - 1), st.integers(0, 10_000), st.sampled_from([1, 2, 5, 10]))
def test_a_poor_imu_sees_the_touch_down_to_its_sample(case: int, seed: int, every: int) -> None:
    """Noise of 0.5 m/s^2, an offset of 3, mounted 20 degrees askew, clipped at 1 g, at 1 kHz to 100 Hz."""
    time_s, force = imu_of(case)
    begin = seed % every
    read = worn(force, seed, 0.5, 3.0, 20.0, STANDARD_GRAVITY_M_S2)[begin::every]
    found_s = falls_of_imu(time_s[begin::every], read)[0].touch_down_s
    assert found_s is not None
    # A weak first touch may lie between two samples of 10 ms: the next one then shows it.
    assert found_s == pytest.approx(falls_of_imu(time_s, force)[0].touch_down_s, abs=0.001 * (1.2 * every + 0.5))


@settings(max_examples=20, deadline=None)
@given(st.integers(0, len(DROPS) - 1), st.floats(-50.0, 1e4))
def test_events_move_with_the_clock(case: int, later_s: float) -> None:
    """Shifting the time of a run shifts what is found by as much."""
    time_s, force = imu_of(case)
    here, there = falls_of_imu(time_s, force)[0], falls_of_imu(time_s + later_s, force)[0]
    for here_s, there_s in ((here.touch_down_s, there.touch_down_s), (here.release_s, there.release_s)):
        assert here_s is not None
        assert there_s == pytest.approx(here_s + later_s, abs=1e-6)


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 10_000), st.floats(0.0, 1.0), st.sampled_from([100.0, 500.0, 1000.0]))
def test_nothing_happens_in_noise(seed: int, noise: float, rate_hz: float) -> None:
    """An IMU at rest, however noisy, a slide, a load cell and angles at rest show no event."""
    time_s = np.arange(0.0, 3.0, 1.0 / rate_hz)
    still = np.tile([0.0, 0.0, STANDARD_GRAVITY_M_S2], (len(time_s), 1))
    assert falls_of_imu(time_s, worn(still, seed, noise, 3.0, 20.0, 80.0)) == ()
    draw = np.random.default_rng(seed)
    assert falls_of_slide(time_s, 0.3 + 2e-5 * draw.standard_normal(len(time_s))) == ()
    quiet = 5.0 + noise * draw.standard_normal((len(time_s), 3))
    assert onset_s(time_s, quiet) is None
    assert jolt_s(time_s, quiet) is None


def test_flights_after_a_bounce_are_no_releases() -> None:
    """A rigid foot bounces: its leg is as light in the air as in the fall, but was not held before."""
    samples = bag_of_run(run("drop", foot="rigid_ankle")).topics["imu/data"]
    force = np.column_stack([samples.columns[name] for name in FORCES])
    light = np.linalg.norm(force, axis=1) < 1.0
    assert light[samples.stamp_s > 1.11].sum() > 50
    assert len(falls_of_imu(samples.stamp_s, force)) == 1


def test_every_touch_down_of_a_bouncing_leg_is_found() -> None:
    """The times at which a rigid foot's force jumps, as its slide has it lowest."""
    bag = bag_of_run(run("drop", foot="rigid_ankle"))
    samples, joints = bag.topics["imu/data"], bag.topics["joint_states"]
    force = np.column_stack([samples.columns[name] for name in FORCES])
    found = touch_downs_s(samples.stamp_s, force)
    height = joints.columns["carriage/position"]
    lowest = (height[1:-1] < height[:-2]) & (height[1:-1] <= height[2:]) & (height[1:-1] < height.min() + 0.003)
    bottoms_s = joints.stamp_s[1:-1][lowest & (joints.stamp_s[1:-1] < 1.2)]
    assert len(bottoms_s) == 2
    for touched_s, bottom_s in zip(found, bottoms_s, strict=False):
        assert 0.0 < bottom_s - touched_s < 0.008
    assert falls_of_imu(samples.stamp_s, force)[0].touch_down_s == found[0]
    still = np.tile(force[0], (len(force), 1))
    assert touch_downs_s(samples.stamp_s, still) == ()


def test_a_hand_that_lowers_a_leg_is_no_release() -> None:
    """At a third of gravity, or for a moment only."""
    time_s = np.arange(0.0, 2.0, 0.001)
    for lighter, lasts_s in ((3.2, 0.3), (9.8, 0.02)):
        force = np.tile([0.0, 0.0, STANDARD_GRAVITY_M_S2], (len(time_s), 1))
        force[(time_s > 1.0) & (time_s < 1.0 + lasts_s), 2] -= lighter
        assert falls_of_imu(time_s, force) == ()


def test_a_fall_at_an_end_of_the_readings_is_half_known() -> None:
    """Begun before the first: no release. Not over at the last: no touch-down."""
    time_s, force = imu_of(0)
    at_rest = np.tile(force[:200].mean(axis=0), (3000, 1))
    cut = time_s < RELEASE_S + 0.08
    (unfinished,) = falls_of_imu(time_s[cut], force[cut])
    assert unfinished.touch_down_s is None
    assert unfinished.release_s == pytest.approx(RELEASE_S, abs=0.0015)
    late = (time_s > RELEASE_S + 0.03) & (time_s < RELEASE_S + 0.15)
    begun_s = np.concatenate((time_s[late], 1.15 + 0.001 * np.arange(1, 3001)))
    (begun,) = falls_of_imu(begun_s, np.concatenate((force[late], at_rest)))
    assert begun.release_s is None
    assert begun.touch_down_s == pytest.approx(RELEASE_S + FALL_S, abs=0.0025)
    assert falls_of_imu(time_s[:1], force[:1]) == ()
    assert falls_of_slide(time_s[:3], force[:3, 2]) == ()


@pytest.mark.parametrize("speed_m_s", [0.01, 0.05])
def test_a_slip_test_touches_and_slides(speed_m_s: float) -> None:
    """First contact comes a millimetre of clearance after the start, in force and angle; the slide is a jolt."""
    recording = recording_of(bag_of_run(run("slip", foot="jammed", speed_m_s=speed_m_s)))
    found = AnkleAlignment().events(recording, {each.name: each.values for each in recording.signals})
    touch_s = 1.0 + 0.001 / speed_m_s
    assert found[TOUCH_DOWN] == pytest.approx(touch_s, abs=0.06)
    force = recording.signal("load_cell/force_z")
    jump = np.abs(np.diff(force.values))[force.time_s[1:] > touch_s + 0.3]
    after_s = force.time_s[1:][force.time_s[1:] > touch_s + 0.3]
    assert found[SLIDE_ONSET] == pytest.approx(after_s[int(np.argmax(jump > 10.0))], abs=0.02)
    pitch = recording.signal("ankle_pitch/position")
    fastest_s = pitch.time_s[int(np.argmax(np.gradient(pitch.values, pitch.time_s)))]
    assert found[BREAKAWAY] == pytest.approx(fastest_s, abs=0.08)
    assert found[BREAKAWAY] > found[SLIDE_ONSET]
    robot = selected(recording, SensorSet.ROBOT)
    by_angles = AnkleAlignment().events(robot, {each.name: each.values for each in robot.signals})
    assert by_angles[TOUCH_DOWN] == pytest.approx(touch_s, abs=0.1)
    assert by_angles[BREAKAWAY] == found[BREAKAWAY]
    assert SLIDE_ONSET not in by_angles


@pytest.mark.parametrize("case", range(len(DROPS)))
def test_measured_and_simulated_runs_meet_at_the_touch_down(case: int) -> None:
    """The same function of either: without noise and gap the event is the same to a tenth of a sample."""
    rig, options = DROPS[case]
    recording = recording_of(bag_of_run(run(rig, **options)))
    alignment, simulated = AnkleAlignment(), SIMULATOR(recording, {})
    measured = alignment.events(recording, {each.name: each.values for each in recording.signals})
    assert alignment.events(recording, simulated)[TOUCH_DOWN] == pytest.approx(measured[TOUCH_DOWN], abs=1e-4)
    higher = SIMULATOR(recording, {"run_height.extra_m": 0.005})
    later_s = np.sqrt(2.0 * 0.055 / STANDARD_GRAVITY_M_S2) - FALL_S
    moved_s = alignment.events(recording, higher)[TOUCH_DOWN] - measured[TOUCH_DOWN]
    assert moved_s == pytest.approx(later_s, abs=0.0006)


def test_a_slow_imu_leaves_the_touch_down_to_a_faster_carriage() -> None:
    """At 100 Hz a blow may lie between two samples."""
    recording = recording_of(bag_of_run(run("drop", foot="rigid_ankle")))
    thin = tuple(
        dataclasses.replace(each, time_s=each.time_s[5::10], values=each.values[5::10])
        if each.name.startswith("imu/")
        else each
        for each in recording.signals
    )
    slow = dataclasses.replace(recording, signals=thin)
    values = {each.name: each.values for each in slow.signals}
    assert AnkleAlignment().events(slow, values)[TOUCH_DOWN] == pytest.approx(RELEASE_S + FALL_S, abs=0.002)


@pytest.mark.parametrize("left", [("imu/",), ("imu/", "carriage/")])
def test_without_an_imu_other_sensors_see_the_touch_down(left: tuple[str, ...]) -> None:
    """The carriage, or without it the ankle that begins to turn."""
    recording = recording_of(bag_of_run(run("drop", foot="unjammed")))
    values = {each.name: each.values for each in recording.signals if not each.name.startswith(left)}
    assert AnkleAlignment().events(recording, values)[TOUCH_DOWN] == pytest.approx(RELEASE_S + FALL_S, abs=0.004)


def test_what_is_registered_at_which_event() -> None:
    """Bodies at their contacts, air at its commands; rigs without contact at none."""
    alignment, drop = AnkleAlignment(), recording_of(bag_of_run(run("drop", foot="unjammed")))
    assert alignment.events_of(drop, "imu/specific_force_z") == (TOUCH_DOWN, REBOUND)
    assert alignment.events_of(drop, "achilles/pressure") == ()
    slip = recording_of(bag_of_run(run("slip", foot="jammed", speed_m_s=0.05)))
    assert alignment.events_of(slip, "load_cell/force_z") == (TOUCH_DOWN, BREAKAWAY)
    assert alignment.events_of(slip, "imu/specific_force_z") == ()
    pull = recording_of(bag_of_run(run("tensile", vacuum_pa=50e3, speed_m_s=0.02)))
    assert alignment.events_of(pull, "load_cell/force_z") == ()
    assert alignment.events(pull, {each.name: each.values for each in pull.signals}) == {}


COMMANDS = (names.PUMP_DUTY.name, *(topic.name for topic in names.SOLENOIDS.values()))
LIFT_S = 1.0


@lru_cache(maxsize=8)
def one(rig: str, height_m: float, **options: object) -> Bag:
    """Return one run as somebody else's recorder has it: standard types, no run sheet."""
    bag = bag_of_run(run(rig, drop_height_m=height_m, **options))
    topics = {name: each for name, each in bag.topics.items() if name != names.TENDON_STATES.name}
    return Bag(rig, topics)


def in_a_row(bags: list[Bag], begin_s: float = 100.0) -> Bag:
    """Join runs to one bag: between two of them a hand lifts the leg back to where it hung."""
    topics: dict[str, list[Samples]] = {}
    for place, bag in enumerate(bags):
        end_s = max(float(each.stamp_s[-1]) for each in bag.topics.values())
        for name, each in bag.topics.items():
            parts = topics.setdefault(name, [])
            parts.append(Samples(each.log_s + begin_s, each.stamp_s + begin_s, each.columns))
            if name not in COMMANDS and place + 1 < len(bags):
                following = bags[place + 1].topics[name].columns
                count = round(LIFT_S * len(each.stamp_s) / end_s)
                time_s = begin_s + end_s + LIFT_S * (np.arange(count) + 0.5) / count
                ways = {key: np.linspace(values[-1], following[key][0], count) for key, values in each.columns.items()}
                parts.append(Samples(time_s, time_s, ways))
        begin_s += end_s + LIFT_S
    return Bag("row", {name: joined(parts) for name, parts in topics.items()})


def joined(parts: list[Samples]) -> Samples:
    """Return samples one after the other."""
    columns = {name: np.concatenate([part.columns[name] for part in parts]) for name in parts[0].columns}
    times = [np.concatenate([getattr(part, clock) for part in parts]) for clock in ("log_s", "stamp_s")]
    return Samples(*times, columns)


def without(bag: Bag, *topics: str) -> Bag:
    """Return a bag without some topics."""
    return dataclasses.replace(bag, topics={k: v for k, v in bag.topics.items() if k not in topics})


def apart(recording: Recording, name: str, from_s: float, to_s: float) -> float:
    """Largest difference of measured and simulated within a stretch, aligned at the touch-down."""
    alignment, simulated = AnkleAlignment(), SIMULATOR(recording, {})
    measured = {each.name: each.values for each in recording.signals}
    late_s = alignment.events(recording, simulated)[TOUCH_DOWN] - alignment.events(recording, measured)[TOUCH_DOWN]
    signal = recording.signal(name)
    inside = (signal.time_s > from_s) & (signal.time_s < to_s)
    return float(
        np.abs(np.interp(signal.time_s + late_s, signal.time_s, simulated[name]) - signal.values)[inside].max()
    )


@pytest.mark.parametrize("rig", ["drop", "landing"])
@pytest.mark.parametrize("left", [(), (names.IMU.name,), (names.JOINT_STATES.name, names.LOAD_CELL.name)])
def test_the_release_is_the_recordings_and_the_height_that_of_the_run_sheet(rig: str, left: tuple[str, ...]) -> None:
    """Whoever saw the release, carriage or IMU: to 2 ms."""
    recording = recording_of(without(one(rig, 0.08), *left), rig, {"drop_height_m": 0.08})
    assert recording.inputs.release_s == pytest.approx(1.0, abs=0.002)
    seen_by = names.IMU.name if names.JOINT_STATES.name in left else names.JOINT_STATES.name
    assert recording.inputs.release_seen_by == seen_by
    assert dict(recording.inputs.options)["drop_height_m"] == 0.08
    if not left:  # aligned at the touch-down, carriage and angle agree to a millimetre and 1.5 degrees
        assert apart(recording, "carriage/position", 0.0, 1.2) < 1e-3
        assert apart(recording, "ankle_pitch/position", 0.0, 1.2) < np.radians(1.5)


HEIGHTS_M = (0.05, 0.03, 0.08)


@pytest.mark.parametrize("left", [(), (names.IMU.name,), (names.JOINT_STATES.name,)])
def test_every_release_of_a_bag_is_a_recording(left: tuple[str, ...]) -> None:
    """Three drops in one bag, lifted by hand between: one recording each, with its own start."""
    row = without(in_a_row([one("drop", height_m) for height_m in HEIGHTS_M]), *left)
    found = recordings_of(row, "drop")
    assert [each.name for each in found] == ["row#1", "row#2", "row#3"]
    for recording in found:
        assert recording.inputs.release_s == pytest.approx(1.0, abs=0.002)
        end_s = max(float(each.time_s[-1]) for each in recording.signals)
        assert 2.0 < end_s < 2.5 + LIFT_S
        assert min(float(each.time_s[0]) for each in recording.signals) >= 0.0
    with pytest.raises(BadRecordingError, match="holds 3 runs"):
        recording_of(row, "drop")


def test_a_run_of_several_is_simulated_as_when_it_is_alone() -> None:
    """The hand that lifts the leg afterwards is no part of it; neither is what was before."""
    row = recordings_of(in_a_row([one("drop", 0.05), one("drop", 0.05)]), "drop")
    assert len({each.setting for each in with_settings(row)}) == 1
    for recording in row:
        assert apart(recording, "carriage/position", 0.0, 2.4) < 0.001
        slide = recording.signal("carriage/position")
        assert slide.values[-1] < slide.values[0] - 0.02


def test_a_jammed_run_after_another_begins_with_its_own_pressures() -> None:
    """Vacuum that stands as a run begins is measured; what was commanded before holds."""
    jammed = one("drop", 0.05, foot="jammed")
    late = {
        name: each.chosen(each.stamp_s > 0.6) if name not in COMMANDS else each for name, each in jammed.topics.items()
    }
    recording = recording_of(Bag("late", late), "drop")
    assert recording.inputs.start_pa is not None
    name = names.PRESSURES[names.ACHILLES].name
    assert apart(recording, name, 0.0, 2.5) < 2e3


def cut(bag: Bag, from_s: float, to_s: float) -> Bag:
    """Leave out what was measured before and after; commands stay."""
    topics = {
        name: each if name in COMMANDS else each.chosen((each.stamp_s >= from_s) & (each.stamp_s <= to_s))
        for name, each in bag.topics.items()
    }
    return dataclasses.replace(bag, topics=topics)


def test_runs_that_are_cut_short_are_left_out_and_said() -> None:
    """The others stay; if none is long enough the bag is refused."""
    short = cut(one("drop", 0.05), 0.0, 1.65)
    row = cut(in_a_row([short, one("drop", 0.05)]), 100.9, np.inf)
    (left,) = recordings_of(row, "drop")
    assert left.name == "row#2"
    assert "1 of 2 runs left out as too short" in left.notes
    with pytest.raises(BadRecordingError, match=r"lasts 0\.7 s, too short"):
        recordings_of(cut(one("drop", 0.05), 0.95, 1.65), "drop")


def test_a_bag_in_which_nothing_falls_is_refused() -> None:
    """One line that names what was looked for and the way out."""
    bag = one("drop", 0.05)
    held = {
        name: each.chosen(each.stamp_s < 0.99) if name not in COMMANDS else each for name, each in bag.topics.items()
    }
    longer = in_a_row([Bag("held", held)] * 2)
    with pytest.raises(
        BadRecordingError, match=r"holds no release: neither carriage nor imu/data .* or name another rig"
    ):
        recordings_of(longer, "drop")


def test_a_late_sensor_saw_the_release_late() -> None:
    """With its delay as an effect the leg is let go earlier, and other sensors see it so."""
    recording = recording_of(without(one("drop", 0.05), names.LOAD_CELL.name), "drop")
    nominal, late = (SIMULATOR(recording, values) for values in ({}, {"joint_delay.delay_s": 0.01}))
    alignment = AnkleAlignment()
    sooner_s = alignment.events(recording, nominal)[TOUCH_DOWN] - alignment.events(recording, late)[TOUCH_DOWN]
    assert sooner_s == pytest.approx(0.01, abs=2e-4)
    slide = recording.signal("carriage/position")
    falling = (slide.time_s > 1.0) & (slide.time_s < 1.1)
    assert np.abs(nominal[slide.name] - late[slide.name])[falling].max() < 1e-5


def test_a_start_that_scatters_moves_a_release_that_was_seen() -> None:
    """By as much, while commands and pressures stay where they were."""
    recording = recording_of(one("landing", 0.05), "landing")
    nominal, later = (SIMULATOR(recording, values) for values in ({}, {"run_start.late_s": 0.004}))
    alignment = AnkleAlignment()
    moved_s = alignment.events(recording, later)[TOUCH_DOWN] - alignment.events(recording, nominal)[TOUCH_DOWN]
    assert moved_s == pytest.approx(0.004, abs=2e-4)
    pressure = recording.signal("manifold/pressure")
    assert np.abs(later[pressure.name] - nominal[pressure.name]).max() < pressure.noise
