"""The logarithm of a ratio of two densities, as a polynomial of second order: what two Gaussians would make of it.

Learned by logistic regression, which estimates the ratio directly (Qin, Biometrika 85, 1998; Sugiyama, Suzuki,
Kanamori, "Density Ratio Estimation in Machine Learning", 2012, chapter 4).
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from importlib import resources
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

WEIGHTS_FILE = "learned.json"
LARGEST_LOG_ODDS = 8.0
"""No single look is surer than 1 in 3000: outside of what was learned from, a polynomial says anything."""


@dataclass(frozen=True)
class DensityRatio:
    """Weights of the polynomial: constant, linear, and products of features i <= j row by row, on scaled features."""

    centre: tuple[float, ...]
    scale: tuple[float, ...]
    constant: float
    linear: tuple[float, ...]
    products: tuple[tuple[float, ...], ...]
    """Row i holds the weights of the products with features i, i + 1, ..."""

    def log_odds(self, features: Sequence[float]) -> float:
        """Return the logarithm of the ratio at the features, within +-`LARGEST_LOG_ODDS`."""
        # Features far from all that was learned from are moved to its border: a square would dominate there.
        x = [
            min(3.5, max(-3.5, (value - centre) / scale))
            for value, centre, scale in zip(features, self.centre, self.scale, strict=True)
        ]
        total = self.constant
        for index, (value, weight, row) in enumerate(zip(x, self.linear, self.products, strict=True)):
            inner = weight
            for product, other in zip(row, x[index:], strict=True):
                inner += product * other
            total += value * inner
        return min(LARGEST_LOG_ODDS, max(-LARGEST_LOG_ODDS, total))


def probability_of(log_odds: float) -> float:
    """Return the probability, 0 to 1, of odds given by their logarithm."""
    return 1.0 / (1.0 + math.exp(-log_odds))


@dataclass(frozen=True)
class StepRatios:
    """All ratios of one place of the IMU."""

    swing: DensityRatio
    touchdown: DensityRatio
    slide: DensityRatio


def learned(mount: str) -> StepRatios:
    """Return the ratios of a place of the IMU that were learned on simulated steps.

    Raises:
        KeyError: there are none for that place.

    """
    return ratios_of(json.loads(resources.files(__package__).joinpath(WEIGHTS_FILE).read_text()), mount)


def ratios_of(entries: Mapping[str, Mapping[str, Any]], mount: str) -> StepRatios:
    """Return the ratios of a place of the IMU from entries as `learned.json` has them.

    Raises:
        KeyError: there are none for that place.

    """
    return StepRatios(*(_ratio_of(entries[f"{what}_{mount}"]) for what in ("swing", "touchdown", "slide")))


def _ratio_of(entry: Mapping[str, Any]) -> DensityRatio:
    return DensityRatio(
        centre=tuple(entry["centre"]),
        scale=tuple(entry["scale"]),
        constant=entry["constant"],
        linear=tuple(entry["linear"]),
        products=tuple(tuple(row) for row in entry["products"]),
    )
