"""Scatter of healthy runs: its covariance, fitted to the repeats at hand, and whitening by it.

One run's covariance is D + U U'. U has a column for each thing that a rig cannot set or that a machine does not repeat,
the simulator's difference for one standard deviation, and smooth blocks per signal for what healthy repeats differ by
otherwise; D is what is left, local in time. Repeats are few, so every variance is moderated: the weighted mean of what
the repeats show and of its prior, with the degrees of freedom of both as weights (Smyth 2004, Stat. Appl. Genet. Mol.
Biol. 3:3, eq. 4). Amplitudes of the columns are fitted by expectation maximisation of the marginal likelihood (factor
analysis with known loadings; Rubin and Thayer 1982, Psychometrika 47:69).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from jammkle_gap.core.constants import Constants
    from jammkle_gap.core.features import Layout


@dataclass(frozen=True)
class Repeats:
    """What repeats of one setting scatter by."""

    layout: Layout
    deviations: NDArray[np.float64]
    """Residuals of runs less the mean of their group (references, or faulty runs), shape (runs, n)."""
    freedom: int
    """Degrees of freedom of the deviations: runs less groups."""
    columns: NDArray[np.float64]
    """Difference that each nuisance makes for one standard deviation of its prior, shape (n, nuisances)."""


@dataclass(frozen=True)
class Scatter:
    """Covariance of one healthy run: diagonal and columns."""

    variance: NDArray[np.float64]
    """D, shape (n,)."""
    columns: NDArray[np.float64]
    """U, shape (n, columns)."""
    freedom: int
    """Degrees of freedom of the repeats that it was fitted to."""
    amplitudes: NDArray[np.float64]
    """Standard deviation of each nuisance in units of its prior's, shape (nuisances,)."""


def fit_scatter(settings: Sequence[Repeats], constants: Constants) -> list[Scatter]:
    """Fit the covariance of one run of each setting.

    Amplitudes of nuisances are those of the machine and its rig: the same in all settings.

    Args:
        settings: Repeats of each; one without repeats has its prior.
        constants: Prior degrees of freedom, blocks, iterations.

    Returns:
        One per setting.

    """
    count = settings[0].columns.shape[1]
    amplitude2 = np.ones(count)
    variances = [np.square(each.layout.floor) for each in settings]
    rests = [np.zeros(each.layout.size) for each in settings]
    total = sum(each.freedom for each in settings)
    for _ in range(constants.scatter_iterations):
        gathered = np.zeros(count)
        for k, each in enumerate(settings):
            if each.freedom == 0:
                continue
            second, rests[k] = _expected(each, variances[k], amplitude2)
            gathered += second
            variances[k] = _moderated_variance(each.layout, rests[k], each.freedom, constants)
        prior = constants.nuisance_prior_freedom
        amplitude2 = (prior + gathered) / (prior + total)
    found = []
    for each, variance in zip(settings, variances, strict=True):
        blocks = _blocks(each, variance, amplitude2, constants)
        scaled = each.columns * np.sqrt(amplitude2)
        found.append(Scatter(variance, np.hstack([scaled, blocks]), each.freedom, np.sqrt(amplitude2)))
    return found


def _expected(
    repeats: Repeats, variance: NDArray[np.float64], amplitude2: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return expected sums of squares: of every nuisance, in its prior's variance, and of what is left per feature."""
    columns = repeats.columns * np.sqrt(amplitude2)
    whitened = columns / np.sqrt(variance)[:, np.newaxis]
    posterior = np.linalg.inv(np.eye(columns.shape[1]) + whitened.T @ whitened)
    scores = (repeats.deviations / np.sqrt(variance)) @ whitened @ posterior
    second = amplitude2 * (np.square(scores).sum(axis=0) + repeats.freedom * np.diag(posterior))
    spread = np.einsum("ij,jk,ik->i", columns, posterior, columns, optimize=True)
    rest = np.square(repeats.deviations - scores @ columns.T).sum(axis=0) + repeats.freedom * spread
    return second, rest


def _moderated_variance(
    layout: Layout, rest: NDArray[np.float64], freedom: int, constants: Constants
) -> NDArray[np.float64]:
    """Return the variance of each feature from sums of squares: local in time, moderated by that of its signal."""
    variance = np.empty(layout.size)
    table = layout.by_signal(rest) / freedom
    half = max(int(np.ceil((constants.local_freedom / freedom - 1.0) / 2.0)), 0)
    window = np.ones(2 * half + 1) / (2 * half + 1)
    local_freedom = freedom * len(window)
    out = layout.by_signal(variance)
    for i, row in enumerate(table):
        local = np.convolve(np.pad(row, half, mode="edge"), window, mode="valid")
        prior = constants.local_prior_freedom
        out[i] = (prior * row.mean() + local_freedom * local) / (prior + local_freedom)
    events = slice(len(layout.signals) * layout.bins, layout.size)
    prior = constants.variance_prior_freedom
    variance[events] = (prior * np.square(layout.floor[events]) + rest[events]) / (prior + freedom)
    return np.maximum(variance, np.square(layout.floor))


def _blocks(
    repeats: Repeats, variance: NDArray[np.float64], amplitude2: NDArray[np.float64], constants: Constants
) -> NDArray[np.float64]:
    """Return a column per signal and block of time: what repeats still differ by over many bins, shape (n, blocks)."""
    layout = repeats.layout
    count = min(constants.blocks, layout.bins)
    block = np.arange(layout.bins) * count // layout.bins
    per_block = np.bincount(block, minlength=count)
    if repeats.freedom:
        columns = repeats.columns * np.sqrt(amplitude2)
        whitened = columns / np.sqrt(variance)[:, np.newaxis]
        posterior = np.linalg.inv(np.eye(columns.shape[1]) + whitened.T @ whitened)
        left = repeats.deviations - ((repeats.deviations / np.sqrt(variance)) @ whitened @ posterior) @ columns.T
    else:
        left = np.zeros((0, layout.size))
    table = layout.by_signal(left)
    expected = layout.by_signal(variance)
    floor = layout.by_signal(layout.floor)
    found = []
    for i in range(len(layout.signals)):
        means = np.array([[run[block == b].mean() for b in range(count)] for run in table[:, i]]).reshape(-1, count)
        white = np.array([expected[i][block == b].mean() for b in range(count)]) / per_block
        own = np.square(means).sum(axis=0) / max(repeats.freedom, 1)
        # Without repeats a block may be off by as much as one sample: drift within the sensor's own noise.
        pooled = own.mean() if repeats.freedom else float(np.square(floor[i]).mean())
        prior = constants.variance_prior_freedom
        moderated = (prior * pooled + repeats.freedom * own) / (prior + repeats.freedom)
        amplitude = np.sqrt(np.maximum(moderated - white, constants.block_share * white))
        for b in range(count):
            column = np.zeros(layout.size)
            layout.by_signal(column)[i, block == b] = amplitude[b]
            found.append(column)
    columns_of_blocks: NDArray[np.float64] = np.array(found).T
    return columns_of_blocks


class Whitener:
    """Applies the symmetric (D + U U')^(-1/2), by the eigenvectors of the small matrix U' D^-1 U (Woodbury)."""

    def __init__(self, variance: NDArray[np.float64], columns: NDArray[np.float64]) -> None:
        """Prepare.

        Args:
            variance: D, shape (n,), above 0.
            columns: U, shape (n, m); m may be 0.

        """
        self._scale = 1.0 / np.sqrt(variance)
        whitened = columns * self._scale[:, np.newaxis]
        values, vectors = np.linalg.eigh(whitened.T @ whitened)
        kept = values > 1e-9 * max(float(values.max(initial=0.0)), 1.0)  # rounding
        self._basis = (whitened @ vectors[:, kept]) / np.sqrt(values[kept])
        self._shrink = 1.0 - 1.0 / np.sqrt(1.0 + values[kept])

    def __call__(self, features: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return whitened features, shape (..., n)."""
        scaled = features * self._scale
        whitened: NDArray[np.float64] = scaled - ((scaled @ self._basis) * self._shrink) @ self._basis.T
        return whitened
