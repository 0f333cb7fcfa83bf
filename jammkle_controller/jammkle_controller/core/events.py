"""The words of contact: events, what is known of contact, where an IMU is, and what is detected there."""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from jammkle_controller.parameters import Mount

if TYPE_CHECKING:
    from collections.abc import Mapping

M_S2 = "m/s^2"
M_S = "m/s"
NEWTON = "N"
METRE = "m"
RADIAN = "rad"
NO_UNIT = ""


class ContactKind(enum.Enum):
    """Kind of contact event."""

    IMPACT = "impact"
    """The foot hit something."""
    SLIP = "slip"
    """The foot slides."""
    LIFTOFF = "lift-off"
    """The foot left the ground."""
    SWING = "swing"
    """The foot swings freely."""
    SETTLED = "settled"
    """The body came to rest after an impact."""


CHANGES = {True: ContactKind.IMPACT, False: ContactKind.LIFTOFF}
"""What a change of contact is, by whether the foot stands from then on."""


class Source(enum.Enum):
    """What an event was felt on."""

    IMU = "imu"
    CONTACT_SWITCH = "contact switch"
    LOAD = "load"
    GAIT = "gait"
    EFFORTS = "joint efforts"
    ANKLE = "ankle angles"
    ODOMETRY = "odometry"


@dataclass(frozen=True)
class ContactEvent:
    """One event.

    Attributes:
        kind: What happened.
        time_ns: Stamp of the IMU sample that decided, ns.
        magnitude: Size of what was felt, in `unit`.
        unit: Unit of `magnitude`.
        detection_delay_s: From the first sample that carries the event to the one that decided, s.
        probability: That it is one, 0 to 1: a posterior on a foot or shank that steps, otherwise assumed.
        source: What it was felt on.
        is_felt: Whether something happened that only this explains; False: a touch-down that stillness alone suggests,
            which a foot that is held still in the air shows as well.
        direction: Unit vector of the sliding or of the blow in the IMU's frame, or in the body's where
            the odometry gave it; zeros: not known.

    """

    kind: ContactKind
    time_ns: int
    magnitude: float
    unit: str
    detection_delay_s: float
    probability: float = 1.0
    source: Source = Source.IMU
    direction: tuple[float, float, float] = (0.0, 0.0, 0.0)
    is_felt: bool = True


class Contact(enum.Enum):
    """What is known of the foot's contact with the ground."""

    UNKNOWN = "unknown"
    """Nothing shows either."""
    CONTACT = "contact"
    """The foot stands."""
    NO_CONTACT = "no contact"
    """The foot is in the air."""


class ContactReport(NamedTuple):
    """What is known of contact now.

    Attributes:
        contact: Whether the foot stands.
        shown_by: What shows it, in words; empty: nothing does.
        at_rest: Whether the IMU has read gravity and nothing else for so long that the ankle is held (`HELD_REST_S`).
        since_ns: Since when contact has had this value, ns by the stamps of the inputs.

    """

    contact: Contact
    shown_by: str
    at_rest: bool
    since_ns: int

    @property
    def bears(self) -> bool:
        """Whether the ankle must be held: it stands, or it rests and nothing shows that it hangs."""
        return self.contact is Contact.CONTACT or (self.contact is Contact.UNKNOWN and self.at_rest)


class Phase(enum.Enum):
    """What the foot does, as far as the IMU shows."""

    GROUND = "on the ground, moving"
    """Something carries the body. So it is assumed at the start."""
    PLANTED = "on the ground, at rest"
    """The body has come to rest; slip is watched for."""
    FLIGHT = "in flight"
    """Nothing carries the body."""
    SWING = "in swing"
    """The foot is off the ground, and the body is carried by another, or hardly."""


class Detection(enum.Enum):
    """Kinds of event, by what they are separated from."""

    IMPACT = "impact"
    FLIGHT = "lift-off into free fall"
    STEP = "lift-off of a step"
    SWING = "swing"
    RAISE = "lift-off of what is raised slowly"
    SLIP_STANDING = "slip of a foot that stood"
    SLIP_STEPPING = "slip while it steps"
    REST = "settled"


_FOOT: Mapping[Detection, str] = {
    Detection.IMPACT: "a blow in a swing, by its density ratio",
    Detection.FLIGHT: "nearly no specific force",
    Detection.STEP: "probability of swing",
    Detection.SWING: "probability of swing",
    Detection.RAISE: "height since it last rested, and a tilt",
    Detection.SLIP_STANDING: "probability of sliding",
    Detection.SLIP_STEPPING: "probability of sliding",
    Detection.REST: "specific force of gravity, and no turning",
}
_UNFELT_ON_THE_BODY: Mapping[Detection, str] = {
    Detection.STEP: "a body that does not fall never showed it: needs the gait, efforts, a switch or the load",
    Detection.SWING: "the swing of one foot is not felt on the body",
    Detection.SLIP_STEPPING: (
        "a body that walks speeds up and slows down at every step: 2 of 309 events were one; odometry shows it"
    ),
}
_BODY: Mapping[Detection, str] = {
    **_FOOT,
    Detection.IMPACT: "the end of free fall; a threshold above weight and level",
    Detection.SLIP_STANDING: "a step of the acceleration that becomes a speed",
    **_UNFELT_ON_THE_BODY,
}
REASONS: Mapping[Mount, Mapping[Detection, str]] = {Mount.FOOT: _FOOT, Mount.SHANK: _FOOT, Mount.BODY: _BODY}
"""What each kind of event is detected on, or why it is not, by the place of the IMU."""


def is_felt(mount: Mount, detection: Detection) -> bool:
    """Whether an IMU in this place is used to detect it."""
    return mount is not Mount.BODY or detection not in _UNFELT_ON_THE_BODY


def not_felt(mount: Mount) -> Mapping[str, str]:
    """Return what is not detected on an IMU in this place, with the reasons."""
    return {each.value: why for each, why in REASONS[mount].items() if not is_felt(mount, each)}
