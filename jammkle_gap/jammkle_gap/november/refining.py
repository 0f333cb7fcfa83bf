"""Fits improved side by side at few runs of the simulator.

Every run is put to use: a fit starts from the derivatives of the probes, and each further run corrects them (Broyden's
rule), so that a candidate costs a handful of runs.
"""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass, replace
from itertools import count
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import lsq_linear  # type: ignore[import-untyped]  # carries no types

from jammkle_gap.november.fitting import PRIOR, Fit, Loss
from jammkle_gap.november.residual import LARGEST

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from jammkle_gap.november.residual import Layout
    from jammkle_gap.november.runs import Runs

_WORTH_NATS = 0.2
_WORTH_SHARE = 3e-4
_SMALLEST_STEP = 1e-7
_REWEIGHTINGS = 4
_ASTRAY = 1.0
"""A step that makes it worse by this much of what it promised to gain corrects no derivatives."""
_CONTENDING = 0.8
"""A fit is begun while it promises to end within this share of the way from the best promise back to the worst start,
and goes on within half as much after every run. Assumed: a derivative tells the kind of an effect well, its size
badly."""
_ROOM_NATS = 20.0
"""A fit that promises to end this close to the best is never given up. Assumed: a linear promise
errs by less."""


def linear_step(
    residual: NDArray[np.float64],
    jacobian: NDArray[np.float64],
    loss: Loss,
    low: NDArray[np.float64],
    high: NDArray[np.float64],
    away: NDArray[np.float64] | None = None,
    reweightings: int = _REWEIGHTINGS,
) -> NDArray[np.float64]:
    """Return the step within bounds that costs least if the residual is linear in it.

    Args:
        residual: Where the step begins, shape (n,).
        jacobian: Of the residual, shape (n, p).
        loss: What to make small.
        low: Smallest step, shape (p,).
        high: Largest step, shape (p,).
        away: Distance from where a prior of weight PRIOR pulls back to, shape (p,); None is no prior.
        reweightings: How often the weights of a robust loss are found anew.

    """
    step = np.zeros(jacobian.shape[1])
    prior = 0.0 if away is None else PRIOR
    pull = np.zeros(step.size) if away is None else PRIOR * away
    for _ in range(reweightings):
        weights = loss.weights(residual + jacobian @ step)
        normal = jacobian.T @ (jacobian * weights[:, None]) + prior * np.eye(step.size)
        size = np.sqrt(np.maximum(np.diag(normal), 1e-30))
        scaled = normal / np.outer(size, size) + 1e-9 * np.eye(size.size)
        slope = -(jacobian.T @ (weights * residual) + pull) / size
        step = np.linalg.solve(scaled, slope) / size
        wide = np.maximum(high, low + 1e-12)
        if np.any(step < low) or np.any(step > wide):
            root = np.linalg.cholesky(scaled).T
            right = np.linalg.solve(root.T, slope)
            step = lsq_linear(root, right, bounds=(low * size, wide * size), method="bvls").x / size
    return step


@dataclass(frozen=True)
class Ask:
    """What a fit wants to know next."""

    point: NDArray[np.float64]
    """To run, shares of the ranges."""
    promised: float
    """Cost that the fit hopes to get to there, nats."""


Worker = Generator[Ask, "NDArray[np.float64] | None", Fit]
"""Asks for points to run, is sent their residuals or None to make do with what it has, returns the fit."""


def refine(start: Fit, loss: Loss, most_runs: int, prior: float = 0.0) -> Worker:
    """Improve a fit.

    Args:
        start: Where to begin, with a Jacobian that may be rough.
        loss: What to make small.
        most_runs: Points to ask for at most.
        prior: Weight of the null values against the data: 0 or PRIOR.

    """
    null = start.space.null

    def cost_of(place: NDArray[np.float64], left: NDArray[np.float64]) -> float:
        return loss.cost(left) + 0.5 * prior * float(np.sum((place - null) ** 2))

    point, residual, jacobian = start.point, start.residual, start.jacobian.copy()
    cost, trust = cost_of(point, residual), 0.6
    for _ in range(most_runs):
        low = np.maximum(-point, -trust)
        high = np.minimum(1.0 - point, trust)
        step = linear_step(residual, jacobian, loss, low, high, point - null if prior else None)
        expected = cost - cost_of(point + step, residual + jacobian @ step)
        if expected < _WORTH_NATS + _WORTH_SHARE * cost or np.abs(step).max() < _SMALLEST_STEP:
            break
        tried = yield Ask(point + step, cost - expected)
        if tried is None:
            break
        if np.abs(tried).max() >= LARGEST:
            trust = float(np.abs(step).max()) / 4.0
            continue
        gained = cost - cost_of(point + step, tried)
        if gained < -_ASTRAY * expected:
            # Far beyond where the derivatives hold: what was seen there says nothing of them here.
            trust = float(np.abs(step).max()) / 4.0
            continue
        miss = tried - residual - jacobian @ step
        jacobian += np.outer(miss, step) / float(step @ step)
        if gained > 0.0:
            point, residual, cost = point + step, tried, cost - gained
        trust = _new_trust(trust, float(np.abs(step).max()), gained / expected)
    return replace(start, point=point, residual=residual, jacobian=jacobian, cost=cost)


def _new_trust(trust: float, length: float, ratio: float) -> float:
    if ratio <= 0.0:
        return length / 3.0
    if ratio < 0.25:  # noqa: PLR2004  # the usual quarter of trust-region methods
        return length
    return max(trust, 2.0 * length)


def fit_side_by_side(starts: Sequence[Fit], loss: Loss, runs: Runs, layout: Layout, most_runs: int) -> list[Fit]:
    """Improve several fits in step, so that the runs of all of them go side by side."""
    return side_by_side([refine(start, loss, most_runs) for start in starts], starts, runs, layout)


def fit_contenders(starts: Sequence[Fit], loss: Loss, runs: Runs, layout: Layout, most_runs: int) -> list[Fit]:
    """Improve several fits in step; those that promise too little beside the best stay as they are.

    Args:
        starts: Where to begin.
        loss: What to make small.
        runs: Of the simulator.
        layout: Of the residuals.
        most_runs: Points to ask for at most, each.

    """
    worst = max((start.cost for start in starts), default=0.0)

    def bar(promises: Sequence[float], rounds: int) -> float:
        best = min(promises, default=worst)
        return best + _ROOM_NATS + _CONTENDING * 0.5**rounds * max(worst - best, 0.0)

    return side_by_side([refine(start, loss, most_runs) for start in starts], starts, runs, layout, bar)


def _no_bar(_: Sequence[float], __: int) -> float:
    return float("inf")


def side_by_side(
    workers: Sequence[Worker],
    starts: Sequence[Fit],
    runs: Runs,
    layout: Layout,
    bar: Callable[[Sequence[float], int], float] = _no_bar,
) -> list[Fit]:
    """Run what several fits ask for together, until all have ended.

    Args:
        workers: See `refine`.
        starts: What each began with.
        runs: Of the simulator.
        layout: Of the residuals.
        bar: From what all have promised so far, and how many runs each has had: the largest promise that is worth one
            more.

    """
    done: dict[int, Fit] = {}
    asked: dict[int, Ask] = {}
    promised: dict[int, float] = {}

    def carry_on(index: int, answer: NDArray[np.float64] | None) -> None:
        try:
            asked[index] = workers[index].send(answer)
        except StopIteration as end:  # how a generator hands over its result
            done[index] = end.value
            asked.pop(index, None)
        else:
            promised[index] = min(promised.get(index, np.inf), asked[index].promised)

    for index in range(len(workers)):
        carry_on(index, None)
    for rounds in count():
        limit = bar([*promised.values(), *(fit.cost for fit in done.values())], rounds)
        for index in [index for index in asked if asked[index].promised > limit]:
            carry_on(index, None)
        if not asked:
            break
        order = sorted(asked)
        results = runs.evaluate([starts[index].space.values(asked[index].point) for index in order])
        for index, result in zip(order, results, strict=True):
            carry_on(index, layout.residual(result))
    return [done[index] for index in range(len(starts))]
