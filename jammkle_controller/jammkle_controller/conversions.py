"""From the controller's core to ROS messages, and from the driver's: with `core.reading` the one place for that.

Units agree on both sides (SI, and vacuum is gauge and positive in both), so only shapes change here.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from jammkle_common.constants import NANOSECONDS_PER_SECOND
from jammkle_common.names import CHANNEL_JAMS, JAM_COMMAND, UNJAM, UNJAM_ALL
from jammkle_controller.core.contact import Contact
from jammkle_controller.core.driver_view import DriverView, Hold
from jammkle_controller.core.events import ContactEvent, ContactKind
from jammkle_msgs.msg import ChannelJamCommand, ChannelJamState, ContactState, Fault, JamCommand
from jammkle_msgs.msg import ContactEvent as ContactEventMessage

if TYPE_CHECKING:
    from collections.abc import Mapping

    from builtin_interfaces.msg import Time

    from jammkle_common.messages import Health
    from jammkle_controller.core.contact import ContactReport
    from jammkle_msgs.msg import JamState

_TYPES = {
    ContactKind.IMPACT: ContactEventMessage.IMPACT,
    ContactKind.SLIP: ContactEventMessage.SLIP,
    ContactKind.LIFTOFF: ContactEventMessage.LIFTOFF,
    ContactKind.SWING: ContactEventMessage.SWING,
    ContactKind.SETTLED: ContactEventMessage.SETTLED,
}

_CONTACTS = {
    Contact.UNKNOWN: ContactState.UNKNOWN,
    Contact.CONTACT: ContactState.CONTACT,
    Contact.NO_CONTACT: ContactState.NO_CONTACT,
}

_VENTED_BY_HAND = (UNJAM.name, UNJAM_ALL.name, *(service.name for service in CHANNEL_JAMS.values()))
"""How the reason of a channel ends that somebody has vented by a service of the driver."""


def contact_event_message(event: ContactEvent, frame_id: str) -> ContactEventMessage:
    """Write a contact event, stamped with the sample that decided, in the frame that it was felt in."""
    message = ContactEventMessage()
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(event.time_ns, NANOSECONDS_PER_SECOND)
    message.header.frame_id = frame_id
    message.type = _TYPES[event.kind]
    message.magnitude = event.magnitude
    message.unit = event.unit
    message.detection_delay_s = event.detection_delay_s
    message.probability = event.probability
    message.source = event.source.value
    message.direction.x, message.direction.y, message.direction.z = event.direction
    return message


def jam_command_message(wish: Mapping[str, float], stamp: Time, *, anew: bool = False) -> JamCommand:
    """Write the wish for every channel: vacuum in Pa, gauge, positive; zero vents. `anew`: as on a change."""
    message = JamCommand()
    message.header.stamp = stamp
    message.anew = anew
    message.channels = [ChannelJamCommand(channel=channel, vacuum_pa=vacuum_pa) for channel, vacuum_pa in wish.items()]
    return message


def contact_state_message(report: ContactReport, health: Health, stamp: Time, *, soft: bool) -> ContactState:
    """Write what is known of contact, and whether the ankle is soft in stance."""
    message = ContactState(contact=_CONTACTS[report.contact], shown_by=report.shown_by, at_rest=report.at_rest)
    message.header.stamp = stamp
    message.soft_in_stance = soft
    message.text = health.message
    return message


def driver_view(message: JamState) -> DriverView:
    """Read what the driver says of itself."""
    by_stream = any(
        channel.fault == Fault.COMMANDS_STALE
        or (channel.commanded_vacuum_pa > 0.0 and channel.reason.endswith(JAM_COMMAND.name))
        for channel in message.channels
    )
    vented = [channel for channel in message.channels if channel.commanded_vacuum_pa == 0.0]
    by_hand = tuple(each.channel for each in vented if each.reason.endswith(_VENTED_BY_HAND) and not each.fault)
    return DriverView(
        min_vacuum_pa=message.min_vacuum_pa,
        max_vacuum_pa=message.max_vacuum_pa,
        refused=message.refused_command,
        unfollowed=tuple((each.channel, each.reason) for each in vented if each.channel not in by_hand),
        by_hand=by_hand,
        stopped=message.emergency_stopped,
        hold=Hold.STREAM if by_stream else Hold.NOBODY,
        faulty=tuple(each.channel for each in message.channels if each.state == ChannelJamState.FAULT),
    )
