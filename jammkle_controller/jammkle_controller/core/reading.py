"""Standard messages as the core takes them, from the graph and from bags alike: shapes change here, units do not.

A message is anything with the fields of its type: the classes of rclpy and those of a reader of bags are not the same.
"""

from __future__ import annotations

import math
from typing import Any

from jammkle_controller.core.imu import ImuSample
from jammkle_controller.core.leg_load import LegReading
from jammkle_graph import wire
from jammkle_graph.constants import NANOSECONDS_PER_SECOND

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
