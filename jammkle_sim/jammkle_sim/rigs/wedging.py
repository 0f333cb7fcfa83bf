"""When a rigid foot under a ball joint wedges on a slope instead of sliding, and what makes it slide.

A leg carries force, beside its own small weight, only along the line from the toe's contact to the ball joint. If that
line lies within the cone of friction around the slope's normal no force makes the toe slide; else the least one does.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from jammkle_common.parameters import typed
from jammkle_sim.physics.ankle import corner_m

if TYPE_CHECKING:
    from jammkle_sim.physics.ankle import AnkleParameters

_SAFE_ANGLE_RAD = math.radians(6.0)
"""By how much the line to the ball joint must miss the cone of friction for the foot to be well clear of wedging.
Chosen from runs: nearer to the cone the blow of the first touch decides the force; with so much the load cell bears it
up to the largest speed of the carriage."""
_FRICTIONS_PER_UNIT = 100
_LEGS_PER_M = 100
"""Advised values are whole hundredths of friction, whole degrees, whole centimetres."""


@dataclass(frozen=True)
class Footing:
    """A rigid foot as it stands: what decides whether it wedges."""

    slope_deg: float
    """Inclination of the slope, toe uphill."""
    leg_m: float
    """From the ankle's joint to the ball joint."""
    ankle: AnkleParameters

    @property
    def tilt_rad(self) -> float:
        """Tilt at which leg and foot hang still under the ball joint; positive moves the foot to the heel's side."""
        ankle = self.ankle
        foot_x_m, _, foot_z_m = ankle.foot_centre_m
        leg_kg = ankle.mass_kg - ankle.foot_mass_kg
        forward_m = ankle.foot_mass_kg * foot_x_m / ankle.mass_kg
        up_m = (leg_kg * ankle.tendon_length_m / 2.0 + ankle.foot_mass_kg * foot_z_m) / ankle.mass_kg
        return math.atan2(forward_m, self.leg_m - up_m)

    @property
    def contact_m(self) -> tuple[float, float]:
        """Where the hanging foot's toe touches the slope: forward of and below the ball joint, m."""
        slope, tilt, radius_m = math.radians(self.slope_deg), self.tilt_rad, self.ankle.contact_radius_m
        toe_m, toe_below_m = corner_m(self.ankle, self.ankle.toe_m)
        down_m = self.leg_m + toe_below_m
        # The centre of the toe's rounded corner, then from there against the slope's normal.
        forward_m = toe_m * math.cos(tilt) - down_m * math.sin(tilt)
        below_m = toe_m * math.sin(tilt) + down_m * math.cos(tilt)
        return forward_m + radius_m * math.sin(slope), below_m + radius_m * math.cos(slope)

    @property
    def angle_to_normal_rad(self) -> float:
        """From the slope's normal to the line from the contact to the ball joint; positive pushes the toe downhill."""
        forward_m, below_m = self.contact_m
        return math.radians(self.slope_deg) - math.atan2(forward_m, below_m)

    @property
    def wedging_friction(self) -> float:
        """Friction from which on the toe wedges; 0 on slopes so gentle that no friction lets it slide down."""
        return max(math.tan(self.angle_to_normal_rad), 0.0)

    @property
    def safe_friction(self) -> float:
        """Largest friction, in hundredths, that is well clear of wedging; below 0 where none is."""
        return math.floor(math.tan(self.angle_to_normal_rad - _SAFE_ANGLE_RAD) * _FRICTIONS_PER_UNIT) / (
            _FRICTIONS_PER_UNIT
        )


def ways_out(footing: Footing, friction: float, steepest_deg: float, longest_m: float) -> str:
    """Say what would let a foot slide that wedges: friction, slope or leg, each only where it helps by itself.

    Args:
        footing: As it stands.
        friction: Of its edge.
        steepest_deg: Largest slope that can be given, degrees.
        longest_m: Longest leg that can be given, m.

    """
    ways: list[str] = []
    if footing.safe_friction > 0.0:
        ways.append(f"{typed('edge_friction', footing.safe_friction)} or less")
    slopes_deg = range(math.ceil(footing.slope_deg), math.floor(steepest_deg) + 1)
    slope_deg = next((each for each in slopes_deg if replace(footing, slope_deg=each).safe_friction >= friction), None)
    if slope_deg is not None:
        ways.append(f"{typed('slope_deg', slope_deg)} or more")
    legs_m = [
        each / _LEGS_PER_M
        for each in range(math.ceil(footing.leg_m * _LEGS_PER_M), math.floor(longest_m * _LEGS_PER_M) + 1)
    ]
    leg_m = next((each for each in legs_m if replace(footing, leg_m=each).safe_friction >= friction), None)
    if leg_m is not None:
        ways.append(f"{typed('leg_m', leg_m)} or more")
    if not ways:
        steep = replace(footing, slope_deg=steepest_deg)
        ways.append(f"{typed('slope_deg', steepest_deg)} with {typed('edge_friction', steep.safe_friction)} or less")
    return "give " + " or ".join(ways)
