"""What simpler methods say of the same evidence: what the diagnosis must be better than, and no part of it.

All look at the difference of faulty runs and references in the features of the headline, in units of the sensors' own
noise and nothing else: no scatter between runs, no whitening, every sample counted as one of its own.

All effects free at once is what `mujoco.sysid` does. Its optimiser is a bounded least squares over parameters of an
MjSpec; most of this library is no part of one (valves, delays, relaxation), so scipy's is used on the same residuals.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import lsq_linear  # type: ignore[import-untyped]  # carries no types

from jammkle_gap.core.constants import Constants
from jammkle_gap.core.fit import Profiles, Signatures, grid_signatures
from jammkle_gap.core.scatter import Whitener
from jammkle_gap.core.search import fit_place
from jammkle_gap.core.signatures import grids_of

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from jammkle_gap.core.conclude import Evidence
    from jammkle_gap.core.fit import Place
    from jammkle_gap.core.scatter import Difference

_FITTED = 4
"""Single effects that are fitted with the simulator: the best on their grids. Chosen: more change no first place."""
_EVALUATIONS = 3
"""Gauss-Newton steps of such a fit."""
_FREE_STEPS = 4
"""Runs of the fit of everything; each corrects the derivatives (Broyden's rule)."""
_SHORTER = 0.4
"""What a step is cut to that makes it worse."""


@dataclass(frozen=True)
class Baselines:
    """Names ranked by each method, best first."""

    rmse: tuple[str, ...]
    """Single effects by the root mean square that they leave."""
    bic: tuple[str, ...]
    """The same by the Bayesian information criterion over all samples; ends where no effect at all is better."""
    free: tuple[str, ...]
    """All effects fitted at once, by how much each moves the signals."""


def baselines(evidence: Evidence) -> Baselines:
    """Rank the effects as simpler methods do, by the evidence of the headline."""
    plain = in_noise(evidence)
    problem, settings, machine = evidence.problem, evidence.settings, evidence.machine
    signatures = grid_signatures(evidence.grids, plain)
    length = float(plain.whitened @ plain.whitened)
    if not signatures:
        return Baselines((), (), ())
    profiles = Profiles(grids_of(problem), signatures, plain.whitened)
    places = {name: profiles.single(name) for name in profiles.names}
    left = {name: length - place.gain for name, place in places.items()}
    for name in sorted(left, key=left.__getitem__)[:_FITTED]:
        fit, _ = fit_place(problem, settings, plain, machine, places[name], Constants(fit_evaluations=_EVALUATIONS))
        left[name] = min(left[name], fit.left)
    samples = sum(len(signal.values) for setting in settings for run in setting.faulty for signal in run.signals)
    sizes = {name: len(place.values[0]) for name, place in places.items()} | {"": 0}
    criteria = {
        name: samples * float(np.log(max(each, 1e-12))) + sizes[name] * float(np.log(samples))
        for name, each in {**left, "": length}.items()
    }
    by_criterion = sorted(criteria, key=criteria.__getitem__)
    return Baselines(
        tuple(sorted(left, key=left.__getitem__)),
        tuple(by_criterion[: by_criterion.index("")]),
        _all_free(evidence, plain, places, signatures),
    )


def in_noise(evidence: Evidence) -> Difference:
    """Return the difference in units of the sensors' noise: no scatter between runs, nothing whitened."""
    whiteners = tuple(
        Whitener(np.square(setting.layout.floor), np.zeros((setting.layout.size, 0))) for setting in evidence.settings
    )
    alone = tuple(dataclasses.replace(each, factor=1.0) for each in evidence.difference.settings)
    plain = dataclasses.replace(evidence.difference, whiteners=whiteners, settings=alone)
    whitened = plain.whiten([each.difference for each in evidence.residuals])
    return dataclasses.replace(plain, whitened=whitened)


def _all_free(
    evidence: Evidence,
    plain: Difference,
    places: Mapping[str, Place],
    signatures: Mapping[str, NDArray[np.float64]],
) -> tuple[str, ...]:
    """Fit all effects at once, and rank them by how much each of them moves the signals then."""
    grids = grids_of(evidence.problem)
    keys, columns, null, low, high, owner = [], [], [], [], [], []
    for name in places:
        for i, (key, parameter) in enumerate(evidence.problem.library.parameters((name,))):
            points = grids[name].points
            others = np.delete(points, i, axis=1) == np.delete(
                [each.null for _, each in evidence.problem.library.parameters((name,))], i
            )
            own = np.flatnonzero(others.all(axis=1) & (points[:, i] != parameter.null))
            near = own[int(np.argmin(np.abs(points[own, i] - parameter.null)))]
            span = parameter.maximum - parameter.minimum
            columns.append(signatures[name][near] * span / (points[near, i] - parameter.null))
            keys.append(key)
            null.append((parameter.null - parameter.minimum) / span)
            low.append(parameter.minimum)
            high.append(parameter.maximum)
            owner.append(name)
    jacobian, origin = np.array(columns).T, np.array(null)
    begin, span = np.array(low), np.array(high) - np.array(low)
    simulated = Signatures(evidence.problem, evidence.settings, plain, evidence.machine)
    best, left, length = origin.copy(), plain.whitened.copy(), 1.0
    straight = np.clip(origin + _step_within(origin, left, jacobian), 0.0, 1.0)
    current = jacobian.copy()
    for _ in range(_FREE_STEPS):
        step = length * _step_within(best, left, current)
        if not np.abs(step).max() > 1e-9:  # noqa: PLR2004 - of the ranges: nothing moves any more
            break
        shares = np.clip(best + step, 0.0, 1.0)
        made = simulated(dict(zip(keys, (begin + shares * span).tolist(), strict=True)))
        rest = plain.whitened - made
        current = current + np.outer(left - rest - current @ step, step) / float(step @ step)
        if rest @ rest < left @ left:
            best, left, length = shares, rest, 1.0
        else:
            length *= _SHORTER
    if (best == origin).all():
        # No run was better than none: what the derivatives say is all there is.
        best = straight
    moved: dict[str, NDArray[np.float64]] = {}
    for i, name in enumerate(owner):
        moved[name] = moved.get(name, np.zeros(len(left))) + (best[i] - origin[i]) * jacobian[:, i]
    sizes = {name: float(np.linalg.norm(each)) for name, each in moved.items()}
    return tuple(sorted(sizes, key=lambda name: -sizes[name]))


def _step_within(
    shares: NDArray[np.float64], left: NDArray[np.float64], jacobian: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the step of least squares that stays in the ranges."""
    room = np.vstack([-shares, 1.0 - shares]) + np.array([[-1e-12], [1e-12]])
    # The same problem in as many rows as columns: there are far more features.
    rows: NDArray[np.float64] = np.asarray(np.linalg.qr(np.column_stack([jacobian, left]), mode="r"))
    step: NDArray[np.float64] = lsq_linear(rows[:, :-1], rows[:, -1], bounds=(room[0], room[1])).x
    return step
