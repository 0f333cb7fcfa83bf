"""What a candidate predicts of features that it is not fitted to: settings, or stretches of time of all of them.

Parameters, and constants where these are not held, are fitted to the other features in one Gauss-Newton step from the
fit to all, which is exact where the simulator is linear about it (cross-validation by blocks; Burman, Chow and Nolan
1994, Biometrika 81:351). What the other features do not show stays as it was fitted: a parameter has the spread of its
range as a prior there.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import lsq_linear  # type: ignore[import-untyped]  # carries no types

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from jammkle_gap.core.discrepancy import Discrepancy
    from jammkle_gap.core.fit import Fit
    from jammkle_gap.core.joint import Machine
    from jammkle_gap.core.scatter import Difference, Setting

_FOLDS, _STRETCHES = 8, 32
"""Parts that the features are held out in, and stretches of time of a recording that they are cut from. Chosen: a fit
sees seven eighths, and of what lasts for longer than a thirtieth of the recording some part."""


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
    found = difference.by_scatter(rests)
    slopes = difference.by_scatter([each.T for each in fit.slopes]).T if fit.slopes else np.zeros((len(found), 0))
    towards = np.concatenate([np.zeros(len(fit.values)), -fit.scores])
    for held_out, step in _steps(machine, error, fit, folds, towards):
        found[held_out] -= slopes[held_out] @ step
    return found


def predicting(machine: Machine, error: Discrepancy, fit: Fit) -> Fit:
    """Return a candidate that has the features of each setting as its parameters predict them, fitted to the others.

    Constants are held where all settings have them. Fitted to the others too, those that one setting alone shows would
    count against an effect that does something like them: how a pump sucks at 20 kPa against a leak that is as large in
    every setting.
    """
    features, free = list(fit.features), len(fit.values)
    steps = _steps(machine, error, fit, by_setting(machine.settings), np.zeros(free))
    for k, (_, step) in enumerate(steps):
        features[k] = features[k] + fit.slopes[k][:, :free] @ step
    return replace(fit, features=tuple(features))


def _steps(
    machine: Machine,
    error: Discrepancy,
    fit: Fit,
    folds: Sequence[NDArray[np.intp]],
    towards: NDArray[np.float64],
) -> list[tuple[NDArray[np.bool_], NDArray[np.float64]]]:
    """Return for every fold which features are held out, and the step of parameters and scores without them.

    Of features of a single fold, or where nothing is fitted, there is none. The step that priors draw towards is given,
    of as many of parameters and scores, in this order, as are fitted.
    """
    fold, count = np.concatenate(folds), 1 + max(int(each.max(initial=0)) for each in folds)
    free = len(towards)
    if count == 1 or not fit.slopes or not free:
        return []
    rests = [raw - change for raw, change in zip(machine.raw, fit.changes(error.difference), strict=True)]
    weights = error.difference_with(fit)
    rows, left = weights.by_scatter([each[:, :free].T for each in fit.slopes]).T, weights.by_scatter(rests)
    least, most = (each[:free] for each in machine.steps(fit))
    spans = [each.maximum - each.minimum for _, each in machine.problem.library.parameters(fit.names)]
    # The standard deviation of a uniform distribution over the range, and 1 of a score.
    prior = np.diag([*(np.sqrt(12.0) / np.array(spans)), *np.ones(free - len(spans))])
    found = []
    for number in range(count):
        kept = fold != number
        table, target = np.vstack([rows[kept], prior]), np.concatenate([left[kept], towards])
        scale = np.linalg.norm(table, axis=0)
        # The triangle of the table holds the same problem; the step stays within the bounds.
        orthogonal, triangle = np.linalg.qr(table / scale)
        step = lsq_linear(triangle, orthogonal.T @ target, (least * scale, most * scale)).x / scale
        found.append((~kept, step))
    return found
