"""Matrix of inertia of carriage, leg and foot, solved for the speeds that are free."""

from __future__ import annotations

from typing import Any

from studies.blind.reality.bodies import FOOT, LEG, SPEEDS
from studies.blind.reality.compiled import compiled
from studies.blind.reality.vectors import Vector, dot, plus, scaled, turned


@compiled
def solve(law: Any, state: Any, count: int) -> None:
    """Fill the matrix of inertia and solve it for the change of the speeds that are free."""
    matrix, load = state.matrix, state.load
    to_ankle = turned(state.leg_turn, (law.ankle_m[0], law.ankle_m[1], law.ankle_m[2]))
    to_leg = turned(state.leg_turn, (law.leg_centre_m[0], law.leg_centre_m[1], law.leg_centre_m[2]))
    to_foot = turned(state.foot_turn, (law.foot_centre_m[0], law.foot_centre_m[1], law.foot_centre_m[2]))
    matrix[0, 0] = law.carriage_kg + law.leg_kg + law.foot_kg
    reach = dot(to_ankle, to_foot)
    for i in range(3):
        for j in range(3):
            same = 1.0 if i == j else 0.0
            leg = law.leg_kg * (dot(to_leg, to_leg) * same - to_leg[i] * to_leg[j])
            leg += law.foot_kg * (dot(to_ankle, to_ankle) * same - to_ankle[i] * to_ankle[j])
            foot = law.foot_kg * (dot(to_foot, to_foot) * same - to_foot[i] * to_foot[j])
            for k in range(3):
                leg += state.leg_turn[i, k] * law.leg_inertia_kg_m2[k] * state.leg_turn[j, k]
                foot += state.foot_turn[i, k] * law.foot_inertia_kg_m2[k] * state.foot_turn[j, k]
            matrix[LEG + i, LEG + j] = leg
            matrix[FOOT + i, FOOT + j] = foot
            both = law.foot_kg * (reach * same - to_foot[i] * to_ankle[j])
            matrix[LEG + i, FOOT + j] = both
            matrix[FOOT + j, LEG + i] = both
    leg_lever = plus(scaled(to_leg, law.leg_kg), scaled(to_ankle, law.foot_kg))
    foot_lever = scaled(to_foot, law.foot_kg)
    _border(matrix, LEG, leg_lever)
    _border(matrix, FOOT, foot_lever)
    if law.foot_is_free <= 0.0 and law.leg_is_free > 0.0:
        _fold(matrix, load)
    _eliminate(matrix, load, state.active, count)
    for i in range(SPEEDS):
        state.change[i] = 0.0
    for a in range(count):
        state.change[state.active[a]] = load[state.active[a]]
    if law.foot_is_free <= 0.0:
        for i in range(3):
            state.change[FOOT + i] = state.change[LEG + i]


@compiled
def _fold(matrix: Any, load: Any) -> None:
    """Let the foot turn as the leg does."""
    for i in range(3):
        load[LEG + i] += load[FOOT + i]
        matrix[0, LEG + i] += matrix[0, FOOT + i]
        matrix[LEG + i, 0] = matrix[0, LEG + i]
        for j in range(3):
            both = matrix[LEG + i, FOOT + j] + matrix[FOOT + i, LEG + j]
            matrix[LEG + i, LEG + j] += both + matrix[FOOT + i, FOOT + j]


@compiled
def _border(matrix: Any, at: int, lever: Vector) -> None:
    """Couple a body's turning to the carriage: what rises per turn, lever cross z."""
    for i, value in enumerate((lever[1], -lever[0], 0.0)):
        matrix[0, at + i] = value
        matrix[at + i, 0] = value


@compiled
def _eliminate(matrix: Any, load: Any, active: Any, count: int) -> None:
    """Solve the symmetric system of the active rows in place; the solution stands in load."""
    for a in range(count):
        row = active[a]
        for b in range(a + 1, count):
            below = active[b]
            factor = matrix[below, row] / matrix[row, row]
            for c in range(a, count):
                matrix[below, active[c]] -= factor * matrix[row, active[c]]
            load[below] -= factor * load[row]
    for a in range(count - 1, -1, -1):
        row = active[a]
        value = load[row]
        for c in range(a + 1, count):
            value -= matrix[row, active[c]] * load[active[c]]
        load[row] = value / matrix[row, row]
