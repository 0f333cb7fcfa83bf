"""What the controller feels on the IMU: contact events."""

from __future__ import annotations

import enum
from dataclasses import dataclass

M_S2 = "m/s^2"
M_S = "m/s"
NEWTON = "N"
METRE = "m"
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


class Source(enum.Enum):
    """What an event was felt on."""

    IMU = "imu"
    CONTACT_SWITCH = "contact switch"
    LOAD = "load"
    GAIT = "gait"
    EFFORTS = "joint efforts"
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
            the odometry told it; zeros: not known.

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
