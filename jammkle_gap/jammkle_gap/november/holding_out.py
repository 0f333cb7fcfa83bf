"""A candidate's parameters without each group of samples in turn, and what it then foretells of that group."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from jammkle_gap.november.fitting import PRIOR, Loss
from jammkle_gap.november.refining import Ask, refine, side_by_side
from jammkle_gap.november.residual import LARGEST

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_gap.november.fitting import Fit
    from jammkle_gap.november.refining import Worker
    from jammkle_gap.november.residual import Layout
    from jammkle_gap.november.runs import Runs

DECIDES = 0.5
"""A group that holds more than this share of what is known of the parameters, along any direction, may decide them
alone: one step from the full fit then says little, and they are fitted again."""
_MOVES = 0.3
"""What such a step has to move the group's own residual by, root mean square in scales, to be worth a new fit."""
RUNS_PER_GROUP = 4
_NO_STEP = 1e-12


@dataclass(frozen=True)
class HeldOut:
    """A candidate with each group held out."""

    points: NDArray[np.float64]
    """Parameters without each group, shape (groups, p), shares of the ranges."""
    residual: NDArray[np.float64]
    """Of each sample, foretold without its own group, shape (n,), noise units."""
    decided: tuple[int, ...]
    """Groups that may decide parameters alone, and have not been fitted without."""


def one_step(fit: Fit, loss: Loss, group_of: NDArray[np.intp], groups: int) -> HeldOut:
    """Leave each group out by one Gauss-Newton step from the full fit: no run of the simulator is needed.

    Args:
        fit: To all samples, with a Jacobian.
        loss: That it was fitted by.
        group_of: Group of each sample, shape (n,).
        groups: How many there are.

    """
    size = fit.point.size
    points = np.tile(fit.point, (groups, 1))
    if not size:
        return HeldOut(points, fit.residual, ())
    weights = loss.weights(fit.residual)
    weighted = fit.jacobian * weights[:, None]
    normals = np.array(
        [[np.bincount(group_of, weighted[:, i] * fit.jacobian[:, k], groups) for k in range(size)] for i in range(size)]
    )
    slopes = np.array([np.bincount(group_of, weighted[:, i] * fit.residual, groups) for i in range(size)])
    # What the full fit left of its slope (a bound, a tolerance) is not the doing of any one group.
    counts = np.bincount(group_of, minlength=groups)
    slopes -= slopes.sum(axis=1, keepdims=True) * counts / counts.sum()
    total = normals.sum(axis=2) + PRIOR * np.eye(size)
    back = PRIOR * (fit.point - fit.space.null)
    shares = np.zeros(groups)
    for group in range(groups):
        step = np.linalg.solve(total - normals[:, :, group], slopes[:, group] - back)
        points[group] = np.clip(fit.point + step, 0.0, 1.0)
        shares[group] = float(np.linalg.eigvals(np.linalg.solve(total, normals[:, :, group])).real.max())
    moved = np.einsum("ij,ij->i", fit.jacobian, (points - fit.point)[group_of])
    far = np.sqrt(np.bincount(group_of, (moved / loss.scale) ** 2, groups) / np.maximum(counts, 1))
    decided = tuple(int(group) for group in np.flatnonzero((shares > DECIDES) & (far > _MOVES)))
    return HeldOut(points, fit.residual + moved, decided)


def fitted_again(
    fits: Sequence[Fit], loss: Loss, group_of: NDArray[np.intp], groups: int, runs: Runs, layout: Layout
) -> list[HeldOut]:
    """Leave each group out; where it may decide parameters alone, by a new fit to all the others.

    Args:
        fits: To all samples, each with a Jacobian; all of them side by side.
        loss: That they were fitted by.
        group_of: Group of each sample, shape (n,).
        groups: How many there are.
        runs: Of the simulator.
        layout: Of the residuals.

    """
    steps = [one_step(fit, loss, group_of, groups) for fit in fits]
    asked = [(index, group) for index, step in enumerate(steps) for group in step.decided]
    starts = [fits[index] for index, _ in asked]
    workers = [
        _anew(fits[index], steps[index].points[group], _without(loss, group_of, group)) for index, group in asked
    ]
    found = dict(zip(asked, side_by_side(workers, starts, runs, layout), strict=True))
    return [_replaced(step, index, found, group_of) for index, step in enumerate(steps)]


def _anew(full: Fit, point: NDArray[np.float64], loss: Loss) -> Worker:
    """Fit from where one step leads: along what the others do not show, that is back at null, not where the fit was."""
    left = yield Ask(point, promised=loss.cost(full.residual))
    if left is None or np.abs(left).max() >= LARGEST:
        return full
    step = point - full.point
    miss = left - full.residual - full.jacobian @ step
    jacobian = full.jacobian + np.outer(miss, step) / max(float(step @ step), _NO_STEP)
    start = replace(full, point=point, residual=left, jacobian=jacobian)
    found = yield from refine(start, loss, RUNS_PER_GROUP, PRIOR)
    away = 0.5 * PRIOR * float(np.sum((full.point - full.space.null) ** 2))
    if found.cost <= loss.cost(full.residual) + away:
        return found
    # One step led astray: the others alone are foretold better from where the full fit stands.
    return (yield from refine(full, loss, RUNS_PER_GROUP, PRIOR))


def _without(loss: Loss, group_of: NDArray[np.intp], group: int) -> Loss:
    """Return the loss in which the samples of a group count for nothing."""
    return Loss(loss.scale, np.where(group_of == group, np.inf, loss.factor))


def _replaced(step: HeldOut, index: int, found: Mapping[tuple[int, int], Fit], group_of: NDArray[np.intp]) -> HeldOut:
    points, residual = step.points.copy(), step.residual.copy()
    for group in step.decided:
        fit = found[index, group]
        points[group] = fit.point
        residual[group_of == group] = fit.residual[group_of == group]
    return HeldOut(points, residual, ())
