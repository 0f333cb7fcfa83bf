"""A foot, or a body, that is raised from rest too slowly for any swing or free fall, and then moves on."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from jammkle_common.constants import STANDARD_GRAVITY_M_S2
from jammkle_controller.core.events import M_S2, METRE, ContactEvent, ContactKind

if TYPE_CHECKING:
    from jammkle_controller.core.imu import ImuSample

SMOOTH_TIME_S = 0.05
"""What is faster than this is shaking and no motion, s: motors and gears shake at 25 Hz and more."""
REST_S = 0.3
"""So long the specific force keeps its value at rest, s. Half-way up a slow rise it is that of gravity for a moment:
of a minimum-jerk rise (Flash and Hogan 1985) by h = 0.3 m, whose jerk there is 30 h / T^3, for less if T < 2 s."""
REST_BAND_M_S2 = 0.15
"""By which the smoothed specific force may stray at rest, m/s^2, and its size from that of the rest before: noise of
0.1 m/s^2, as of a cheap IMU, leaves 0.02 at 200 Hz."""
REST_RATE_RAD_S = 0.1
"""By which it may turn at rest, rad/s: five times the bias of a common gyro."""
LONGEST_S = 3.0
"""Time over which a rise is integrated, s; what has not been raised by then is unknown until it rests again. No rise
keeps its acceleration for as long: then it is a rest, whatever gravity was taken for before."""
BIAS_M_S2 = 0.05 * STANDARD_GRAVITY_M_S2
"""Of a cheap accelerometer. At rest it is part of gravity; as the IMU tilts, it is not."""
LEAST_TILT_RAD = math.radians(2.0)
"""An elevator raises a robot that stands without tilting it; a hand does not. A gyro's bias of 0.01 rad/s makes as much
in 3.5 s."""
DOWN_SHARE = 0.5
"""Of the height, below which it rests where it was raised from."""
PUT_DOWN_S = 1.0
"""At rest for so long it stands again, wherever that is, s: no hand is as still. Assumed."""

_PROBABILITY = 0.95
Vector = tuple[float, float, float]
_ZERO: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class RaiseSettings:
    """Height, m, by which a foot or body is raised that does not stand any more."""

    height_m: float


class RaiseDetector:
    """Integrates how high the sole has come since the IMU was last at rest.

    A strapdown integration from rest (zero-velocity update: Skog et al. 2010) with gravity as measured there,

        v' = -w x v + f - g,    g' = -w x g,    h' = (v + w x lever) . g / |g|,

    less what an accelerometer's bias b makes of a tilt by an angle a from there, b sin(a) t^2 / 2. A sole in stance
    does not rise, whatever the leg above it does; a body does not by more than its legs are long.
    """

    def __init__(self, settings: RaiseSettings, lever_m: Vector) -> None:
        """Make a detector that has seen nothing.

        Args:
            settings: The height.
            lever_m: From the IMU to the sole in the IMU's frame, m.

        """
        self.settings = settings
        self._lever_m = lever_m
        self.restart()

    def restart(self) -> None:
        """Forget everything: what comes cannot be compared."""
        self._smooth: Vector | None = None
        self._turning = 0.0
        self._weight_m_s2: float | None = None
        self._anchor = self._mean = self._rest = self._gravity = self._velocity = _ZERO
        self._kept_s = 0.0
        self.disarm()

    def disarm(self) -> None:
        """Wait for the next rest: the foot left the ground or came down otherwise."""
        self.is_raised = False
        self._since_rest_s: float | None = None
        self._height_m: float | None = None

    def follow(self, sample: ImuSample, interval_s: float) -> None:
        """Take the next sample, `interval_s` after the one before."""
        _, x, y, z, p, q, r = sample
        force = (x, y, z)
        share = interval_s / (interval_s + SMOOTH_TIME_S)
        self._smooth = smooth = force if self._smooth is None else _towards(self._smooth, force, share)
        self._turning += (p * p + q * q + r * r - self._turning) * share
        strays = math.dist(smooth, self._anchor) > REST_BAND_M_S2 or self._turning > REST_RATE_RAD_S**2
        if strays:
            self._anchor = self._mean = smooth
            self._kept_s = 0.0
        else:
            self._kept_s += interval_s
            share = interval_s / (interval_s + REST_S)
            self._mean = _towards(self._mean, force, share)
        if self._kept_s >= REST_S and (self._is_weight(math.hypot(*smooth)) or self._kept_s >= LONGEST_S):
            self._rest = self._gravity = self._mean
            self._weight_m_s2 = math.hypot(*self._mean)
            self._velocity = _ZERO
            self._since_rest_s = 0.0
            if not self.is_raised:
                self._height_m = 0.0
        elif self._since_rest_s is not None and self._height_m is not None:
            self._since_rest_s += interval_s
            known = self._since_rest_s <= LONGEST_S
            self._height_m = self._height_m + interval_s * self._up_m_s(sample, interval_s) if known else None

    def _is_weight(self, force_m_s2: float) -> bool:
        """Whether a constant specific force is that of gravity, and not half of a rise."""
        if self._weight_m_s2 is None:
            return abs(force_m_s2 - STANDARD_GRAVITY_M_S2) < BIAS_M_S2
        return abs(force_m_s2 - self._weight_m_s2) < REST_BAND_M_S2

    def _up_m_s(self, sample: ImuSample, interval_s: float) -> float:
        """Integrate gravity and velocity; return how fast the sole rises."""
        _, x, y, z, p, q, r = sample
        gx, gy, gz = self._gravity
        gx, gy, gz = (
            gx + interval_s * (r * gy - q * gz),
            gy + interval_s * (p * gz - r * gx),
            gz + interval_s * (q * gx - p * gy),
        )
        self._gravity = (gx, gy, gz)
        vx, vy, vz = self._velocity
        vx, vy, vz = (
            vx + interval_s * (r * vy - q * vz + x - gx),
            vy + interval_s * (p * vz - r * vx + y - gy),
            vz + interval_s * (q * vx - p * vy + z - gz),
        )
        self._velocity = (vx, vy, vz)
        lx, ly, lz = self._lever_m
        sx, sy, sz = vx + q * lz - r * ly, vy + r * lx - p * lz, vz + p * ly - q * lx
        return (sx * gx + sy * gy + sz * gz) / (math.sqrt(gx * gx + gy * gy + gz * gz) or 1.0)

    def _tilt_rad(self) -> float:
        lengths = math.hypot(*self._gravity) * math.hypot(*self._rest)
        cosine = sum(a * b for a, b in zip(self._gravity, self._rest, strict=True)) / (lengths or 1.0)
        return math.acos(min(1.0, max(-1.0, cosine)))

    def on_ground(self, time_ns: int) -> ContactEvent | None:
        """Return a lift-off once it is higher than `height_m`, whatever the bias, and has tilted."""
        height_m, since_s, least_m = self._height_m, self._since_rest_s, self.settings.height_m
        if since_s is None or height_m is None or height_m <= least_m:
            return None
        tilt_rad = self._tilt_rad()
        unsure_m = 0.5 * BIAS_M_S2 * math.sin(tilt_rad) * since_s * since_s
        if tilt_rad < LEAST_TILT_RAD or height_m - unsure_m <= least_m:
            return None
        return ContactEvent(ContactKind.LIFTOFF, time_ns, height_m, METRE, since_s, _PROBABILITY)

    @property
    def rested_s(self) -> float:
        """How long the IMU has read gravity and nothing else, s; 0: it does not."""
        if self._smooth is None or abs(math.hypot(*self._smooth) - STANDARD_GRAVITY_M_S2) > 2.0 * BIAS_M_S2:
            return 0.0
        return self._kept_s

    def raise_it(self) -> None:
        """Take that it has been raised: its height is kept while it rests in the air."""
        self.is_raised = True

    def set_down(self, time_ns: int, force_m_s2: float) -> ContactEvent | None:
        """Return a touch-down, reported late, of what was raised and rests: for longer if not where it rose from."""
        came_back = self._height_m is not None and self._height_m < DOWN_SHARE * self.settings.height_m
        if self._kept_s < (REST_S if came_back else PUT_DOWN_S):
            return None
        return ContactEvent(
            ContactKind.IMPACT, time_ns, force_m_s2, M_S2, self._kept_s, _PROBABILITY, is_felt=came_back
        )


def _towards(a: Vector, b: Vector, share: float) -> Vector:
    return (a[0] + (b[0] - a[0]) * share, a[1] + (b[1] - a[1]) * share, a[2] + (b[2] - a[2]) * share)
