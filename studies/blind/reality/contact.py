"""What feet and floors do to each other: elastic force over depth, damping by Hunt and Crossley, friction by LuGre.

No contact of the rigs was ever measured. What is chosen so that the paper's drop table comes out says so; the rest is
assumed from the parts' materials.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from jammkle_common.constants import STANDARD_ATMOSPHERE_PA
from studies.blind.reality.bodies import PRESS_POINTS

if TYPE_CHECKING:
    from numpy.typing import NDArray

_DEEPEST_M = 0.008
"""A corner's table ends here; beyond it the force goes on straight."""


@dataclass(frozen=True)
class Press:
    """Force over depth of one corner."""

    force_n: NDArray[np.float64]
    """At depths in even steps from 0, shape (PRESS_POINTS,)."""
    step_m: float
    damping_s_m: float
    """Hunt and Crossley: share of the force that comes on top per speed of pressing, s/m."""


def hertz(stiffness_n_m15: float, damping_s_m: float) -> Press:
    """Return a round corner on a flat: force grows with depth to the power of 1.5."""
    depth_m = np.linspace(0.0, _DEEPEST_M, PRESS_POINTS)
    return Press(stiffness_n_m15 * depth_m**1.5, _DEEPEST_M / (PRESS_POINTS - 1), damping_s_m)


SOLE_N_M15, SOLE_S_M = 2e5, 1.5
"""One corner of the ankle's printed sole: 30 N press it by 2.8 mm. Chosen, with friction and damping of the joint, so
that the drop test's means of both ankles come out, 42.52 and 31.26 m/s^2, and that the first touch stays below them: a
stiffer corner makes it the peak of the unjammed ankle."""
WOOD_N_M15, WOOD_S_M = 1e7, 1.5
"""One corner of the sole on a plywood slope: 30 N press it by 0.2 mm. Assumed: the edge of a print on wood, where the
platform of the drop rig meets the soft rounded toe tip first. The damping is assumed: it returns a quarter of 1 m/s."""
HARD_N_M15, HARD_S_M = 2.5e7, 1.6
"""A foot without any give, corner or tip: 140 N press it by 0.3 mm. Assumed: hard plastic on the platform. The damping
is chosen so that it rebounds to a fifth of its fall: the paper says "bouncing significantly", and no more."""
STRIBECK_M_S = 0.005
"""Speed at which friction has gone down from static to sliding. Assumed: plastic on a floor."""
STATIC_SHARE = 1.06
"""Static over sliding friction. Assumed: plastic on a floor. What a plan tells is taken as the sliding one."""
BRISTLE_1_M = 2e4
"""Share of the load per bending of the sole: with a coefficient of 0.5 it gives by 25 um before it slides. Assumed."""
BRISTLE_S_M = 2.0
"""Share of the load per speed of bending. Assumed: a stuck toe under 30 N swings out in a few swings."""
MAT_S = 0.003
"""Damping over stiffness of a mat on the floor. Assumed: foam."""


@dataclass(frozen=True)
class SquashBall:
    """A hollow rubber ball: its shell bends, its air is pressed."""

    radius_m: float = 0.020
    """By the rules of the World Squash Federation: 39.5 to 40.5 mm across."""
    mass_kg: float = 0.024
    """By the same rules: 23 to 25 g."""
    wall_m: float = 0.0055
    """What radius, mass and the density of filled rubber leave."""
    shell_n_m: float = 3.2e3
    """The same rules: 3.2 N/mm at 23 degC with a slow ball."""
    air_share: float = 0.552
    """How much of the volume of the two caps that are pressed flat is taken from the air: the ball bulges. Chosen, with
    the damping, so that the drop test's mean of 60.60 m/s^2 comes out."""
    air_exponent: float = 1.4
    """Fast: the air keeps its heat."""
    damping_s_m: float = 0.9
    """Chosen as above; the leg then rebounds to a half of the height that it fell."""

    def press(self) -> Press:
        """Return the force of the whole ball between leg and floor over its squash."""
        deepest_m = 2.0 * (self.radius_m - self.wall_m) * 0.98
        squash_m = np.linspace(0.0, deepest_m, PRESS_POINTS)
        hollow_m3 = 4.0 / 3.0 * math.pi * (self.radius_m - self.wall_m) ** 3
        cap_m = squash_m / 2.0
        caps_m3 = 2.0 / 3.0 * math.pi * cap_m**2 * (3.0 * self.radius_m - cap_m)
        taken_m3 = np.minimum(self.air_share * caps_m3, 0.9 * hollow_m3)
        pressure_pa = STANDARD_ATMOSPHERE_PA * ((1.0 - taken_m3 / hollow_m3) ** -self.air_exponent - 1.0)
        force_n = self.shell_n_m * squash_m + pressure_pa * np.gradient(taken_m3, squash_m)
        return Press(np.maximum.accumulate(force_n), deepest_m / (PRESS_POINTS - 1), self.damping_s_m)
