"""Between ROS messages and the controller's core: the one place where units, signs, frames and enums change.

Units agree on both sides (SI, and vacuum is gauge and positive in both), so only shapes change here.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from jammkle_controller.core.driver_view import DriverView, Hold
from jammkle_controller.core.events import ContactEvent, ContactKind
from jammkle_controller.core.imu import ImuSample
from jammkle_graph.constants import NANOSECONDS_PER_SECOND
from jammkle_graph.names import CHANNELS, JAM_COMMAND
from jammkle_msgs.msg import ChannelJamCommand, Fault, JamCommand
from jammkle_msgs.msg import ContactEvent as ContactEventMessage

if TYPE_CHECKING:
    from builtin_interfaces.msg import Time
    from sensor_msgs.msg import Imu

    from jammkle_msgs.msg import JamState

_NOT_MEASURED = -1.0
"""Value of a covariance's first entry that says that the quantity is not measured (sensor_msgs/Imu)."""

_TYPES = {
    ContactKind.IMPACT: ContactEventMessage.IMPACT,
    ContactKind.SLIP: ContactEventMessage.SLIP,
    ContactKind.LIFTOFF: ContactEventMessage.LIFTOFF,
    ContactKind.SETTLED: ContactEventMessage.SETTLED,
}


def imu_sample(message: Imu) -> ImuSample:
    """Read an IMU message.

    An IMU without an accelerometer gives NaN, which the core ignores and counts; one without a gyro gives zero rate,
    which costs some slip detection and nothing else.
    """
    stamp = message.header.stamp
    force = message.linear_acceleration
    rate = message.angular_velocity
    sample = ImuSample(
        stamp.sec * NANOSECONDS_PER_SECOND + stamp.nanosec, force.x, force.y, force.z, rate.x, rate.y, rate.z
    )
    if message.linear_acceleration_covariance[0] == _NOT_MEASURED:
        return sample._replace(force_x=math.nan)
    if message.angular_velocity_covariance[0] == _NOT_MEASURED:
        return sample._replace(rate_x=0.0, rate_y=0.0, rate_z=0.0)
    return sample


def contact_event_message(event: ContactEvent, frame_id: str) -> ContactEventMessage:
    """Write a contact event, stamped with the sample that decided, in the IMU's frame."""
    message = ContactEventMessage()
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(event.time_ns, NANOSECONDS_PER_SECOND)
    message.header.frame_id = frame_id
    message.type = _TYPES[event.kind]
    message.magnitude = event.magnitude
    message.unit = event.unit
    message.detection_delay_s = event.detection_delay_s
    return message


def jam_command_message(vacuum_pa: float, stamp: Time) -> JamCommand:
    """Write the wish for every channel: vacuum in Pa, gauge, positive; zero vents."""
    message = JamCommand()
    message.header.stamp = stamp
    message.channels = [ChannelJamCommand(channel=channel, vacuum_pa=vacuum_pa) for channel in CHANNELS]
    return message


def driver_view(message: JamState) -> DriverView:
    """Read what the driver says of itself."""
    by_stream = any(
        channel.fault == Fault.COMMANDS_STALE
        or (channel.commanded_vacuum_pa > 0.0 and channel.reason.endswith(JAM_COMMAND.name))
        for channel in message.channels
    )
    return DriverView(
        min_vacuum_pa=message.min_vacuum_pa,
        max_vacuum_pa=message.max_vacuum_pa,
        refused=message.refused_command,
        unfollowed=tuple((c.channel, c.reason) for c in message.channels if c.commanded_vacuum_pa == 0.0),
        stopped=message.emergency_stopped,
        hold=Hold.STREAM if by_stream else Hold.NOBODY,
    )
