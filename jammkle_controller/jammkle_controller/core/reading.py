"""Standard messages as the core takes them, from the graph and from bags alike: shapes change here, units do not.

A message is anything with the fields of its type: the classes of rclpy and those of a reader of bags are not the same.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from jammkle_common import wire
from jammkle_common.constants import NANOSECONDS_PER_SECOND
from jammkle_common.names import ANKLE_JOINTS
from jammkle_controller.core.imu import ImuSample
from jammkle_controller.core.leg_contact import AnkleReading, LegReading
from jammkle_controller.core.slip import BodyTwist, LegPose

if TYPE_CHECKING:
    from collections.abc import Sequence

_NOT_MEASURED = -1.0
"""Value of a covariance's first entry that says that the quantity is not measured (sensor_msgs/Imu)."""


def nanoseconds(stamp: Any) -> int:
    """Return a stamp (builtin_interfaces/Time) as whole nanoseconds."""
    return int(stamp.sec * NANOSECONDS_PER_SECOND + stamp.nanosec)


def imu_sample(message: Any) -> ImuSample:
    """Read an IMU message (sensor_msgs/Imu).

    An IMU without an accelerometer gives NaN, which the core ignores and counts; one without a gyro gives zero rate,
    which costs some slip detection and nothing else.
    """
    force = message.linear_acceleration
    rate = message.angular_velocity
    sample = ImuSample(nanoseconds(message.header.stamp), force.x, force.y, force.z, rate.x, rate.y, rate.z)
    return _measured(sample, message.linear_acceleration_covariance[0], message.angular_velocity_covariance[0])


def imu_sample_of(measured: wire.Measured) -> ImuSample:
    """Return the same of an IMU message that was read from its bytes."""
    values = measured.values
    sample = ImuSample(measured.time_ns, *values[wire.IMU_FORCE], *values[wire.IMU_RATE])
    return _measured(sample, values[wire.IMU_FORCE_COVARIANCE][0], values[wire.IMU_RATE_COVARIANCE][0])


def _measured(sample: ImuSample, force_variance: float, rate_variance: float) -> ImuSample:
    """Leave out of a sample what its covariances say was not measured."""
    if force_variance == _NOT_MEASURED:
        return sample._replace(force_x=math.nan)
    if rate_variance == _NOT_MEASURED:
        return sample._replace(rate_x=0.0, rate_y=0.0, rate_z=0.0)
    return sample


def load_n(message: Any) -> float:
    """Return the load on the foot, N, positive: the cell between rig and leg reads tension as positive."""
    return -float(message.wrench.force.z)


def load_n_of(measured: wire.Measured) -> float:
    """Return the same of a message that was read from its bytes."""
    return -measured.values[wire.WRENCH_FORCE_Z]


def joint_position(message: Any, joint: str) -> float | None:
    """Return the position of a joint (sensor_msgs/JointState), rad; None: the message does not hold it."""
    names = list(message.name)
    if joint not in names:
        return None
    index = names.index(joint)
    return float(message.position[index]) if index < len(message.position) else None


def leg_reading(message: Any, hip: str, knee: str) -> LegReading | None:
    """Return angles, rates and efforts of hip and knee (sensor_msgs/JointState); None: the message lacks some."""
    names = list(message.name)
    if hip not in names or knee not in names:
        return None
    places = names.index(hip), names.index(knee)
    columns = (message.position, message.velocity, message.effort)
    if any(len(column) <= max(places) for column in columns):
        return None
    return LegReading(*(float(column[place]) for column in columns for place in places))


def ankle_reading(message: Any, hip: str, knee: str) -> AnkleReading | None:
    """Return angles and rates of the ankle, and its shank's (sensor_msgs/JointState); None: the message lacks some."""
    names = list(message.name)
    roll, pitch, _ = ANKLE_JOINTS
    if not {roll, pitch, hip, knee} <= set(names):
        return None
    places = [names.index(joint) for joint in (pitch, roll, hip, knee)]
    if min(len(message.position), len(message.velocity)) <= max(places):
        return None
    pitch_rad, roll_rad = (float(message.position[place]) for place in places[:2])
    pitch_rad_s, roll_rad_s, hip_rad_s, knee_rad_s = (float(message.velocity[place]) for place in places)
    return AnkleReading(pitch_rad, roll_rad, pitch_rad_s, roll_rad_s, hip_rad_s + knee_rad_s)


def leg_pose(message: Any, leg: Sequence[str]) -> LegPose | None:
    """Return angles and rates of abduction, hip, knee and ankle (sensor_msgs/JointState).

    Args:
        message: Of the joints.
        leg: Names of abduction, hip and knee; a leg whose abduction is not among the joints has none.

    Returns:
        None: hip or knee are missing. What there is not of the ankle is NaN.

    """
    names = list(message.name)
    roll, pitch, yaw = ANKLE_JOINTS
    if not set(leg[1:]) <= set(names):
        return None
    places = [names.index(joint) if joint in names else -1 for joint in (*leg, pitch, roll, yaw)]
    if min(len(message.position), len(message.velocity)) <= max(places):
        return None
    absent = (0.0, *(math.nan,) * (len(places) - 1))
    columns = (message.position, message.velocity)
    return LegPose(
        *(
            float(column[place]) if place >= 0 else missing
            for column in columns
            for place, missing in zip(places, absent, strict=True)
        )
    )


def body_twist(message: Any) -> BodyTwist:
    """Read an odometry (nav_msgs/Odometry): its twist is in the frame of the body, child_frame_id.

    Its spread is the root of the largest of the three variances of the velocity; where they are zero it is not known.
    """
    speed, rate = message.twist.twist.linear, message.twist.twist.angular
    variance = max(float(message.twist.covariance[7 * axis]) for axis in range(3))
    return BodyTwist(
        nanoseconds(message.header.stamp),
        (float(speed.x), float(speed.y), float(speed.z)),
        (float(rate.x), float(rate.y), float(rate.z)),
        math.sqrt(variance) if 0.0 < variance < math.inf else 0.0,
    )
