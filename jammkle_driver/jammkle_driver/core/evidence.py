"""What was measured, and what was driven meanwhile, by the hardware's own times: nothing else is evidence of a fault.

A busy host hands readings and acknowledgements over late, in any order, or not at all. Here they are put in order by
their stamps, and a set of readings counts only once the hardware has said what it drove up to then. Where it has not,
the pressures begin anew; so a pause of the host can hide a fault for a moment, and never make one.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from jammkle_driver.core.hardware import ActuatorCommand

LONGEST_UNKNOWN_S = 0.1
"""Time from one acknowledgement to the next, s, beyond which nobody knows what was driven in between: two of the
periods at which hardware repeats it (20 Hz, jammkle_msgs/ActuatorStates)."""

LATE_SETS = 5
"""Sets of readings after which one that is missing a place is taken without it."""

_KEPT_S = 2.5
"""How long what was driven is remembered, s: longer than readings may be missing until all begins anew."""

_MOST_WAITING = 200
"""Sets that wait for an acknowledgement at the most: two seconds; older ones count for nothing."""

_SET_BACK_S = 1.0
"""By how much a stamp must be before the last one, s, to be of a clock that was set back, and not merely late."""


@dataclass(frozen=True)
class Moment:
    """Readings of one moment, and what led to them.

    Attributes:
        stamp_s: When they were made, s.
        readings_pa: Pa absolute, by place; one that is missing was not read.
        elapsed_s: Time since the moment before, s; 0 of the first one.
        driven: What the hardware drove over the last few seconds, each with the stamp since when, s; oldest first.
        known: Whether all of that is known ever since the moment before.

    """

    stamp_s: float
    readings_pa: Mapping[str, float]
    elapsed_s: float
    driven: tuple[tuple[float, ActuatorCommand], ...]
    known: bool


class Evidence:
    """Puts readings and what was driven in order."""

    def __init__(self, places: Sequence[str]) -> None:
        """Expect readings of `places`."""
        self._places = tuple(places)
        self._acknowledged = False
        self.clear()

    def clear(self) -> None:
        """Forget all readings and commands; what comes now begins anew."""
        self._driven: deque[tuple[float, ActuatorCommand]] = deque()
        self._until_s = -math.inf
        self._holes: deque[tuple[float, float]] = deque()
        self._waiting: dict[float, dict[str, float]] = {}
        self._last_s = -math.inf
        self._silent_sets = dict.fromkeys(self._places, 0)

    @property
    def acknowledged_s(self) -> float:
        """Stamp up to which the hardware has said what it drove, s; minus infinity if it has said nothing."""
        return self._until_s

    def command(self, command: ActuatorCommand, stamp_s: float) -> None:
        """Note what the hardware is told from `stamp_s` on, s; counts only where it acknowledges nothing."""
        if not self._acknowledged:
            self._drive(command, stamp_s)

    def acknowledge(self, command: ActuatorCommand, stamp_s: float) -> None:
        """Note what the hardware says that it drives, from `stamp_s` on or still then, s."""
        if not self._acknowledged or stamp_s < self._until_s:  # its first one, or a clock that was set back
            self._acknowledged = True
            self.clear()
        elif stamp_s - self._until_s > LONGEST_UNKNOWN_S:
            self._holes.append((self._until_s, stamp_s))
        self._until_s = stamp_s
        self._drive(command, stamp_s)

    def read(self, place: str, pressure_pa: float, stamp_s: float) -> None:
        """Take one reading, Pa absolute."""
        if stamp_s < self._last_s - _SET_BACK_S:
            self.clear()
        if stamp_s > self._last_s:
            self._waiting.setdefault(stamp_s, {})[place] = pressure_pa
            while len(self._waiting) > _MOST_WAITING:
                del self._waiting[min(self._waiting)]

    def due(self) -> Iterator[Moment]:
        """Yield, in order, the moments that are complete, and for which it is known what was driven."""
        while self._waiting:
            oldest_s = min(self._waiting)
            if self._acknowledged and oldest_s > self._until_s:
                return
            expected = sum(1 for silent in self._silent_sets.values() if silent <= 2 * LATE_SETS)
            if len(self._waiting[oldest_s]) < expected and len(self._waiting) <= LATE_SETS:
                return
            readings_pa = self._waiting.pop(oldest_s)
            holes = [(begin_s, end_s) for begin_s, end_s in self._holes if begin_s < oldest_s and end_s > self._last_s]
            if not self._driven or oldest_s < self._driven[0][0] or any(oldest_s < end_s for _, end_s in holes):
                continue  # nobody knows what led to it
            for place in self._places:
                self._silent_sets[place] = 0 if place in readings_pa else self._silent_sets[place] + 1
            elapsed_s = oldest_s - self._last_s if math.isfinite(self._last_s) else 0.0
            self._last_s = oldest_s
            self._holes = deque(hole for hole in self._holes if hole[1] > oldest_s)
            while len(self._driven) > 1 and self._driven[1][0] < oldest_s - _KEPT_S:
                self._driven.popleft()
            yield Moment(oldest_s, readings_pa, elapsed_s, tuple(self._driven), known=not holes)

    def _drive(self, command: ActuatorCommand, stamp_s: float) -> None:
        if not self._driven or command != self._driven[-1][1]:
            self._driven.append((stamp_s, command))
