"""Time-outs: what has stopped coming, and whether the driver itself keeps up."""

from __future__ import annotations

import math
from dataclasses import dataclass


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
    """Expires when more than `timeout_s` has passed since it was last fed, in the time that the ankle lives in.

    Attributes:
        timeout_s: Silence allowed, s.

    """

    def __init__(self, timeout_s: float) -> None:
        """Make a watchdog that was never fed, and so never expires.

        Args:
            timeout_s: Silence allowed, s, > 0.

        """
        self.timeout_s = timeout_s
        self._fed_s: float | None = None

    @property
    def fed(self) -> bool:
        """Whether there ever was a sign of life."""
        return self._fed_s is not None

    def feed(self, now: Instant) -> None:
        """Note a sign of life."""
        self._fed_s = now.graph_s

    def forget(self) -> None:
        """Behave as if it had never been fed."""
        self._fed_s = None

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


STALL_PERIODS = 5.0
"""Periods without work after which the driver itself has stood still: as a board's watchdog of 200 ms sees it."""

_FOLLOW = 0.05
"""Weight of the latest period in the mean lateness: about a second of 20 Hz."""

_LATE_SHARE = 0.5
"""Mean lateness, in periods, from which the executor is overloaded. Assumed: work then comes at two thirds its rate."""

_REMEMBERED_S = 5.0
"""How long a stall is reported after it has ended, s."""


@dataclass(frozen=True)
class OverloadStatus:
    """What is known of the driver's own pace.

    Attributes:
        overloaded: Whether work comes late now, or the driver has stood still lately.
        late_s: Mean lateness of regular work, s.
        stalls: How often the driver stood still.
        longest_s: Longest standstill, s.

    """

    overloaded: bool
    late_s: float
    stalls: int
    longest_s: float

    @property
    def values(self) -> dict[str, str]:
        """The same in numbers for people, with units in the key."""
        return {
            "mean lateness (s)": f"{self.late_s:.4f}",
            "standstills (1)": str(self.stalls),
            "longest standstill (s)": f"{self.longest_s:.2f}",
        }


class OverloadWatch:
    """Looks at the times between two pieces of regular work, on the steady clock.

    Attributes:
        late_s: Mean lateness, s.

    """

    def __init__(self, period_s: float) -> None:
        """Make one for work that should come every `period_s` s."""
        self._period_s = period_s
        self._last_s: float | None = None
        self.late_s = 0.0
        self._stalls = 0
        self._longest_s = 0.0
        self._until_s = -math.inf

    def tick(self, steady_s: float) -> float:
        """Note that work is done now; return for how long the driver had stood still, s, mostly 0."""
        if self._last_s is None:
            self._last_s = steady_s
            return 0.0
        since_s = steady_s - self._last_s
        self._last_s = steady_s
        late_s = max(since_s - self._period_s, 0.0)
        if since_s > STALL_PERIODS * self._period_s:
            self._stalls += 1
            self._longest_s = max(self._longest_s, since_s)
            self._until_s = steady_s + _REMEMBERED_S
            return since_s
        self.late_s += _FOLLOW * (late_s - self.late_s)
        return 0.0

    def status(self, steady_s: float) -> OverloadStatus:
        """Return what is known now."""
        busy = self.late_s > _LATE_SHARE * self._period_s
        return OverloadStatus(busy or steady_s < self._until_s, self.late_s, self._stalls, self._longest_s)
