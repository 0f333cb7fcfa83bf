"""From which gap on a signal is off: the less its noise is known, the further."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import f as fisher  # type: ignore[import-untyped]  # carries no types

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from jammkle_sim.gap.noise import NoiseSource
    from jammkle_sim.gap.residual import Layout

FALSE_ALARMS = 0.002
"""Chance that a signal in good order exceeds its limit. Assumed: 1 % over some ten signals that hang together."""


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


def limits_of(layout: Layout, noise: Mapping[str, NoiseSource], base: float) -> Limits:
    """Return the limits of all signals.

    The ratio of two variances in good order, each known from so many independent samples, follows Fisher's F: where
    noise comes from a few runs that drift, a few more that drift further are no gap.

    Args:
        layout: Of the residuals.
        noise: By signal.
        base: Smallest limit, noise units.

    """
    counts = np.bincount(layout.signal_of, minlength=len(layout.names)) / layout.least_factor
    found = {}
    for name, samples in zip(layout.names, counts, strict=True):
        known_from = noise[name].known_from
        sure = np.isinf(known_from)
        ratio = 1.0 if sure else float(fisher.ppf(1.0 - FALSE_ALARMS, max(samples, 1.0), max(known_from, 1.0)))
        found[name] = max(base, float(np.sqrt(ratio)))
    return Limits(base, found)
