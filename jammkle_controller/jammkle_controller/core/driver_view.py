"""What the driver says of itself, as far as the controller must know it."""

from __future__ import annotations

import enum
from dataclasses import dataclass

from jammkle_common.names import CLEAR_FAULT, WAY_BACK


class Hold(enum.Enum):
    """Why channels are, or were, jammed."""

    NOBODY = "nobody"
    """Nothing is held by jam_command."""
    STREAM = "stream"
    """jam_command holds, or held until it fell silent."""


@dataclass(frozen=True)
class DriverView:
    """What was last heard of the driver.

    Attributes:
        min_vacuum_pa: Least vacuum that it takes, Pa; 0: not known.
        max_vacuum_pa: Most vacuum that it takes, Pa; 0: not known.
        refused: Why it refused the last jam_command; empty: it did not.
        unfollowed: Channels that are not asked to jam, with the reason; by name.
        by_hand: Channels that somebody has vented by a service; they follow the next change of wish.
        stopped: Whether an emergency stop holds.
        hold: Whether jam_command holds, or held until it fell silent.
        faulty: Channels in FAULT, which follow nothing before `~/clear_fault`.

    """

    min_vacuum_pa: float = 0.0
    max_vacuum_pa: float = 0.0
    refused: str = ""
    unfollowed: tuple[tuple[str, str], ...] = ()
    by_hand: tuple[str, ...] = ()
    stopped: bool = False
    hold: Hold = Hold.NOBODY
    faulty: tuple[str, ...] = ()

    @property
    def soft(self) -> tuple[str, ...]:
        """Channels that are not asked to jam, whoever decided so."""
        return (*(channel for channel, _ in self.unfollowed), *self.by_hand)

    @property
    def first_clear(self) -> str:
        """What must be done before channels can follow at all; empty: nothing."""
        if not self.stopped and not self.faulty:
            return ""
        why = "an emergency stop holds" if self.stopped else f"in fault: {', '.join(self.faulty)}"
        return f"but {why}: call {CLEAR_FAULT.path} first, then this again"

    def objection(self, name: str, vacuum_pa: float) -> str:
        """Return why the driver would not take a set point, Pa; empty if it would, or if its limits are not known."""
        if self.max_vacuum_pa <= 0.0 or self.min_vacuum_pa <= vacuum_pa <= self.max_vacuum_pa:
            return ""
        return (
            f"{name} is {vacuum_pa:g}; the driver takes {self.min_vacuum_pa:g} to {self.max_vacuum_pa:g} Pa "
            "(its min_vacuum_pa and max_vacuum_pa)"
        )

    def trouble(self, vacuum_pa: float) -> str:
        """Return why a wish of `vacuum_pa` Pa is not followed; empty if it is."""
        if vacuum_pa <= 0.0:
            return ""
        if self.refused:
            return f"the driver does not follow: {self.refused}"
        if self.stopped:
            return f"the driver does not follow: an emergency stop holds; release it, driver/clear_fault, {WAY_BACK}"
        if self.unfollowed:
            channel, reason = self.unfollowed[0]
            return f"the driver does not follow: {channel}: {reason or 'not asked to jam'}; {WAY_BACK}"
        return ""
