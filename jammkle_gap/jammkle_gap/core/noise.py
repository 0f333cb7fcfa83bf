"""White noise and resolution of a signal, from its own samples, where nobody declared them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from jammkle_gap.core.data import Signal

BLOCKS = 8
"""Stretches of time of which the median is taken: motion faster than the samples in fewer than half does not count."""
_WEIGHTS = np.array([0.5, -1.0, 0.5])
"""A sample less what its neighbours promise: a straight line gives 0, white noise 1.5 times its variance."""


def noise_of(signal: Signal) -> tuple[float, float]:
    """Return standard deviation from sample to sample, and smallest step, in the signal's unit.

    As declared; where neither is, the noise is estimated by differences of neighbouring samples, which cancel whatever
    changes slowly (Rice 1984, Ann. Stat. 12:1215; of second order: Gasser, Sroka and Jennen-Steinmetz 1986, Biometrika
    73:625), and the smallest step that occurs is the resolution.
    """
    if signal.noise > 0.0 or signal.resolution > 0.0:
        return signal.noise, signal.resolution
    if signal.values.size < BLOCKS + len(_WEIGHTS) - 1:
        return 0.0, 0.0
    second = np.convolve(signal.values, _WEIGHTS, "valid")
    variances = [np.square(block).mean() for block in np.array_split(second, BLOCKS)]
    return float(np.sqrt(np.median(variances) / np.square(_WEIGHTS).sum())), _smallest_step(signal.values)


def _smallest_step(values: NDArray[np.float64]) -> float:
    """Return the smallest difference of two values; 0 for a constant."""
    steps = np.diff(np.unique(values))
    return float(steps.min()) if steps.size else 0.0
