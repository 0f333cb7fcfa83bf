"""The quadruped: weighs what it says, stands, trots on, lands, and slides where the ground lets it."""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING

import pytest

from jammkle_common.constants import STANDARD_GRAVITY_M_S2
from jammkle_common.names import CHANNELS
from jammkle_sim.robots.catalogue import robot, robot_simulation
from jammkle_sim.robots.options import RobotOptions

if TYPE_CHECKING:
    from jammkle_sim.rigs.simulation import Simulation

WEIGHT_N = 7.2 * STANDARD_GRAVITY_M_S2
STANDING_M = 0.296
"""On its toes, jammed."""
ANKLES = ("lf_ankle", "rf_ankle", "lh_ankle", "rh_ankle")


def held(options: RobotOptions) -> Simulation:
    """Return one whose ankles are jammed as in a stance, from the start: no reservoir is evacuated first."""
    simulation = robot_simulation("quadruped", dataclasses.replace(options, reservoir_volume_m3=0.0))
    for ankle in simulation.ankles.values():
        ankle.hold_vacuum(dict.fromkeys(CHANNELS, 40e3))
    return simulation


def test_it_weighs_four_times_what_the_paper_drops() -> None:
    """7.2 kg, 12 servos, four ankles of three axes each."""
    built = robot("quadruped", RobotOptions())
    assert built.model.body_mass.sum() == pytest.approx(7.2)
    assert built.model.nv == 6 + 12 + 12
    assert tuple(ankle.name for ankle in built.ankles) == ANKLES


def test_it_stands() -> None:
    """For three seconds on jammed toes: level, at its height, every foot bearing about a quarter, none sliding."""
    simulation = held(RobotOptions())
    *_, last = simulation.samples(3.0, 50)
    assert last.base_tilt_rad < 0.01
    assert last.base_position_m[2] == pytest.approx(STANDING_M, abs=0.005)
    for name in ANKLES:
        assert last.ankles[name].foot.normal_force_n == pytest.approx(WEIGHT_N / 4.0, rel=0.25)
        assert last.ankles[name].foot.sliding_distance_m < 0.004


def test_it_stands_soft() -> None:
    """Unjammed toes sink further, the hind ones most; nothing falls over."""
    *_, last = robot_simulation("quadruped", RobotOptions()).samples(3.0, 50)
    assert last.base_tilt_rad < 0.04
    assert STANDING_M - 0.02 < last.base_position_m[2] < STANDING_M - 0.005


def test_it_trots() -> None:
    """Forward at more than half its speed, level, lifting every foot, over ground with bumps too."""
    for options in (RobotOptions(behaviour="walk"), RobotOptions(behaviour="walk", roughness_m=0.01, imu="body")):
        simulation = held(options)
        samples = list(simulation.samples(3.0, 50))
        assert max(each.base_tilt_rad for each in samples) < 0.15
        assert samples[-1].base_position_m[0] > 0.5 * 0.15 * 2.0
        for name in ANKLES:
            assert not all(each.ankles[name].foot.stands for each in samples)
    imus = {each.ankles[name].imu for name in ANKLES for each in samples[-1:]}
    assert len(imus) == 1  # one on the body for all


def test_it_lands() -> None:
    """Dropped from 0.1 m it stands a second later, and its feet bear it."""
    simulation = held(RobotOptions(behaviour="drop", release_time_s=0.6, drop_height_m=0.1))
    samples = list(simulation.samples(1.9, 100))
    assert not any(each.foot.stands for each in samples[55].ankles.values())
    assert samples[-1].base_position_m[2] == pytest.approx(STANDING_M, abs=0.01)
    assert sum(each.foot.normal_force_n for each in samples[-1].ankles.values()) == pytest.approx(WEIGHT_N, rel=0.05)


def test_it_slides_down_a_slope_that_turns_slippery() -> None:
    """Every foot as far as it moves, the trunk as gravity and friction say; before, none does."""
    options = RobotOptions(behaviour="slip", slope_deg=20.0, slip_friction=0.1, slip_time_s=1.0)
    simulation = robot_simulation("quadruped", options)
    *_, settled = simulation.samples(0.7, 50)
    *_, before = simulation.samples(0.3, 50)
    toes_m = {name: simulation.data.geom(f"{name}/toe_left").xpos.copy() for name in ANKLES}
    *_, after = simulation.samples(0.4, 50)
    slope_rad = math.radians(20.0)
    for name in ANKLES:
        held_m, start_m, end_m = (each.ankles[name].foot.sliding_distance_m for each in (settled, before, after))
        assert start_m - held_m < 0.001
        assert end_m - start_m == pytest.approx(
            math.dist(simulation.data.geom(f"{name}/toe_left").xpos, toes_m[name]), rel=0.02
        )
    expected_m = STANDARD_GRAVITY_M_S2 * (math.sin(slope_rad) - 0.1 * math.cos(slope_rad)) * 0.4**2 / 2.0
    assert math.dist(after.base_position_m, before.base_position_m) == pytest.approx(expected_m, rel=0.02)
