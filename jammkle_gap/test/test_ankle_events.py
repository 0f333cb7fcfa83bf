"""When contacts happen: release, touch-down, first contact and the onset of a slide."""

from __future__ import annotations

import dataclasses
from functools import lru_cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation  # type: ignore[import-untyped]  # carries no types

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
    release_s,
    touch_down_s,
    touch_downs_s,
)
from jammkle_gap.ankle.recording import bag_of_run, recording_of
from jammkle_gap.ankle.sensors import SensorSet, selected
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
    found_s = touch_down_s(time_s[begin::every], read)
    assert found_s is not None
    # A weak first touch may lie between two samples of 10 ms: the next one then shows it.
    assert found_s == pytest.approx(touch_down_s(time_s, force), abs=0.001 * (1.2 * every + 0.5))


@settings(max_examples=20, deadline=None)
@given(st.integers(0, len(DROPS) - 1), st.floats(-50.0, 1e4))
def test_events_move_with_the_clock(case: int, later_s: float) -> None:
    """Shifting the time of a run shifts what is found by as much."""
    time_s, force = imu_of(case)
    for event in (touch_down_s, release_s):
        here_s, there_s = event(time_s, force), event(time_s + later_s, force)
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
    assert touch_down_s(samples.stamp_s, force) == found[0]
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
