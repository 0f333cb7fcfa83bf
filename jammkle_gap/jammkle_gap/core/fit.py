"""Fitting effects to a whitened difference with the simulator itself."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import least_squares  # type: ignore[import-untyped]  # carries no types

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_gap.core.constants import Constants
    from jammkle_gap.core.effects import EffectParameter

    Signature = Callable[[Mapping[str, float]], NDArray[np.float64]]
    """Whitened signature of parameters by key, shape (n,)."""

_STEP_SHARE, _LEAST_STEP = 0.15, 0.01
"""Step of a difference quotient: share of the distance from null, and least share of the range. Chosen: contact makes
smaller differences of a simulation uneven."""
_SHORTENINGS = 3
"""Times that a step is tried, each time shortened to what there is to explain."""
_LEAST_REACH = 3.0
"""Change of the whitened signature that is always let pass: three standard deviations."""


@dataclass(frozen=True)
class Fit:
    """One candidate, fitted: one effect, or several."""

    names: tuple[str, ...]
    values: Mapping[str, float]
    """By key `effect.parameter`."""
    signature: NDArray[np.float64]
    """Whitened, shape (n,)."""
    left: float
    """Squared length of what it leaves of the difference."""
    jacobian: NDArray[np.float64]
    """Derivatives of the signature, shape (n, parameters), per unit of each parameter."""
    whitened: NDArray[np.float64]
    """The difference that it was fitted to, shape (n,)."""
    features: tuple[NDArray[np.float64], ...] = ()
    """What it makes of the features of each setting, in their units."""


def refine(
    difference: NDArray[np.float64],
    names: tuple[str, ...],
    parameters: Sequence[tuple[str, EffectParameter]],
    start: Mapping[str, float],
    signature: Signature,
    constants: Constants,
) -> Fit:
    """Fit parameters with the simulator: Gauss-Newton in a trust region within their bounds (scipy's `trf`).

    Args:
        difference: Whitened, shape (n,).
        names: Of the effects.
        parameters: Their parameters by key.
        start: Where to begin, by key.
        signature: Simulates and whitens.
        constants: Steps at most, and when it ends.

    """
    low = np.array([each.minimum for _, each in parameters])
    span = np.array([each.maximum - each.minimum for _, each in parameters])
    null = np.array([(each.null - each.minimum) / (each.maximum - each.minimum) for _, each in parameters])
    keys = [key for key, _ in parameters]
    known: dict[bytes, NDArray[np.float64]] = {}

    def signature_at(shares: NDArray[np.float64]) -> NDArray[np.float64]:
        place = shares.tobytes()
        if place not in known:
            known[place] = signature(dict(zip(keys, (low + shares * span).tolist(), strict=True)))
        return known[place]

    def jacobian_at(shares: NDArray[np.float64]) -> NDArray[np.float64]:
        columns = []
        # A step that changes more than there is to explain is no derivative.
        reach = max(float(np.linalg.norm(difference - signature_at(shares))), _LEAST_REACH)
        for i, share in enumerate(shares):
            step = max(_STEP_SHARE * abs(share - null[i]), _LEAST_STEP)
            step = -step if share + step > 1.0 else step
            change = np.zeros(len(difference))
            for _ in range(_SHORTENINGS):
                moved = shares.copy()
                moved[i] += step
                change = signature_at(moved) - signature_at(shares)
                length = float(np.linalg.norm(change))
                if length <= reach:
                    break
                step *= reach / length
            columns.append(change / (moved[i] - share))
        slopes: NDArray[np.float64] = -np.array(columns).T
        return slopes

    begin = np.clip((np.array([start[key] for key in keys]) - low) / span, 1e-6, 1.0 - 1e-6)
    found = least_squares(
        lambda shares: difference - signature_at(shares),
        begin,
        jac=jacobian_at,
        bounds=(0.0, 1.0),
        max_nfev=constants.fit_evaluations,
        xtol=constants.fit_tolerance,
        ftol=constants.fit_tolerance,
    )
    best = min(known.items(), key=lambda item: float(np.square(difference - item[1]).sum()))
    shares = np.frombuffer(best[0])
    left = float(np.square(difference - best[1]).sum())
    values = dict(zip(keys, (low + shares * span).tolist(), strict=True))
    return Fit(names, values, best[1], left, -np.asarray(found.jac) / span, difference)
