"""What no candidate explains: what it depends on, as a short formula, for the engineer who goes on from there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_gap.november.residual import Layout

MOST_TERMS = 4
THRESHOLD = 0.1
"""Terms whose standardised factor is below this share of the largest are taken out, again and again."""
WORTH = 0.1
"""A formula that explains less than this of the held-out square is none."""
MOST_OTHERS = 3
"""Other signals that may stand in a formula: those that go along with the residual most."""
_STILL = 0.02
_RIDGE = 1e-3
_ROUNDS = 10


@dataclass(frozen=True)
class Formula:
    """A residual written as a sum of few terms."""

    signal: str
    unit: str
    terms: tuple[tuple[str, float], ...]
    """Name and factor, in the signal's unit."""
    share: float
    """Of the squared residual that it explains where it was not fitted."""

    @property
    def text(self) -> str:
        """The formula, readable."""
        return f"{self.signal} - simulated = " + " ".join(f"{factor:+.3g} {name}" for name, factor in self.terms)


def features(
    layout: Layout,
    simulated: Sequence[Mapping[str, NDArray[np.float64]]],
    residual: NDArray[np.float64],
    name: str,
) -> dict[str, NDArray[np.float64]]:
    """Return the terms on offer for one signal: itself, time, the signals that go along with its residual, products.

    Returns:
        By a readable name, each shape (samples of that signal,).

    """
    pieces = [piece for piece in layout.pieces if piece.signal == name]
    levels = _levels(layout, simulated, name)
    off = np.concatenate([residual[piece.where] for piece in pieces])
    others = sorted((other for other in levels if other != name), key=lambda other: -_along(off, levels[other]))
    cuts = np.cumsum([piece.where.stop - piece.where.start for piece in pieces])[:-1]
    times = [layout.time_s[piece.where] - layout.time_s[piece.where][0] for piece in pieces]
    plain = {"t": np.concatenate(times)}
    rates = {}
    for other in [name, *others[:MOST_OTHERS]]:
        rate = np.concatenate(
            [rate_of(part, time_s) for part, time_s in zip(np.split(levels[other], cuts), times, strict=True)]
        )
        plain[f"[{other}]"] = levels[other]
        rates[f"d[{other}]"] = rate
        rates[f"sign(d[{other}])"] = np.tanh(rate / max(_STILL * float(np.abs(rate).max()), 1e-12))
    terms = {"1": np.ones_like(off), **plain, **rates}
    for first in plain:
        for second in (*plain, *rates):
            if second in rates or first <= second:
                terms[f"{first}*{second}"] = terms[first] * terms[second]
    for rate_name, rate in rates.items():
        if not rate_name.startswith("sign"):
            terms[f"{rate_name}*|{rate_name}|"] = rate * np.abs(rate)
    return terms


def rate_of(values: NDArray[np.float64], time_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the derivative by time; 0 where there is one sample only."""
    return np.gradient(values, time_s) if values.size > 1 else np.zeros_like(values)


def _levels(
    layout: Layout, simulated: Sequence[Mapping[str, NDArray[np.float64]]], name: str
) -> dict[str, NDArray[np.float64]]:
    """Return every signal that all recordings of one signal share, at the times of that one."""
    pieces = [piece for piece in layout.pieces if piece.signal == name]
    shared = set.intersection(*(set(simulated[piece.recording]) for piece in pieces)) & set(layout.names)
    at = {(piece.recording, piece.signal): layout.time_s[piece.where] for piece in layout.pieces}
    return {
        other: np.concatenate(
            [np.interp(at[p.recording, name], at[p.recording, other], simulated[p.recording][other]) for p in pieces]
        )
        for other in sorted(shared)
    }


def _along(one: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    other = other - other.mean()
    return abs(float(one @ other)) / max(float(np.sqrt(other @ other)), 1e-30)


def sparse_formula(
    layout: Layout,
    simulated: Sequence[Mapping[str, NDArray[np.float64]]],
    residual: NDArray[np.float64],
    name: str,
) -> Formula | None:
    """Look for a short formula of one signal's residual (sequentially thresholded least squares).

    Returns:
        None if none explains anything where it was not fitted.

    """
    held = np.concatenate([np.arange(p.where.start, p.where.stop) for p in layout.pieces if p.signal == name])
    noise = next(piece.noise for piece in layout.pieces if piece.signal == name)
    unit = next(piece.unit for piece in layout.pieces if piece.signal == name)
    target, block = (residual * layout.noise)[held] / noise, layout.block_of[held]
    if np.unique(block).size < 2:  # noqa: PLR2004  # nothing to hold out
        return None
    offered = features(layout, simulated, residual, name)
    names = list(offered)
    matrix = np.column_stack([offered[term] for term in names])
    size = np.sqrt(np.mean(matrix**2, axis=0))
    matrix = matrix / np.maximum(size, 1e-30)
    kept = _thresholded(matrix, target)
    if not kept:
        return None
    left = 0.0
    for each in np.unique(block):
        inside = block == each
        factors = _least_squares(matrix[~inside][:, kept], target[~inside])
        left += float(np.sum((target[inside] - matrix[inside][:, kept] @ factors) ** 2))
    share = 1.0 - left / max(float(target @ target), 1e-30)
    if share < WORTH:
        return None
    factors = _least_squares(matrix[:, kept], target)
    terms = [(names[k], float(factors[i] / size[k] * noise)) for i, k in enumerate(kept)]
    return Formula(name, unit, tuple(terms), share)


def _least_squares(matrix: NDArray[np.float64], target: NDArray[np.float64]) -> NDArray[np.float64]:
    normal = matrix.T @ matrix + _RIDGE * target.size * np.eye(matrix.shape[1])
    return np.linalg.solve(normal, matrix.T @ target)


def _thresholded(matrix: NDArray[np.float64], target: NDArray[np.float64]) -> list[int]:
    kept = [k for k in range(matrix.shape[1]) if np.any(matrix[:, k])]
    for _ in range(_ROUNDS):
        factors = np.abs(_least_squares(matrix[:, kept], target))
        strong = [k for k, factor in zip(kept, factors, strict=True) if factor >= THRESHOLD * factors.max()]
        if len(strong) > MOST_TERMS and len(strong) == len(kept):
            strong.remove(kept[int(np.argmin(factors))])
        if strong == kept:
            break
        kept = strong
    while len(kept) > MOST_TERMS:
        factors = np.abs(_least_squares(matrix[:, kept], target))
        kept.pop(int(np.argmin(factors)))
    return kept
