"""When the foot will touch down: from the robot's own plan, or from the rhythm of the flights before."""

from __future__ import annotations

import statistics
from collections import deque

from jammkle_common.constants import NANOSECONDS_PER_SECOND

FLIGHTS = 3
"""As many flights in a row must have lasted about as long before the next one is foreseen."""
LARGEST_SPREAD = 0.15
"""Spread of those, over their mean, up to which they are alike: 45 ms in a swing of 0.3 s."""


class Rhythm:
    """Foresees the end of a flight or swing from how long the last ones took."""

    def __init__(self) -> None:
        """Know no flight."""
        self._lasted_ns: deque[int] = deque(maxlen=FLIGHTS)
        self._lifted_ns: int | None = None

    def lift(self, time_ns: int) -> None:
        """Note a lift-off."""
        self._lifted_ns = time_ns

    def land(self, time_ns: int) -> None:
        """Note a touch-down."""
        if self._lifted_ns is not None and time_ns > self._lifted_ns:
            self._lasted_ns.append(time_ns - self._lifted_ns)
        self._lifted_ns = None

    def forget(self) -> None:
        """Forget all: the clock was set back, or the IMU failed."""
        self._lasted_ns.clear()
        self._lifted_ns = None

    @property
    def touchdown_ns(self) -> int | None:
        """When this flight will end, ns; None: it is not known, or there is none."""
        if self._lifted_ns is None or len(self._lasted_ns) < FLIGHTS:
            return None
        mean_ns = statistics.fmean(self._lasted_ns)
        if statistics.pstdev(self._lasted_ns) > LARGEST_SPREAD * mean_ns:
            return None
        return self._lifted_ns + round(mean_ns)


class GaitPhase:
    """Foresees touch-downs from a phase that runs from 0, touch-down, to 1."""

    SILENT_S = 0.3
    """A phase that was not heard for so long is not one to plan with, s."""

    def __init__(self) -> None:
        """Know no phase."""
        self._phase = 0.0
        self._time_ns: int | None = None
        self._rate_hz = 0.0

    def hear(self, phase: float, time_ns: int) -> None:
        """Take the phase, 0 to 1, at a time, ns; anything else is ignored."""
        if not 0.0 <= phase <= 1.0:
            return
        if self._time_ns is not None and 0 < time_ns - self._time_ns < self.SILENT_S * NANOSECONDS_PER_SECOND:
            gained = (phase - self._phase) % 1.0
            rate_hz = gained * NANOSECONDS_PER_SECOND / (time_ns - self._time_ns)
            self._rate_hz = rate_hz if self._rate_hz == 0.0 else self._rate_hz + 0.2 * (rate_hz - self._rate_hz)
        elif self._time_ns is not None:
            self._rate_hz = 0.0
        self._phase, self._time_ns = phase, time_ns

    def phase(self, time_ns: int) -> float | None:
        """Phase at a time, ns, 0 to 1; None: not heard lately, or it stands still."""
        if self._time_ns is None or self._rate_hz <= 0.0:
            return None
        since_s = (time_ns - self._time_ns) / NANOSECONDS_PER_SECOND
        if not 0.0 <= since_s < self.SILENT_S:
            return None
        return (self._phase + since_s * self._rate_hz) % 1.0

    def touchdown_ns(self, time_ns: int) -> int | None:
        """When the phase is 1 next, ns; None: not known."""
        phase = self.phase(time_ns)
        if phase is None:
            return None
        return time_ns + round((1.0 - phase) / self._rate_hz * NANOSECONDS_PER_SECOND)
