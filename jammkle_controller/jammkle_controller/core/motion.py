"""What a stream of IMU samples says of motion: features that the detectors decide on, whether it rests, and rises.

Features are first-order low-passes by implicit Euler, whose time constants are times and not counts, so that they
are stable and mean the same at any rate, with dropped samples and jitter; none depends on how the IMU is turned.
"""

from __future__ import annotations

import math
from collections import deque
from typing import TYPE_CHECKING

from jammkle_common.constants import NANOSECONDS_PER_SECOND, STANDARD_GRAVITY_M_S2
from jammkle_controller.core.events import M_S2, METRE, ContactEvent, ContactKind

if TYPE_CHECKING:
    from jammkle_controller.core.imu import ImuSample
    from jammkle_controller.parameters import ControllerParameters

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


def scaled(p: float, a: Vector) -> Vector:
    """Return p a."""
    return (p * a[0], p * a[1], p * a[2])


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
        self._slow = sx, sy, sz = towards(self._slow, (x, y, z), interval_s / (interval_s + SHARP_TIME_S))
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
        self._mean = mx, my, mz = towards(self._mean, (x, y, z), share)
        scale = STANDARD_GRAVITY_M_S2 / (math.sqrt(dot(self._mean, self._mean)) or 1.0)
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
        return (
            math.log10(0.1 + sharp),
            math.log10(0.1 + self.sharp_ratio),
            math.log10(_RATE_FLOOR + self._turning),
            math.log10(_FORCE_FLOOR + self._long_unrest),
            min(0.6, swung_s),
            dot(self.sharp, self.gravity) / (sharp * math.sqrt(dot(self.gravity, self.gravity)) + 1e-9),
        )


SETTLE_WINDOW_S = 0.2
"""Time for which a body must be quiet to be at rest, s."""
SETTLE_RMS_M_S2 = 0.5
"""Largest rms of | |specific force| - g | at rest, m/s^2; leaves 0.05 g for the bias of a cheap accelerometer."""
SETTLE_RMS_RAD_S = 0.2
"""Largest rms of the angular velocity at rest, rad/s."""
LEAST_REST_SAMPLES = 10
"""A window with fewer samples says nothing of rest."""


class RestDetector:
    """Slides a window over the stream and says when it is quiet."""

    def __init__(self) -> None:
        """Make a detector that has seen nothing."""
        self._window: deque[tuple[int, float, float]] = deque()
        self._force_sum = 0.0
        self._rate_sum = 0.0

    def restart(self) -> None:
        """Begin a new window."""
        self._window.clear()
        self._force_sum = 0.0
        self._rate_sum = 0.0

    def on_ground(self, time_ns: int, force_m_s2: float, rate_squared: float) -> ContactEvent | None:
        """Take the next |specific force|, m/s^2, and squared |angular velocity|, rad^2/s^2; return a rest if quiet.

        Its magnitude is the rms of | |specific force| - g |, its delay how long the window lasted.
        """
        deviation = force_m_s2 - STANDARD_GRAVITY_M_S2
        force_squared = deviation * deviation
        window = self._window
        window.append((time_ns, force_squared, rate_squared))
        self._force_sum += force_squared
        self._rate_sum += rate_squared
        lasted_s = (time_ns - window[0][0]) / NANOSECONDS_PER_SECOND
        if lasted_s < SETTLE_WINDOW_S:
            return None
        samples = len(window)
        # The sums lose digits as large squares leave them; a tiny negative remainder means zero.
        force_mean = max(0.0, self._force_sum) / samples
        rate_mean = max(0.0, self._rate_sum) / samples
        _, oldest_force, oldest_rate = window.popleft()
        self._force_sum -= oldest_force
        self._rate_sum -= oldest_rate
        quiet = force_mean <= SETTLE_RMS_M_S2**2 and rate_mean <= SETTLE_RMS_RAD_S**2
        if not quiet or samples < LEAST_REST_SAMPLES:
            return None
        return ContactEvent(ContactKind.SETTLED, time_ns, math.sqrt(force_mean), M_S2, lasted_s)


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

_RAISED_PROBABILITY = 0.95


class RaiseDetector:
    """Integrates how high the sole has come since the IMU was last at rest.

    A strapdown integration from rest (zero-velocity update: Skog et al. 2010) with gravity as measured there,

        v' = -w x v + f - g,    g' = -w x g,    h' = (v + w x lever) . g / |g|,

    less what an accelerometer's bias b makes of a tilt by an angle a from there, b sin(a) t^2 / 2. A sole in stance
    does not rise, whatever the leg above it does; a body does not by more than its legs are long.
    """

    def __init__(self, parameters: ControllerParameters) -> None:
        """Make a detector that has seen nothing."""
        self.parameters = parameters
        self.lever_m = ZERO
        """From the IMU to the sole in the IMU's frame, m."""
        self.restart()

    def restart(self) -> None:
        """Forget everything: what comes cannot be compared."""
        self._smooth: Vector | None = None
        self._turning = 0.0
        self._weight_m_s2: float | None = None
        self._anchor = self._mean = self._rest = self._gravity = self._velocity = ZERO
        self._kept_s = 0.0
        self.disarm()

    def disarm(self) -> None:
        """Wait for the next rest: the foot left the ground or came down otherwise."""
        self.is_raised = False
        """Whether it has been raised: its height is kept while it rests in the air."""
        self._since_rest_s: float | None = None
        self._height_m: float | None = None

    def follow(self, sample: ImuSample, interval_s: float) -> None:
        """Take the next sample, `interval_s` after the one before."""
        _, x, y, z, p, q, r = sample
        force = (x, y, z)
        share = interval_s / (interval_s + SMOOTH_TIME_S)
        self._smooth = smooth = force if self._smooth is None else towards(self._smooth, force, share)
        self._turning += (p * p + q * q + r * r - self._turning) * share
        strays = math.dist(smooth, self._anchor) > REST_BAND_M_S2 or self._turning > REST_RATE_RAD_S**2
        if strays:
            self._anchor = self._mean = smooth
            self._kept_s = 0.0
        else:
            self._kept_s += interval_s
            share = interval_s / (interval_s + REST_S)
            self._mean = towards(self._mean, force, share)
        if self._kept_s >= REST_S and (self._is_weight(math.hypot(*smooth)) or self._kept_s >= LONGEST_S):
            self._rest = self._gravity = self._mean
            self._weight_m_s2 = math.hypot(*self._mean)
            self._velocity = ZERO
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
        self._gravity = turned(self._gravity, sample, interval_s)
        self._velocity = integrated(self._velocity, self._gravity, sample, interval_s)
        sole = at_lever(self._velocity, self.lever_m, sample)
        return dot(sole, self._gravity) / (math.sqrt(dot(self._gravity, self._gravity)) or 1.0)

    def _tilt_rad(self) -> float:
        lengths = math.hypot(*self._gravity) * math.hypot(*self._rest)
        cosine = dot(self._gravity, self._rest) / (lengths or 1.0)
        return math.acos(min(1.0, max(-1.0, cosine)))

    def on_ground(self, time_ns: int) -> ContactEvent | None:
        """Return a lift-off once it is higher than `raised_m` of the parameters, whatever the bias, and has tilted."""
        height_m, since_s, least_m = self._height_m, self._since_rest_s, self.parameters.raised_m
        if since_s is None or height_m is None or height_m <= least_m:
            return None
        tilt_rad = self._tilt_rad()
        unsure_m = 0.5 * BIAS_M_S2 * math.sin(tilt_rad) * since_s * since_s
        if tilt_rad < LEAST_TILT_RAD or height_m - unsure_m <= least_m:
            return None
        return ContactEvent(ContactKind.LIFTOFF, time_ns, height_m, METRE, since_s, _RAISED_PROBABILITY)

    @property
    def rested_s(self) -> float:
        """How long the IMU has read gravity and nothing else, s; 0: it does not."""
        if self._smooth is None or abs(math.hypot(*self._smooth) - STANDARD_GRAVITY_M_S2) > 2.0 * BIAS_M_S2:
            return 0.0
        return self._kept_s

    def set_down(self, time_ns: int, force_m_s2: float) -> ContactEvent | None:
        """Return a touch-down, reported late, of what was raised and rests: for longer if not where it rose from."""
        came_back = self._height_m is not None and self._height_m < DOWN_SHARE * self.parameters.raised_m
        if self._kept_s < (REST_S if came_back else PUT_DOWN_S):
            return None
        return ContactEvent(
            ContactKind.IMPACT, time_ns, force_m_s2, M_S2, self._kept_s, _RAISED_PROBABILITY, is_felt=came_back
        )
