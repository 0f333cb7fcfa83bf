"""Equations of motion of `bodies`: Newton and Euler in space, written out for carriage, leg and foot.

Seven speeds describe all that the joints allow; joints that are locked leave the equations, so nothing drifts. The
integrator kicks, drifts and kicks: exact in free fall and of second order in all else. Corners press by Hunt and
Crossley and rub by LuGre.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from studies.blind.reality.bodies import CORNERS, FOOT, LEG, SPEEDS, TENDONS
from studies.blind.reality.compiled import compiled
from studies.blind.reality.inertia import solve
from studies.blind.reality.loads import gather
from studies.blind.reality.vectors import Vector, cross, dot, less, plus, row, scaled, turn, turned, vector

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


@compiled
def advance(
    laws: NDArray[Any],
    states: NDArray[Any],
    pull_n: NDArray[np.float64],
    steps: int,
    step_s: float,
    is_held: bool,  # noqa: FBT001  # numba takes no keyword
    drive_m: float,
    drive_m_s: float,
) -> None:
    """Advance one machine.

    Args:
        laws: `Law.packed`.
        states: Changed, shape (1,) of STATE.
        pull_n: Of each tendon, the same through all steps, shape (TENDONS,).
        steps: How many.
        step_s: Length of each.
        is_held: The carriage does not move.
        drive_m: Where the spindle is at the start, if there is one.
        drive_m_s: Its speed.

    """
    law, state = laws[0], states[0]
    active = _find_active(law, state, is_held)
    for i in range(3):
        state.cell_n[i] = 0.0
    free = -1.0 if is_held else 1.0
    if state.freedom != free:  # what is let go accelerates from the first moment
        state.freedom = free
        gather(law, state, pull_n, step_s, drive_m, drive_m_s)
        solve(law, state, active)
    for step in range(steps):
        for i in range(SPEEDS):
            state.speed[i] += state.change[i] * step_s / 2.0
        _drift(state, step_s)
        for i in range(SPEEDS):  # what depends on speed looks at the end of the step
            state.speed[i] += state.change[i] * step_s / 2.0
        at_m = drive_m + drive_m_s * step_s * (step + 1)
        ground = gather(law, state, pull_n, step_s, at_m, drive_m_s)
        for i in range(SPEEDS):
            state.speed[i] -= state.change[i] * step_s / 2.0
        solve(law, state, active)
        for i in range(SPEEDS):
            state.speed[i] += state.change[i] * step_s / 2.0
        _weigh(law, state, ground, steps)


@compiled
def lengths_and_rates(
    laws: NDArray[Any],
    states: NDArray[Any],
    length_m: NDArray[np.float64],
    rate_m_s: NDArray[np.float64],
) -> None:
    """Write length and rate of every tendon from seat to seat, each of shape (TENDONS,)."""
    law, state = laws[0], states[0]
    leg_spin = vector(state.speed, LEG)
    foot_spin = vector(state.speed, FOOT)
    for i in range(TENDONS):
        up = turned(state.leg_turn, row(law.seat_leg_m, i))
        down = turned(state.foot_turn, row(law.seat_foot_m, i))
        way = less(up, down)
        length_m[i] = math.sqrt(dot(way, way))
        rate_m_s[i] = dot(way, less(cross(leg_spin, up), cross(foot_spin, down))) / length_m[i]


@compiled
def _find_active(law: Any, state: Any, is_held: bool) -> int:  # noqa: FBT001  # as above
    count = 0
    for i in range(SPEEDS):
        free = (
            (i == 0 and not is_held)
            or (LEG <= i < FOOT and law.leg_is_free > 0.0)
            or (i >= FOOT and law.foot_is_free > 0.0)
        )
        if free:
            state.active[count] = i
            count += 1
    return count


@compiled
def _drift(state: Any, step_s: float) -> None:
    state.height_m += state.speed[0] * step_s
    turn(state.leg_turn, vector(state.speed, LEG), step_s)
    turn(state.foot_turn, vector(state.speed, FOOT), step_s)
    state.plate_m += state.plate_m_s * step_s
    for i in range(CORNERS):
        state.mat_m[i] = max(state.mat_m[i] + state.mat_m_s[i] * step_s, 0.0)


@compiled
def _weigh(law: Any, state: Any, ground: Vector, steps: int) -> None:
    """Add to the mean of what the load cell bears: mass times acceleration of all below it, less gravity and ground."""
    leg_spin, foot_spin = vector(state.speed, LEG), vector(state.speed, FOOT)
    leg_change, foot_change = vector(state.change, LEG), vector(state.change, FOOT)
    to_ankle = turned(state.leg_turn, (law.ankle_m[0], law.ankle_m[1], law.ankle_m[2]))
    to_leg = turned(state.leg_turn, (law.leg_centre_m[0], law.leg_centre_m[1], law.leg_centre_m[2]))
    to_foot = turned(state.foot_turn, (law.foot_centre_m[0], law.foot_centre_m[1], law.foot_centre_m[2]))
    up = (0.0, 0.0, state.change[0] + law.gravity_m_s2)
    leg = plus(up, _carried(leg_spin, leg_change, to_leg))
    foot = plus(up, plus(_carried(leg_spin, leg_change, to_ankle), _carried(foot_spin, foot_change, to_foot)))
    total = plus(scaled(leg, law.leg_kg), plus(scaled(foot, law.foot_kg), scaled(up, law.cell_kg)))
    total = less(total, ground)
    for i in range(3):
        state.cell_n[i] += total[i] / steps


@compiled
def _carried(spin: Vector, change: Vector, arm: Vector) -> Vector:
    return plus(cross(change, arm), cross(spin, cross(spin, arm)))
