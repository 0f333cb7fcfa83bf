"""What a stream of IMU samples says of motion: the quantities that the detectors decide on, sample by sample.

All of them are first-order low-passes by implicit Euler, whose time constants are times and not counts, so that they
are stable and mean the same at any rate, with dropped samples and jitter; none depends on how the IMU is turned.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from jammkle_common.constants import STANDARD_GRAVITY_M_S2

if TYPE_CHECKING:
    from jammkle_controller.core.imu import ImuSample

Vector = tuple[float, float, float]
ZERO: Vector = (0.0, 0.0, 0.0)


def dot(a: Vector, b: Vector) -> float:
    """Return the scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Vector, b: Vector) -> Vector:
    """Return the vector product."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def combine(p: float, a: Vector, q: float, b: Vector) -> Vector:
    """Return p a + q b."""
    return (p * a[0] + q * b[0], p * a[1] + q * b[1], p * a[2] + q * b[2])


def towards(a: Vector, b: Vector, share: float) -> Vector:
    """Return the vector that is a share of the way from a to b."""
    return (a[0] + (b[0] - a[0]) * share, a[1] + (b[1] - a[1]) * share, a[2] + (b[2] - a[2]) * share)


def turned(a: Vector, sample: ImuSample, interval_s: float) -> Vector:
    """Return what a vector that stays as it is in the world becomes in the frame of an IMU that turns: a' = -w x a."""
    x, y, z = a
    _, _, _, _, p, q, r = sample
    return (x + interval_s * (r * y - q * z), y + interval_s * (p * z - r * x), z + interval_s * (q * x - p * y))


def integrated(velocity: Vector, gravity: Vector, sample: ImuSample, interval_s: float) -> Vector:
    """Return the velocity of an IMU in its own frame after an interval: v' = -w x v + f - g."""
    vx, vy, vz = velocity
    gx, gy, gz = gravity
    _, x, y, z, p, q, r = sample
    return (
        vx + interval_s * (r * vy - q * vz + x - gx),
        vy + interval_s * (p * vz - r * vx + y - gy),
        vz + interval_s * (q * vx - p * vy + z - gz),
    )


def at_lever(velocity: Vector, lever_m: Vector, sample: ImuSample) -> Vector:
    """Return the velocity of what is rigidly at a lever from the IMU: v + w x lever."""
    vx, vy, vz = velocity
    lx, ly, lz = lever_m
    _, _, _, _, p, q, r = sample
    return (vx + q * lz - r * ly, vy + r * lx - p * lz, vz + p * ly - q * lx)


LOAD_TIME_S = 0.01
"""Time constant of the load, s: above the ringing of a foot (30 Hz and more), below a step."""
STILL_TIME_S = 0.03
"""Window of the zero-velocity statistic, s. Skog et al. take 5 to 25 ms at 250 Hz and more on a boot."""
SHARP_TIME_S = 0.005
"""What is faster than this is sharp, s: a blow, and not a limb's motion (its fastest share is some 20 Hz)."""
SHARP_SPREAD_TIME_S = 0.05
"""Window over which sharpness is usual, s."""
LONG_TIME_S = 0.15
"""Window of the context: about half a step."""
GRAVITY_TIME_S = 1.0
"""Time constant with which gravity follows the accelerometer, s; the gyro carries it in between."""
STILL_GRAVITY_TIME_S = 0.05
"""As above, while the IMU is still: then what it reads is gravity."""
STILL_FORCE_M2_S4 = 0.25
STILL_RATE_RAD2_S2 = 0.04
"""Squared deviations, below which the IMU is still: 0.5 m/s^2 for 0.05 g of bias, and 0.2 rad/s."""

_FORCE_FLOOR = 1e-3
_RATE_FLOOR = 1e-4
_SHARP_FLOOR = 1e-3
"""Added before the logarithm, (m/s^2)^2, (rad/s)^2: the noise of a common sensor; better ones say the same."""


class Motion:
    """Features of the motion at the IMU."""

    def __init__(self, force: Vector = (0.0, 0.0, STANDARD_GRAVITY_M_S2)) -> None:
        """Begin at a specific force, m/s^2, that is taken for gravity."""
        self.force_m_s2 = self._load_m_s2 = math.hypot(*force)
        self.gravity: Vector = force
        self.sharp: Vector = (0.0, 0.0, 0.0)
        self.sharp_m_s2 = 0.0
        self.sharp_ratio = 0.0
        self._mean = self._slow = force
        self._unrest = 0.0
        self._turning = 0.0
        self._sharpness = 0.0
        self._usual_sharpness = 0.0
        self._long_unrest = 0.0
        self._long_turning = 0.0

    def update(self, sample: ImuSample, interval_s: float) -> None:
        """Take the next sample, `interval_s` after the one before."""
        _, x, y, z, p, q, r = sample
        self.force_m_s2 = force = math.sqrt(x * x + y * y + z * z)
        share = interval_s / (interval_s + SHARP_TIME_S)
        sx, sy, sz = self._slow
        sx, sy, sz = sx + (x - sx) * share, sy + (y - sy) * share, sz + (z - sz) * share
        self._slow = (sx, sy, sz)
        self.sharp = (x - sx, y - sy, z - sz)
        sharp_squared = (x - sx) ** 2 + (y - sy) ** 2 + (z - sz) ** 2
        self.sharp_m_s2 = math.sqrt(sharp_squared)
        self.sharp_ratio = math.sqrt(sharp_squared / (self._usual_sharpness + _SHARP_FLOOR))
        self._usual_sharpness += (min(sharp_squared, 25.0 * self._usual_sharpness + 0.01) - self._usual_sharpness) * (
            interval_s / (interval_s + SHARP_SPREAD_TIME_S)
        )
        share = interval_s / (interval_s + LOAD_TIME_S)
        self._load_m_s2 += (force - self._load_m_s2) * share
        self._sharpness += (sharp_squared - self._sharpness) * share
        share = interval_s / (interval_s + STILL_TIME_S)
        mx, my, mz = self._mean
        mx, my, mz = mx + (x - mx) * share, my + (y - my) * share, mz + (z - mz) * share
        self._mean = (mx, my, mz)
        length = math.sqrt(mx * mx + my * my + mz * mz) or 1.0
        scale = STANDARD_GRAVITY_M_S2 / length
        unrest = (x - scale * mx) ** 2 + (y - scale * my) ** 2 + (z - scale * mz) ** 2
        turning = p * p + q * q + r * r
        self._unrest += (unrest - self._unrest) * share
        self._turning += (turning - self._turning) * share
        share = interval_s / (interval_s + LONG_TIME_S)
        self._long_unrest += (unrest - self._long_unrest) * share
        self._long_turning += (turning - self._long_turning) * share
        self._follow_gravity(sample, interval_s)

    def _follow_gravity(self, sample: ImuSample, interval_s: float) -> None:
        """Turn gravity with the body, g' = -w x g, and pull it to the accelerometer: r' = -w x r + (f - r) / T."""
        follow_s = STILL_GRAVITY_TIME_S if self.is_still else GRAVITY_TIME_S
        follow = interval_s / (interval_s + follow_s)
        _, x, y, z, _, _, _ = sample
        gx, gy, gz = self.gravity
        tx, ty, tz = turned(self.gravity, sample, interval_s)
        self.gravity = (tx + (x - gx) * follow, ty + (y - gy) * follow, tz + (z - gz) * follow)

    @property
    def is_still(self) -> bool:
        """Whether the zero-velocity statistic is that of an IMU at rest."""
        return self._unrest < STILL_FORCE_M2_S4 and self._turning < STILL_RATE_RAD2_S2

    @property
    def load(self) -> float:
        """Low-passed |specific force| in units of gravity: 0 in free fall, 1 at rest."""
        return self._load_m_s2 / STANDARD_GRAVITY_M_S2

    def features(self) -> tuple[float, ...]:
        """Return what the posterior of contact is made of.

        The two parts of the generalised likelihood ratio for zero velocity, SHOE (Skog, Haendel, Nilsson, Rantakokko,
        "Zero-Velocity Detection - An Algorithm Evaluation", IEEE Trans. Biomed. Eng. 57, 2010, eq. 13),

            T = mean |f - g mean(f)/|mean(f)||^2 / s_f^2 + mean |w|^2 / s_w^2

        kept apart and as logarithms, over a short and a long window; the sharpness; and the load.
        """
        return (
            math.log10(_FORCE_FLOOR + self._unrest),
            math.log10(_RATE_FLOOR + self._turning),
            math.log10(_SHARP_FLOOR + self._sharpness),
            min(3.0, self._load_m_s2 / STANDARD_GRAVITY_M_S2),
            math.log10(_FORCE_FLOOR + self._long_unrest),
            math.log10(_RATE_FLOOR + self._long_turning),
        )

    def blow_features(self, swung_s: float) -> tuple[float, ...]:
        """Return what separates a touch-down in a swing that has lasted `swung_s`, s, from the swing's own jerks.

        Its sharp part, that in units of what was usual, how fast the limb turns and shakes, how long it has swung, and
        whether the blow comes from below.
        """
        sharp = self.sharp_m_s2
        gx, gy, gz = self.gravity
        along = self.sharp[0] * gx + self.sharp[1] * gy + self.sharp[2] * gz
        return (
            math.log10(0.1 + sharp),
            math.log10(0.1 + self.sharp_ratio),
            math.log10(_RATE_FLOOR + self._turning),
            math.log10(_FORCE_FLOOR + self._long_unrest),
            min(0.6, swung_s),
            along / (sharp * math.sqrt(gx * gx + gy * gy + gz * gz) + 1e-9),
        )
