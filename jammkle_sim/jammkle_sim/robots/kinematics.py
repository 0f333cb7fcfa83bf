"""Where the joints of a leg must be for its ankle to be somewhere: hip and knee, with or without abduction.

Frame of a hip: x forward, y to the left, z up. An angle about y turns what hangs down backward: the thigh's is counted
from straight down, the knee's from the thigh, and is negative.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

_STRAIGHTEST = 0.999
"""Longest reach, as a share of a straight leg: there the knee's angle still says where the ankle is."""


@dataclass(frozen=True)
class Segments:
    """Lengths of a leg."""

    thigh_m: float
    """From hip to knee."""
    shank_m: float
    """From knee to ankle."""

    def angles_rad(self, forward_m: float, up_m: float) -> tuple[float, float]:
        """Return hip and knee angle that bring the ankle to a place in the leg's plane, or as near as it reaches.

        Args:
            forward_m: Forward of the hip, m.
            up_m: Above the hip, m; negative.

        """
        straight_m = self.thigh_m + self.shank_m
        distance_m = min(max(math.hypot(forward_m, up_m), abs(self.thigh_m - self.shank_m)), _STRAIGHTEST * straight_m)
        product = 2.0 * self.thigh_m * self.shank_m
        bend = math.acos((distance_m**2 - self.thigh_m**2 - self.shank_m**2) / product)
        backward = math.atan2(-forward_m, -up_m)
        ahead = math.atan2(self.shank_m * math.sin(bend), self.thigh_m + self.shank_m * math.cos(bend))
        return backward + ahead, -bend


def abducted(segments: Segments, offset_m: float, place_m: tuple[float, float, float]) -> tuple[float, float, float]:
    """Return abduction, hip and knee angle that bring the ankle to a place.

    Args:
        segments: Lengths.
        offset_m: How far to the left of the abduction axis the leg's plane is; negative: to the right.
        place_m: Of the ankle, in the frame of the hip.

    """
    forward_m, left_m, up_m = place_m
    along_m = -math.sqrt(max(left_m**2 + up_m**2 - offset_m**2, 0.0))
    abduction = math.atan2(up_m, left_m) - math.atan2(along_m, offset_m)
    return math.remainder(abduction, 2.0 * math.pi), *segments.angles_rad(forward_m, along_m)
