"""Standard messages as the core takes them, from the graph and from bags alike: shapes change here, units do not.

A message is anything with the fields of its type: the classes of rclpy and those of a reader of bags are not the same.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

from jammkle_common import names, wire
from jammkle_common.constants import NANOSECONDS_PER_SECOND
from jammkle_controller.core.imu import ImuSample
from jammkle_controller.core.inputs import AnkleAngles, Input
from jammkle_controller.core.landing import Stored
from jammkle_controller.core.leg_contact import AnkleReading, LegReading
from jammkle_controller.core.slip import BodyTwist, LegPose

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jammkle_controller.core.leg import Leg
    from jammkle_controller.parameters import ControllerParameters

_NOT_MEASURED = -1.0
"""Value of a covariance's first entry that says that the quantity is not measured (sensor_msgs/Imu)."""

_UNSTAMPED = {
    names.FOOT_CONTACT.name: Input.CONTACT_SWITCH,
    names.PLANNED_CONTACT.name: Input.PLANNED_CONTACT,
    names.GAIT_PHASE.name: Input.GAIT_PHASE,
}


COMMANDS_STALE = 15
"""Fault (jammkle_msgs) of a channel that the driver let go since jam_command fell silent."""


class DriverReport(NamedTuple):
    """What the driver reports, as far as the controller decides by it."""

    stored: Stored
    by_stream: bool
    """Whether jam_command holds, or held until it fell silent."""


class Received(NamedTuple):
    """What a controller receives at a time, ns: a sample, reading or report, or the value of an input."""

    time_ns: int
    what: ImuSample | AnkleAngles | AnkleReading | LegReading | LegPose | BodyTwist | DriverReport | Input
    value: float = 0.0


def received_in(
    message: Any, topic: names.Topic, time_ns: int, parameters: ControllerParameters, leg: Leg | None
) -> list[Received]:
    """Return what a controller receives in a message.

    Args:
        message: Of the topic's type.
        topic: What it is, whatever it is called in a bag.
        time_ns: When it came, which counts where it has no stamp.
        parameters: Of the controller: which joints are its leg's, and whether efforts and odometry are read.
        leg: What the leg is, where that is known.

    """
    if topic.name in _UNSTAMPED:
        return [Received(time_ns, _UNSTAMPED[topic.name], float(message.data))]
    at_ns = nanoseconds(message.header.stamp)
    if topic is names.IMU:
        return [Received(at_ns, imu_sample(message))]
    if topic is names.LOAD_CELL:
        return [Received(at_ns, Input.LOAD, load_n(message))]
    if topic is names.ODOMETRY:
        return [Received(at_ns, body_twist(message))]
    if topic is names.JAM_STATE:
        return [Received(at_ns, driver_report(message))]
    hip, knee = parameters.hip_joint, parameters.knee_joint
    readings = (
        ankle_angles(message),
        ankle_reading(message, hip, knee),
        leg_reading(message, hip, knee) if parameters.use_efforts else None,
        leg_pose(message, (leg.abduction, hip, knee)) if leg is not None and parameters.use_odometry else None,
    )
    return [Received(at_ns, each) for each in readings if each is not None]


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


def ankle_angles(message: Any) -> AnkleAngles | None:
    """Return the ankle's roll and, where there is one, pitch (sensor_msgs/JointState); None: the message lacks them."""
    roll, pitch = (_of_joints(message, (joint,), "position") for joint in names.ANKLE_JOINTS[:2])
    return None if roll is None else AnkleAngles(roll[0], math.nan if pitch is None else pitch[0])


def leg_reading(message: Any, hip: str, knee: str) -> LegReading | None:
    """Return angles, rates and efforts of hip and knee (sensor_msgs/JointState); None: the message lacks some."""
    values = _of_joints(message, (hip, knee), "position", "velocity", "effort")
    return None if values is None else LegReading(*values)


def ankle_reading(message: Any, hip: str, knee: str) -> AnkleReading | None:
    """Return angles and rates of the ankle, hip and knee (sensor_msgs/JointState); None: the message lacks some."""
    roll, pitch, _ = names.ANKLE_JOINTS
    values = _of_joints(message, (pitch, roll, hip, knee), "position", "velocity")
    if values is None:
        return None
    pitch_rad, roll_rad, _, _, pitch_rad_s, roll_rad_s, hip_rad_s, knee_rad_s = values
    return AnkleReading(pitch_rad, roll_rad, pitch_rad_s, roll_rad_s, hip_rad_s, knee_rad_s)


def leg_pose(message: Any, leg: Sequence[str]) -> LegPose | None:
    """Return angles and rates of abduction, hip, knee and ankle (sensor_msgs/JointState).

    Args:
        message: Of the joints.
        leg: Names of abduction, hip and knee; a leg whose abduction is not among the joints has none.

    Returns:
        None: hip or knee are missing. What there is not of the ankle is NaN.

    """
    roll, pitch, yaw = names.ANKLE_JOINTS
    joints = (*leg, pitch, roll, yaw)
    measured = [joint for joint in joints if joint in message.name]
    values = _of_joints(message, measured, "position", "velocity") if {*leg[1:]} <= {*measured} else None
    if values is None:
        return None
    angles = dict(zip(measured, values[: len(measured)], strict=True))
    rates = dict(zip(measured, values[len(measured) :], strict=True))
    absent = {leg[0]: 0.0}
    return LegPose(*(of.get(joint, absent.get(joint, math.nan)) for of in (angles, rates) for joint in joints))


def _of_joints(message: Any, joints: Sequence[str], *fields: str) -> list[float] | None:
    """Return the values of joints, field by field (sensor_msgs/JointState); None: the message lacks some."""
    known = list(message.name)
    if not {*joints} <= {*known}:
        return None
    places = [known.index(joint) for joint in joints]
    columns = [getattr(message, field) for field in fields]
    if any(len(column) <= max(places) for column in columns):
        return None
    return [float(column[place]) for column in columns for place in places]


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


def driver_report(message: Any) -> DriverReport:
    """Read what the driver reports (jammkle_msgs/JamState); what is not measured, or old bags lack, is nothing."""
    vacuum_pa, reservoir_m3 = float(message.manifold_vacuum_pa), float(getattr(message, "reservoir_volume_m3", 0.0))
    by_stream = any(
        getattr(each, "fault", 0) == COMMANDS_STALE
        or (each.commanded_vacuum_pa > 0.0 and each.reason.endswith(names.JAM_COMMAND.name))
        for each in message.channels
    )
    return DriverReport(Stored(max(vacuum_pa, 0.0) if math.isfinite(vacuum_pa) else 0.0, reservoir_m3), by_stream)
