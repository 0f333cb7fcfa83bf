"""The ledger: how much of the gap closes by the machine's constants, by each effect, and what is left.

Every figure is of stretches of time that it was not fitted to: what a candidate leaves there with parameters and
constants fitted to all others (cross-validation by blocks; Burman, Chow and Nolan 1994, Biometrika 81:351). The fit to
the others is one Gauss-Newton step from that to all, which is exact where the simulator is linear about it. What
overlaps is shared by Shapley's value: the mean of what a part closes over all orders in which the parts may be added
(Shapley 1953, Contributions to the Theory of Games II:307).
"""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from math import factorial
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import lsq_linear  # type: ignore[import-untyped]  # carries no types

from jammkle_gap.core.joint import begun, fit_jointly
from jammkle_gap.core.result import LedgerEntry

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_gap.core.constants import Constants
    from jammkle_gap.core.discrepancy import Discrepancy
    from jammkle_gap.core.fit import Fit
    from jammkle_gap.core.joint import Machine
    from jammkle_gap.core.scatter import Difference, Setting
    from jammkle_gap.core.simulate import Made, Runner

CONSTANTS = "constants of the machine"
LEFT = "left"
_FOLDS, _STRETCHES = 8, 32
"""Parts that the features are held out in, and stretches of time of a recording that they are cut from. Chosen: a fit
sees seven eighths, and of what lasts for longer than a thirtieth of the recording some part."""
_SMALLEST = 0.05
"""Gap above scatter below which there is nothing to share."""


def predicted(
    machine: Machine, error: Discrepancy, difference: Difference, fit: Fit, folds: Sequence[NDArray[np.intp]]
) -> NDArray[np.float64]:
    """Return what a candidate leaves of each fold of the features when it is fitted to the others.

    Args:
        machine: What is explained.
        error: Of the simulator: weighs the features.
        difference: With the columns of the constants.
        fit: Of the candidate to all features.
        folds: Number of the fold of each feature, per setting, from 0; features of a single fold are left as fitted.

    Returns:
        Whitened by scatter, shape (n of all settings,). Folds are of whitened features, so that what scatter can
        explain over a whole recording is not taken for a prediction that fails.

    """
    rests = [raw - change for raw, change in zip(machine.raw, fit.changes(difference), strict=True)]
    found, fold = difference.by_scatter(rests), np.concatenate(folds)
    if fold.max(initial=0) == 0 or not fit.slopes or not fit.slopes[0].shape[1]:
        return found
    turned = [each.T for each in fit.slopes]
    slopes = difference.by_scatter(turned).T
    weights = error.difference_with(fit)
    rows, left = weights.by_scatter(turned).T, weights.by_scatter(rests)
    least, most = machine.steps(fit)
    free = len(least) - len(fit.scores)
    prior = np.hstack([np.zeros((len(fit.scores), free)), np.eye(len(fit.scores))])
    for number in range(int(fold.max()) + 1):
        kept = fold != number
        table, target = np.vstack([rows[kept], prior]), np.concatenate([left[kept], -fit.scores])
        scale = np.maximum(np.linalg.norm(table, axis=0), 1e-12)
        # The triangle of the table holds the same problem; the step stays within the bounds.
        orthogonal, triangle = np.linalg.qr(table / scale)
        step = lsq_linear(triangle, orthogonal.T @ target, (least * scale, most * scale)).x / scale
        found[~kept] -= slopes[~kept] @ step
    return found


def by_setting(settings: Sequence[Setting]) -> list[NDArray[np.intp]]:
    """Return folds that are the settings: how well a fit holds in a regime that it has not seen."""
    return [np.full(setting.layout.size, k) for k, setting in enumerate(settings)]


def by_time(settings: Sequence[Setting]) -> list[NDArray[np.intp]]:
    """Return folds that are stretches of time of every setting, each of them every eighth."""
    found = []
    for setting in settings:
        layout = setting.layout
        stretch = np.arange(layout.bins) * _STRETCHES // layout.bins % _FOLDS
        found.append(np.concatenate([np.tile(stretch, len(layout.signals)), np.zeros(len(layout.event_s), dtype=int)]))
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
    whitens, folds = error.difference_with(fit), by_time(machine.settings)
    gaps = {frozenset[str](): _gap(difference.by_scatter(machine.raw), difference.healthy)}
    for count in range(1, len(parts) + 1):
        for chosen in combinations(parts, count):
            own = known.get(chosen)
            if own is None:
                names = tuple(name for name in chosen if name != CONSTANTS)
                own, made = _fit_part(
                    machine if CONSTANTS in chosen else machine.held(), whitens, fit, names, constants
                )
                runner.count([made])
            gaps[frozenset(chosen)] = _gap(predicted(machine, error, difference, own, folds), difference.healthy)
    whole, least = gaps[frozenset()], gaps[frozenset(parts)]
    above = whole - 1.0 if whole - 1.0 > _SMALLEST else np.nan
    found = [LedgerEntry(part, _shapley(part, parts, gaps) / above, gaps[frozenset({part})]) for part in parts]
    return (*found, LedgerEntry(LEFT, max(least - 1.0, 0.0) / above, least))


def _fit_part(
    machine: Machine,
    whitens: Difference,
    best: Fit,
    names: tuple[str, ...],
    constants: Constants,
) -> tuple[Fit, Made]:
    """Return a fit of some of the effects of a candidate, begun where the candidate has come to, and its runs.

    Args:
        machine: What is to be explained; that of `held` has its constants nominal.
        whitens: The difference beside the discrepancy that the candidate leaves.
        best: The candidate.
        names: Effects of it, or none.
        constants: Of the model.

    """
    if not machine.problem.constants:
        nominal = tuple(replace(each, shared=each.shared[:, :0]) for each in whitens.settings)
        whitens = replace(whitens, settings=nominal, shared=whitens.shared[:, :0])
    signatures = machine.signatures()
    return fit_jointly(machine, whitens, begun(names, best.values), signatures, constants), signatures.made


def _gap(left: NDArray[np.float64], healthy: float) -> float:
    return max(float(np.sqrt(np.square(left).mean() / healthy)), 1.0)


def _shapley(part: str, parts: Sequence[str], gaps: Mapping[frozenset[str], float]) -> float:
    others = [each for each in parts if each != part]
    total = 0.0
    for count in range(len(parts)):
        weight = factorial(count) * factorial(len(others) - count) / factorial(len(parts))
        for chosen in combinations(others, count):
            total += weight * (gaps[frozenset(chosen)] - gaps[frozenset({*chosen, part})])
    return total
