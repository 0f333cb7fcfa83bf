"""Held-out scores of candidates, block by block, and which of them the data can tell apart."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from jammkle_gap.november.fitting import loss_of
from jammkle_gap.november.holding_out import one_step

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from jammkle_gap.november.fitting import Fit
    from jammkle_gap.november.holding_out import HeldOut
    from jammkle_gap.november.residual import Layout, Weighting

FREEDOM = 4.0
"""Degrees of freedom of the Student-t density: a far sample counts, but does not decide alone. Assumed."""
STANDARD_ERRORS = 2.0
SMALLEST_ERROR_NATS = 1.5
"""A difference of scores is never known better than this: less than odds of 20 tell nothing apart. Assumed."""
CLEAR_NATS = 3.0
"""What another effect must gain at least, beyond the logarithm of how many were tried. Assumed: odds of 20."""


@dataclass(frozen=True)
class Score:
    """How well a candidate foretells what it was not fitted to."""

    fit: Fit
    segments: NDArray[np.float64]
    """Log-likelihood of each segment, nats, its block held out."""
    held_out: NDArray[np.float64]
    """Residual with the block of each sample held out, shape (n,), noise units."""
    points: NDArray[np.float64]
    """Parameters with each block held out, shape (blocks, p), shares of the ranges."""

    @property
    def names(self) -> tuple[str, ...]:
        """The effects, sorted."""
        return self.fit.names

    @property
    def total(self) -> float:
        """Sum over all segments, nats."""
        return float(self.segments.sum())


@dataclass(frozen=True)
class Difference:
    """How much better one candidate is than another."""

    nats: float
    error: float
    """Standard error, from the scatter over segments."""

    @property
    def told_apart(self) -> bool:
        """Whether it exceeds two standard errors."""
        return self.nats > STANDARD_ERRORS * self.error


def log_likelihood(layout: Layout, weighting: Weighting, residual: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the log-likelihood of each segment up to a constant, nats, shape (segments,)."""
    scale, factor = weighting.scale_of(layout), weighting.factor[layout.signal_of]
    each = -0.5 * (FREEDOM + 1.0) * np.log1p((residual / scale) ** 2 / FREEDOM) / factor
    return np.bincount(layout.segment_of, each, layout.block_of_segment.size).astype(np.float64)


def score(fit: Fit, layout: Layout, weighting: Weighting) -> Score:
    """Score a fit with each block held out in turn by one step, without any further run of the simulator."""
    return scored(
        fit, one_step(fit, loss_of(layout, weighting), layout.block_of, len(layout.blocks)), layout, weighting
    )


def scored(fit: Fit, held: HeldOut, layout: Layout, weighting: Weighting) -> Score:
    """Score a fit by what it foretells of each block held out."""
    return Score(fit, log_likelihood(layout, weighting, held.residual), held.residual, held.points)


def difference(better: Score, other: Score) -> Difference:
    """Compare two candidates, paired over segments."""
    apart = better.segments - other.segments
    error = float(np.sqrt(apart.size) * np.std(apart, ddof=1))
    return Difference(float(apart.sum()), max(error, SMALLEST_ERROR_NATS))


def clearly_better(more: Score, fewer: Score, tried: int) -> bool:
    """Whether a candidate with more effects earns them: by two standard errors, and for how many were tried.

    That something is off is known beforehand, by limits of its own: beside no effect, the errors alone count.
    """
    apart = difference(more, fewer)
    if not fewer.names:
        return apart.told_apart
    extra = max(1, len(more.names) - len(fewer.names))
    return apart.told_apart and apart.nats > extra * (CLEAR_NATS + float(np.log(max(tried, 1))))


def admitted(scores: list[Score], tried: int) -> list[Score]:
    """Return the candidates that are clearly better than every part of them and than the best with fewer effects."""
    kept: list[Score] = []
    for each in sorted(scores, key=lambda one: (len(one.names), -one.total)):
        fewer = [other for other in kept if len(other.names) < len(each.names)]
        best = max(fewer, key=lambda other: other.total, default=None)
        parts = [other for other in scores if set(other.names) < set(each.names)]
        rivals = parts + ([best] if best is not None else [])
        if all(clearly_better(each, other, tried) for other in rivals):
            kept.append(each)
    return kept


def best_set(scores: list[Score], tried: int) -> list[Score]:
    """Return all candidates within two standard errors of the best, best first.

    Args:
        scores: The nominal simulator among them.
        tried: How many effects were on offer: the more, the more a new one has to gain.

    """
    kept = sorted(admitted(scores, tried), key=lambda one: -one.total)
    return [each for each in kept if not difference(kept[0], each).told_apart]
