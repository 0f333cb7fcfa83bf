"""What the state of the link to the hardware means for the driver: when to fail, when to acknowledge a board."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from jammkle_driver.core.faults import REMEDIES, Reason
from jammkle_driver.core.hardware import LinkState, LinkStatus, ResetCause, SafeCause

NOISE_WINDOW_S = 5.0
"""Time over which check sum errors are counted, s. Assumed."""

NOISE_SHARE = 0.01
"""Share of telegrams with a wrong check sum from which the line is noisy: a good one has less than one in a million."""


@dataclass(frozen=True)
class LinkVerdict:
    """What is to be done about the link.

    Attributes:
        fault: Why every channel must go to FAULT; empty where none must.
        reason: The same as an enum; NONE where none must.
        let_go: Why the board has let go although nothing has failed: the driver had not been heard. Empty where not.
        wait: Whether nothing may jam yet: the board that let go has not yet taken the release.
        acknowledge: Whether the board's latched safe state is acknowledged now.

    """

    fault: str = ""
    reason: Reason = Reason.NONE
    let_go: str = ""
    wait: bool = False
    acknowledge: bool = False


class LinkGuard:
    """Looks at the link. A safe state that the board went to while something was jammed is never left by itself.

    A board that latched while nothing was jammed, as every board has when it is plugged in, is acknowledged without
    asking anybody: there is no jam that could go on by itself.
    """

    def __init__(self) -> None:
        """Make a guard that has seen nothing yet."""
        self._failed = False
        self._lost = False

    def look(self, link: LinkStatus, *, jammed: bool) -> LinkVerdict:
        """Return what to do.

        Args:
            link: What is known of the link now.
            jammed: Whether a channel is asked to jam.

        """
        if jammed and link.state is LinkState.CONNECTED and link.latched == {SafeCause.HOST_SILENT}:
            # The driver itself was late: what is wished again may be jammed again.
            return LinkVerdict(let_go=f"the board let go: {SafeCause.HOST_SILENT.value}", wait=True, acknowledge=True)
        if jammed:
            reason, fault = _fault(link)
            self._failed = bool(fault)
            self._lost = reason is Reason.BOARD_UNPLUGGED
            return LinkVerdict(fault, reason)
        if self._lost and link.state is LinkState.CONNECTED:
            self._lost = False
            if SafeCause.RESET in link.latched:  # it was no cable: a boot loader is silent for up to 2 s
                reason, fault = _fault(link)
                return LinkVerdict(fault, reason)
        if link.state is LinkState.CONNECTED and not link.latched:
            self._failed = False
        idle = link.state is LinkState.CONNECTED and bool(link.latched) and not self._failed
        return LinkVerdict(wait=idle and link.latched == {SafeCause.HOST_SILENT}, acknowledge=idle)

    def clear(self) -> None:
        """Note that somebody has acknowledged what happened."""
        self._failed = self._lost = False


def _fault(link: LinkStatus) -> tuple[Reason, str]:
    if link.state is LinkState.LOST:
        text = f"the board does not answer ({link.detail}): look at cable and supply, then call ~/clear_fault"
        return Reason.BOARD_UNPLUGGED, text
    if link.latched:
        causes = ", ".join(sorted(cause.value for cause in link.latched))
        reset = f", last reset: {link.reset_cause.value}" if link.reset_cause else ""
        low = SafeCause.SUPPLY_LOW in link.latched or link.reset_cause is ResetCause.BROWN_OUT
        reason = Reason.BROWN_OUT if low else Reason.BOARD_REBOOTED
        return reason, f"the board went to its safe state ({causes}{reset}): call ~/clear_fault, then jam anew"
    return Reason.NONE, ""


class NoiseMeter:
    """Counts wrong check sums over the last few seconds."""

    def __init__(self) -> None:
        """Make one that has heard nothing."""
        self._marks: deque[tuple[float, int, int]] = deque()

    def look(self, link: LinkStatus, steady_s: float) -> str:
        """Return what is wrong with the line now, with numbers; empty where nothing is."""
        self._marks.append((steady_s, link.crc_errors, link.exchanges))
        while self._marks[0][0] < steady_s - NOISE_WINDOW_S:
            self._marks.popleft()
        errors = link.crc_errors - self._marks[0][1]
        telegrams = errors + link.exchanges - self._marks[0][2]
        if errors <= 0 or errors < NOISE_SHARE * telegrams:
            return ""
        share = 100.0 * errors / max(telegrams, 1)
        return (
            f"line noise: {share:.0f} % of telegrams had a wrong check sum in the last {NOISE_WINDOW_S:g} s: "
            f"{REMEDIES[Reason.LINE_NOISE]}"
        )
