"""A candidate's parameters and the machine's constants, fitted together with the simulator.

Maximum of the posterior: the whitened residual of all recordings, with the tolerances of the constants as their priors
and bounds (Gauss-Newton in a trust region, scipy's `least_squares`). Where references have calibrated the constants,
these are held. Derivatives by the constants are taken once for each recording, are shared by all candidates, and follow
the steps of each (Broyden 1965, Math. Comp. 19:577); for the best candidates they are taken again where the fit
has come to.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import solve_triangular  # type: ignore[import-untyped]  # carries no types
from scipy.optimize import least_squares  # type: ignore[import-untyped]  # carries no types

from jammkle_gap.core.fit import Fit, Signatures

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_gap.core.calibrate import Calibration
    from jammkle_gap.core.constants import Constants
    from jammkle_gap.core.scatter import Difference, Setting
    from jammkle_gap.core.simulate import Made, Problem

_STEP_SHARE, _LEAST_STEP = 0.15, 0.01
"""Step of a difference quotient: share of the distance from null, and least share of the range. Chosen: contact makes
smaller differences of a simulation uneven."""
_SHORTENINGS = 3
"""Times that a step is tried, each time shortened to what there is to explain."""
_LEAST_REACH = 3.0
"""Change of the whitened signature that is always let pass: three standard deviations."""
_INFEASIBLE = 1e6
"""Whitened features of what cannot be simulated: far from everything that is measured."""
_FARTHEST = 10.0
"""Standard deviations from nominal up to which a constant without bounds is looked for."""
_NEGLIGIBLE = 0.1
"""Change of the squared whitened residual at which a fit ends, where one is left per feature: no candidate is more
likely than another for less."""
_FIRST_STEP = 3.0
"""Standard deviations that the first step of a fit may move the constants by. Chosen: most machines lie within."""
_STEP = 0.2
"""Step of a difference quotient by a constant, in its standard deviations. Chosen: the payload of an arm lies along a
ridge with the masses of its links; with whole ones it stays a standard deviation beside the maximum."""
_VISIBLE = 1.0
"""Whitened length of what one standard deviation of a constant moves in a setting, below which it is not seen there."""


@dataclass(frozen=True)
class Machine:
    """What is to be explained, and what is known of the machine beforehand: drawings, or what references showed."""

    problem: Problem
    settings: tuple[Setting, ...]
    raw: tuple[NDArray[np.float64], ...]
    """Measured less simulated with the constants as known beforehand, per setting."""
    prior: Calibration
    silent: tuple[frozenset[str], ...]
    """Parameters and constants that move nothing in a setting, per setting."""
    nominal: tuple[NDArray[np.float64], ...] = ()
    """Features as simulated with the constants as known beforehand, per setting; empty: simulated where needed."""

    def values(self, deviations: NDArray[np.float64]) -> dict[str, float]:
        """Return the constants that are not nominal, by name, from deviations in their tolerances' standard ones."""
        if not self.problem.constants:
            return dict(self.prior.values)
        moved = zip(self.problem.constants, deviations.tolist(), strict=True)
        return {
            each.name: min(max(each.null + x * each.sigma, each.minimum), each.maximum) for each, x in moved if x != 0.0
        }

    def signatures(self) -> Signatures:
        """Return what simulates the machine about what is known of it."""
        return Signatures(self.problem, self.settings, self.values(self.mean), self.silent, self.nominal)

    def coarse(self) -> Machine:
        """Return the same as `Problem.coarse` runs it, for derivatives and a search; itself if that changes nothing."""
        runs = [self.problem.coarse(each.faulty[0]) for each in self.settings]
        if all(run is each.faulty[0] for run, each in zip(runs, self.settings, strict=True)):
            return self
        changed = zip(self.settings, runs, strict=True)
        settings = tuple(replace(each, faulty=(run, *each.faulty[1:])) for each, run in changed)
        return replace(self, settings=settings, nominal=())

    @property
    def mean(self) -> NDArray[np.float64]:
        """Deviations that are known beforehand, shape (constants,)."""
        return np.array([self.prior.deviations[each.name] for each in self.problem.constants])

    @property
    def root(self) -> NDArray[np.float64]:
        """Lower root of their covariance, shape (constants, constants)."""
        return np.linalg.cholesky(self.prior.covariance).astype(np.float64)

    @property
    def bounds(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Least and largest deviations, shape (constants,) each."""
        every = self.problem.constants
        low = np.array([max((each.minimum - each.null) / each.sigma, -_FARTHEST) for each in every])
        high = np.array([min((each.maximum - each.null) / each.sigma, _FARTHEST) for each in every])
        return low, high

    def held(self) -> Machine:
        """Return the same with its constants held where they are known to be."""
        known = replace(self.prior, deviations={}, covariance=np.zeros((0, 0)))
        return replace(self, problem=replace(self.problem, constants=()), prior=known)

    def steps(self, fit: Fit) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return least and largest steps of parameters, and of scores where these are independent, from a fit."""
        parameters = self.problem.library.parameters(fit.names)
        low = [each.minimum - fit.values[key] for key, each in parameters]
        high = [each.maximum - fit.values[key] for key, each in parameters]
        if not len(fit.scores):
            return np.minimum(low, -1e-12), np.maximum(high, 1e-12)
        # Beyond references' knowledge scores mix the constants, and have no bounds of their own.
        free = np.full(len(fit.scores), np.inf)
        independent = np.array_equal(self.root, np.eye(len(fit.scores)))
        least, most = self.bounds
        below, above = (least - fit.scores, most - fit.scores) if independent else (-free, free)
        return np.minimum([*low, *below], -1e-12), np.maximum([*high, *above], 1e-12)


def begun(names: tuple[str, ...], values: Mapping[str, float]) -> Fit:
    """Return a candidate that is to be fitted, with where its parameters begin, by key."""
    nothing = np.zeros(0)
    return Fit(names, values, nothing, np.inf, np.zeros((0, 0)), nothing)


def blank_of(difference: Difference, slopes: Sequence[NDArray[np.float64]] = ()) -> Fit:
    """Return none of the effects, which changes nothing.

    Args:
        difference: Of which settings.
        slopes: Derivatives by independent deviations of the constants, per setting; empty: these are not fitted.

    """
    count = slopes[0].shape[1] if slopes else 0
    features = tuple(np.zeros(each.size) for each in difference.settings)
    return replace(begun((), {}), features=features, scores=np.zeros(count), slopes=tuple(slopes))


def fit_jointly(
    machine: Machine,
    difference: Difference,
    start: Fit,
    signatures: Signatures,
    constants: Constants,
    slopes: Sequence[NDArray[np.float64]] | None = None,
) -> Fit:
    """Return a candidate fitted together with the constants of the machine; without features if it cannot be simulated.

    Args:
        machine: What is to be explained.
        difference: Whitens.
        start: Names, parameters and scores to begin with.
        signatures: Simulates the machine, and counts the runs.
        constants: When it ends.
        slopes: Derivatives of the features, of `slopes_in`: by parameters and constants, or by constants alone; those
            by parameters are then taken anew at every step. None: by the constants those that the difference has.

    """
    objective = _Objective(machine, difference, start.names, signatures, slopes)
    place = begin = objective.begin(start)
    if len(place):
        low, high = objective.bounds
        # Steps are counted from where it begins: scipy's first trust region is as wide as the variables are large, so
        # that constants that lie next to 0 would hardly move.
        found = least_squares(
            lambda step: objective.left(begin + step),
            np.zeros_like(begin),
            jac=lambda step: objective.jacobian(begin + step),
            bounds=(low - begin, high - begin),
            x_scale=objective.scale,
            max_nfev=constants.joint_evaluations,
            xtol=constants.fit_tolerance**2,
            ftol=_NEGLIGIBLE / difference.whitened.size,
        )
        place = begin + found.x
    made = objective.features(place)
    if made is None:
        return replace(start, features=(), whitened=difference.whitened, left=np.inf)
    scores = objective.scores(place)
    parts = [part - each.shared @ scores for part, each in zip(made, difference.settings, strict=True)]
    signature = difference.whiten(parts)
    derivatives, count = objective.derivatives(place), objective.count
    by_parameters = difference.split(derivatives[:, :count] / objective.span)
    by_scores = difference.split(derivatives[:, count:] @ machine.root)
    return Fit(
        start.names,
        objective.values(place),
        signature,
        float(np.square(difference.whitened - signature).sum()),
        difference.whiten([each.T for each in by_parameters]).T,
        difference.whitened,
        tuple(parts),
        scores,
        machine.values(place[objective.count :]),
        tuple(np.hstack(each) for each in zip(by_parameters, by_scores, strict=True)),
    )


class _Objective:
    """Whitened residual and derivatives of a candidate with the constants, at shares of ranges and at deviations."""

    def __init__(
        self,
        machine: Machine,
        difference: Difference,
        names: tuple[str, ...],
        signatures: Signatures,
        slopes: Sequence[NDArray[np.float64]] | None,
    ) -> None:
        self._machine, self._difference, self._signatures = machine, difference, signatures
        parameters = machine.problem.library.parameters(names)
        self._keys, self.count = [key for key, _ in parameters], len(parameters)
        self._low = np.array([each.minimum for _, each in parameters])
        self.span = np.array([each.maximum - each.minimum for _, each in parameters])
        self._null = np.array([(each.null - each.minimum) / (each.maximum - each.minimum) for _, each in parameters])
        self._mean, self._root = machine.mean, machine.root
        least, most = machine.bounds
        self.bounds = np.concatenate([0.0 * self._null, least]), np.concatenate([0.0 * self._null + 1.0, most])
        own = [] if slopes is None else [each[:, : each.shape[1] - len(self._mean)] for each in slopes]
        self._slopes: NDArray[np.float64] | None = None
        if own and own[0].shape[1] == self.count:
            self._slopes = np.concatenate(own) * self.span
        if slopes is not None:
            self._by_constants = np.concatenate([each[:, each.shape[1] - len(self._mean) :] for each in slopes])
        else:
            # By the deviations themselves, since these are what has bounds.
            columns = np.concatenate([each.shared for each in difference.settings])
            self._by_constants = solve_triangular(self._root, columns.T, trans="T", lower=True).T
        self.scale = np.concatenate([np.ones(self.count), np.full(len(self._mean), _FIRST_STEP)])
        """Of parameters' shares and of constants."""
        self._columns = np.zeros((sum(each.size for each in difference.settings), len(self.scale)))
        self._last: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None
        self._target = difference.by_scatter(machine.raw)
        self._known: dict[bytes, list[NDArray[np.float64]] | None] = {}

    def begin(self, start: Fit) -> NDArray[np.float64]:
        """Return where a candidate stands, within the bounds."""
        shares = (np.array([start.values[key] for key in self._keys]) - self._low) / self.span
        away = self._root @ start.scores if len(start.scores) else 0.0
        low, high = self.bounds
        begin: NDArray[np.float64] = np.clip(np.concatenate([shares, self._mean + away]), low + 1e-6, high - 1e-6)
        return begin

    def values(self, place: NDArray[np.float64]) -> dict[str, float]:
        """Return the parameters by key."""
        return dict(zip(self._keys, (self._low + place[: self.count] * self.span).tolist(), strict=True))

    def scores(self, place: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the constants in independent standard deviations from what is known of them."""
        away = place[self.count :] - self._mean
        found: NDArray[np.float64] = solve_triangular(self._root, away, lower=True) if len(self._root) else away
        return found

    def features(self, place: NDArray[np.float64]) -> list[NDArray[np.float64]] | None:
        """Return what changes in each setting; None where it cannot be simulated."""
        key = place.tobytes()
        if key not in self._known:
            machine = self._machine.values(place[self.count :])
            self._known[key] = self._signatures.parts(self.values(place), machine)
        return self._known[key]

    def left(self, place: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return what is left of the whitened difference, and the scores as what is left of the priors."""
        made = self.features(place)
        change = np.full(len(self._target), _INFEASIBLE) if made is None else self._difference.by_scatter(made)
        return np.concatenate([self._target - change, self.scores(place)])

    def derivatives(self, place: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return derivatives of the features by shares of the parameters' ranges and by the constants.

        Beside constants they are taken once, and then explain every step as well (Broyden 1965, Math. Comp. 19:577), at
        no further run.

        Returns:
            Shape (n, parameters + constants).

        """
        made = self.features(place)
        if made is None or (self._last is not None and np.array_equal(self._last[0], place)):
            return self._columns
        here = np.concatenate(made)
        if self._last is None or not len(self._root):
            own = self._slopes if self._slopes is not None else self._by_parameters(place)
            self._columns = np.hstack([own, self._by_constants])
        else:
            step = place - self._last[0]
            further = here - self._last[1] - self._columns @ step
            scaled = step / self.scale
            self._columns = self._columns + np.outer(further, scaled / self.scale / (scaled @ scaled))
        self._last = (place, here)
        return self._columns

    def _by_parameters(self, place: NDArray[np.float64]) -> NDArray[np.float64]:
        reach = float(np.linalg.norm(self.left(place)[: len(self._target)]))

        def stacked(shares: NDArray[np.float64]) -> NDArray[np.float64]:
            made = self.features(np.concatenate([shares, place[self.count :]]))
            return np.full(len(self._target), _INFEASIBLE) if made is None else np.concatenate(made)

        def length(change: NDArray[np.float64]) -> float:
            return float(np.linalg.norm(self._difference.by_scatter(self._difference.split(change))))

        return quotients(stacked, place[: self.count], self._null, reach, length)

    def jacobian(self, place: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return derivatives of `left`."""
        columns = self._difference.by_scatter([each.T for each in self._difference.split(self.derivatives(place))]).T
        inverse = np.linalg.inv(self._root) if len(self._root) else self._root
        prior = np.hstack([np.zeros((len(self._root), self.count)), inverse])
        rows: NDArray[np.float64] = np.vstack([-columns, prior])
        return rows


def derivatives_of(machine: Machine, fit: Fit) -> list[NDArray[np.float64]]:
    """Return the derivatives that a fit has come to, per setting, shape (n, parameters + constants).

    They are by each parameter, and by one standard deviation of each constant.
    """
    free = len(fit.values)
    back = np.linalg.inv(machine.root) if len(machine.root) else np.zeros((0, 0))
    return [np.hstack([each[:, :free], each[:, free:] @ back]) for each in fit.slopes]


CENTRAL, FORWARD = (1.0, -1.0), (1.0, 0.0)
"""Ends of a difference quotient, in steps. What a candidate and the constants differ by is small beside either, and
would be lost in the curvature by forward ones, which take half of the runs."""


def slopes_in(
    k: int,
    machine: Machine,
    difference: Difference,
    fit: Fit,
    ends_at: tuple[float, float] = CENTRAL,
) -> tuple[NDArray[np.float64], Made]:
    """Return derivatives of the features of one setting where a candidate has come to, and the runs that it took.

    Args:
        k: Which setting.
        machine: The recordings.
        difference: Tells which constants move what; those that hardly move a setting keep the derivatives they have.
        fit: The candidate.
        ends_at: `CENTRAL` or `FORWARD`.

    Returns:
        Derivatives of shape (n, parameters + constants): by each parameter, and by one standard deviation of each
        constant.

    """
    signatures, parameters = machine.coarse().signatures(), machine.problem.library.parameters(fit.names)
    place, (least, most) = machine.mean + machine.root @ fit.scores, machine.bounds
    free, found = len(parameters), derivatives_of(machine, fit)[k]
    moving = np.linalg.norm(difference.split(difference.shared)[k], axis=0) > _VISIBLE
    for i in np.flatnonzero(np.concatenate([np.ones(free, dtype=bool), moving])).tolist():
        ends, places = [], []
        for sign in ends_at:
            values, moved = dict(fit.values), place.copy()
            if i < free:
                key, each = parameters[i]
                span = each.maximum - each.minimum
                step = max(_STEP_SHARE * abs(fit.values[key] - each.null), _LEAST_STEP * span)
                values[key] = float(np.clip(values[key] + sign * step, each.minimum, each.maximum))
                places.append(values[key])
            else:
                j = i - free
                moved[j] = np.clip(moved[j] + sign * _STEP, least[j], most[j])
                places.append(float(moved[j]))
            ends.append((values, machine.values(moved)))
        width = places[0] - places[1]
        if width == 0.0:
            continue
        after, before = (signatures.part(k, *end) for end in ends)
        if after is not None and before is not None:
            found[:, i] = (after - before) / width
    return found, signatures.made


def quotients(
    function: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    shares: NDArray[np.float64],
    null: NDArray[np.float64],
    reach: float,
    length_of: Callable[[NDArray[np.float64]], float] = lambda change: float(np.linalg.norm(change)),
) -> NDArray[np.float64]:
    """Return difference quotients of a signature, shape (n, parameters).

    Args:
        function: Of shares of each parameter's range.
        shares: Where.
        null: Shares at which the effect is off.
        reach: Length of what there is to explain. A step that changes more is no derivative, and is shortened.
        length_of: Gives the whitened length of a change.

    """
    here, columns = function(shares), []
    for i, share in enumerate(shares):
        step = max(_STEP_SHARE * abs(share - null[i]), _LEAST_STEP)
        step = -step if share + step > 1.0 else step
        moved, change = shares, np.zeros_like(here)
        for _ in range(_SHORTENINGS):
            moved = shares.copy()
            moved[i] += step
            change = function(moved) - here
            length = length_of(change)
            if length <= max(reach, _LEAST_REACH):
                break
            step *= max(reach, _LEAST_REACH) / length
        columns.append(change / (moved[i] - share))
    slopes: NDArray[np.float64] = np.array(columns).reshape(len(shares), here.size).T
    return slopes
