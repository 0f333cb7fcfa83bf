"""A leg of two links: the load on its foot from efforts, and the speed of its sole from odometry and joints."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from jammkle_common.constants import NANOSECONDS_PER_SECOND, STANDARD_GRAVITY_M_S2
from jammkle_controller.core.motion import ZERO, Vector, cross

FOLLOW_TIME_S = 0.003
"""Time constant with which the load follows, s: two looks at 500 Hz, so that the noise of one rate does not count."""
LONGEST_S = 0.05
"""Readings further apart than this are not compared, s: a torque changes in between."""
LEAST_BEND = 0.1
"""Sine of the knee's angle below which a straight leg hides the load: torques do not show it there. Six degrees."""
_HIGHEST = 1e4
"""Angles, rates and efforts beyond it are none, rad, rad/s, N m."""


class LegReading(NamedTuple):
    """Angles, rad, rates, rad/s, and efforts, N m, of hip and knee: counted from straight down and from the thigh.

    An angle about y, to the left, turns what hangs down backward. An effort is that of the servo on the joint, in the
    mean since the last control step, as drives report it.
    """

    hip_rad: float
    knee_rad: float
    hip_rad_s: float
    knee_rad_s: float
    hip_n_m: float
    knee_n_m: float


@dataclass(frozen=True)
class Leg:
    """A leg of two links that hang down, and where it is on the body: what `robot_description` says of it."""

    thigh_m: float
    """From hip to knee."""
    shank_m: float
    """From knee to the ankle's joint."""
    thigh_kg: float
    """Taken for a rod."""
    shank_kg: float
    """With ankle and foot; taken for a rod."""
    shank_centre_m: float
    """From the knee to the centre of that mass."""
    abduction: str = ""
    """Name of the joint above the hip in joint_states, which turns about x; empty: there is none."""
    hip_m: Vector = ZERO
    """Of the axis of abduction, or of the hip where there is none, in base_link, the frame of the body's twist."""
    offset_m: float = 0.0
    """From there to the left to the plane of the leg."""
    lean_rad: float = 0.0
    """Pitch of the ankle's frame against the shank's: the shank's lean as it stands."""
    toe_m: float = 0.0
    heel_m: float = 0.0
    half_width_m: float = 0.0
    sole_m: float = 0.0
    """From the ankle's joint to the corners of the sole: forward, backward, to both sides, down."""
    lever_m: Vector = ZERO
    """From the IMU to the middle of the sole, in the IMU's frame."""


class LegLoad:
    """Observes the force on a foot by the generalised momentum of its leg.

    With p = M(q) q' of a double pendulum, the torques that no servo makes are a first-order low-pass of
    p' - tau - C^T q' + g (De Luca, Albu-Schaeffer, Haddadin, Hirzinger, "Collision Detection and Safe Reaction with the
    DLR-III Lightweight Manipulator Arm", IROS 2006), here over the interval between two readings:

        r <- r + ((p1 - p0) / dt - mean(tau + C^T q' - g) - r) dt / (dt + FOLLOW_TIME_S),    r = J^T F

    The hip is taken as unaccelerated and upright, which leaves some newtons in a swing (`inputs.SPREAD_N`), and
    the force as acting at the ankle: what its tendons bear of a force at toe or heel is some newtons in a stance.
    """

    def __init__(self, leg: Leg, armature_kg_m2: float) -> None:
        """Know the leg, and the inertia of its motors behind their gears."""
        self._leg = leg
        self._armature_kg_m2 = armature_kg_m2
        rod = 4.0 / 3.0  # of a rod about its end, in units of its mass by its centre's distance squared
        self._coupling = leg.shank_kg * leg.thigh_m * leg.shank_centre_m
        self._shank = rod * leg.shank_kg * leg.shank_centre_m**2
        self._both = leg.thigh_m**2 * (leg.thigh_kg / 3.0 + leg.shank_kg) + self._shank + armature_kg_m2
        self._thigh_weight_n_m = STANDARD_GRAVITY_M_S2 * leg.thigh_m * (leg.thigh_kg / 2.0 + leg.shank_kg)
        self._shank_weight_n_m = STANDARD_GRAVITY_M_S2 * leg.shank_kg * leg.shank_centre_m
        self._before: tuple[int, float, float, float, float] | None = None
        self._hip_n_m = self._knee_n_m = 0.0

    def update(self, reading: LegReading, time_ns: int) -> float | None:
        """Return how hard the ground presses up on the foot, N, at a reading; None: it is not known now."""
        if not all(abs(value) < _HIGHEST for value in reading):  # a NaN is not less than anything
            return None
        hip, knee, hip_rate, knee_rate, hip_n_m, knee_n_m = reading
        sine, cosine = math.sin(knee), math.cos(knee)
        both = self._shank + self._coupling * cosine
        momentum = (self._both + 2.0 * self._coupling * cosine) * hip_rate + both * knee_rate
        knee_momentum = both * hip_rate + (self._shank + self._armature_kg_m2) * knee_rate
        weight_n_m = self._shank_weight_n_m * math.sin(hip + knee)
        pull = hip_n_m - self._thigh_weight_n_m * math.sin(hip) - weight_n_m
        knee_pull = knee_n_m - weight_n_m - self._coupling * sine * hip_rate * (hip_rate + knee_rate)
        before, self._before = self._before, (time_ns, momentum, knee_momentum, pull, knee_pull)
        if before is None:
            return None
        elapsed_s = (time_ns - before[0]) / NANOSECONDS_PER_SECOND
        if not 0.0 < elapsed_s <= LONGEST_S:
            return None
        share = elapsed_s / (elapsed_s + FOLLOW_TIME_S)
        unexplained = (momentum - before[1]) / elapsed_s - (pull + before[3]) / 2.0
        knee_unexplained = (knee_momentum - before[2]) / elapsed_s - (knee_pull + before[4]) / 2.0
        self._hip_n_m += (unexplained - self._hip_n_m) * share
        self._knee_n_m += (knee_unexplained - self._knee_n_m) * share
        # r = J^T F solved for the upward part, with both torques: what rubs along the ground does not count.
        if abs(sine) < LEAST_BEND:
            return None
        leg = self._leg
        shank_m = leg.shank_m * math.cos(hip + knee)
        both_m = leg.thigh_m * math.cos(hip) + shank_m
        return (both_m * self._knee_n_m - shank_m * self._hip_n_m) / (leg.thigh_m * leg.shank_m * sine)


LEVEL_M = 0.003
"""Corners of the sole that are higher than the lowest one by this count by 1/e, m: a body that is 0.03 rad (1.7 deg)
off the ground's own slope sees those of a foot of 0.1 m so far apart."""

_Frame = tuple[Vector, Vector, Vector]
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
    turning = twist.angular_rad_s
    speed = _plus(twist.linear_m_s, cross(turning, leg.hip_m))
    frame = _about_x(_UPRIGHT, pose.abduction_rad)
    turning = _grown(turning, frame[0], pose.abduction_rad_s)
    speed = _plus(speed, cross(turning, _scaled(frame[1], leg.offset_m)))
    frame = _about_y(frame, pose.hip_rad)
    turning = _grown(turning, frame[1], pose.hip_rad_s)
    speed = _plus(speed, cross(turning, _scaled(frame[2], -leg.thigh_m)))
    frame = _about_y(frame, pose.knee_rad)
    turning = _grown(turning, frame[1], pose.knee_rad_s)
    speed = _plus(speed, cross(turning, _scaled(frame[2], -leg.shank_m)))
    if not math.isfinite(sum((*pose[3:6], *pose[9:12]))):
        return speed
    turning = _grown(turning, frame[1], pose.pitch_rad_s)
    frame = _about_y(frame, leg.lean_rad + pose.pitch_rad)
    turning = _grown(turning, frame[0], pose.roll_rad_s)
    frame = _about_x(frame, pose.roll_rad)
    turning = _grown(turning, frame[2], pose.yaw_rad_s)
    return _plus(speed, cross(turning, _stood_on(leg, _about_z(frame, pose.yaw_rad))))


def _stood_on(leg: Leg, foot: _Frame) -> Vector:
    """Return the middle of the lowest corners, from the ankle's joint."""
    down = _scaled(foot[2], -leg.sole_m)
    corners = [
        _grown(_grown(down, foot[0], forward_m), foot[1], left_m)
        for forward_m in (leg.toe_m, -leg.heel_m)
        for left_m in (leg.half_width_m, -leg.half_width_m)
    ]
    lowest_m = min(corner[2] for corner in corners)
    shares = [math.exp((lowest_m - corner[2]) / LEVEL_M) for corner in corners]
    total = sum(shares)
    x, y, z = (sum(s * c[axis] for s, c in zip(shares, corners, strict=True)) / total for axis in range(3))
    return (x, y, z)


def _about_x(frame: _Frame, angle_rad: float) -> _Frame:
    x, y, z = frame
    sine, cosine = math.sin(angle_rad), math.cos(angle_rad)
    return x, _grown(_scaled(y, cosine), z, sine), _grown(_scaled(z, cosine), y, -sine)


def _about_y(frame: _Frame, angle_rad: float) -> _Frame:
    x, y, z = frame
    sine, cosine = math.sin(angle_rad), math.cos(angle_rad)
    return _grown(_scaled(x, cosine), z, -sine), y, _grown(_scaled(z, cosine), x, sine)


def _about_z(frame: _Frame, angle_rad: float) -> _Frame:
    x, y, z = frame
    sine, cosine = math.sin(angle_rad), math.cos(angle_rad)
    return _grown(_scaled(x, cosine), y, sine), _grown(_scaled(y, cosine), x, -sine), z


def _plus(a: Vector, b: Vector) -> Vector:
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


def _scaled(a: Vector, by: float) -> Vector:
    return (a[0] * by, a[1] * by, a[2] * by)


def _grown(a: Vector, b: Vector, by: float) -> Vector:
    return (a[0] + b[0] * by, a[1] + b[1] * by, a[2] + b[2] * by)
