"""The reality's rigid bodies and contacts obey mechanics, each checked against what can be said without them."""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np
import pytest

from studies.blind.reality.bodies import (
    CORNERS,
    HARD_N_M15,
    HARD_S_M,
    TENDONS,
    WOOD_N_M15,
    WOOD_S_M,
    Law,
    SquashBall,
    ankle_angles_rad,
    energy_j,
    hertz,
    still,
    turned_about_y,
)
from studies.blind.reality.legs import Stand, ankle_law, free_lengths_m, tip_law
from studies.blind.reality.machine import PLAIN, Machine
from studies.blind.reality.motion import advance, lengths_and_rates

STEP_S = 2e-5
GRAVITY = 9.80665
STAND = Stand(mass_kg=1.8, toe_m=0.06, friction=0.5, slope_rad=0.0, touch_m=0.02)
NO_PULL = np.zeros(TENDONS)


def free_of_friction(law: Law) -> Law:
    return dataclasses.replace(law, joint_static_n_m=0.0, joint_sliding_n_m=0.0, joint_viscous_n_m_s=0.0, stop_rad=3.1)


def swinging() -> Law:
    """A leg that hangs on a ball joint, with a foot on another."""
    stand = dataclasses.replace(STAND, pivot_m=0.18)
    return dataclasses.replace(free_of_friction(ankle_law(Machine(), stand)), leg_is_free=1.0)


def go(law: Law, state: object, seconds: float, *, held: bool = False) -> None:
    advance(law.packed(), state, NO_PULL, round(seconds / STEP_S), STEP_S, held, 0.0, 0.0)


def test_free_fall_is_exact() -> None:
    """A body let go falls by half g t squared, to rounding."""
    law = ankle_law(Machine(), STAND)
    state = still(1.0, 0.0, 0.3)
    go(law, state, 0.4)
    assert state["height_m"][0] == pytest.approx(1.0 - GRAVITY * 0.4**2 / 2.0, abs=1e-10)
    assert state["speed"][0][0] == pytest.approx(-GRAVITY * 0.4, abs=1e-10)


def test_tumbling_keeps_energy() -> None:
    """Leg and foot that swing and tumble without friction keep their energy to a millionth."""
    law = swinging()
    state = still(3.0, 0.1, 0.7)
    state["speed"][0] = (0.0, 0.2, 0.4, 1.0, 3.0, 5.0, 1.0)
    before = energy_j(law, state)
    go(law, state, 0.5)
    assert energy_j(law, state) == pytest.approx(before, rel=1e-6)


def test_halving_the_step_quarters_the_error() -> None:
    """The integrator is of second order where forces are smooth."""
    law = swinging()

    def swung(step_s: float) -> float:
        state = still(3.0, 0.1, 0.7)
        state["speed"][0] = (0.0, 0.2, 0.4, 1.0, 3.0, 5.0, 1.0)
        advance(law.packed(), state, NO_PULL, round(0.2 / step_s), step_s, True, 0.0, 0.0)  # noqa: FBT003  # compiled code takes no keyword
        return float(state["foot_turn"][0][0, 0])

    exact = swung(2e-5)
    coarse, fine = abs(swung(8e-4) - exact), abs(swung(4e-4) - exact)
    assert coarse / fine == pytest.approx(4.0, rel=0.15)


def test_momentum_about_the_vertical_is_kept() -> None:
    """Nothing turns a hanging leg and foot about the vertical through the pivot: that momentum stays."""
    law = swinging()
    state = still(3.0, 0.2, 0.5)
    state["speed"][0][1:] = (0.5, 0.3, 2.0, 1.0, -2.0, 4.0)

    def momentum() -> float:
        one = state[0]
        leg, foot, spin, turn = one["leg_turn"], one["foot_turn"], one["speed"][1:4], one["speed"][4:7]
        total = leg @ (law.leg_inertia_kg_m2 * (leg.T @ spin)) + foot @ (law.foot_inertia_kg_m2 * (foot.T @ turn))
        first, ankle = leg @ law.leg_centre_m, leg @ law.ankle_m
        second = ankle + foot @ law.foot_centre_m
        total += law.leg_kg * np.cross(first, np.cross(spin, first))
        total += law.foot_kg * np.cross(second, np.cross(spin, ankle) + np.cross(turn, second - ankle))
        return float(total[2])

    before = momentum()
    go(law, state, 0.4, held=True)
    assert momentum() == pytest.approx(before, rel=1e-5)


def test_pendulum_swings_with_its_period() -> None:
    """A leg with its foot fixed swings as a physical pendulum of its mass, lever and inertia."""
    law = dataclasses.replace(swinging(), foot_is_free=0.0)
    ankle = Machine().ankle
    centre = np.array(ankle.foot_centre_m) + law.ankle_m
    inertia = law.leg_inertia_kg_m2[1] + law.leg_kg * law.leg_centre_m[2] ** 2
    inertia += law.foot_inertia_kg_m2[1] + law.foot_kg * (centre @ centre)
    x, z = law.foot_kg * centre[0], law.leg_kg * law.leg_centre_m[2] + law.foot_kg * centre[2]
    rest_rad = math.atan2(x, -z)
    period_s = 2.0 * math.pi * math.sqrt(inertia / (GRAVITY * math.hypot(x, z)))
    state = still(3.0, rest_rad + 0.02, rest_rad + 0.02)
    go(law, state, period_s / 2.0, held=True)
    turn = state["leg_turn"][0]
    assert math.atan2(turn[0, 2], turn[2, 2]) - rest_rad == pytest.approx(-0.02, abs=2e-5)


def test_load_cell_bears_the_weight_of_what_hangs() -> None:
    """At rest the load cell reads the weight of leg and foot, pulled positive, and nothing sideways."""
    law = ankle_law(Machine(), STAND)
    state = still(1.0, 0.0, 0.0)
    law = dataclasses.replace(law, foot_is_free=0.0)
    go(law, state, 0.001, held=True)
    assert state["cell_n"][0] == pytest.approx([0.0, 0.0, 0.352 * GRAVITY], abs=1e-9)


def test_standing_still_the_ground_bears_the_whole_weight() -> None:
    """A foot that has come to rest is pushed up by the weight of all that stands on it."""
    law = dataclasses.replace(ankle_law(Machine(), STAND), foot_is_free=0.0)
    state = still(0.02, 0.0, 0.0)
    go(law, state, 2.0)
    assert state["ground_n"][0][:, 2].sum() == pytest.approx(1.8 * GRAVITY, rel=1e-3)
    assert abs(state["speed"][0][0]) < 1e-4


@pytest.mark.parametrize("press", [hertz(HARD_N_M15, HARD_S_M), hertz(WOOD_N_M15, WOOD_S_M), SquashBall().press()])
def test_bouncing_never_gains_height(press: object) -> None:
    """A ball bounces to less than before each time, and a light blow gives back nearly all without damping."""
    stand = dataclasses.replace(STAND, toe_m=0.02)
    law = tip_law(Machine(), stand, 0.024, 0.02, press)  # type: ignore[arg-type]  # one of the three
    state, tops, top = still(0.09, 0.0, 0.0), [0.09], 0.0
    rising = False
    for _ in range(1500):
        go(law, state, 0.0005)
        if state["speed"][0][0] > 0.0:
            rising, top = True, max(top, float(state["height_m"][0]))
        elif rising:
            tops.append(top)
            rising, top = False, 0.0
    assert len(tops) > 2
    assert all(later < before for before, later in itertools.pairwise(tops))
    # Without damping the whole height comes back.
    law, state = dataclasses.replace(law, press_damping_s_m=0.0), still(0.06, 0.0, 0.0)
    go(law, state, 0.02)
    top = 0.0
    for _ in range(400):
        go(law, state, 0.0005)
        top = max(top, float(state["height_m"][0]))
    assert top == pytest.approx(0.06, abs=2e-4)


def sliding(slope_rad: float, friction: float) -> float:
    """Speed along the slope, m/s, of a leg's foot on a slope after a while of pushing, by a free joint at the top."""
    stand = dataclasses.replace(STAND, friction=friction, slope_rad=slope_rad)
    law = dataclasses.replace(ankle_law(Machine(), stand, hertz(WOOD_N_M15, WOOD_S_M)), foot_is_free=0.0)
    state = still(PLAIN.touch_height_m(0.06, 0.0, slope_rad), 0.0, 0.0)
    go(law, state, 0.1)
    return float(state["ground_n"][0][:, 0].sum() / max(state["ground_n"][0][:, 2].sum(), 1e-9))


def test_friction_stays_within_its_cone() -> None:
    """What the ground holds along itself never exceeds the static friction's share of what it bears."""
    assert abs(sliding(0.3, 0.2)) <= 0.2 * 1.06 + 1e-9


def test_friction_holds_what_is_within_its_cone() -> None:
    """A foot whose rail lets it only go down is held on a gentle slope: the ground pushes straight up."""
    law = dataclasses.replace(
        ankle_law(Machine(), dataclasses.replace(STAND, friction=0.9, slope_rad=0.3), hertz(WOOD_N_M15, WOOD_S_M)),
        foot_is_free=0.0,
    )
    state = still(PLAIN.touch_height_m(0.06, 0.0, 0.3), 0.0, 0.0)
    go(law, state, 1.5)
    assert abs(state["speed"][0][0]) < 1e-4


def test_joint_friction_stops_a_spinning_foot() -> None:
    """A foot that spins on a rubbing joint loses its energy of turning, bent bristles counted, and never gains any."""
    law = dataclasses.replace(ankle_law(Machine(), STAND), gravity_m_s2=0.0, joint_static_n_m=0.03)
    law = dataclasses.replace(law, joint_sliding_n_m=0.02)
    state = still(1.0, 0.0, 0.0)
    state["speed"][0][4:] = (1.0, 4.0, 2.0)
    energies = []
    for _ in range(40):
        bent = state["joint_bristle_rad"][0]
        energies.append(energy_j(law, state) + law.joint_bristle_n_m_rad * float(bent @ bent) / 2.0)
        go(law, state, 0.002, held=True)
    assert all(later <= before + 1e-9 for before, later in itertools.pairwise(energies))
    assert energies[-1] < 1e-2 * energies[0]


def test_tendon_lengths_grow_as_geometry_says() -> None:
    """Toe down, the Achilles tendons grow by about lever times angle, the others shrink, and rates are their slopes."""
    law, ankle = ankle_law(Machine(), STAND), Machine().ankle
    length_m, rate_m_s = np.zeros(TENDONS), np.zeros(TENDONS)
    state = still(1.0, 0.0, 0.0)
    state["speed"][0][5] = -1.0
    lengths_and_rates(law.packed(), state, length_m, rate_m_s)
    assert length_m == pytest.approx([ankle.tendon_length_m] * TENDONS)
    assert rate_m_s[2:] == pytest.approx([ankle.achilles_arm_m] * 2)
    assert rate_m_s[:2] == pytest.approx([-ankle.peroneal_forward_m] * 2)
    free_m = free_lengths_m(ankle, 0.4, 0.001)
    lengths_and_rates(law.packed(), still(1.0, 0.0, 0.4), length_m, rate_m_s)
    assert (length_m - free_m)[2:] == pytest.approx([0.001, 0.001], abs=1e-12)


def test_angles_are_read_as_they_were_turned() -> None:
    """Pitch, then roll, then yaw come back from the matrices."""
    roll, pitch, yaw = 0.2, -0.5, 0.3
    about_x = np.array([[1, 0, 0], [0, math.cos(roll), -math.sin(roll)], [0, math.sin(roll), math.cos(roll)]])
    about_z = np.array([[math.cos(yaw), -math.sin(yaw), 0], [math.sin(yaw), math.cos(yaw), 0], [0, 0, 1]])
    leg = turned_about_y(0.1)
    foot = leg @ turned_about_y(pitch) @ about_x @ about_z
    assert ankle_angles_rad(leg[None], foot[None])[0] == pytest.approx([roll, pitch, yaw])


def test_mat_gives_by_its_compliance() -> None:
    """On a mat a standing foot is lower by the mat's compliance times its share of the load."""
    heights = []
    for give in (0.0, 1e-4):
        machine = dataclasses.replace(Machine(), leg=dataclasses.replace(PLAIN, mat_m_n=give))
        law = dataclasses.replace(ankle_law(machine, STAND), foot_is_free=0.0)
        state = still(0.02, 0.0, 0.0)
        go(law, state, 2.0)
        heights.append(float(state["height_m"][0]))
    assert heights[0] - heights[1] == pytest.approx(1e-4 * 1.8 * GRAVITY / CORNERS, rel=0.02)
