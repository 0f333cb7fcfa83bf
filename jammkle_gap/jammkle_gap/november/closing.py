"""How far the gap shrinks: on blocks and on a regime that the effect was not fitted to, beside a ceiling."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from jammkle_gap.november.fitting import loss_of
from jammkle_gap.november.holding_out import fitted_again
from jammkle_gap.november.unexplained import features
from jammkle_gap.november.where import INTERVAL, resampled

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_gap.november.fitting import Fit
    from jammkle_gap.november.residual import Layout, Weighting
    from jammkle_gap.november.runs import Runs

FLOOR = 1.0
"""The noise, in its own units."""
SMALLEST_GAP = 0.05
"""Below this much above the floor there is nothing to close, noise units."""
_LAGS = (0, 1, 2, 4, 8, 16)
_RIDGES = (1e-3, 1e-2, 1e-1, 1.0)
_ENOUGH_ROWS = 5000


@dataclass(frozen=True)
class Closing:
    """A gap before and after, in noise units unless said otherwise."""

    nominal: float
    with_effect: float
    closed: float
    """1 - (with_effect - floor) / (nominal - floor), signals below the floor counting as at it; not a number where
    there was nothing to close."""
    interval: tuple[float, float]


@dataclass(frozen=True)
class SignalClosing:
    """As `Closing`, of one signal, and in its own unit."""

    signal: str
    unit: str
    noise: float
    """One noise unit, in the signal's unit, where nothing adds to it."""
    limit: float
    """Largest gap that counts as none, noise units."""
    closing: Closing
    nominal_physical: float
    """Root mean square before, in the signal's unit."""
    with_effect_physical: float
    """Root mean square after, in the signal's unit."""


def closed_share(nominal: float, with_effect: float, signals: int = 1) -> float:
    """Return how much of the gap above the floor is closed, 1: all; negative: it has grown.

    Args:
        nominal: Before, noise units; of several signals, `Layout.gap_above_floor`.
        with_effect: After, the same.
        signals: How many they are of: one that is off is diluted by all others.

    """
    if nominal - FLOOR < _smallest(signals):
        return float("nan")
    return 1.0 - (max(with_effect, FLOOR) - FLOOR) / (nominal - FLOOR)


def _smallest(signals: int) -> float:
    """Return what one signal that is off by the smallest gap adds to all, noise units."""
    return float(np.sqrt(FLOOR**2 + ((FLOOR + SMALLEST_GAP) ** 2 - FLOOR**2) / signals)) - FLOOR


def _table(layout: Layout, residual: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return sums of squares, shape (blocks, signals)."""
    size, count = len(layout.names), len(layout.blocks)
    sums = np.bincount(layout.block_of * size + layout.signal_of, residual**2, count * size)
    return sums.astype(np.float64).reshape(count, size)


def _root_of(values: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(values**2)))


def closings(
    layout: Layout, nominal: NDArray[np.float64], with_effect: NDArray[np.float64], limits: Mapping[str, float]
) -> tuple[Closing, tuple[SignalClosing, ...]]:
    """Compare two residuals over all and per signal, with intervals from resampled blocks.

    Args:
        layout: Of the residuals.
        nominal: Without any effect, noise units.
        with_effect: With it, each block predicted by a fit to the others.
        limits: Largest gap of each signal that counts as none, noise units.

    """
    before, after = _table(layout, nominal), _table(layout, with_effect)
    counts = _table(layout, np.ones_like(nominal))
    drawn = resampled(len(layout.blocks))

    def root(table: NDArray[np.float64], signals: slice) -> NDArray[np.float64]:
        sums, sizes = table[drawn].sum(axis=1)[:, signals], counts[drawn].sum(axis=1)[:, signals]
        held = (sizes > 0).sum(axis=1)
        above = np.maximum(sums / np.maximum(sizes, 1), FLOOR**2)
        squares = np.where(sizes > 0, above, 0.0).sum(axis=1)
        # Blocks may be drawn in which none of these signals was recorded.
        result: NDArray[np.float64] = np.sqrt(np.where(held > 0, squares / np.maximum(held, 1), np.nan))
        return result

    def one(signals: slice) -> Closing:
        squares = [each.sum(axis=0)[signals] / counts.sum(axis=0)[signals] for each in (before, after)]
        first, last = (float(np.sqrt(np.mean(each))) for each in squares)
        count = len(squares[0])
        closed = closed_share(_above(squares[0]), _above(squares[1]), count)
        befores, afters = root(before, signals), root(after, signals)
        real = befores - FLOOR >= _smallest(count)
        if not real.any():
            return Closing(first, last, closed, (float("nan"), float("nan")))
        low, high = np.quantile(1.0 - (afters[real] - FLOOR) / (befores[real] - FLOOR), INTERVAL)
        return Closing(first, last, closed, (float(low), float(high)))

    per_signal = []
    for index, name in enumerate(layout.names):
        piece = next(piece for piece in layout.pieces if piece.signal == name)
        physical = [_root_of((each * layout.noise)[layout.signal_of == index]) for each in (nominal, with_effect)]
        closing = one(slice(index, index + 1))
        per_signal.append(SignalClosing(name, piece.unit, piece.noise, limits[name], closing, *physical))
    return one(slice(0, len(layout.names))), tuple(per_signal)


@dataclass(frozen=True)
class RegimeClosing:
    """How far the gap closes on a regime that was not fitted."""

    regime: str
    nominal: float
    with_effect: float
    closed: float


def held_out_regimes(
    fit: Fit, layout: Layout, weighting: Weighting, runs: Runs, nominal: NDArray[np.float64]
) -> tuple[RegimeClosing, ...]:
    """Fit without each regime in turn, and run the simulator on that regime.

    Returns:
        Empty where there is only one regime.

    """
    regimes = sorted({recording.regime for recording in runs.recordings})
    if len(regimes) < 2 or not fit.space.keys:  # noqa: PLR2004  # one alone cannot be held out
        return ()
    regime_of = np.zeros(layout.measured.size, dtype=np.intp)
    for piece in layout.pieces:
        regime_of[piece.where] = regimes.index(runs.recordings[piece.recording].regime)
    (held,) = fitted_again([fit], loss_of(layout, weighting), regime_of, len(regimes), runs, layout)
    found = []
    points = [fit.space.values(point) for point in held.points]
    for place, results in enumerate(runs.evaluate(points)):
        inside = regime_of == place
        squares = [_squares(layout, each, inside) for each in (nominal, layout.residual(results))]
        before, after = (float(np.sqrt(np.mean(each))) for each in squares)
        closed = closed_share(_above(squares[0]), _above(squares[1]), squares[0].size)
        found.append(RegimeClosing(regimes[place], before, after, closed))
    return tuple(found)


def _above(squares: NDArray[np.float64]) -> float:
    """Return the gap over signals of such mean squares, those below the floor counting as at it."""
    return float(np.sqrt(np.mean(np.maximum(squares, FLOOR**2))))


def _squares(layout: Layout, residual: NDArray[np.float64], inside: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the mean square of every signal that has samples there."""
    size = len(layout.names)
    counts = np.bincount(layout.signal_of[inside], minlength=size)
    squares = np.bincount(layout.signal_of[inside], residual[inside] ** 2, size)
    found: NDArray[np.float64] = squares[counts > 0] / counts[counts > 0]
    return found


def ceiling(
    layout: Layout, simulated: Sequence[Mapping[str, NDArray[np.float64]]], nominal: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the residual that a flexible model of the same inputs leaves, each block predicted from the others.

    Ridge regression on the simulated signals, their rates, products and lags: a black box, which names nothing. Its
    strength is chosen by the same held-out blocks, which flatters it a little.
    """
    left: NDArray[np.float64] = nominal.copy()
    for name in layout.names:
        pieces = [piece for piece in layout.pieces if piece.signal == name]
        held = np.concatenate([np.arange(piece.where.start, piece.where.stop) for piece in pieces])
        offered = features(layout, simulated, nominal, name)
        plain = [column for term, column in offered.items() if "*" not in term]
        shifted = [np.roll(column, lag) for column in plain for lag in _LAGS[1:]]
        # Every so many samples are enough to fit, and the rest is predicted all the same.
        matrix = np.column_stack([*offered.values(), *shifted])
        matrix /= np.maximum(np.sqrt(np.mean(matrix**2, axis=0)), 1e-30)
        block = layout.block_of[held]
        numbers = np.unique(block)
        thin = max(1, held.size // _ENOUGH_ROWS)
        grams, rights = {}, {}
        for b in numbers:
            rows = np.flatnonzero(block == b)[::thin]
            grams[b] = matrix[rows].T @ matrix[rows] * thin
            rights[b] = matrix[rows].T @ nominal[held[rows]] * thin
        gram, right = sum(grams.values()), sum(rights.values())
        tried = []
        for strength in _RIDGES:
            ridge = strength * held.size * np.eye(matrix.shape[1])
            after = nominal[held].copy()
            for b in numbers:
                after[block == b] -= matrix[block == b] @ np.linalg.solve(gram - grams[b] + ridge, right - rights[b])
            tried.append(after)
        left[held] = min([nominal[held], *tried], key=lambda each: float(each @ each))
    return left
