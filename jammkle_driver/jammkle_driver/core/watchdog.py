"""Tells when something that should come regularly has stopped coming."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Instant:
    """One moment.

    Attributes:
        steady_s: How far real time has come, s: tells whether the driver keeps up. In lockstep with a simulation it is
            `graph_s`, as that waits for a driver that is late.
        graph_s: The time that the ankle lives in, s, in which everything is timed: of a simulation the graph's clock
            (ROS time), which stands still while it is paused; of real hardware the steady clock.

    """

    steady_s: float
    graph_s: float


class Watchdog:
    """Expires when more than `timeout_s` has passed since it was last fed, in the time that the ankle lives in."""

    def __init__(self, timeout_s: float) -> None:
        """Make a watchdog that was never fed, and so never expires.

        Args:
            timeout_s: Silence allowed, s, > 0.

        """
        self._timeout_s = timeout_s
        self._fed_s: float | None = None

    @property
    def timeout_s(self) -> float:
        """Silence allowed, s."""
        return self._timeout_s

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
        """Leave out `stood_s` s in which the one who listens stood still itself, and could hear nothing."""
        if self._fed_s is not None:
            self._fed_s += stood_s

    def expired(self, now: Instant) -> bool:
        """Return True if the last sign of life is older than the timeout."""
        if self._fed_s is None:
            return False
        # A simulation that was started anew sets the graph's clock back; silence is then counted from there.
        self._fed_s = min(self._fed_s, now.graph_s)
        return now.graph_s - self._fed_s > self._timeout_s
