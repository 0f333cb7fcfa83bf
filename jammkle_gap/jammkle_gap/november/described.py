"""What a diagnosis says of its fits: effects with their numbers, candidates beside the best, signals to look at."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from jammkle_gap.november.intervals import half_widths
from jammkle_gap.november.scoring import difference

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np
    from numpy.typing import NDArray

    from jammkle_gap.november.recording import Recording
    from jammkle_gap.november.residual import Layout, Weighting
    from jammkle_gap.november.scoring import Score


@dataclass(frozen=True)
class FittedParameter:
    """One number of an effect, with its 95 % interval."""

    name: str
    unit: str
    value: float
    interval: tuple[float, float]
    at_bound: bool
    """Whether it ended at a bound, where the truth may lie outside."""


@dataclass(frozen=True)
class FittedEffect:
    """An effect that explains the gap, or a part of it."""

    name: str
    subsystem: str
    sentence: str
    parameters: tuple[FittedParameter, ...]


@dataclass(frozen=True)
class Candidate:
    """A set of effects that explains the gap as well as the best does."""

    names: tuple[str, ...]
    score: float
    """Held-out log-likelihood above the nominal simulator's, nats."""
    behind: float
    """Nats behind the best."""
    error: float
    """Standard error of that, nats."""
    effects: tuple[FittedEffect, ...]


@dataclass(frozen=True)
class Overlay:
    """One signal of one recording: measured, nominal and corrected."""

    recording: str
    signal: str
    unit: str
    time_s: NDArray[np.float64]
    measured: NDArray[np.float64]
    nominal: NDArray[np.float64]
    corrected: NDArray[np.float64]


def fitted_effects(score: Score, weighting: Weighting, layout: Layout, limit: float) -> tuple[FittedEffect, ...]:
    """Return the effects of a candidate with the intervals of their parameters.

    Args:
        score: The candidate.
        weighting: How the signals are judged.
        layout: Of the residual.
        limit: A gap, in noise units, that counts as none.

    """
    fit = score.fit
    wide = half_widths(fit, layout, weighting, limit) * (fit.space.maximum - fit.space.minimum)
    values = fit.space.all_values(fit.point)
    found = []
    for effect in fit.space.effects:
        parameters = []
        for parameter in effect.parameters:
            key = effect.key(parameter)
            half = float(wide[fit.space.keys.index(key)])
            low = max(values[key] - half, parameter.minimum)
            high = min(values[key] + half, parameter.maximum)
            parameters.append(
                FittedParameter(parameter.name, parameter.unit, values[key], (low, high), key in fit.at_bounds)
            )
        found.append(FittedEffect(effect.name, effect.subsystem, effect.sentence, tuple(parameters)))
    return tuple(found)


def beside_best(each: Score, best: Score, nominal: Score, effects: tuple[FittedEffect, ...]) -> Candidate:
    """Return a candidate beside the best one and the nominal simulator."""
    behind = difference(best, each)
    return Candidate(each.names, each.total - nominal.total, behind.nats, behind.error, effects)


def overlays_of(
    layout: Layout,
    recordings: Sequence[Recording],
    nominal: NDArray[np.float64],
    corrected: NDArray[np.float64],
) -> tuple[Overlay, ...]:
    """Return every signal as measured, as simulated and as corrected, from residuals in noise units."""
    return tuple(
        Overlay(
            recording=recordings[piece.recording].name,
            signal=piece.signal,
            unit=piece.unit,
            time_s=layout.time_s[piece.where],
            measured=layout.measured[piece.where],
            nominal=layout.measured[piece.where] - (nominal * layout.noise)[piece.where],
            corrected=layout.measured[piece.where] - (corrected * layout.noise)[piece.where],
        )
        for piece in layout.pieces
    )
