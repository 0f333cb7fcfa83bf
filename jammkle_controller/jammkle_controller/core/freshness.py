"""How long the IMU has been silent."""

from __future__ import annotations


class Freshness:
    """Watches a count of samples from regular work, so that the samples themselves need not read any clock."""

    def __init__(self, timeout_s: float, now_s: float) -> None:
        """Start watching now.

        Args:
            timeout_s: Silence that makes the stream stale, s.
            now_s: The time that the ankle lives in, s: a paused simulation stops it, and is no fault.

        """
        self._timeout_s = timeout_s
        self._count = 0
        self._since_s = self._now_s = now_s

    def observe(self, count: int, now_s: float) -> None:
        """Take the number of samples received so far, and the time, s."""
        # A simulated clock reads zero until it first ticks: its first value is no lapse of time.
        clock_starts = self._now_s == 0.0 and now_s > 0.0
        if count != self._count or now_s < self._now_s or clock_starts:
            self._count = count
            self._since_s = now_s
        self._now_s = now_s

    @property
    def silent_s(self) -> float:
        """Time without a sample, s, as of the last `observe`."""
        return self._now_s - self._since_s

    @property
    def stale(self) -> bool:
        """Whether samples are missing although time goes on."""
        return self.silent_s > self._timeout_s
