"""What the state of the link to the hardware means for the driver: when to fail, when to acknowledge a board."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

from jammkle_driver.core.faults import Finding, Reason, finding
from jammkle_driver.core.hardware import LinkState, LinkStatus, ResetCause, SafeCause

BOARD = "board"
"""Place of what is found at the board."""

LINE = "line"
"""Place of what is found on the line to the board."""

NOISE_WINDOW_S = 5.0
"""Time over which check sum errors are counted, s. Assumed."""

RESTART_TOLD_S = 60.0
"""How long a board's new start is told, s. Chosen: people look at /diagnostics now and then."""

NOISE_SHARE = 0.01
"""Share of telegrams with a wrong check sum from which the line is noisy: a good one has less than one in a million."""


@dataclass(frozen=True)
class LinkVerdict:
    """What is to be done about the link.

    Attributes:
        fault: Why every channel must go to FAULT; None where none must.
        let_go: Why the board has let go although nothing has failed: the driver had not been heard. None where not.
        wait: Whether nothing may jam yet: the board that let go has not yet taken the release.
        acknowledge: Whether the board's latched safe state is acknowledged now.

    """

    fault: Finding | None = None
    let_go: Finding | None = None
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
            text = f"the board let go: {SafeCause.HOST_SILENT.value}"
            let_go = Finding(Reason.BOARD_LET_GO, BOARD, text, link_numbers(link))
            return LinkVerdict(let_go=let_go, wait=True, acknowledge=True)
        if jammed:
            fault = _fault(link)
            self._failed = fault is not None
            self._lost = fault is not None and fault.reason is Reason.BOARD_UNPLUGGED
            return LinkVerdict(fault)
        if self._lost and link.state is LinkState.CONNECTED:
            self._lost = False
            if SafeCause.RESET in link.latched:  # it was no cable: a boot loader is silent for up to 2 s
                return LinkVerdict(_fault(link))
        if link.state is LinkState.CONNECTED and not link.latched:
            self._failed = False
        idle = link.state is LinkState.CONNECTED and bool(link.latched) and not self._failed
        return LinkVerdict(wait=idle and link.latched == {SafeCause.HOST_SILENT}, acknowledge=idle)

    def clear(self) -> None:
        """Note that somebody has acknowledged what happened."""
        self._failed = self._lost = False


def link_numbers(link: LinkStatus) -> dict[str, str]:
    """Return in numbers for people what is known of the board and of the line to it, with units in the key."""
    return {
        "board starts (1)": str(link.starts),
        "supply (V)": "not measured" if link.supply_v is None else f"{link.supply_v:.2f}",
        "connects (1)": str(link.connects),
        "exchanges (1)": str(link.exchanges),
        "check sum errors (1)": str(link.crc_errors),
        "time-outs (1)": str(link.timeouts),
        "refusals (1)": str(link.refusals),
        "rate (Hz)": "not measured" if link.rate_hz is None else f"{link.rate_hz:.0f}",
    }


def _fault(link: LinkStatus) -> Finding | None:
    if link.state is LinkState.LOST:
        text = f"the board does not answer ({link.detail}): look at cable and supply, then call ~/clear_fault"
        return Finding(Reason.BOARD_UNPLUGGED, BOARD, text, link_numbers(link))
    if link.latched:
        causes = ", ".join(sorted(cause.value for cause in link.latched))
        reset = f", last reset: {link.reset_cause.value}" if link.reset_cause else ""
        low = SafeCause.SUPPLY_LOW in link.latched or link.reset_cause is ResetCause.BROWN_OUT
        reason = Reason.BROWN_OUT if low else Reason.BOARD_REBOOTED
        text = f"the board went to its safe state ({causes}{reset}): call ~/clear_fault, then jam anew"
        return Finding(reason, BOARD, text, link_numbers(link))
    return None


class RestartWatch:
    """Notes when the board starts anew, jammed or not: one that does so again and again is not well."""

    def __init__(self) -> None:
        """Make one that has seen no board."""
        self._starts = 0
        self._at_s = -math.inf

    def look(self, link: LinkStatus, steady_s: float) -> Finding | None:
        """Return what is to be said of a start at most `RESTART_TOLD_S` s ago; the first one is none."""
        if link.starts > self._starts:
            if self._starts > 0:
                self._at_s = steady_s
            self._starts = link.starts
        if steady_s > self._at_s + RESTART_TOLD_S:
            return None
        cause = "" if link.reset_cause is None else f", by {link.reset_cause.value}"
        seen = f"has started anew {steady_s - self._at_s:.0f} s ago{cause}; {link.starts} starts were seen"
        browned_out = link.reset_cause is ResetCause.BROWN_OUT
        reason = Reason.BROWN_OUT if browned_out else Reason.BOARD_REBOOTED
        return finding(reason, BOARD, seen, link_numbers(link))


class NoiseMeter:
    """Counts wrong check sums over the last few seconds."""

    def __init__(self) -> None:
        """Make one that has heard nothing."""
        self._marks: deque[tuple[float, int, int]] = deque()

    def look(self, link: LinkStatus, steady_s: float) -> Finding | None:
        """Return what is wrong with the line at a moment of the steady clock, s; None where nothing is."""
        self._marks.append((steady_s, link.crc_errors, link.exchanges))
        while self._marks[0][0] < steady_s - NOISE_WINDOW_S:
            self._marks.popleft()
        errors = link.crc_errors - self._marks[0][1]
        telegrams = errors + link.exchanges - self._marks[0][2]
        if errors <= 0 or errors < NOISE_SHARE * telegrams:
            return None
        share = errors / max(telegrams, 1)
        values = {
            "wrong check sums (share of telegrams)": f"{share:.3f}",
            "wrong check sums (1)": str(errors),
            "counted over (s)": f"{NOISE_WINDOW_S:g}",
        }
        seen = f"has noise: {100.0 * share:.0f} % of telegrams had a wrong check sum in the last {NOISE_WINDOW_S:g} s"
        return finding(Reason.LINE_NOISE, LINE, seen, values)
