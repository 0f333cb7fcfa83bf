"""Samples of many signals on one time base, as they come: between two samples of a measurement lies a straight line.

What is no measurement (states, commands, words, switches) keeps its last value until the next one.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from jammkle_common.constants import NANOSECONDS_PER_SECOND

if TYPE_CHECKING:
    from collections.abc import Iterator

LATENESS_NS = 2 * NANOSECONDS_PER_SECOND
"""How long a moment waits for late samples. Assumed: a recorder's queues hold two seconds (`recorder.QUEUE_DEPTH`)."""

HOLE_NS = NANOSECONDS_PER_SECOND
"""Time without samples from which on a measurement is empty instead of a straight line. Assumed: well above the period
of what is measured here, 10 ms at most."""

EMPTY_NS = 600 * NANOSECONDS_PER_SECOND
"""Time without samples of any kind from which on there are no rows. Assumed: no sensor of a robot that runs is silent
for as long; a clock that was set makes years."""


@dataclass
class _Signal:
    """Samples of one column that are still needed. `is_measured`: straight lines between them."""

    is_measured: bool
    samples: deque[tuple[int, Any]] = field(default_factory=deque)

    def at(self, time_ns: int) -> Any:
        """Return the value at a time; None where there is none. Times must not decrease from call to call."""
        samples = self.samples
        while len(samples) > 1 and samples[1][0] <= time_ns:
            samples.popleft()
        if not samples or samples[0][0] > time_ns:
            return None
        begin_ns, value = samples[0]
        if not self.is_measured or begin_ns == time_ns:
            return value
        if len(samples) == 1 or samples[1][0] - begin_ns > HOLE_NS:
            return None
        end_ns, end = samples[1]
        return value + (end - value) * (time_ns - begin_ns) / (end_ns - begin_ns)


class TimeGrid:
    """Rows at equal distances in time, each as soon as nothing can change it any more."""

    def __init__(self, rate_hz: float) -> None:
        """Begin at time zero, with this many rows per second."""
        self._rate_hz = rate_hz
        self._next = 0
        self._now_ns = -1
        self._signals: dict[str, _Signal] = {}
        self.holes: list[tuple[int, int]] = []
        """Begin and end of the times without rows, ns."""
        self._passed = 0

    def add(self, time_ns: int, name: str, value: Any, *, is_measured: bool) -> None:
        """Take a sample; one that is older than its predecessor is put where it belongs."""
        samples = self._signals.setdefault(name, _Signal(is_measured)).samples
        later = []
        while samples and samples[-1][0] > time_ns:
            later.append(samples.pop())
        samples.append((time_ns, value))
        samples.extend(reversed(later))
        if self._now_ns >= 0 and time_ns - self._now_ns > EMPTY_NS:
            self.holes.append((self._now_ns, time_ns))
        self._now_ns = max(self._now_ns, time_ns)

    def ready(self) -> Iterator[dict[str, Any]]:
        """Return the rows that are ready, with `time_s`."""
        return self._until(self._now_ns - LATENESS_NS)

    def rest(self) -> Iterator[dict[str, Any]]:
        """Return the rows up to the last sample: nothing else comes."""
        return self._until(self._now_ns)

    def _until(self, end_ns: int) -> Iterator[dict[str, Any]]:
        while (time_ns := round(self._next * NANOSECONDS_PER_SECOND / self._rate_hz)) <= end_ns:
            if self._passed < len(self.holes) and time_ns > self.holes[self._passed][0]:
                end_ns = self.holes[self._passed][1]
                self._next = max(self._next, math.ceil(end_ns * self._rate_hz / NANOSECONDS_PER_SECOND))
                self._passed += 1
                continue
            self._next += 1
            row = {"time_s": time_ns / NANOSECONDS_PER_SECOND}
            for name, signal in self._signals.items():
                value = signal.at(time_ns)
                if value is not None:
                    row[name] = value
            yield row
