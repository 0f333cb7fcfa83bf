"""Whether a set of readings is new, or an old one that is handed over again, as by hardware that stands still.

Noise makes sensors differ from one reading to the next; that all of them repeat to the digit happens with a probability
that is counted while they work. Where it is small, a set that repeats was not measured, whatever its stamp says: it
tells nothing of the air, and no part may be blamed for it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

KNOWN_AFTER = 100
"""Readings from which a sensor's way to repeat itself is known: a second of noise."""

_LIVELY = 0.1
"""Share of sets that repeat, below which a repeated one is no news: of noise of half a converter's step three sensors
and a manifold's repeat together in one set of ten or less."""

_BY_CHANCE = 1e-6
"""Probability of a run below which it is none: once in three hours at 100 Hz."""


class Freshness:
    """Compares each set of readings with the one before."""

    def __init__(self) -> None:
        """Know nothing of the sensors yet."""
        self._last: dict[str, float] = {}
        self._sets = 0
        self._repeats = 0
        self._run = 0

    @property
    def run(self) -> int:
        """How many sets in a row have repeated the one before them."""
        return self._run

    @property
    def stood_still(self) -> bool:
        """Whether the run is too long for chance, of sensors that were seen to be lively."""
        return self._run > 0 and self._lively and self._share**self._run < _BY_CHANCE

    def take(self, readings_pa: Mapping[str, float]) -> bool:
        """Take the next set, Pa by place; return whether it repeats the last one though its sensors are lively."""
        same = len(readings_pa) > 1 and readings_pa == self._last
        self._last = dict(readings_pa)
        if same:
            self._run += 1
            return self._lively
        if not self.stood_still:
            self._sets += self._run + 1
            self._repeats += self._run
        self._run = 0
        return False

    @property
    def _share(self) -> float:
        return (self._repeats + 1) / (self._sets + 2)  # Laplace's rule of succession

    @property
    def _lively(self) -> bool:
        return self._sets >= KNOWN_AFTER and self._share < _LIVELY
