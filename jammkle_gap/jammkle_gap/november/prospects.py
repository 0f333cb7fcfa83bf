"""Whether it is worth going on with a search: what candidates leave, beside what counts as none."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable

    from jammkle_gap.november.fitting import Fit
    from jammkle_gap.november.limits import Limits
    from jammkle_gap.november.residual import Layout

_PROMISING = 0.5
"""Where all leave more than this of the gap, few more are fitted, as leads: nothing will be named anyway."""
_LITTLE = 0.1
"""Share of the gap that may be left for no further effect to be looked for."""


@dataclass(frozen=True)
class Prospects:
    """Of one search."""

    layout: Layout
    nominal: Fit
    """Of no effect."""
    limits: Limits
    """Largest gaps that count as none."""

    def settled(self, fits: Iterable[Fit]) -> bool:
        """Whether some candidate leaves what counts as none, and little of the gap: no other effect would be added."""
        return any(
            self.limits.holds(self.layout, fit.residual) and self._share_left(self._gap(fit)) < _LITTLE
            for fit in fits
            if fit.names
        )

    def worthwhile(self, fits: Iterable[Fit]) -> bool:
        """Whether one of these closes enough that going on may end in an explanation."""
        return self.enough(min(map(self._gap, fits)))

    def enough(self, gap: float) -> bool:
        """Whether a candidate that leaves this gap may become an explanation."""
        return self._share_left(gap) < _PROMISING

    def least(self, fits: Iterable[Fit]) -> float:
        """Return the gap of the worst signal, where it is least: many quiet signals hide nothing of one that is off."""
        return min(max(self.layout.gaps(fit.residual).values()) for fit in fits)

    def _gap(self, fit: Fit) -> float:
        return self.layout.gap_above_floor(fit.residual)

    def _share_left(self, gap: float) -> float:
        stake = self._gap(self.nominal) - 1.0
        return (gap - 1.0) / stake if stake > 0.0 else 1.0
