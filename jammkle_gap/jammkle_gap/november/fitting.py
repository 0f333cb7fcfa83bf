"""Bounded robust least squares of some effects over all recordings: what a fit is, and its last polish by scipy."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import least_squares  # type: ignore[import-untyped]  # carries no types

from jammkle_gap.november.residual import weigh
from jammkle_gap.november.sensitivity import space_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from jammkle_gap.november.effect import Effect
    from jammkle_gap.november.residual import Layout, Weighting
    from jammkle_gap.november.runs import Runs
    from jammkle_gap.november.sensitivity import Space

ROBUST = 2.5
"""Residuals beyond this many scales pull linearly, no longer as squares (soft L1)."""
PRIOR = 1.0
"""Weight of a parameter's null value against the data, at a distance of its whole range, nats. A parameter that nothing
but held-out samples shows goes back to null, and does not run away."""
_DIFFERENCE = 0.02
_INWARDS = 2e-3
_MOVED = 2.0
_FINEST = 1e-6
POLISHING_RUNS = 3
"""Derivatives that scipy may ask for when a candidate is fitted again; each is a run per parameter."""
CALIBRATED_RUNS = 12
"""The same, where a calibration is fitted along."""


@dataclass(frozen=True)
class Loss:
    """Negative log-likelihood up to a constant, in nats: robust, and counting only independent samples."""

    scale: NDArray[np.float64]
    """Per sample, in noise units."""
    factor: NDArray[np.float64]
    """Per sample: samples that count as one."""

    def cost(self, residual: NDArray[np.float64]) -> float:
        """Return the cost, nats."""
        square = (residual / self.scale) ** 2
        return float(np.sum(ROBUST**2 * (np.sqrt(1.0 + square / ROBUST**2) - 1.0) / self.factor))

    def weights(self, residual: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the weights of the squares that have the same slope, shape (n,)."""
        square = (residual / self.scale) ** 2
        weights: NDArray[np.float64] = 1.0 / (np.sqrt(1.0 + square / ROBUST**2) * self.scale**2 * self.factor)
        return weights


def loss_of(layout: Layout, weighting: Weighting) -> Loss:
    """Return the loss that fits make small, by a judgement of the signals.

    What a simulator is doubted for is left out: it says how far fits may be told apart, not how well each should fit.
    """
    return Loss(weighting.scale[layout.signal_of], weighting.factor[layout.signal_of])


@dataclass(frozen=True)
class Fit:
    """Effects with the parameters that fit best."""

    space: Space
    point: NDArray[np.float64]
    """Shares of the ranges, shape (p,)."""
    residual: NDArray[np.float64]
    """Shape (n,), noise units."""
    jacobian: NDArray[np.float64]
    """Of the residual by the shares of the ranges, shape (n, p)."""
    cost: float
    polished: bool = False
    calibration: tuple[Effect, ...] = ()
    """Fitted along, but no part of the candidate."""

    @property
    def names(self) -> tuple[str, ...]:
        """The effects, sorted; empty is the nominal simulator."""
        return tuple(sorted(effect.name for effect in self.space.effects))

    @property
    def at_bounds(self) -> tuple[str, ...]:
        """Parameters that ended at a bound, where the truth may lie outside."""
        edge = (self.point <= _FINEST) | (self.point >= 1.0 - _FINEST)
        return tuple(key for key, at in zip(self.space.keys, edge & (self.point != self.space.null), strict=True) if at)


def uncalibrated(nominal: NDArray[np.float64]) -> Fit:
    """Return the fit of nothing at all."""
    return Fit(space_of([]), np.zeros(0), nominal, np.zeros((nominal.size, 0)), 0.0, polished=True)


def calibrate(calibration: Sequence[Effect], runs: Runs, layout: Layout, nominal: NDArray[np.float64]) -> Fit:
    """Fit what is always fitted along, from where the simulator stands."""
    space = space_of([], calibration)
    fit = Fit(
        space, space.null, nominal, np.zeros((nominal.size, len(space.keys))), 0.0, calibration=tuple(calibration)
    )
    for _ in range(2):
        fit = polish(fit, loss_of(layout, weigh(layout, fit.residual)), runs, layout, CALIBRATED_RUNS)
    return fit


def jacobians_at(fits: Sequence[Fit], runs: Runs, layout: Layout) -> list[NDArray[np.float64]]:
    """Return Jacobians by one-sided differences towards the inside, all run side by side, each of shape (n, p).

    A step is a small share of the range, and smaller where the Jacobian known so far says that this would move the
    signals by more than a few times their noise.
    """
    asked = []
    for index, fit in enumerate(fits):
        moves = np.sqrt(np.mean(fit.jacobian**2, axis=0))
        for k in range(fit.point.size):
            step = max(min(_DIFFERENCE, _MOVED / max(moves[k], 1e-12)), _FINEST)
            asked.append((index, k, step if fit.point[k] <= 0.5 else -step))  # noqa: PLR2004  # the middle of the range
    points = []
    for index, k, step in asked:
        point = fits[index].point.copy()
        point[k] += step
        points.append(fits[index].space.values(point))
    jacobians = [np.empty_like(fit.jacobian) for fit in fits]
    for (index, k, step), result in zip(asked, runs.evaluate(points), strict=True):
        jacobians[index][:, k] = (layout.residual(result) - fits[index].residual) / step
    return jacobians


def polish(start: Fit, loss: Loss, runs: Runs, layout: Layout, most_runs: int = POLISHING_RUNS) -> Fit:
    """Fit again from where a fit ended, by scipy's trust region with derivatives of its own."""
    space = start.space
    if not space.keys:
        return replace(start, polished=True, cost=loss.cost(start.residual))
    root = 1.0 / (loss.scale * np.sqrt(loss.factor))

    def residual_at(point: NDArray[np.float64]) -> NDArray[np.float64]:
        return layout.residual(runs.evaluate([space.values(point)])[0])

    def robust(square: NDArray[np.float64]) -> NDArray[np.float64]:
        # scipy hands over the squares of residuals divided by scale and sqrt(factor): see Loss.cost.
        inner = 1.0 + square * loss.factor / ROBUST**2
        first = inner**-0.5
        cost = 2.0 * ROBUST**2 * (np.sqrt(inner) - 1.0) / loss.factor
        return np.array([cost, first, -0.5 * loss.factor / ROBUST**2 * inner**-1.5])

    def jacobian_of(point: NDArray[np.float64], residual: NDArray[np.float64]) -> NDArray[np.float64]:
        return jacobians_at([replace(start, point=point, residual=residual)], runs, layout)[0]

    # Never from a bound, where a trust region stalls.
    at_bound = (start.point <= _FINEST) | (start.point >= 1.0 - _FINEST)
    inside = np.where(at_bound, np.clip(start.point, _INWARDS, 1.0 - _INWARDS), start.point)
    found = least_squares(
        lambda point: residual_at(point) * root,
        inside,
        jac=lambda point: jacobian_of(point, residual_at(point)) * root[:, None],
        bounds=(0.0, 1.0),
        method="trf",
        loss=robust,
        ftol=1e-4,
        xtol=1e-4,
        max_nfev=most_runs,
    )
    point, residual = np.asarray(found.x, dtype=np.float64), np.asarray(found.fun, dtype=np.float64) / root
    if loss.cost(start.residual) < loss.cost(residual):
        point, residual = start.point, start.residual
    jacobian = jacobian_of(point, residual)
    return replace(start, point=point, residual=residual, jacobian=jacobian, cost=loss.cost(residual), polished=True)
