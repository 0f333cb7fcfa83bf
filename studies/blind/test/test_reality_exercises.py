"""Exercises of the second simulator: what its IMU feels, that its foot hangs as on the pressure rig, and faults."""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING

import numpy as np
import pytest

from jammkle_common import names
from jammkle_common.constants import STANDARD_GRAVITY_M_S2
from studies.blind.reality.faults import FaultSetting
from studies.blind.reality.machine import STILL, Machine
from studies.blind.reality.run import run
from studies.blind.reality.sensors import BadPlanError, Plan

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from studies.blind.reality.sensors import RealRun

EXERCISES = ("cycle", "press", "shake", "tilt")


def done(
    rig: str, *faults: FaultSetting, seed: int = STILL, machine: Machine | None = None, **options: float
) -> RealRun:
    return run(Plan(rig, options), machine or Machine(), faults, seed)


def joint(found: RealRun, name: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    track = found.topics[names.JOINT_STATES.name]
    return track.stamp_s, track.values[:, track.columns.index(f"{name}.position")]


@pytest.mark.parametrize("rig", EXERCISES)
def test_the_same_seed_gives_the_same_bits_and_another_does_not(rig: str) -> None:
    first, same, other = (done(rig, seed=seed) for seed in (3, 3, 4))
    for name, track in first.topics.items():
        assert np.array_equal(track.values, same.topics[name].values)
    imu = names.IMU.name
    assert not np.array_equal(first.topics[imu].values[:100], other.topics[imu].values[:100])


def test_a_tilted_imu_feels_gravity_turned() -> None:
    """In the second pose the shank is pitched toe-down: what was up lies behind."""
    tilt_deg, imu = 30.0, done("tilt", tilt_deg=30.0, hold_s=2.0).topics[names.IMU.name]
    held = (imu.stamp_s > 4.0) & (imu.stamp_s < 5.0)  # 0.6 s and 2 s upright, 0.6 s on the way
    force = imu.values[held, :3].mean(axis=0)
    wanted = STANDARD_GRAVITY_M_S2 * np.array(
        [-math.sin(math.radians(tilt_deg)), 0.0, math.cos(math.radians(tilt_deg))]
    )
    assert force == pytest.approx(wanted, abs=0.1)


def test_the_angular_rate_adds_up_to_the_tilt() -> None:
    imu = done("tilt", tilt_deg=30.0, hold_s=1.0).topics[names.IMU.name]
    turning = (imu.stamp_s > 1.0) & (imu.stamp_s < 2.6)
    turned_rad = float(np.trapezoid(imu.values[turning, 4], imu.stamp_s[turning]))
    assert turned_rad == pytest.approx(math.radians(30.0), abs=0.01)


def test_a_foot_hangs_as_on_the_pressure_rig() -> None:
    """Other equations of the same foot: angles of a rotation against angles of an axis each."""
    guided = joint(done("cycle", vacuum_pa=50e3), "ankle_pitch")[1]
    hanging = joint(done("pressure", vacuum_pa=50e3), "ankle_pitch")[1]
    assert guided[:50].mean() == pytest.approx(hanging[:50].mean(), abs=0.002)


def test_a_jammed_ankle_gives_less_when_pressed() -> None:
    time_s, pitch_rad = joint(done("press", vacuum_pa=50e3), "ankle_pitch")
    half_s = float(time_s[-1]) / 2.0
    assert np.ptp(pitch_rad[time_s > half_s + 1.0]) < np.ptp(pitch_rad[time_s < half_s])


def test_friction_in_the_joint_takes_from_the_swing_of_a_shaken_foot() -> None:
    grit = FaultSetting("gritty_joint", {"dry_n_m": 0.02})
    plain, gritty = (np.ptp(joint(each, "ankle_yaw")[1]) for each in (done("shake"), done("shake", grit)))
    assert gritty < 0.8 * plain


def test_a_heavier_foot_sags_further_when_tilted() -> None:
    machine = Machine()
    heavier = dataclasses.replace(machine, ankle=dataclasses.replace(machine.ankle, foot_kg=0.24))
    plain, heavy = (np.ptp(joint(done("tilt", machine=each), "ankle_roll")[1]) for each in (machine, heavier))
    assert heavy > 1.2 * plain


def test_a_press_that_would_stand_flat_is_refused() -> None:
    with pytest.raises(BadPlanError, match="turn_deg"):
        done("press", tilt_deg=8.0, turn_deg=9.0)
