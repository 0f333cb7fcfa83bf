"""From which gap on a signal is off: the less its noise is known, the further."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import f as fisher  # type: ignore[import-untyped]  # carries no types

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from jammkle_gap.november.noise import NoiseSource
    from jammkle_gap.november.residual import Layout

FALSE_ALARMS = 0.001
"""Chance that a signal in good order exceeds its limit. Assumed: 1 % over some ten signals that hang together."""

_SAME = 0.02
"""Gaps that differ by less are the same, noise units."""


@dataclass(frozen=True)
class Limits:
    """Largest gap that counts as none, noise units."""

    base: float
    """Of a signal whose noise is known for sure."""
    of_signal: Mapping[str, float]

    def worst(self, layout: Layout, residual: NDArray[np.float64]) -> tuple[str, float, float]:
        """Return the signal that is furthest beyond its limit, its gap, and the ratio of the two."""
        gaps = layout.gaps(residual)
        name = max(gaps, key=lambda each: gaps[each] / self.of_signal[each])
        return name, gaps[name], gaps[name] / self.of_signal[name]

    def holds(self, layout: Layout, residual: NDArray[np.float64]) -> bool:
        """Whether no signal is off."""
        return self.worst(layout, residual)[2] <= 1.0

    def do_not_tell(self, layout: Layout, best: NDArray[np.float64], other: NDArray[np.float64]) -> bool:
        """Whether another residual is as good as the best, whatever scores make of it.

        Both leave what counts as none, and where the other leaves more, the noise is badly known: a score takes it for
        what it seems to be.

        Args:
            layout: Of the residuals.
            best: What the best leaves, shape (n,).
            other: What the other one leaves, shape (n,).

        """
        first, second = layout.gaps(best), layout.gaps(other)
        known = [name for name in layout.names if self.of_signal[name] <= self.base]
        return self.holds(layout, other) and all(second[name] < first[name] + _SAME for name in known)


def limits_of(layout: Layout, noise: Mapping[str, NoiseSource], base: float) -> Limits:
    """Return the limits of all signals.

    The part of the noise that hangs together may be known from a few runs only; the ratio of two such variances follows
    Fisher's F. Where runs drift, a few more that drift further are no gap.

    Args:
        layout: Of the residuals.
        noise: By signal.
        base: Smallest limit, noise units.

    """
    counts = np.bincount(layout.signal_of, minlength=len(layout.names))
    found = {}
    for name, samples in zip(layout.names, counts, strict=True):
        hanging = noise[name].hanging
        ratio = 1.0
        if hanging.share > 0.0 and np.isfinite(hanging.known_from):
            known = max(hanging.known_from, 1.0)
            freedoms = min(max(samples / hanging.samples, 1.0), known), known
            ratio += hanging.share * (float(fisher.ppf(1.0 - FALSE_ALARMS, *freedoms)) - 1.0)
        found[name] = max(base, float(np.sqrt(ratio)))
    return Limits(base, found)
