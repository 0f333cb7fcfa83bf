"""How a foot or shank moves, on several scales of time: what swing, stance and touch-down are told apart by.

Every mean is a first-order low-pass by implicit Euler: it means the same at any rate, with dropped samples and jitter.
Features are logarithms, so that they shift, and do not stretch, where another robot is larger or faster.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from jammkle_graph.constants import STANDARD_GRAVITY_M_S2

if TYPE_CHECKING:
    from jammkle_controller.core.imu import ImuSample
    from jammkle_controller.core.motion import Motion, Vector

SHORT_S, MIDDLE_S, LONG_S = 0.008, 0.03, 0.15
"""Time constants, s: a blow (3 to 12 ms), the window of zero-velocity detectors (Skog et al. 2010), half a step."""
SHARP_S = 0.005
"""What is faster than this is sharp, s: a blow, and not a limb's motion (its fastest share is some 20 Hz)."""
USUAL_S = 0.3
"""Time over which sharpness is usual, s: about a swing."""
BURST_S = 0.025
"""Time constant with which a burst of sharpness is forgotten, s."""
LARGEST_LOAD = 3.0

_SPREADS_SQUARED = 25.0
"""No sample counts for more than this in what is usual, in units of it."""
_FORCE_FLOOR, _RATE_FLOOR, _RATIO_FLOOR = 1e-3, 1e-4, 0.1
"""Added before the logarithm, (m/s^2)^2, (rad/s)^2: the noise of a common sensor; better ones say the same."""


class _Means:
    """One quantity, averaged over the three scales."""

    __slots__ = ("long", "middle", "short")

    def __init__(self) -> None:
        self.short = self.middle = self.long = 0.0

    def update(self, value: float, interval_s: float) -> None:
        self.short += (value - self.short) * interval_s / (interval_s + SHORT_S)
        self.middle += (value - self.middle) * interval_s / (interval_s + MIDDLE_S)
        self.long += (value - self.long) * interval_s / (interval_s + LONG_S)


class _Sharpness:
    """What of a vector is faster than `SHARP_S`, squared, and its largest burst in units of what is usual."""

    __slots__ = ("_floor", "_slow", "burst", "mean", "usual", "vector")

    def __init__(self, start: Vector, floor: float) -> None:
        self._slow = start
        self._floor = floor
        self.vector: Vector = (0.0, 0.0, 0.0)
        self.mean = self.burst = 0.0
        self.usual = floor

    def update(self, x: float, y: float, z: float, interval_s: float) -> None:
        # The difference from the value before is low-passed by the same share at any rate.
        keep = SHARP_S / (interval_s + SHARP_S)
        sx, sy, sz = self._slow
        self.vector = dx, dy, dz = x - sx, y - sy, z - sz
        self._slow = (x - dx * keep, y - dy * keep, z - dz * keep)
        sharp = dx * dx + dy * dy + dz * dz
        self.mean += (sharp - self.mean) * interval_s / (interval_s + SHORT_S)
        self.burst = max(self.burst * BURST_S / (interval_s + BURST_S), sharp / (self.usual + 10.0 * self._floor))
        limited = min(sharp, _SPREADS_SQUARED * self.usual + 10.0 * self._floor)
        self.usual += (limited - self.usual) * interval_s / (interval_s + USUAL_S)


class Scales:
    """Turning, unrest and sharpness of a foot or shank."""

    def __init__(self, force: Vector) -> None:
        """Begin at a specific force, m/s^2, and at rest."""
        self.turning = _Means()
        self.unrest = _Means()
        self.sharp = _Sharpness(force, _FORCE_FLOOR)
        self.turning_sharp = _Sharpness((0.0, 0.0, 0.0), _RATE_FLOOR)
        self._long_load = math.hypot(*force) / STANDARD_GRAVITY_M_S2

    def update(self, sample: ImuSample, motion: Motion, interval_s: float) -> None:
        """Take the next sample, `interval_s` after the one before, and the motion at it."""
        _, x, y, z, p, q, r = sample
        self.turning.update(motion.turning_rad2_s2, interval_s)
        self.unrest.update(motion.unrest_m2_s4, interval_s)
        self.sharp.update(x, y, z, interval_s)
        self.turning_sharp.update(p, q, r, interval_s)
        load = motion.force_m_s2 / STANDARD_GRAVITY_M_S2
        self._long_load += (load - self._long_load) * interval_s / (interval_s + LONG_S)

    def features(self, motion: Motion) -> tuple[float, ...]:
        """Return what the probability of swing is made of."""
        turning, unrest = self.turning, self.unrest
        return (
            math.log10(_RATE_FLOOR + turning.short),
            math.log10(_RATE_FLOOR + turning.middle),
            math.log10(_RATE_FLOOR + turning.long),
            math.log10(_FORCE_FLOOR + unrest.short),
            math.log10(_FORCE_FLOOR + unrest.middle),
            math.log10(_FORCE_FLOOR + unrest.long),
            math.log10(_FORCE_FLOOR + self.sharp.mean),
            math.log10(_RATIO_FLOOR + self.sharp.burst),
            math.log10(_FORCE_FLOOR + self.sharp.usual),
            math.log10(_RATE_FLOOR + self.turning_sharp.mean),
            math.log10(_RATIO_FLOOR + self.turning_sharp.burst),
            min(LARGEST_LOAD, motion.load),
            min(LARGEST_LOAD, self._long_load),
        )
