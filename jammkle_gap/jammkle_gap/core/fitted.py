"""What is said of a candidate: how much it explains, and its parameters with their intervals."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy import stats  # type: ignore[import-untyped]  # carries no types

from jammkle_gap.core.result import Candidate, FittedEffect, FittedParameter

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from jammkle_gap.core.constants import Constants
    from jammkle_gap.core.evidence import Evidence
    from jammkle_gap.core.fit import Fit

_Z90 = 1.645
"""Half of a 90 % interval, in standard deviations."""
_AT_BOUND = 0.01
"""Share of a parameter's range from a bound within which it counts as at it."""
_DETECTABLE = (stats.norm.ppf(0.99) + stats.norm.ppf(0.99)) ** 2
"""Squared whitened length that is detected with 99 % power at 1 % false alarms along a known direction."""


def candidate_of(
    evidence: Evidence,
    fit: Fit | None,
    names: tuple[str, ...],
    probability: float,
    constants: Constants,
) -> Candidate:
    """Return what is said of a candidate.

    Args:
        evidence: What was gathered.
        fit: Of the candidate; None: none of the effects on offer.
        names: Of its effects.
        probability: Of the candidate.
        constants: Of the model.

    """
    if fit is None:
        return Candidate(names, probability, 0.0, ())
    others = {
        other for members in evidence.classes for other in members if set(members) & set(names) and other not in names
    }
    return Candidate(
        names,
        probability,
        explained_by(evidence, fit),
        _fitted(evidence, fit, constants),
        tuple(sorted(others)),
    )


def left_by(evidence: Evidence, fit: Fit | None) -> NDArray[np.float64]:
    """Return what a candidate leaves of the difference, whitened by scatter alone."""
    whole = evidence.difference
    return whole.whitened - (whole.whiten(fit.features) if fit is not None and fit.features else 0.0)


def explained_by(evidence: Evidence, fit: Fit) -> float:
    """Return the share of the squared whitened difference that a candidate explains."""
    left, whole = left_by(evidence, fit), evidence.difference.whitened
    return 1.0 - float(left @ left) / float(whole @ whole)


def _fitted(evidence: Evidence, fit: Fit, constants: Constants) -> tuple[FittedEffect, ...]:
    library = evidence.problem.library
    half = _half_widths(evidence, fit, constants)
    found = []
    for name in fit.names:
        effect = library.effect(name)
        parameters = []
        for each in effect.parameters:
            key = effect.key(each)
            value, index = fit.values[key], list(fit.values).index(key)
            span = each.maximum - each.minimum
            low, high = max(value - half[index], each.minimum), min(value + half[index], each.maximum)
            bound = min(value - each.minimum, each.maximum - value) < _AT_BOUND * span and value != each.null
            seen = float(np.linalg.norm(fit.jacobian[:, index]))
            step = np.sqrt(_DETECTABLE) / seen if seen > 0.0 else np.nan
            detectable = each.null + np.sign(value - each.null) * step
            inside = each.minimum <= detectable <= each.maximum
            parameters.append(
                FittedParameter(
                    each.name, each.unit, value, (low, high), bool(bound), float(detectable) if inside else np.nan
                )
            )
        found.append(FittedEffect(name, effect.subsystem, effect.sentence, tuple(parameters)))
    return tuple(found)


def freedom_of(evidence: Evidence, constants: Constants) -> float:
    """Return the degrees of freedom of the simulator's own error: at most one a signal and block of time."""
    blocks = constants.blocks * sum(len(setting.layout.signals) for setting in evidence.settings)
    return min(constants.discrepancy_freedom, float(blocks))


def _half_widths(evidence: Evidence, fit: Fit, constants: Constants) -> NDArray[np.float64]:
    """Return half of each parameter's 90 % interval: curvature, times what the fit leaves beyond healthy scatter.

    What is left is the simulator's own error, which hangs together over time: see `freedom_of`.
    """
    size = evidence.difference.whitened.size
    beyond = max(fit.left / size / evidence.difference.healthy - 1.0, 0.0)
    inflation = 1.0 + beyond * size / freedom_of(evidence, constants)
    scale = np.maximum(np.linalg.norm(fit.jacobian, axis=0), 1e-12)
    normal = (fit.jacobian / scale).T @ (fit.jacobian / scale)
    variance = np.diag(np.linalg.pinv(normal, rcond=1e-8)) / scale**2
    half: NDArray[np.float64] = _Z90 * np.sqrt(np.maximum(variance, 0.0) * inflation)
    return half
