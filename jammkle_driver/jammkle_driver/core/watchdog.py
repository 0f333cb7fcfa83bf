"""Tells when something that should come regularly has stopped coming, at any speed of simulation."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Instant:
    """One moment on both clocks.

    Attributes:
        steady_s: The machine's steady clock, s; never jumps, never stops.
        graph_s: The time that the ankle lives in, s: of a simulation the graph's clock (ROS time), which stands still
            while it is paused; of real hardware the steady clock.
        clock_runs: Whether somebody keeps that time. A paused simulation repeats it; one that has died does not, and
            then the steady clock alone counts.

    """

    steady_s: float
    graph_s: float
    clock_runs: bool = True


class Watchdog:
    """Expires when more than `timeout_s` has passed on both clocks since it was last fed.

    Both, because a paused simulation stops the graph's clock and a fast one outruns the machine's;
    neither is a fault. Where nobody keeps the graph's clock any more, the steady one alone.
    """

    def __init__(self, timeout_s: float) -> None:
        """Make a watchdog that was never fed, and so never expires.

        Args:
            timeout_s: Silence allowed, s, > 0.

        """
        self._timeout_s = timeout_s
        self._steady_s: float | None = None
        self._graph_s = 0.0

    @property
    def timeout_s(self) -> float:
        """Silence allowed, s."""
        return self._timeout_s

    @property
    def fed(self) -> bool:
        """Whether there ever was a sign of life."""
        return self._steady_s is not None

    def feed(self, now: Instant) -> None:
        """Note a sign of life."""
        self._steady_s = now.steady_s
        self._graph_s = now.graph_s

    def forget(self) -> None:
        """Behave as if it had never been fed."""
        self._steady_s = None

    def excuse(self, stood_s: float) -> None:
        """Leave out `stood_s` s in which the one who listens stood still itself, and could hear nothing."""
        if self._steady_s is not None:
            self._steady_s += stood_s

    def expired(self, now: Instant) -> bool:
        """Return True if the last sign of life is older than the timeout on both clocks."""
        if self._steady_s is None:
            return False
        # A simulation that was started anew sets the graph's clock back; silence is then counted from there.
        self._graph_s = min(self._graph_s, now.graph_s)
        graph_silent = now.graph_s - self._graph_s > self._timeout_s or not now.clock_runs
        return now.steady_s - self._steady_s > self._timeout_s and graph_silent
