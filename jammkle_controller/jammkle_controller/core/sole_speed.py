"""How fast the sole of a foot goes over the ground, from the body's own speed and the joints between both."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

LEVEL_M = 0.003
"""Corners of the sole that are higher than the lowest one by this count by 1/e, m: a body that is 0.03 rad (1.7 deg)
off the ground's own slope sees those of a foot of 0.1 m so far apart."""

Vector = tuple[float, float, float]
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
    """Standard deviation of that velocity, per axis; 0: not told."""


@dataclass(frozen=True)
class LegGeometry:
    """Where a leg is on the body, and how long its parts are."""

    hip_m: Vector
    """Of the axis of abduction, or of the hip where there is none, in the frame of the body's twist."""
    offset_m: float
    """From there to the left to the plane of the leg."""
    thigh_m: float
    shank_m: float
    lean_rad: float
    """Pitch of the ankle's frame against the shank's: the shank's lean as it stands."""
    toe_m: float
    heel_m: float
    half_width_m: float
    sole_m: float
    """From the ankle's joint to the corners of the sole: forward, backward, to both sides, down."""


def sole_velocity_m_s(leg: LegGeometry, pose: LegPose, twist: BodyTwist) -> Vector:
    """Return the velocity over the ground of what a foot stands on, in the body's frame, m/s.

    Rigid bodies in a row: with every joint the angular velocity grows by the joint's, and along every link the velocity
    by w x r, which is v + w x r + J(q) q' of the leg as a whole (leg odometry, as of Bloesch et al., "State Estimation
    for Legged Robots on Unstable and Slippery Terrain", IROS 2013, solved for the foot). It stands on its lowest
    corners: what it turns about is not sliding. Where the ankle is not measured the sole is taken to be its joint.
    """
    turning = twist.angular_rad_s
    speed = _sum(twist.linear_m_s, _cross(turning, leg.hip_m))
    frame = _about_x(_UPRIGHT, pose.abduction_rad)
    turning = _grown(turning, frame[0], pose.abduction_rad_s)
    speed = _sum(speed, _cross(turning, _scaled(frame[1], leg.offset_m)))
    frame = _about_y(frame, pose.hip_rad)
    turning = _grown(turning, frame[1], pose.hip_rad_s)
    speed = _sum(speed, _cross(turning, _scaled(frame[2], -leg.thigh_m)))
    frame = _about_y(frame, pose.knee_rad)
    turning = _grown(turning, frame[1], pose.knee_rad_s)
    speed = _sum(speed, _cross(turning, _scaled(frame[2], -leg.shank_m)))
    if not math.isfinite(sum((*pose[3:6], *pose[9:12]))):
        return speed
    turning = _grown(turning, frame[1], pose.pitch_rad_s)
    frame = _about_y(frame, leg.lean_rad + pose.pitch_rad)
    turning = _grown(turning, frame[0], pose.roll_rad_s)
    frame = _about_x(frame, pose.roll_rad)
    turning = _grown(turning, frame[2], pose.yaw_rad_s)
    return _sum(speed, _cross(turning, _stood_on(leg, _about_z(frame, pose.yaw_rad))))


def _stood_on(leg: LegGeometry, foot: _Frame) -> Vector:
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


def _sum(a: Vector, b: Vector) -> Vector:
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


def _scaled(a: Vector, by: float) -> Vector:
    return (a[0] * by, a[1] * by, a[2] * by)


def _grown(a: Vector, b: Vector, by: float) -> Vector:
    return (a[0] + b[0] * by, a[1] + b[1] * by, a[2] + b[2] * by)


def _cross(a: Vector, b: Vector) -> Vector:
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])
