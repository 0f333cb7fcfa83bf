"""How fast the robot's time passes, as its stamps show it."""

from __future__ import annotations

import math
from collections import deque

_SPAN_S = 2.0
"""Real time over which the factor is taken. Assumed: steady to look at, and soon right after a change."""


class RealTimeFactor:
    """Seconds of the robot's time per second of real time."""

    def __init__(self) -> None:
        """Begin without a sample."""
        self._seen: deque[tuple[float, float]] = deque()

    def note(self, robot_s: float, real_s: float) -> None:
        """Take the robot's latest time, NaN where it has none yet, at a real time, both in s.

        Time that goes back starts anew.
        """
        if math.isnan(robot_s):
            return
        if self._seen and robot_s < self._seen[-1][0]:
            self._seen.clear()
        self._seen.append((robot_s, real_s))
        while len(self._seen) > 2 and self._seen[1][1] <= real_s - _SPAN_S:  # noqa: PLR2004 - it takes two
            self._seen.popleft()

    def value(self) -> float:
        """Return the factor; NaN until half of the span was seen."""
        if not self._seen:
            return math.nan
        (first_s, first_real_s), (last_s, last_real_s) = self._seen[0], self._seen[-1]
        passed_s = last_real_s - first_real_s
        return (last_s - first_s) / passed_s if passed_s > _SPAN_S / 2.0 else math.nan
