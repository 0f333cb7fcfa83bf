"""What silence, noise and lateness mean: of board, line and sensors, of who commands, and of the driver itself."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

from jammkle_driver.core.faults import REMEDIES, Finding, Reason, finding
from jammkle_driver.core.hardware import MANIFOLD, LinkState, LinkStatus, ResetCause, SafeCause

if TYPE_CHECKING:
    from collections.abc import Sequence


@dataclass(frozen=True)
class Instant:
    """One moment.

    Attributes:
        steady_s: How far real time has come, s: shows whether the driver keeps up. In lockstep with a simulation it is
            `graph_s`, as that waits for a driver that is late.
        graph_s: The time that the ankle lives in, s, in which everything is timed: of a simulation the graph's clock
            (ROS time), which stands still while it is paused; of real hardware the steady clock.

    """

    steady_s: float
    graph_s: float


class Watchdog:
    """Expires when more than `timeout_s` has passed since it was last fed, in the time that the ankle lives in."""

    def __init__(self, timeout_s: float) -> None:
        """Make a watchdog that was never fed, and so never expires."""
        self.timeout_s = timeout_s
        self._fed_s: float | None = None

    @property
    def fed(self) -> bool:
        """Whether there ever was a sign of life."""
        return self._fed_s is not None

    def feed(self, now: Instant) -> None:
        """Note a sign of life."""
        self._fed_s = now.graph_s

    def excuse(self, stood_s: float) -> None:
        """Leave out `stood_s` s in which the one who listens stood still itself, and could notice nothing."""
        if self._fed_s is not None:
            self._fed_s += stood_s

    def expired(self, now: Instant) -> bool:
        """Return True if the last sign of life is older than the timeout."""
        if self._fed_s is None:
            return False
        # A simulation that was started anew sets the graph's clock back; silence is then counted from there.
        self._fed_s = min(self._fed_s, now.graph_s)
        return now.graph_s - self._fed_s > self.timeout_s


_STALL_PERIODS = 5.0
"""Periods without work after which the driver itself has stood still: as a board's watchdog of 200 ms sees it."""

_FOLLOW = 0.05
"""Weight of the latest period in the mean lateness: about a second of 20 Hz."""

_LATE_SHARE = 0.5
"""Mean lateness, in periods, from which the executor is overloaded. Assumed: work then comes at two thirds its rate."""

_REMEMBERED_S = 5.0
"""How long a stall is reported after it has ended, s."""


class OverloadWatch:
    """Looks at the times between two pieces of regular work, on the steady clock: mean lateness, and standstills."""

    def __init__(self, period_s: float) -> None:
        """Make one for work that should come every `period_s` s."""
        self._period_s = period_s
        self._last_s: float | None = None
        self._reported_until_s = -math.inf
        self.late_s = self.longest_s = 0.0
        self.stalls = 0

    def tick(self, steady_s: float) -> float:
        """Note that work is done now; return for how long the driver had stood still, s, mostly 0."""
        since_s = self._period_s if self._last_s is None else steady_s - self._last_s
        self._last_s = steady_s
        if since_s > _STALL_PERIODS * self._period_s:
            self.stalls += 1
            self.longest_s = max(self.longest_s, since_s)
            self._reported_until_s = steady_s + _REMEMBERED_S
            return since_s
        self.late_s += _FOLLOW * (max(since_s - self._period_s, 0.0) - self.late_s)
        return 0.0

    @property
    def overloaded(self) -> bool:
        """Whether work comes late now, or the driver has stood still lately."""
        stalled = self._last_s is not None and self._last_s < self._reported_until_s
        return stalled or self.late_s > _LATE_SHARE * self._period_s

    @property
    def values(self) -> dict[str, str]:
        """What is known in numbers for people, with units in the key."""
        return {
            "mean lateness (s)": f"{self.late_s:.4f}",
            "standstills (1)": str(self.stalls),
            "longest standstill (s)": f"{self.longest_s:.2f}",
        }


BOARD = "board"
"""Place of what is found at the board."""

LINE = "line"
"""Place of what is found on the line to the board."""

NOISE_WINDOW_S = 5.0
"""Time over which check sum errors are counted, s. Assumed."""

RESTART_REPORTED_S = 60.0
"""How long a board's new start is reported, s. Chosen: people look at /diagnostics now and then."""

NOISE_SHARE = 0.01
"""Share of telegrams with a wrong check sum from which the line is noisy: a good one has less than one in a million."""


@dataclass(frozen=True)
class LinkVerdict:
    """What is to be done about the link.

    Attributes:
        fault: Why every channel must go to FAULT; None where none must.
        let_go: Why the board has let go although nothing has failed: no command had come. None where not.
        wait: Whether nothing may jam yet: the board that let go has not yet taken the release.
        acknowledge: Whether the board's latched safe state is acknowledged now.

    """

    fault: Finding | None = None
    let_go: Finding | None = None
    wait: bool = False
    acknowledge: bool = False


class LinkWatch:
    """Looks at the link: what a board that is lost or has latched means, noise on the line, and new starts.

    A safe state that the board went to while something was jammed is never left by itself. A board that latched while
    nothing was jammed, as every board has when it is plugged in, is acknowledged without asking anybody: there is no
    jam that could go on by itself.

    Attributes:
        noise: What is wrong with the line, by the check sums of the last few seconds; None where nothing is.
        restarted: That the board has started anew a while ago, jammed or not: one that does so again and again is not
            well; None where it has not.

    """

    def __init__(self) -> None:
        """Make a watch that has seen nothing yet."""
        self._failed = self._lost = False
        self._marks: deque[tuple[float, int, int]] = deque()
        self._starts = 0
        self._restarted_s = -math.inf
        self.noise: Finding | None = None
        self.restarted: Finding | None = None

    def look(self, link: LinkStatus, *, jammed: bool) -> LinkVerdict:
        """Return what to do about the link; `jammed` where a channel is asked to jam."""
        if jammed and link.state is LinkState.CONNECTED and link.latched == {SafeCause.HOST_SILENT}:
            # The driver itself was late: what is asked for again may be jammed again.
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

    def count(self, link: LinkStatus, steady_s: float) -> None:
        """Count wrong check sums and starts, at a moment of the steady clock, s; several times a second."""
        self.noise, self.restarted = self._count_noise(link, steady_s), self._count_starts(link, steady_s)

    def _count_noise(self, link: LinkStatus, steady_s: float) -> Finding | None:
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

    def _count_starts(self, link: LinkStatus, steady_s: float) -> Finding | None:
        """Return what is to be said of a start at most `RESTART_REPORTED_S` s ago; the first one is none."""
        if link.starts > self._starts:
            if self._starts > 0:
                self._restarted_s = steady_s
            self._starts = link.starts
        if steady_s > self._restarted_s + RESTART_REPORTED_S:
            return None
        cause = "" if link.reset_cause is None else f", by {link.reset_cause.value}"
        seen = f"has started anew {steady_s - self._restarted_s:.0f} s ago{cause}; {link.starts} starts were seen"
        browned_out = link.reset_cause is ResetCause.BROWN_OUT
        reason = Reason.BROWN_OUT if browned_out else Reason.BOARD_REBOOTED
        return finding(reason, BOARD, seen, link_numbers(link))


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


def silence_allowed(timeout_s: float) -> dict[str, str]:
    """Return what a silent one has not kept to, in numbers for people, with units in the key."""
    return {"silence allowed (s)": f"{timeout_s:g}"}


class SensorWatch:
    """Counts for how long each sensor has given no pressure; a channel without one fails, a manifold does not.

    A silent sensor ends in a latched fault, which needs evidence that a pause of the host cannot make. So silence is
    counted in ticks of the driver, each by two periods at the most, however late it comes; and where hardware is asked
    and answers, by those ticks alone in which an answer was taken. Whether it answers at all, its link says.
    """

    def __init__(self, channels: Sequence[str], timeout_s: float, period_s: float) -> None:
        """Watch the manifold and `channels`, in ticks of `period_s`; who is silent for `timeout_s` is not measured."""
        self._names = tuple(channels)
        self.timeout_s = timeout_s
        self._period_s = period_s
        self.forget()

    def forget(self) -> None:
        """Be as new: no pressure was taken yet."""
        self._silent_s: dict[str, float] = {}
        self._all_silent_s = self._unanswered_s = 0.0
        self._measured: set[str] = set()
        self._answered = False

    @property
    def manifold_measured(self) -> bool:
        """Whether the manifold's sensor ever gave a pressure."""
        return MANIFOLD in self._silent_s

    @property
    def unanswered(self) -> bool:
        """Whether hardware that is asked has not answered for the time-out: every pressure is an old one."""
        return self._unanswered_s > self.timeout_s

    def take(self, place: str, *, valid: bool) -> None:
        """Note an answer of the hardware, and whether a sensor's pressure was in it."""
        self._answered = True
        self._unanswered_s = 0.0
        if valid:
            self._measured.add(place)
            self._silent_s[place] = self._all_silent_s = 0.0

    def silent(self, place: str) -> bool:
        """Whether a sensor that gave a pressure once gives none now."""
        return self._silent_s.get(place, 0.0) > self.timeout_s

    def tick(self, passed_s: float, *, asked: bool) -> None:
        """Count the time since the last tick, 0 where nothing could be measured in it.

        Hardware that is `asked` answers each time; else it speaks by itself.
        """
        counted_s = min(max(passed_s, 0.0), 2.0 * self._period_s)
        if asked and not self._answered:
            self._unanswered_s += counted_s
        else:
            for place in self._silent_s.keys() - self._measured:
                self._silent_s[place] += counted_s
            self._all_silent_s += 0.0 if self._measured else counted_s
        self._measured.clear()
        self._answered = False

    @property
    def all_silent(self) -> bool:
        """Whether none of them gives a pressure: those of one board fall silent within milliseconds."""
        return self._all_silent_s > 0.5 * self.timeout_s

    def fallen_silent(self, measured: Sequence[str]) -> tuple[str, ...]:
        """Return which of the channels whose pressure is known give none now: all, where no sensor does."""
        silent = tuple(name for name in measured if self.silent(name))
        return tuple(measured) if silent and self.all_silent else silent

    def why(self, silent: Sequence[str]) -> Finding:
        """Return as a finding that the sensors of these channels have fallen silent."""
        reason = Reason.BOARD_UNPLUGGED if self.all_silent else Reason.SENSOR_DEAD
        place = ", ".join(silent)
        whose = "no sensor gives" if self.all_silent else f"{place} sensor gives no"
        remedy = "look at hardware or simulation" if self.all_silent else REMEDIES[reason]
        text = f"{whose} valid pressure for {self.timeout_s:g} s (pressure_timeout_s): {remedy}"
        return Finding(reason, place, text, silence_allowed(self.timeout_s)).to_clear()
