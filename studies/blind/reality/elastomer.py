"""What a slice of fibre answers to stretch, and a rubbing contact to slip."""

from __future__ import annotations

import math

from studies.blind.reality.compiled import compiled

_LARGEST_SHARE = 0.985
"""Share of Gent's limit beyond which the law goes on along its tangent."""


@compiled
def gent_pa(modulus_pa: float, limit: float, stretch: float) -> tuple[float, float]:
    """Return nominal stress and its slope over stretch of an incompressible Gent solid pulled along one axis."""
    square = stretch * stretch
    strain = stretch - 1.0 / square
    slope = 1.0 + 2.0 / (square * stretch)
    invariant = square + 2.0 / stretch - 3.0
    share = invariant / limit
    if share < _LARGEST_SHARE:
        stiff = modulus_pa / (1.0 - share)
        return stiff * strain, stiff * (slope + 2.0 * strain * strain / (limit * (1.0 - share)))
    stiff = modulus_pa / (1.0 - _LARGEST_SHARE)
    beyond = 1.0 + (share - _LARGEST_SHARE) / (1.0 - _LARGEST_SHARE)
    return stiff * strain * beyond, stiff * (slope * beyond + 2.0 * strain * strain / (limit * (1.0 - _LARGEST_SHARE)))


@compiled
def bristle_n(before_n: float, slip_m: float, most_n: float, stiffness_n_m: float) -> tuple[float, float]:
    """Return force and slope over slip of bent bristles after a slip at even speed (LuGre, solved for the step)."""
    if most_n <= 0.0:
        return 0.0, 0.0
    held = min(max(before_n, -most_n), most_n)
    goal = most_n if slip_m >= 0.0 else -most_n
    left = math.exp(-stiffness_n_m * abs(slip_m) / most_n)
    return goal + (held - goal) * left, stiffness_n_m * left * abs(goal - held) / most_n
