"""The ledger: how much of the gap closes by the machine's constants, by each effect, and what is left.

Every figure is of recordings that it was not fitted to. Of each setting it is what a candidate leaves there with
parameters and constants fitted to all others: by one Gauss-Newton step from the fit to all, which is exact where the
simulator is linear about it. What overlaps is shared by Shapley's value: the mean of what a part closes over all orders
in which the parts may be added (Shapley 1953, Contributions to the Theory of Games II:307).
"""

from __future__ import annotations

from itertools import combinations
from math import factorial
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import lsq_linear  # type: ignore[import-untyped]  # carries no types

from jammkle_gap.core.joint import fit_part
from jammkle_gap.core.result import LedgerEntry

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_gap.core.calibrate import Discrepancy
    from jammkle_gap.core.constants import Constants
    from jammkle_gap.core.fit import Fit
    from jammkle_gap.core.joint import Machine
    from jammkle_gap.core.scatter import Difference
    from jammkle_gap.core.simulate import Runner

CONSTANTS = "constants of the machine"
LEFT = "left"


def predicted_without(
    machine: Machine, error: Discrepancy, difference: Difference, fit: Fit
) -> list[NDArray[np.float64]]:
    """Return what a candidate leaves of each setting when it is fitted to the others, in the features' units.

    Args:
        machine: What is explained.
        error: Of the simulator: weighs the features.
        difference: With the columns of the constants.
        fit: Of the candidate to all settings. A single setting is left as fitted.

    """
    rests = [
        raw - part - each.shared @ fit.scores if len(fit.scores) else raw - part
        for raw, part, each in zip(machine.raw, fit.features, difference.settings, strict=True)
    ]
    if len(rests) == 1 or not fit.slopes or not fit.slopes[0].shape[1]:
        return rests
    weights = error.difference_with(fit)
    rows = weights.split(weights.by_scatter([each.T for each in fit.slopes]).T)
    left = weights.split(weights.by_scatter(rests))
    least, most = machine.steps(fit)
    free = len(least) - len(fit.scores)
    prior = np.hstack([np.zeros((len(fit.scores), free)), np.eye(len(fit.scores))])
    found = []
    for k, rest in enumerate(rests):
        others = [i for i in range(len(rests)) if i != k]
        table = np.vstack([*(rows[i] for i in others), prior])
        scale = np.maximum(np.linalg.norm(table, axis=0), 1e-12)
        target = np.concatenate([*(left[i] for i in others), -fit.scores])
        # The triangle of the table holds the same problem; the step stays within the bounds.
        orthogonal, triangle = np.linalg.qr(table / scale)
        step = lsq_linear(triangle, orthogonal.T @ target, (least * scale, most * scale)).x / scale
        found.append(rest - fit.slopes[k] @ step)
    return found


def ledger_of(
    machine: Machine,
    error: Discrepancy,
    difference: Difference,
    best: Fit | None,
    fits: Mapping[tuple[str, ...], Fit],
    runner: Runner,
    constants: Constants,
) -> tuple[LedgerEntry, ...]:
    """Return the shares of the gap: the constants first, then every effect of the best candidate, then what is left.

    Args:
        machine: What is explained.
        error: Of the simulator.
        difference: Whitens by scatter.
        best: The candidate; None: none of the effects.
        fits: All candidates fitted with the constants; none of them, (), is one.
        runner: Makes the runs of those that are missing.
        constants: Of the model.

    """
    fit = fits[()] if best is None else best
    known = {(CONSTANTS, *names): each for names, each in fits.items()}
    parts = (CONSTANTS, *fit.names) if machine.problem.constants else fit.names
    known.update({(CONSTANTS, *fit.names): fit})
    whitens = error.difference_with(fit)
    gaps = {frozenset[str](): _gap(difference, machine.raw)}
    for count in range(1, len(parts) + 1):
        for chosen in combinations(parts, count):
            own = known.get(chosen)
            if own is None:
                names = tuple(name for name in chosen if name != CONSTANTS)
                own, made = fit_part(machine if CONSTANTS in chosen else machine.held(), whitens, fit, names, constants)
                runner.count([made])
            gaps[frozenset(chosen)] = _gap(difference, predicted_without(machine, error, difference, own))
    whole, least = gaps[frozenset()], gaps[frozenset(parts)]
    above = max(whole - 1.0, 1e-9)
    found = [LedgerEntry(part, _shapley(part, parts, gaps) / above, gaps[frozenset({part})]) for part in parts]
    return (*found, LedgerEntry(LEFT, max(least - 1.0, 0.0) / above, least))


def _gap(difference: Difference, parts: Sequence[NDArray[np.float64]]) -> float:
    return max(float(np.sqrt(np.square(difference.by_scatter(parts)).mean() / difference.healthy)), 1.0)


def _shapley(part: str, parts: Sequence[str], gaps: Mapping[frozenset[str], float]) -> float:
    others = [each for each in parts if each != part]
    total = 0.0
    for count in range(len(parts)):
        weight = factorial(count) * factorial(len(others) - count) / factorial(len(parts))
        for chosen in combinations(others, count):
            total += weight * (gaps[frozenset(chosen)] - gaps[frozenset({*chosen, part})])
    return total
