"""What the state of the link to the hardware means for the driver: when to fail, when to acknowledge a board."""

from __future__ import annotations

from dataclasses import dataclass

from jammkle_driver.core.hardware import LinkState, LinkStatus


@dataclass(frozen=True)
class LinkVerdict:
    """What is to be done about the link.

    Attributes:
        fault: Why every channel must go to FAULT; empty where none must.
        acknowledge: Whether the board's latched safe state is acknowledged now.

    """

    fault: str = ""
    acknowledge: bool = False


class LinkGuard:
    """Looks at the link. A safe state that the board went to while something was jammed is never left by itself.

    A board that latched while nothing was jammed, as every board has when it is plugged in, is acknowledged without
    asking anybody: there is no jam that could go on by itself.
    """

    def __init__(self) -> None:
        """Make a guard that has seen nothing yet."""
        self._failed = False

    def look(self, link: LinkStatus, *, jammed: bool) -> LinkVerdict:
        """Return what to do.

        Args:
            link: What is known of the link now.
            jammed: Whether a channel is asked to jam.

        """
        if jammed:
            fault = _fault(link)
            self._failed = bool(fault)
            return LinkVerdict(fault)
        if link.state is LinkState.CONNECTED and not link.latched:
            self._failed = False
        idle = link.state is LinkState.CONNECTED and bool(link.latched) and not self._failed
        return LinkVerdict(acknowledge=idle)

    def clear(self) -> None:
        """Note that somebody has acknowledged what happened."""
        self._failed = False


def _fault(link: LinkStatus) -> str:
    if link.state is LinkState.LOST:
        return f"the board does not answer ({link.detail}): look at cable and supply, then call ~/clear_fault"
    if link.latched:
        causes = ", ".join(sorted(cause.value for cause in link.latched))
        reset = f", last reset: {link.reset_cause.value}" if link.reset_cause else ""
        return f"the board went to its safe state ({causes}{reset}): call ~/clear_fault, then jam anew"
    return ""
