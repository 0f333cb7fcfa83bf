"""Shares with their intervals, and how far stated probabilities are from what comes true."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import binomtest  # type: ignore[import-untyped]  # carries no types

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

LEVEL = 0.95
BINS = 10


@dataclass(frozen=True)
class Share:
    """So many out of so many, with its Wilson interval."""

    hits: int
    of: int

    @property
    def value(self) -> float:
        """The share; not a number of none."""
        return self.hits / self.of if self.of else float("nan")

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval by Wilson's score; all of 0 to 1 where there is nothing to go by."""
        if not self.of:
            return 0.0, 1.0
        found = binomtest(self.hits, self.of).proportion_ci(LEVEL, method="wilson")
        return float(found.low), float(found.high)


def share(hits: Iterable[bool]) -> Share:
    """Count."""
    listed = [bool(hit) for hit in hits]
    return Share(sum(listed), len(listed))


@dataclass(frozen=True)
class Bin:
    """Answers of about the same stated probability."""

    low: float
    high: float
    count: int
    stated: float
    """Mean probability that was stated."""
    true: Share
    """How many came true."""


def reliability(stated: Sequence[float], true: Sequence[bool]) -> tuple[Bin, ...]:
    """Sort answers into bins of equal width by the probability that was stated for them; empty bins are left out.

    Args:
        stated: Probability of each answer, 0 to 1.
        true: Whether it was right.

    """
    edges = np.linspace(0.0, 1.0, BINS + 1)
    place = np.clip(np.digitize(stated, edges[1:-1], right=True), 0, BINS - 1)
    bins = []
    for k in range(BINS):
        inside = [i for i in range(len(stated)) if place[i] == k]
        if inside:
            mean = float(np.mean([stated[i] for i in inside]))
            bins.append(Bin(float(edges[k]), float(edges[k + 1]), len(inside), mean, share(true[i] for i in inside)))
    return tuple(bins)


def calibration_error(bins: Sequence[Bin]) -> float:
    """Return the expected calibration error: mean distance of stated from true, weighted by the answers of each bin."""
    count = sum(each.count for each in bins)
    if not count:
        return float("nan")
    return sum(each.count * abs(each.stated - each.true.value) for each in bins) / count
