"""The gap of one subsystem over the last seconds, and how long it has been too large."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jammkle_gap.monitor.core.followed import Residual


@dataclass(frozen=True)
class Worst:
    """The signal that is off most."""

    signal: str
    gap: float
    """Root mean square of measured less simulated over the window, noise units."""
    phase: str
    """In which most of its squares lie."""


class GapWindow:
    """Squares of the residuals of one subsystem."""

    def __init__(self, length_s: float) -> None:
        """Begin with nothing; what is older than `length_s` is left out."""
        self._length_s = length_s
        self._parts: deque[tuple[float, str, str, float, int]] = deque()

    def clear(self) -> None:
        """Forget everything."""
        self._parts.clear()

    def add(self, end_s: float, residuals: Sequence[Residual]) -> None:
        """Take the residuals of a stretch that ended at a time."""
        for each in residuals:
            squares = float(np.sum(each.scaled**2))
            self._parts.append((end_s, each.signal, each.phase, squares, len(each.scaled)))
        while self._parts and self._parts[0][0] <= end_s - self._length_s:
            self._parts.popleft()

    def gaps(self) -> dict[str, float]:
        """Return the gap of every signal that was compared, noise units."""
        sums: dict[str, tuple[float, int]] = {}
        for _, signal, _, squares, count in self._parts:
            before = sums.get(signal, (0.0, 0))
            sums[signal] = (before[0] + squares, before[1] + count)
        return {signal: math.sqrt(squares / count) for signal, (squares, count) in sums.items()}

    def worst(self) -> Worst | None:
        """Return the signal that is off most; None if nothing was compared."""
        gaps = self.gaps()
        if not gaps:
            return None
        name = max(gaps, key=lambda signal: gaps[signal])
        phases: dict[str, float] = {}
        for _, signal, phase, squares, _ in self._parts:
            if signal == name:
                phases[phase] = phases.get(phase, 0.0) + squares
        return Worst(name, gaps[name], max(phases, key=lambda phase: phases[phase]))
