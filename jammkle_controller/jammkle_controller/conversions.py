"""From the controller's core to ROS messages, and from the driver's: with `core.reading` the one place for that.

Units agree on both sides (SI, and vacuum is gauge and positive in both), so only shapes change here. Kinds of event and
values of contact have the same names on both sides.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from jammkle_common.constants import NANOSECONDS_PER_SECOND
from jammkle_common.names import CHANNEL_JAMS, CLEAR_FAULT, UNJAM, UNJAM_ALL, WAY_BACK
from jammkle_controller.core.reading import driver_report
from jammkle_msgs.msg import ChannelJamCommand, ChannelJamState, ContactState, JamCommand
from jammkle_msgs.msg import ContactEvent as ContactEventMessage
from jammkle_msgs.msg import Landing as LandingMessage

if TYPE_CHECKING:
    from collections.abc import Mapping

    from builtin_interfaces.msg import Time

    from jammkle_common.messages import Health
    from jammkle_controller.core.events import ContactEvent, ContactReport
    from jammkle_controller.core.landing import Landing
    from jammkle_msgs.msg import JamState

_VENTED_BY_HAND = (UNJAM.name, UNJAM_ALL.name, *(service.name for service in CHANNEL_JAMS.values()))
"""How the reason of a channel ends that somebody has vented by a service of the driver."""


def contact_event_message(event: ContactEvent, frame_id: str) -> ContactEventMessage:
    """Write a contact event, stamped with the sample that decided, in the frame that it was felt in."""
    message = ContactEventMessage()
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(event.time_ns, NANOSECONDS_PER_SECOND)
    message.header.frame_id = frame_id
    message.type = getattr(ContactEventMessage, event.kind.name)
    message.magnitude = event.magnitude
    message.unit = event.unit
    message.detection_delay_s = event.detection_delay_s
    message.probability = event.probability
    message.source = event.source.value
    message.direction.x, message.direction.y, message.direction.z = event.direction
    return message


def jam_command_message(set_points_pa: Mapping[str, float], stamp: Time, *, anew: bool = False) -> JamCommand:
    """Write the set point of every channel: vacuum in Pa, gauge, positive; zero vents. `anew`: as on a change."""
    message = JamCommand()
    message.header.stamp = stamp
    message.anew = anew
    message.channels = [
        ChannelJamCommand(channel=channel, vacuum_pa=vacuum_pa) for channel, vacuum_pa in set_points_pa.items()
    ]
    return message


def contact_state_message(report: ContactReport, health: Health, stamp: Time, *, soft: bool) -> ContactState:
    """Write what is known of contact, and whether the ankle is soft in stance."""
    contact = getattr(ContactState, report.contact.name)
    message = ContactState(contact=contact, shown_by=report.shown_by, at_rest=report.at_rest)
    message.header.stamp = stamp
    message.soft_in_stance = soft
    message.text = health.message
    return message


def landing_message(landing: Landing, travel_m: float) -> LandingMessage:
    """Write what was chosen for a landing, stamped with its touch-down; travel of the Achilles pair in m."""
    message = LandingMessage(
        speed_m_s=landing.speed_m_s,
        chosen_vacuum_pa=landing.chosen_pa,
        reached_vacuum_pa=landing.reached_pa,
        travel_m=travel_m,
        surprised=landing.surprised,
        why=landing.why,
    )
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(landing.time_ns, NANOSECONDS_PER_SECOND)
    return message


class DriverView:
    """What the driver reported last.

    Attributes:
        by_hand: Channels that somebody has vented by a service; they follow the next change of set points.
        report: What the controller decides by.

    """

    def __init__(self, message: JamState) -> None:
        """Read it; an empty one is that of a driver that has not said anything yet."""
        self._message = message
        vented = [each for each in message.channels if each.commanded_vacuum_pa == 0.0]
        self.by_hand = tuple(
            each.channel for each in vented if each.reason.endswith(_VENTED_BY_HAND) and not each.fault
        )
        self._unfollowed = [each for each in vented if each.channel not in self.by_hand]
        self.report = driver_report(message)

    @property
    def soft(self) -> tuple[str, ...]:
        """Channels that are not asked to jam, whoever decided so."""
        return (*(each.channel for each in self._unfollowed), *self.by_hand)

    @property
    def first_clear(self) -> str:
        """What must be done before channels can follow at all; empty: nothing."""
        faulty = [each.channel for each in self._message.channels if each.state == ChannelJamState.FAULT]
        if not self._message.emergency_stopped and not faulty:
            return ""
        why = "an emergency stop holds" if self._message.emergency_stopped else f"in fault: {', '.join(faulty)}"
        return f"but {why}: call {CLEAR_FAULT.path} first, then this again"

    def objection(self, name: str, vacuum_pa: float) -> str:
        """Return why the driver would not take a set point, Pa; empty if it would, or if its limits are not known."""
        least_pa, most_pa = self._message.min_vacuum_pa, self._message.max_vacuum_pa
        if most_pa <= 0.0 or least_pa <= vacuum_pa <= most_pa:
            return ""
        return (
            f"{name} is {vacuum_pa:g}; the driver takes {least_pa:g} to {most_pa:g} Pa "
            "(its min_vacuum_pa and max_vacuum_pa)"
        )

    def trouble(self, vacuum_pa: float) -> str:
        """Return why a set point of `vacuum_pa` Pa is not followed; empty if it is."""
        if vacuum_pa <= 0.0:
            return ""
        if self._message.refused_command:
            return f"the driver does not follow: {self._message.refused_command}"
        if self._message.emergency_stopped:
            return f"the driver does not follow: an emergency stop holds; release it, driver/clear_fault, {WAY_BACK}"
        if self._unfollowed:
            first = self._unfollowed[0]
            return f"the driver does not follow: {first.channel}: {first.reason or 'not asked to jam'}; {WAY_BACK}"
        return ""
