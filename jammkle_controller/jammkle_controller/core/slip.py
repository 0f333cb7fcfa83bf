"""Slip detection: a foot that stood picks up speed while the ground still carries it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from jammkle_common.constants import NANOSECONDS_PER_SECOND, STANDARD_GRAVITY_M_S2
from jammkle_controller.core.density_ratio import probability_of
from jammkle_controller.core.events import M_S, ContactEvent, ContactKind

if TYPE_CHECKING:
    from jammkle_controller.core.imu import ImuSample
    from jammkle_controller.core.motion import Motion

TREND_TIME_S = 0.015
"""Time constant of the trend that a step is measured against, s. A sway of amplitude a at f Hz deviates from its own
trend by a (2 pi f 0.015)^2: a body that sways by 10 mm at 3 Hz (3.6 m/s^2) by 0.28 m/s^2."""

SPREAD_TIME_S = 0.5
STEP_SPREADS = 6.0
"""A step stands out by as many root mean squares of what was usual: the rate of false ones of a Gaussian is nil."""

ONSET_VALID_S = 0.3
"""How long a step may take to become a speed, s: 0.1 m/s^2 then has not."""

STEADY_TIME_S = 0.005
STEADY_SHARE = 0.3
"""The acceleration of a foot that slides goes on; one of a vibration has turned round within half a period."""
LEAST_STEADY_S = 0.025
"""Half a period at 20 Hz: what shakes faster has turned round by then, s."""

LEAK_TIME_S = 0.25
"""Time constant with which the speed is forgotten, s: a bias of 0.05 g is then a speed of 0.1 m/s, twice less than the
speed at which a landing foot slides, and a step of 0.2 m/s^2 still becomes one of 0.05 m/s."""

LANDED_S = 0.6
"""Time after an impact in which the foot may slide without having stood, s."""
RINGING_S = 0.05
"""Time after an impact in which it rings and is not integrated, s: three periods at 60 Hz."""

LOADED_M_S2 = 0.5 * STANDARD_GRAVITY_M_S2
"""Below this |specific force| the foot is leaving the ground, not sliding, m/s^2. On a slope of angle a without any
friction the ground still carries g cos(a): half of g is 60 deg."""

UPWARD = 0.5
"""A speed whose upward part is more than this is pushing off or stepping, not sliding; cosine, 60 deg off the
vertical."""

Vector = tuple[float, float, float]
_ZERO: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class SlipSettings:
    """When a foot slides.

    Attributes:
        speed_m_s: Least speed of the sole, m/s; on a body, gained since a step of the acceleration.
        step_m_s2: Least step, m/s^2.
        landed_speed_m_s: Speed along the ground after an impact without any step, m/s.
        probability: That the sole of a foot or shank slides, from which on it is told.
        lever_m: From the IMU to the sole in the IMU's frame, m: turning about the sole is then no sliding.

    """

    speed_m_s: float
    step_m_s2: float
    landed_speed_m_s: float
    probability: float
    lever_m: Vector = _ZERO


class SlipDetector:
    """Looks for a step in the specific force that becomes a speed of the sole.

    Friction that breaks away leaves a step in the acceleration (Coulomb), which swaying does not have. The jump test of
    a linear trend (Basseville and Nikiforov, "Detection of Abrupt Changes", 1993, section 2.4; the trend is Brown's
    double exponential smoothing) finds its onset:

        d = f - (2 s1 - s2),   s1 and s2 the once and twice smoothed f;   |d| > max(step_m_s2, STEP_SPREADS rms(d))

    From there on what gravity and the level before the step do not explain is integrated, turned with the gyro, and the
    speed of the sole is that of the IMU less what turning about the sole makes of it (the contact constraint of a rigid
    link: v_sole = v + w x lever):

        v' = -w x v + (f - r) - v / LEAK_TIME_S

    It slips when that speed, as long as the acceleration goes on in the direction of the step, exceeds `speed_m_s`.
    Sliding at constant speed is invisible to an IMU, and so is an onset slower than the trend.
    """

    def __init__(self, settings: SlipSettings) -> None:
        """Make a detector that is not watching yet."""
        self.settings = settings
        self._spread = 0.0
        self.release()

    @property
    def watching(self) -> bool:
        """Whether the foot has stood, so that any sliding from there is seen."""
        return self._stood

    def plant(self, sample: ImuSample) -> None:
        """Begin to watch: the foot rests, so `sample` shows gravity."""
        force = (sample.force_x, sample.force_y, sample.force_z)
        self._once = self._twice = self._steady = force
        self._spread = 0.0
        self._stood = True
        self._landed_ns: int | None = None
        self._forget_step()

    def land(self, time_ns: int) -> None:
        """Begin to watch a foot that has just hit the ground and may slide without having stood."""
        self.release()
        self._landed_ns = time_ns

    def release(self) -> None:
        """Stop watching: the foot is off the ground."""
        self._once = self._twice = self._steady = _ZERO
        self._stood = False
        self._landed_ns = None
        self._forget_step()

    def _forget_step(self) -> None:
        self._onset_ns: int | None = None
        self._step: Vector = _ZERO
        self._level: Vector = _ZERO
        self._velocity: Vector = _ZERO
        self._turn_speed: Vector = _ZERO
        self._begun_turn: Vector | None = None

    def on_ground(
        self, sample: ImuSample, interval_s: float, motion: Motion, *, disturbed: bool = False
    ) -> ContactEvent | None:
        """Take the next sample of a foot on the ground; return a slip if it slides.

        Args:
            sample: What the IMU reads.
            interval_s: Since the one before, s.
            motion: Of the same sample.
            disturbed: The ankle itself is jolting it: only a step twice as large counts.

        """
        if motion.force_m_s2 < LOADED_M_S2:
            self._forget_step()
            return None
        if self._stood:
            return self._after_rest(sample, interval_s, motion, disturbed=disturbed)
        if self._landed_ns is not None:
            return self._after_landing(sample, interval_s, motion)
        return None

    def _after_rest(
        self, sample: ImuSample, interval_s: float, motion: Motion, *, disturbed: bool
    ) -> ContactEvent | None:
        time_ns, x, y, z, _, _, _ = sample
        trend = _combine(2.0, self._once, -1.0, self._twice)
        step = (x - trend[0], y - trend[1], z - trend[2])
        size_squared = _dot(step, step)
        force = (x, y, z)
        share = interval_s / (interval_s + TREND_TIME_S)
        self._once = _towards(self._once, force, share)
        self._twice = _towards(self._twice, self._once, share)
        self._steady = _towards(self._steady, force, interval_s / (interval_s + STEADY_TIME_S))
        if self._onset_ns is None:
            least = max(self.settings.step_m_s2 * (2.0 if disturbed else 1.0), STEP_SPREADS * math.sqrt(self._spread))
            if size_squared < least * least:
                self._spread += (size_squared - self._spread) * interval_s / (interval_s + SPREAD_TIME_S)
                return None
            self._onset_ns = time_ns
            self._level = trend
            self._step = step
        return self._follow_step(sample, interval_s, motion)

    def _follow_step(self, sample: ImuSample, interval_s: float, motion: Motion) -> ContactEvent | None:
        onset_ns = self._onset_ns or sample.time_ns
        # The level before the step turns against the body, r' = -w x r: a body that tilts does not slide.
        turned = _cross(self._level, (sample.rate_x, sample.rate_y, sample.rate_z))
        self._level = _combine(1.0, self._level, interval_s, turned)
        excess = (sample.force_x - self._level[0], sample.force_y - self._level[1], sample.force_z - self._level[2])
        self._integrate(sample, interval_s, excess)
        lasted_s = (sample.time_ns - onset_ns) / NANOSECONDS_PER_SECOND
        sole = self._sole_velocity()
        speed = math.sqrt(_dot(sole, sole))
        if lasted_s < STEADY_TIME_S:
            return None
        # A foot that slides goes on to speed up; what shakes slows down again within half a period.
        steady = _combine(1.0, self._steady, -1.0, self._level)
        if _dot(steady, sole) < STEADY_SHARE * self.settings.step_m_s2 * speed or lasted_s > ONSET_VALID_S:
            self._forget_step()
            return None
        if lasted_s < LEAST_STEADY_S:
            return None
        return self._told(sample.time_ns, onset_ns, speed, sole, motion, self.settings.speed_m_s)

    def _after_landing(self, sample: ImuSample, interval_s: float, motion: Motion) -> ContactEvent | None:
        landed_ns = self._landed_ns or 0
        since_s = (sample.time_ns - landed_ns) / NANOSECONDS_PER_SECOND
        if since_s < RINGING_S:
            return None
        if since_s > LANDED_S:
            self._landed_ns = None
            return None
        gravity = motion.gravity
        up_squared = _dot(gravity, gravity) or 1.0
        excess = (sample.force_x - gravity[0], sample.force_y - gravity[1], sample.force_z - gravity[2])
        along = _dot(excess, gravity) / up_squared
        level = _combine(1.0, excess, -along, gravity)
        if self._onset_ns is None:
            self._onset_ns = sample.time_ns
        self._integrate(sample, interval_s, level)
        sole = self._sole_velocity()
        speed = math.sqrt(_dot(sole, sole))
        return self._told(sample.time_ns, self._onset_ns, speed, sole, motion, self.settings.landed_speed_m_s)

    def _integrate(self, sample: ImuSample, interval_s: float, excess: Vector) -> None:
        rate = (sample.rate_x, sample.rate_y, sample.rate_z)
        turned = _cross(self._velocity, rate)
        keep = LEAK_TIME_S / (interval_s + LEAK_TIME_S)
        vx, vy, vz = self._velocity
        self._velocity = (
            keep * (vx + interval_s * (turned[0] + excess[0])),
            keep * (vy + interval_s * (turned[1] + excess[1])),
            keep * (vz + interval_s * (turned[2] + excess[2])),
        )
        self._turn_speed = _cross(rate, self.settings.lever_m)
        if self._begun_turn is None:
            self._begun_turn = self._turn_speed

    def _sole_velocity(self) -> Vector:
        begun = self._begun_turn or _ZERO
        gained = _combine(1.0, self._turn_speed, -1.0, begun)
        return _combine(1.0, self._velocity, 1.0, gained)

    def _told(
        self, time_ns: int, onset_ns: int, speed: float, sole: Vector, motion: Motion, limit_m_s: float
    ) -> ContactEvent | None:
        gravity = motion.gravity
        up = _dot(sole, gravity) / (math.sqrt(_dot(gravity, gravity)) or 1.0)
        if speed <= limit_m_s or up > UPWARD * speed:
            return None
        self._stood = False
        self._landed_ns = None
        self._onset_ns = None
        return ContactEvent(
            ContactKind.SLIP,
            time_ns,
            speed,
            M_S,
            (time_ns - onset_ns) / NANOSECONDS_PER_SECOND,
            probability_of(1.0 + 2.0 * (speed / limit_m_s - 1.0)),
            direction=(sole[0] / speed, sole[1] / speed, sole[2] / speed),
        )


def _dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a: Vector, b: Vector) -> Vector:
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def _combine(p: float, a: Vector, q: float, b: Vector) -> Vector:
    return (p * a[0] + q * b[0], p * a[1] + q * b[1], p * a[2] + q * b[2])


def _towards(a: Vector, b: Vector, share: float) -> Vector:
    return (a[0] + (b[0] - a[0]) * share, a[1] + (b[1] - a[1]) * share, a[2] + (b[2] - a[2]) * share)
