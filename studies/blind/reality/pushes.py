"""Forces and moments on leg and foot as loads on the seven speeds."""

from __future__ import annotations

from typing import Any

from studies.blind.reality.bodies import FOOT, LEG
from studies.blind.reality.compiled import compiled
from studies.blind.reality.vectors import Vector, cross


@compiled
def push_leg(state: Any, at: Vector, force: Vector) -> None:
    """Add a force on the leg; `at` is from the pivot, axes of the world."""
    state.load[0] += force[2]
    add_moment(state, LEG, cross(at, force))


@compiled
def push_foot(state: Any, to_ankle: Vector, at: Vector, force: Vector) -> None:
    """Add a force on the foot; `at` is from the ankle's joint, axes of the world."""
    push_leg(state, to_ankle, force)
    add_moment(state, FOOT, cross(at, force))


@compiled
def add_moment(state: Any, at: int, moment: Vector) -> None:
    """Add a moment on the body whose turning begins at a speed."""
    for i in range(3):
        state.load[at + i] += moment[i]
