"""What the controller feels on the IMU: contact events."""

from __future__ import annotations

import enum
from dataclasses import dataclass

M_S2 = "m/s^2"
M_S = "m/s"


class ContactKind(enum.Enum):
    """Kind of contact event."""

    IMPACT = "impact"
    """The foot hit something."""
    SLIP = "slip"
    """The foot slides."""
    LIFTOFF = "lift-off"
    """The foot left the ground."""
    SETTLED = "settled"
    """The body came to rest after an impact."""


@dataclass(frozen=True)
class ContactEvent:
    """One event.

    Attributes:
        kind: What happened.
        time_ns: Stamp of the IMU sample that decided, ns.
        magnitude: Size of what was felt, in `unit`.
        unit: Unit of `magnitude`.
        detection_delay_s: From the first sample that carries the event to the one that decided, s.

    """

    kind: ContactKind
    time_ns: int
    magnitude: float
    unit: str
    detection_delay_s: float
