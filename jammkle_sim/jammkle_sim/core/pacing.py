"""When simulated time may move on: paced to real time, and how well that succeeds. Knows no clock of its own."""

from __future__ import annotations

import math
from collections import deque

AS_FAST_AS_POSSIBLE = 0.0
"""The speed that stands for no pacing at all."""

MAX_BACKLOG_S = 0.1
"""Real time that may be caught up, s. Assumed: longer than any usual pause of the machine, and short enough that
catching up is no burst that a 100 Hz regulator would feel."""

_FACTOR_WINDOW_S = 2.0
_FACTOR_SAMPLE_S = 0.05
_FACTOR_SHORTEST_S = 0.25


class Pacer:
    """Maps simulated time to the real time at which it is due, without drift: due times count from one fixed anchor.

    Simulated time never runs ahead of real time x speed. When the machine falls behind by more than
    `max_backlog_s` of real time, the excess is given up for good instead of being caught up in a rush.
    """

    def __init__(self, speed: float, max_backlog_s: float = MAX_BACKLOG_S) -> None:
        """Make a pacer; `restart` it before use.

        Args:
            speed: Simulated seconds per real second; 0 is as fast as possible.
            max_backlog_s: Real time that may be caught up, s.

        """
        self._max_backlog_s = max_backlog_s
        self._late_cycles = 0
        self._given_up_s = 0.0
        self._speed = speed
        self._anchor_real_s = 0.0
        self._anchor_simulated_s = 0.0
        self._last_simulated_s = 0.0

    @property
    def speed(self) -> float:
        """Simulated seconds per real second; 0 is as fast as possible."""
        return self._speed

    @property
    def late_cycles(self) -> int:
        """How many cycles began only when the one after them was due already."""
        return self._late_cycles

    @property
    def given_up_s(self) -> float:
        """Real time, s, that was lost for good because the backlog had grown beyond its bound."""
        return self._given_up_s

    def restart(self, simulated_s: float, now_s: float, speed: float | None = None) -> None:
        """Begin anew: `simulated_s` is due at `now_s`. After a pause, a change of speed, or whatever stopped time."""
        self._anchor_real_s = now_s
        self._anchor_simulated_s = simulated_s
        self._last_simulated_s = simulated_s
        if speed is not None:
            self._speed = speed

    def wait_s(self, simulated_s: float, now_s: float) -> float:
        """Real time, s, until `simulated_s` is due; 0 when it is due, never negative."""
        if self._speed == AS_FAST_AS_POSSIBLE:
            return 0.0
        return max(0.0, self._due_s(simulated_s) - now_s)

    def begin(self, simulated_s: float, now_s: float) -> None:
        """Note that the cycle which ends at `simulated_s` begins now; keeps the count of late ones and the backlog."""
        if self._speed == AS_FAST_AS_POSSIBLE:
            return
        late_s = now_s - self._due_s(simulated_s)
        if late_s > (simulated_s - self._last_simulated_s) / self._speed:
            self._late_cycles += 1
        self._last_simulated_s = simulated_s
        if late_s > self._max_backlog_s:
            self._given_up_s += late_s - self._max_backlog_s
            self._anchor_real_s += late_s - self._max_backlog_s

    def _due_s(self, simulated_s: float) -> float:
        return self._anchor_real_s + (simulated_s - self._anchor_simulated_s) / self._speed


class RealTimeFactor:
    """Simulated time per real time, measured over the last two seconds of real time."""

    def __init__(self) -> None:
        """Make a meter that has measured nothing."""
        self._samples: deque[tuple[float, float]] = deque()

    def restart(self) -> None:
        """Forget everything: time stood still, and a mean across that would mean nothing."""
        self._samples.clear()

    def note(self, simulated_s: float, now_s: float) -> None:
        """Note where simulated time stands at real time `now_s`."""
        samples = self._samples
        if samples and now_s - samples[-1][0] < _FACTOR_SAMPLE_S:
            return
        samples.append((now_s, simulated_s))
        while now_s - samples[0][0] > _FACTOR_WINDOW_S:
            samples.popleft()

    def value(self) -> float:
        """Simulated seconds per real second; NaN while less than a quarter of a second has been measured."""
        if not self._samples:
            return math.nan
        (first_s, first_simulated_s), (last_s, last_simulated_s) = self._samples[0], self._samples[-1]
        span_s = last_s - first_s
        return (last_simulated_s - first_simulated_s) / span_s if span_s >= _FACTOR_SHORTEST_S else math.nan
