"""The error that a sensor's step leaves in the mean of a bin.

Rounding to a step q errs by q^2 / 12 in the mean square. How much of that a mean takes away depends on what moves the
readings of a bin across the steps: noise, or motion. With the phase of the steps left to chance, the errors of two
readings that differ by d before rounding have a covariance of the sum over l of q^2 / (2 pi^2 l^2) cos(2 pi l d / q)
(Fourier series of the sawtooth). Readings that scatter normally by t about a bin's mean therefore share, by their
characteristic function (Widrow and Kollar 2008, Quantization Noise, ch. 4 and 9; Gray and Stockham 1993, IEEE Trans.
Inf. Theory 39:805),

    S = sum over l >= 1 of q^2 / (2 pi^2 l^2) exp(-4 pi^2 l^2 t^2 / q^2),

which is q^2 / 12 where all stand on one code and nothing from t = q / 2 on. The mean of n readings errs by
S + (q^2 / 12 - S) / n in the mean square: what they share, and their own. Rounded readings of a bin vary by
w = t^2 + q^2 / 12 - S, which rises with t, so that their variance w tells S. A steady motion through the bin, whose
readings are spread evenly instead, has the S of the same w to within q^2 / 360.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

_SCATTER = np.linspace(0.0, 1.0, 201)
"""t in steps; beyond the last, S is below the rounding of a number."""
_ORDERS = np.arange(1, 501)[:, np.newaxis]
"""Terms of the sum; those left out are a thousandth of it where all readings stand on one code, and less elsewhere."""
_SHARED = (np.exp(-4.0 * np.square(np.pi * _ORDERS * _SCATTER)) / (2.0 * np.square(np.pi * _ORDERS))).sum(axis=0)
_SHARED *= 1.0 / 12.0 / _SHARED[0]
_VARIANCE = np.square(_SCATTER) + 1.0 / 12.0 - _SHARED
SIDE = 4
"""Bins on either side whose readings tell how much they vary. A slow motion crosses a step in few bins, and errs in all
of them. Chosen: a motion of a quarter of a step in a bin crosses one in them."""


def mean_error(variance: NDArray[np.float64], step: float, count: float) -> NDArray[np.float64]:
    """Return the mean square error that rounding leaves in the mean of a bin, per bin, in the unit's square.

    Args:
        variance: Of rounded readings about their bin's mean, shape (bins,), in the unit's square.
        step: Of the sensor, above 0.
        count: Readings in a bin, 1 or more.

    """
    shared = np.interp(variance / step**2, _VARIANCE, _SHARED)
    found: NDArray[np.float64] = step**2 * (shared + (1.0 / 12.0 - shared) / count)
    return found


def varying(
    runs: Sequence[tuple[NDArray[np.float64], NDArray[np.float64]]], bin_s: float, bins: int
) -> NDArray[np.float64]:
    """Return the variance of all runs' readings about the mean of their bin, shape (bins,), in the unit's square.

    Bins before and bins after are taken by themselves, each with the bin, and the less counts: a machine that stands
    still until it is let go is not said to move before.

    Args:
        runs: Times, s, and values of one signal in each run.
        bin_s: Length of a bin, s.
        bins: How many.

    """
    squares, freedom = np.zeros(bins), np.zeros(bins)
    for time_s, values in runs:
        at = np.floor(time_s / bin_s).astype(int)
        inside = (at >= 0) & (at < bins)
        at, read = at[inside], values[inside]
        count = np.bincount(at, minlength=bins)
        means = np.bincount(at, weights=read, minlength=bins) / np.maximum(count, 1)
        squares += np.bincount(at, weights=np.square(read - means[at]), minlength=bins)
        freedom += np.maximum(count - 1, 0)
    sides = []
    for offset in (0, SIDE):
        sums = [np.convolve(np.pad(each, SIDE), np.ones(SIDE + 1), "valid") for each in (squares, freedom)]
        sides.append((sums[0] / np.maximum(sums[1], 1.0))[offset : offset + bins])
    found: NDArray[np.float64] = np.minimum(*sides)
    return found
