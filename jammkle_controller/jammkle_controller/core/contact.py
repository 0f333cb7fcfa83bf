"""Whether the foot stands: yes, no, or not known, and what shows it."""

from __future__ import annotations

import enum
from typing import NamedTuple


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
