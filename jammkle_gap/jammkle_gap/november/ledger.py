"""What a search knows so far: fits, how the signals are judged by the best of them, and their held-out scores."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from jammkle_gap.november.fitting import Loss, loss_of
from jammkle_gap.november.holding_out import fitted_again
from jammkle_gap.november.residual import Weighting, doubt_of, weigh
from jammkle_gap.november.scoring import Score, score, scored

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from jammkle_gap.november.fitting import Fit
    from jammkle_gap.november.holding_out import HeldOut
    from jammkle_gap.november.residual import Layout
    from jammkle_gap.november.runs import Runs

MOST_CORRELATED = 10.0
"""Samples that count as one while searching, at most. Assumed: as correlated as coloured noise is."""


class Ledger:
    """Fits by their effects."""

    def __init__(self, layout: Layout, nominal: Fit) -> None:
        """Begin with the nominal simulator alone."""
        self._layout = layout
        self.fits: dict[tuple[str, ...], Fit] = {(): nominal}
        self.weighting = weigh(layout, nominal.residual)
        self._weighted: dict[tuple[str, ...], tuple[Fit, Weighting]] = {}
        self._held: dict[tuple[str, ...], tuple[Fit, HeldOut]] = {}

    def add(self, fits: Iterable[Fit]) -> None:
        """Take fits in, in place of those of the same effects."""
        self.fits |= {fit.names: fit for fit in fits}

    def judge(self) -> None:
        """Take the scale of each signal from the candidate that leaves least of it, correlation from the best over all.

        The best over all leaves least in shares, which need not be the one of the best score: where a lasting error is
        left, its samples count as few, and what would take it away would look worth little. For the same reason a
        signal's scale is not what the best over all leaves: of two effects that each explain some signals, neither
        alone would show what both are worth together.
        """
        for names, fit in self.fits.items():
            if self._weighted.get(names, (None,))[0] is not fit:
                self._weighted[names] = fit, weigh(self._layout, fit.residual)
        best, weighting = min(
            self._weighted.values(),
            key=lambda each: float(np.sum(np.log(each[1].scale) + 1e-3 * np.log(each[1].factor))),
        )
        change = self.fits[()].residual - best.residual
        scale = np.min([each.scale for _, each in self._weighted.values()], axis=0)
        self.weighting = replace(weighting, scale=scale, doubt=doubt_of(self._layout, change))

    def loss(self) -> Loss:
        """Return the loss to search by.

        While searching, all signals count as correlated as the least correlated one, and no more than a good residual
        is: else what takes a lasting error away would look worth little. Held-out scores alone decide in the end.
        """
        factor = np.full_like(self.weighting.factor, min(float(self.weighting.factor.min()), MOST_CORRELATED))
        return loss_of(self._layout, replace(self.weighting, factor=factor))

    def cost(self, names: tuple[str, ...]) -> float:
        """Return the cost of a fit as judged now, nats."""
        return self.loss().cost(self.fits[names].residual)

    def scores(self) -> list[Score]:
        """Return the held-out score of every fit, best first."""
        return sorted(map(self._score, self.fits.values()), key=lambda one: -one.total)

    def hold_out(self, candidates: Sequence[tuple[str, ...]], runs: Runs) -> None:
        """Fit candidates without each block that may decide their parameters alone."""
        loss = loss_of(self._layout, self.weighting)
        fits = [self.fits[names] for names in candidates if self._held_of(self.fits[names]) is None]
        blocks = self._layout.block_of, len(self._layout.blocks)
        for fit, held in zip(fits, fitted_again(fits, loss, *blocks, runs, self._layout), strict=True):
            self._held[fit.names] = fit, held

    def _held_of(self, fit: Fit) -> HeldOut | None:
        of, held = self._held.get(fit.names, (None, None))
        return held if of is fit else None

    def _score(self, fit: Fit) -> Score:
        held = self._held_of(fit)
        if held is None:
            return score(fit, self._layout, self.weighting)
        return scored(fit, held, self._layout, self.weighting)
