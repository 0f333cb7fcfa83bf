"""How long the IMU has been silent, by two clocks."""

from __future__ import annotations


class Freshness:
    """Watches a count of samples from a timer, so that the samples themselves need not read any clock.

    A stream is stale only when both the steady clock and the graph's clock have advanced by more than the timeout
    since the last sample: a paused simulation stops the graph's clock, and is no fault.
    """

    def __init__(self, timeout_s: float, steady_s: float, graph_s: float) -> None:
        """Start watching now.

        Args:
            timeout_s: Silence that makes the stream stale, s.
            steady_s: Time of the steady clock, s.
            graph_s: Time of the graph's clock, s.

        """
        self._timeout_s = timeout_s
        self._count = 0
        self._since_steady_s = self._steady_s = steady_s
        self._since_graph_s = self._graph_s = graph_s

    def observe(self, count: int, steady_s: float, graph_s: float) -> None:
        """Take the number of samples received so far and the time of both clocks, s."""
        # A simulated clock reads zero until it is first heard: its first value is no lapse of time.
        clock_starts = self._graph_s == 0.0 and graph_s > 0.0
        if count != self._count or graph_s < self._graph_s or clock_starts:
            self._count = count
            self._since_steady_s = steady_s
            self._since_graph_s = graph_s
        self._steady_s = steady_s
        self._graph_s = graph_s

    @property
    def silent_s(self) -> float:
        """Time without a sample by the steady clock, s, as of the last `observe`."""
        return self._steady_s - self._since_steady_s

    @property
    def stale(self) -> bool:
        """Return True if samples are missing although time goes on."""
        graph_silent_s = self._graph_s - self._since_graph_s
        return self.silent_s > self._timeout_s and graph_silent_s > self._timeout_s

    @property
    def paused(self) -> bool:
        """Return True if samples are missing and the graph's clock stands still."""
        return self.silent_s > self._timeout_s and not self.stale
