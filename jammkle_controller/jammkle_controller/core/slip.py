"""Slips: felt on the IMU of a body that stands, and seen in the speed of the sole, by odometry and joints."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from jammkle_common.constants import NANOSECONDS_PER_SECOND, STANDARD_GRAVITY_M_S2
from jammkle_controller.core.events import M_S, ContactEvent, ContactKind, Source
from jammkle_controller.core.motion import ZERO, at_lever, combine, cross, dot, integrated, scaled, towards, turned
from jammkle_controller.core.stepping import between_s, probability_of

if TYPE_CHECKING:
    from jammkle_controller.core.imu import ImuSample
    from jammkle_controller.core.leg import Leg
    from jammkle_controller.core.motion import Motion, Vector
    from jammkle_controller.parameters import ControllerParameters

    _Frame = tuple[Vector, Vector, Vector]

TREND_TIME_S = 0.015
"""Time constant of the trend that a step is measured against, s. A sway of amplitude a at f Hz deviates from its own
trend by a (2 pi f 0.015)^2: a body that sways by 10 mm at 3 Hz (3.6 m/s^2) by 0.28 m/s^2."""

SPREAD_TIME_S = 0.5
STEP_M_S2 = 0.4
"""Least step of the acceleration that may be a slip, m/s^2: a body that sways by 10 mm at 3 Hz makes 0.28 m/s^2."""
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

LANDED_SPEED_M_S = 0.25
"""Speed along the ground after an impact that is a slip of a foot that has not stood, m/s."""
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


class SlipDetector:
    """Looks for a step in the specific force that becomes a speed of the sole.

    Friction that breaks away leaves a step in the acceleration (Coulomb), which swaying does not have. The jump test of
    a linear trend (Basseville and Nikiforov, "Detection of Abrupt Changes", 1993, section 2.4; the trend is Brown's
    double exponential smoothing) finds its onset:

        d = f - (2 s1 - s2),   s1 and s2 the once and twice smoothed f;   |d| > max(STEP_M_S2, STEP_SPREADS rms(d))

    From there on what gravity and the level before the step do not explain is integrated, turned with the gyro, and the
    speed of the sole is that of the IMU less what turning about the sole makes of it (the contact constraint of a rigid
    link: v_sole = v + w x lever):

        v' = -w x v + (f - r) - v / LEAK_TIME_S

    It slips when that speed, as long as the acceleration goes on in the direction of the step, exceeds
    `slip_speed_m_s`.
    Sliding at constant speed is invisible to an IMU, and so is an onset slower than the trend.
    """

    def __init__(self, parameters: ControllerParameters) -> None:
        """Make a detector that is not watching yet."""
        self.parameters = parameters
        self.lever_m = ZERO
        """From the IMU to the sole in the IMU's frame, m: turning about the sole is then no sliding."""
        self.watches = False
        """Whether the foot has stood, so that any sliding from there is seen."""
        self._spread = 0.0
        self.release()

    def plant(self, sample: ImuSample) -> None:
        """Begin to watch: the foot rests, so `sample` shows gravity."""
        force = (sample.force_x, sample.force_y, sample.force_z)
        self._once = self._twice = self._steady = force
        self._spread = 0.0
        self.watches = True
        self._landed_ns: int | None = None
        self._forget_step()

    def land(self, time_ns: int) -> None:
        """Begin to watch a foot that has just hit the ground and may slide without having stood."""
        self.release()
        self._landed_ns = time_ns

    def release(self) -> None:
        """Stop watching: the foot is off the ground."""
        self._once = self._twice = self._steady = ZERO
        self.watches = False
        self._landed_ns = None
        self._forget_step()

    def _forget_step(self) -> None:
        self._onset_ns: int | None = None
        self._step: Vector = ZERO
        self._level: Vector = ZERO
        self._velocity: Vector = ZERO
        self._turn_speed: Vector = ZERO
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
        if self.watches:
            return self._after_rest(sample, interval_s, motion, disturbed=disturbed)
        if self._landed_ns is not None:
            return self._after_landing(sample, interval_s, motion)
        return None

    def _after_rest(
        self, sample: ImuSample, interval_s: float, motion: Motion, *, disturbed: bool
    ) -> ContactEvent | None:
        time_ns, x, y, z, _, _, _ = sample
        trend = combine(2.0, self._once, -1.0, self._twice)
        step = (x - trend[0], y - trend[1], z - trend[2])
        size_squared = dot(step, step)
        force = (x, y, z)
        share = interval_s / (interval_s + TREND_TIME_S)
        self._once = towards(self._once, force, share)
        self._twice = towards(self._twice, self._once, share)
        self._steady = towards(self._steady, force, interval_s / (interval_s + STEADY_TIME_S))
        if self._onset_ns is None:
            least = max(STEP_M_S2 * (2.0 if disturbed else 1.0), STEP_SPREADS * math.sqrt(self._spread))
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
        self._level = turned(self._level, sample, interval_s)
        self._integrate(sample, interval_s, self._level)
        lasted_s = between_s(onset_ns, sample.time_ns)
        sole = self._sole_velocity()
        speed = math.sqrt(dot(sole, sole))
        if lasted_s < STEADY_TIME_S:
            return None
        # A foot that slides goes on to speed up; what shakes slows down again within half a period.
        steady = combine(1.0, self._steady, -1.0, self._level)
        if dot(steady, sole) < STEADY_SHARE * STEP_M_S2 * speed or lasted_s > ONSET_VALID_S:
            self._forget_step()
            return None
        if lasted_s < LEAST_STEADY_S:
            return None
        return self._told(sample.time_ns, onset_ns, speed, sole, motion, self.parameters.slip_speed_m_s)

    def _after_landing(self, sample: ImuSample, interval_s: float, motion: Motion) -> ContactEvent | None:
        landed_ns = self._landed_ns or 0
        since_s = between_s(landed_ns, sample.time_ns)
        if since_s < RINGING_S:
            return None
        if since_s > LANDED_S:
            self._landed_ns = None
            return None
        gravity = motion.gravity
        up_squared = dot(gravity, gravity) or 1.0
        upright = dot((sample.force_x, sample.force_y, sample.force_z), gravity) / up_squared
        if self._onset_ns is None:
            self._onset_ns = sample.time_ns
        self._integrate(sample, interval_s, scaled(upright, gravity))  # what goes along the ground is left
        sole = self._sole_velocity()
        speed = math.sqrt(dot(sole, sole))
        return self._told(sample.time_ns, self._onset_ns, speed, sole, motion, LANDED_SPEED_M_S)

    def _integrate(self, sample: ImuSample, interval_s: float, level: Vector) -> None:
        """Take the next sample into the speed: what its specific force is beyond the level, and how it turns."""
        keep = LEAK_TIME_S / (interval_s + LEAK_TIME_S)
        self._velocity = scaled(keep, integrated(self._velocity, level, sample, interval_s))
        self._turn_speed = at_lever(ZERO, self.lever_m, sample)
        if self._begun_turn is None:
            self._begun_turn = self._turn_speed

    def _sole_velocity(self) -> Vector:
        gained = combine(1.0, self._turn_speed, -1.0, self._begun_turn or ZERO)
        return combine(1.0, self._velocity, 1.0, gained)

    def _told(
        self, time_ns: int, onset_ns: int, speed: float, sole: Vector, motion: Motion, limit_m_s: float
    ) -> ContactEvent | None:
        gravity = motion.gravity
        up = dot(sole, gravity) / (math.sqrt(dot(gravity, gravity)) or 1.0)
        if speed <= limit_m_s or up > UPWARD * speed:
            return None
        self.watches = False
        self._landed_ns = None
        self._onset_ns = None
        delay_s, probability = between_s(onset_ns, time_ns), probability_of(1.0 + 2.0 * (speed / limit_m_s - 1.0))
        direction = scaled(1.0 / speed, sole)
        return ContactEvent(ContactKind.SLIP, time_ns, speed, M_S, delay_s, probability, direction=direction)


LEVEL_M = 0.003
"""Corners of the sole that are higher than the lowest one by this count by 1/e, m: a body that is 0.03 rad (1.7 deg)
off the ground's own slope sees those of a foot of 0.1 m so far apart."""

_X, _Y, _Z = 0, 1, 2
_UPRIGHT: _Frame = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


class LegPose(NamedTuple):
    """Angles, rad, and rates, rad/s, of a leg and its ankle, in the order of the joints from the body on.

    Abduction turns about x of the body, hip and knee about y, counted as in `LegReading`; then the ankle's pitch, roll
    and yaw. NaN for the three of the ankle: it is not measured.
    """

    abduction_rad: float
    hip_rad: float
    knee_rad: float
    pitch_rad: float
    roll_rad: float
    yaw_rad: float
    abduction_rad_s: float
    hip_rad_s: float
    knee_rad_s: float
    pitch_rad_s: float
    roll_rad_s: float
    yaw_rad_s: float


class BodyTwist(NamedTuple):
    """How the body moves, in its own frame: x forward, y to the left, z up."""

    time_ns: int
    linear_m_s: Vector
    """Velocity of its origin."""
    angular_rad_s: Vector
    spread_m_s: float = 0.0
    """Standard deviation of that velocity, per axis; 0: not reported."""


def sole_velocity_m_s(leg: Leg, pose: LegPose, twist: BodyTwist) -> Vector:
    """Return the velocity over the ground of what a foot stands on, in the body's frame, m/s.

    Rigid bodies in a row: with every joint the angular velocity grows by the joint's, and along every link the velocity
    by w x r, which is v + w x r + J(q) q' of the leg as a whole (leg odometry, as of Bloesch et al., "State Estimation
    for Legged Robots on Unstable and Slippery Terrain", IROS 2013, solved for the foot). It stands on its lowest
    corners: what it turns about is not sliding. Where the ankle is not measured the sole is taken to be its joint.
    """
    turning, frame = twist.angular_rad_s, _UPRIGHT
    speed = combine(1.0, twist.linear_m_s, 1.0, cross(turning, leg.hip_m))
    for axis, angle_rad, rate_rad_s, along, length_m in (
        (_X, pose.abduction_rad, pose.abduction_rad_s, _Y, leg.offset_m),
        (_Y, pose.hip_rad, pose.hip_rad_s, _Z, -leg.thigh_m),
        (_Y, pose.knee_rad, pose.knee_rad_s, _Z, -leg.shank_m),
    ):
        frame = _turned(frame, axis, angle_rad)
        turning = combine(1.0, turning, rate_rad_s, frame[axis])
        link = scaled(length_m, frame[along])
        speed = combine(1.0, speed, 1.0, cross(turning, link))
    if not math.isfinite(sum((*pose[3:6], *pose[9:12]))):
        return speed
    for axis, angle_rad, rate_rad_s in (
        (_Y, leg.lean_rad + pose.pitch_rad, pose.pitch_rad_s),
        (_X, pose.roll_rad, pose.roll_rad_s),
        (_Z, pose.yaw_rad, pose.yaw_rad_s),
    ):
        frame = _turned(frame, axis, angle_rad)
        turning = combine(1.0, turning, rate_rad_s, frame[axis])
    return combine(1.0, speed, 1.0, cross(turning, _stood_on(leg, frame)))


def _stood_on(leg: Leg, foot: _Frame) -> Vector:
    """Return the middle of the lowest corners, from the ankle's joint."""
    corners = [
        combine(1.0, combine(-leg.sole_m, foot[_Z], forward_m, foot[_X]), left_m, foot[_Y])
        for forward_m in (leg.toe_m, -leg.heel_m)
        for left_m in (leg.half_width_m, -leg.half_width_m)
    ]
    lowest_m = min(corner[2] for corner in corners)
    shares = [math.exp((lowest_m - corner[2]) / LEVEL_M) for corner in corners]
    total = sum(shares)
    x, y, z = (sum(s * c[axis] for s, c in zip(shares, corners, strict=True)) / total for axis in range(3))
    return (x, y, z)


def _turned(frame: _Frame, axis: int, angle_rad: float) -> _Frame:
    """Return a frame turned about one of its own axes."""
    sine, cosine = math.sin(angle_rad), math.cos(angle_rad)
    following, last = (axis + 1) % 3, (axis + 2) % 3
    axes = [*frame]
    axes[following] = combine(cosine, frame[following], sine, frame[last])
    axes[last] = combine(cosine, frame[last], -sine, frame[following])
    return axes[0], axes[1], axes[2]


LEAST_SPREAD_M_S = 0.012
"""However sure an odometry is: rates of joints that are known to 0.02 rad/s, on a leg of 0.3 m and its body's turning,
leave as much."""
SLOW_SPREADS = math.sqrt(2.0 * math.log(10.0))
"""Below so many spreads a speed along the ground is no way: one in ten of a Rayleigh distribution is more."""
UP_SPREADS = 3.29
"""Above so many spreads, up or down, the foot is put down or lifted, whatever it bears: one in a thousand of noise."""
LEAST_WAY_M = 0.002
"""Way beyond what noise explains that is a slip: half of what counts as one in the trial. Chosen, with the two shares
above, on development runs of the quadruped (studies/contact/README.md)."""
FALSE_ALARM_S = 60.0
"""Mean time of stance between two false alarms of white noise alone."""
QUIET_S = 0.03
"""A foot that was slow for so long has stopped, and may slip anew; as slides are separated in the trial."""
LONGEST_S = 0.06
"""Readings further apart than this are not compared, s: a foot slides by 10 mm in it at 0.17 m/s."""
RESTART_S = 1.0
"""A stamp that is earlier by so much is of a clock that was set back; by less, it comes late."""
PROBABILITY = 0.84
"""That a slip which is reported is one: the share on development runs of the quadruped."""
_KEPT = 64
"""Poses that wait for an odometry that comes late: 0.13 s at 500 Hz, 0.64 s at 100 Hz."""
_HIGHEST = 1e3
"""Speeds and rates beyond it are none, m/s and rad/s."""


@dataclass
class OdometryCounts:
    """What came of the odometry."""

    used: int = 0
    not_finite: int = 0
    late: int = 0
    """Stamps that are not after the one before."""
    frozen: int = 0
    unmatched: int = 0
    """Without a pose of the leg just before and after."""


class SoleSlip:
    """Pairs odometry and leg by their stamps, and reports when a foot that stands has gone a way.

    Multivariate cumulative sum (Crosier, Technometrics 30, 1988): with v the velocity of the sole along the body's x
    and y, and k the speed that noise may have,

        c = s + v dt,    s <- c max(0, 1 - k dt / |c|),    a slip at |s| > max(LEAST_WAY_M, h)

    h is such that white noise alone makes one false alarm in FALSE_ALARM_S: from k and h it takes one reading of
    probability exp(-(k + h / dt)^2 / (2 spread^2)) to alarm. The sum begins anew where the foot does not stand, and
    where its sole goes up or down. The body is taken to be along the ground.
    """

    def __init__(self, leg: Leg, parameters: ControllerParameters) -> None:
        """Know the leg, and have received nothing."""
        self._leg = leg
        self.parameters = parameters
        self.counts = OdometryCounts()
        self._poses: deque[tuple[int, LegPose, bool | None]] = deque(maxlen=_KEPT)
        self._waiting: BodyTwist | None = None
        self._twist: BodyTwist | None = None
        self._changed_ns = 0
        self.paired_ns: int | None = None
        """Stamp of the latest speed of the sole that is known; None: none yet."""
        self._rest()

    def _rest(self) -> None:
        self._way_m = (0.0, 0.0)
        self._gone_m = (0.0, 0.0)
        self._since_ns = 0
        self._slides = False
        self._quiet_s = 0.0

    def on_pose(self, pose: LegPose, time_ns: int, *, stands: bool | None) -> ContactEvent | None:
        """Take the leg at a time, and whether its foot stands then; None: that is not known."""
        if not all(abs(value) < _HIGHEST for value in (*pose[:3], *pose[6:9])):  # a NaN is not less than anything
            return None
        if self._poses and time_ns <= self._poses[-1][0]:
            if self._poses[-1][0] - time_ns < RESTART_S * NANOSECONDS_PER_SECOND:
                return None
            self._poses.clear()
        self._poses.append((time_ns, pose, stands))
        waiting, self._waiting = self._waiting, None
        return None if waiting is None else self._match(waiting, time_ns)

    def on_twist(self, twist: BodyTwist, time_ns: int) -> ContactEvent | None:
        """Take an odometry that comes at a time; its own stamp is earlier by its latency."""
        if not all(abs(value) < _HIGHEST for value in (*twist.linear_m_s, *twist.angular_rad_s)):
            self.counts.not_finite += 1
            return None
        before = self._twist
        if before is not None and 0 <= before.time_ns - twist.time_ns < RESTART_S * NANOSECONDS_PER_SECOND:
            self.counts.late += 1
            return None
        self._twist = twist
        if before is None or before[1:3] != twist[1:3] or twist.time_ns < before.time_ns:
            self._changed_ns = twist.time_ns
        if twist.time_ns - self._changed_ns > self.parameters.imu_frozen_s * NANOSECONDS_PER_SECOND:
            self.counts.frozen += 1
            return None
        if not self._poses or twist.time_ns > self._poses[-1][0]:
            self._waiting = twist
            return None
        return self._match(twist, max(time_ns, self._poses[-1][0]))

    def _match(self, twist: BodyTwist, time_ns: int) -> ContactEvent | None:
        """Follow the sole at the stamp of an odometry, with the leg in between two of its poses."""
        after = len(self._poses) - 1
        while after and self._poses[after - 1][0] >= twist.time_ns:
            after -= 1
        end_ns, end, stands = self._poses[after]
        pose = end
        if end_ns > twist.time_ns:
            begin_ns, begin, stood = self._poses[after - 1] if after else (0, end, stands)
            if not after or end_ns - begin_ns > LONGEST_S * NANOSECONDS_PER_SECOND:
                self.counts.unmatched += 1
                return None
            share = (twist.time_ns - begin_ns) / (end_ns - begin_ns)
            pose = LegPose(*(a + (b - a) * share for a, b in zip(begin, end, strict=True)))
            stands = stands if stands is None or stood is None else stands and stood
        if stands is None:
            return None
        before_ns, self.paired_ns = self.paired_ns, twist.time_ns
        self.counts.used += 1
        elapsed_s = 0.0 if before_ns is None else between_s(before_ns, twist.time_ns)
        if not stands or not 0.0 < elapsed_s <= LONGEST_S:
            self._rest()
            return None
        spread_m_s = max(LEAST_SPREAD_M_S, twist.spread_m_s or self.parameters.odometry_spread_m_s)
        velocity = sole_velocity_m_s(self._leg, pose, twist)
        return self._follow(velocity, spread_m_s, elapsed_s, twist.time_ns, time_ns)

    def _follow(
        self, velocity: Vector, spread_m_s: float, elapsed_s: float, stamp_ns: int, time_ns: int
    ) -> ContactEvent | None:
        """Sum the way of a foot that stands."""
        forward_m_s, left_m_s, up_m_s = velocity
        if abs(up_m_s) > UP_SPREADS * spread_m_s:
            self._rest()
            return None
        slow_m_s = SLOW_SPREADS * spread_m_s
        if self._slides:
            is_slow = math.hypot(forward_m_s, left_m_s) < slow_m_s
            self._quiet_s = self._quiet_s + elapsed_s if is_slow else 0.0
            if self._quiet_s >= QUIET_S:
                self._rest()
            return None
        step_m = forward_m_s * elapsed_s, left_m_s * elapsed_s
        way_m = self._way_m[0] + step_m[0], self._way_m[1] + step_m[1]
        size_m = math.hypot(*way_m)
        share = 0.0 if size_m == 0.0 else max(0.0, 1.0 - slow_m_s * elapsed_s / size_m)
        if self._way_m == (0.0, 0.0):
            self._gone_m = (0.0, 0.0)
            self._since_ns = stamp_ns - round(elapsed_s * NANOSECONDS_PER_SECOND)
        self._way_m = way_m[0] * share, way_m[1] * share
        self._gone_m = self._gone_m[0] + step_m[0], self._gone_m[1] + step_m[1]
        if size_m * share <= max(LEAST_WAY_M, noise_way_m(spread_m_s, elapsed_s)):
            return None
        self._slides = True
        gone_s = between_s(self._since_ns, stamp_ns)
        gone_m = math.hypot(*self._gone_m)
        delay_s = between_s(self._since_ns, time_ns)
        direction = (way_m[0] / size_m, way_m[1] / size_m, 0.0)
        return ContactEvent(
            ContactKind.SLIP, time_ns, gone_m / gone_s, M_S, delay_s, PROBABILITY, Source.ODOMETRY, direction
        )


def noise_way_m(spread_m_s: float, elapsed_s: float) -> float:
    """Return the way, m, that white noise of readings so far apart goes once in FALSE_ALARM_S."""
    highest = math.sqrt(2.0 * math.log(FALSE_ALARM_S / elapsed_s))
    return elapsed_s * spread_m_s * max(0.0, highest - SLOW_SPREADS)
