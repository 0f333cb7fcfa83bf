"""The machine's constants and a candidate's parameters, fitted together where references are missing.

Maximum of the posterior: the whitened residual of all recordings, with the tolerances of the constants as their priors
and bounds (Gauss-Newton in a trust region, scipy's `least_squares`). Derivatives by the constants are taken once for
each recording, at the nominal machine, and shared by all candidates, as in a chord method (Ortega and Rheinboldt 1970,
Iterative Solution of Nonlinear Equations, ch. 7). It ends where these derivatives say that the gradient is 0, which is
beside the maximum: for the best candidates they are taken again where the fit has come to.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.linalg import solve_triangular  # type: ignore[import-untyped]  # carries no types
from scipy.optimize import least_squares  # type: ignore[import-untyped]  # carries no types

from jammkle_gap.core.calibrate import Discrepancy
from jammkle_gap.core.detect import detect
from jammkle_gap.core.fit import (
    LEAST_STEP,
    STEP_SHARE,
    Fit,
    Profiles,
    Signatures,
    grid_signatures,
    quotients,
)
from jammkle_gap.core.posterior import NONE_OF_THEM
from jammkle_gap.core.search import Candidates
from jammkle_gap.core.signatures import grids_of
from jammkle_gap.core.simulate import Made, StoppedError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_gap.core.calibrate import Calibration
    from jammkle_gap.core.constants import Constants
    from jammkle_gap.core.detect import Detection
    from jammkle_gap.core.fit import GridFeatures, Place
    from jammkle_gap.core.scatter import Difference, Residuals, Setting
    from jammkle_gap.core.search import Provisional
    from jammkle_gap.core.simulate import Problem, Runner

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
_FAR = 0.5
"""Standard deviations that the constants move alone, from which on effects are looked for there as well."""
_BEYOND = 2.5
"""Standard deviations from nominal from which on a constant may stand for an effect. Chosen: one of 70 constants of a
machine as drawn lies beyond."""
_WORTH_GOING_ON = 4.0
"""What another step must take off the squared whitened residual, for the constants alone to be fitted on: two nats."""
_NESTED = 2
"""Candidates from whose constants those alone are fitted once more."""
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
    base: Mapping[str, float] = field(default_factory=dict)
    """Constants that are held where they are, by name."""

    def values(self, deviations: NDArray[np.float64]) -> dict[str, float]:
        """Return the constants that are not nominal, by name, from deviations in their tolerances' standard ones."""
        moved = zip(self.problem.constants, deviations.tolist(), strict=True)
        return {**self.base, **{each.name: each.null + x * each.sigma for each, x in moved if x != 0.0}}

    def signatures(self, difference: Difference) -> Signatures:
        """Return what simulates the machine about what is known of it."""
        return Signatures(self.problem, self.settings, difference, self.values(self.mean), self.silent)

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
        return replace(
            self,
            problem=replace(self.problem, constants=()),
            prior=replace(self.prior, deviations={}, covariance=np.zeros((0, 0))),
            base=self.values(self.mean),
        )

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
        slopes: Derivatives of the features, of `slopes_at`: by parameters and constants, or by constants alone; those
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
            x_scale=np.concatenate([np.ones(objective.count), np.full(len(begin) - objective.count, _FIRST_STEP)]),
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
    by_parameters = [each / objective.span for each in difference.split(objective.derivatives(place))]
    by_scores = [each.shared for each in difference.settings]
    if slopes is not None:
        by_scores = [each[:, each.shape[1] - len(scores) :] @ machine.root for each in slopes]
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
        self._along = difference.shared
        if slopes is not None:
            self._along = difference.by_scatter([each[:, each.shape[1] - len(self._mean) :].T for each in slopes]).T
        elif len(self._root):
            # By the deviations themselves, since these are what has bounds.
            self._along = solve_triangular(self._root, self._along.T, trans="T", lower=True).T
        self._target = difference.by_scatter(machine.raw)
        self._known: dict[bytes, list[NDArray[np.float64]] | None] = {}
        self._derived: dict[bytes, NDArray[np.float64]] = {}

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
        """Return derivatives of the features by shares of the parameters' ranges, shape (n, parameters)."""
        if self._slopes is not None:
            return self._slopes
        key = place.tobytes()
        if key not in self._derived:
            reach = float(np.linalg.norm(self.left(place)[: len(self._target)]))

            def stacked(shares: NDArray[np.float64]) -> NDArray[np.float64]:
                made = self.features(np.concatenate([shares, place[self.count :]]))
                return np.full(len(self._target), _INFEASIBLE) if made is None else np.concatenate(made)

            def length(change: NDArray[np.float64]) -> float:
                return float(np.linalg.norm(self._difference.by_scatter(self._difference.split(change))))

            self._derived[key] = quotients(stacked, place[: self.count], self._null, reach, length)
        return self._derived[key]

    def jacobian(self, place: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return derivatives of `left`."""
        own = self._difference.by_scatter([each.T for each in self._difference.split(self.derivatives(place))]).T
        inverse = np.linalg.inv(self._root) if len(self._root) else self._root
        prior = np.hstack([np.zeros((len(self._root), self.count)), inverse])
        rows: NDArray[np.float64] = np.vstack([np.hstack([-own, -self._along]), prior])
        return rows


def slopes_at(machine: Machine, difference: Difference, fit: Fit, signatures: Signatures) -> list[NDArray[np.float64]]:
    """Return derivatives of the features where a candidate has come to.

    Central differences: what a candidate and the constants differ by is small beside either, and would be lost in the
    curvature.

    Args:
        machine: The recordings.
        difference: Tells which constants move what; those that hardly move a setting keep the derivatives they have.
        fit: The candidate.
        signatures: Simulates the machine.

    Returns:
        Per setting, shape (n, parameters + constants): by each parameter, and by one standard deviation of each
        constant.

    """
    return [slopes_in(k, machine, difference, fit, signatures) for k in range(len(machine.settings))]


_CENTRAL, _FORWARD = (1.0, -1.0), (1.0, 0.0)
"""Ends of a difference quotient, in steps."""


def slopes_in(
    k: int,
    machine: Machine,
    difference: Difference,
    fit: Fit,
    signatures: Signatures,
    ends_at: tuple[float, float] = _CENTRAL,
) -> NDArray[np.float64]:
    """Return the derivatives of one setting; see `slopes_at`. Forward differences take half of the runs."""
    parameters = machine.problem.library.parameters(fit.names)
    place, (least, most) = machine.mean + machine.root @ fit.scores, machine.bounds
    back = np.linalg.inv(machine.root) if len(place) else np.zeros((0, 0))
    free, known = len(parameters), fit.slopes[k]
    found = np.hstack([known[:, :free], known[:, free:] @ back])
    moving = np.linalg.norm(difference.split(difference.shared)[k], axis=0) > _VISIBLE
    for i in np.flatnonzero(np.concatenate([np.ones(free, dtype=bool), moving])).tolist():
        ends, places = [], []
        for sign in ends_at:
            values, moved = dict(fit.values), place.copy()
            if i < free:
                key, each = parameters[i]
                span = each.maximum - each.minimum
                step = max(STEP_SHARE * abs(fit.values[key] - each.null), LEAST_STEP * span)
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
    return found


def _slopes_and_runs(
    k: int, machine: Machine, difference: Difference, fit: Fit, ends_at: tuple[float, float]
) -> tuple[NDArray[np.float64], Made]:
    signatures = machine.signatures(difference)
    return slopes_in(k, machine, difference, fit, signatures, ends_at), signatures.made


def _affordable(machine: Machine, constants: Constants) -> bool:
    """Return whether derivatives by all constants may be taken as often as they help."""
    return len(machine.problem.constants) * len(machine.settings) <= constants.affordable_derivatives


def _are_dear(machine: Machine, constants: Constants) -> bool:
    """Return whether derivatives by all constants take too long for every candidate to have its own."""
    recorded_s = sum(setting.faulty[0].duration_s for setting in machine.settings)
    return len(machine.problem.constants) * recorded_s > constants.derivatives_s


def _in_time(machine: Machine, constants: Constants) -> Constants:
    """Return constants that make fewer runs where those for derivatives are many already."""
    if not _are_dear(machine, constants):
        return constants
    few = constants.hurried
    return replace(constants, refined=constants.refined_beside, joint_evaluations=few, reweighings=few)


@dataclass(frozen=True)
class Explained:
    """Everything that was fitted beside the constants of the machine."""

    nothing: Fit
    """None of the effects: the constants alone, beside scatter."""
    noticed: tuple[Fit, ...]
    """Single effects beside scatter alone: whether there is a gap."""
    candidates: Candidates
    """Beside model discrepancy: which effect it is."""
    within: Fit
    """None of the effects, beside model discrepancy."""
    own: Mapping[tuple[str, ...], float]
    """Log-likelihood of each candidate, and of none of them, ()."""


def explain(
    machine: Machine,
    residuals: Sequence[Residuals],
    difference: Difference,
    grids: GridFeatures,
    runner: Runner,
    constants: Constants,
    provisional: Provisional | None = None,
) -> Explained:
    """Look for the effects that explain the difference beside the constants of the machine.

    Effects are looked for on their grids, beside constants that are linear about the nominal machine and about where
    they explain most alone. Those that promise most are fitted with the simulator, pairs of them too where there is a
    gap, and the most likely again with derivatives of their own.

    Args:
        machine: What is to be explained.
        residuals: The same, by run.
        difference: Whitened by scatter and the priors of the constants.
        grids: What grid points make of the features.
        runner: Makes the runs.
        constants: Of the model.
        provisional: Reports the first answer.

    Raises:
        StoppedError: asked to stop before anything was fitted.

    """
    problem, constants = machine.problem, _in_time(machine, constants)
    error = Discrepancy(machine.settings, residuals, difference, constants)
    blank = _start((), {}, [np.zeros(each.size) for each in difference.settings])
    nothing, slopes = _constants_alone(machine, error, blank, runner, constants)
    bases = _bases(machine, error, blank, nothing, slopes, grids)
    if provisional is not None:
        length = max(bases[0].length, 1.0)
        shares = [(each.names[0], min(max(each.gain / length, 0.0), 1.0)) for each in bases[0].singles]
        provisional(shares)

    def fitted(starts: Sequence[tuple[_Base, Fit, Place]], what: str) -> tuple[list[Fit], bool]:
        work = [
            (machine, error, _from(problem, place, begun), base.weighs, constants, base.slopes)
            for base, begun, place in starts
        ]
        answers, finished = _until_stopped(runner, fit_beside_error, work, what)
        return best_of([fit for fit, _ in answers if fit.features]), finished

    def best_of(fits: Sequence[Fit]) -> list[Fit]:
        own = error.scores(nothing, fits, len(problem.library.effects))[1:]
        kept: dict[frozenset[str], Fit] = {}
        for fit, _ in sorted(zip(fits, own, strict=True), key=lambda each: -each[1]):
            kept.setdefault(frozenset(fit.names), fit)
        return list(kept.values())

    def refitted(fits: Sequence[Fit], beside: Fit) -> list[Fit]:
        work = [(machine, error, replace(fit, scores=beside.scores), beside, constants, slopes) for fit in fits]
        answers, _ = _until_stopped(runner, fit_beside_error, work, "fitting")
        return [fit for fit, _ in answers if fit.features]

    singles, finished = fitted(_promising_singles(problem, grids, error, blank, bases, constants), "fitting")
    if error.left_per_feature(nothing) < constants.doubtful:
        # Where little is left, nats decide: constants that a candidate has found may explain more alone, too.
        tried = [nothing, *(fit for each in singles[:_NESTED] for fit in refitted([blank], each))]
        nothing = min(tried, key=lambda fit: _whitened_by(difference, fit).left)
    noticed = tuple(_whitened_by(difference, fit) for fit in singles)
    alone = _whitened_by(difference, nothing)
    pairs: list[Fit] = []
    gap = detect_jointly(machine, error, alone, noticed, constants).gap
    if finished and singles and gap:
        if error.left_per_feature(singles[0]) > constants.doubtful and _affordable(machine, constants):
            # What it leaves is searched for a second effect, and shall be as little as can be.
            answers, finished = _until_stopped(runner, _settled, [(machine, error, singles[0], constants)], "fitting")
            singles = best_of([*(fit for fit, _ in answers), *singles])
        promising = _promising_pairs(problem, grids, error, singles, bases[min(1, len(bases) - 1)], constants)
        pairs, finished = fitted(promising, "fitting pairs")
    within, own = nothing, {NONE_OF_THEM: 0.0}
    if finished:
        fits, own, finished = _weighed(machine, error, (nothing, *singles, *pairs), runner, constants, gap=gap)
        within = fits.pop(NONE_OF_THEM)
        singles = [fit for fit in fits.values() if len(fit.names) == 1]
        pairs = [fit for fit in fits.values() if len(fit.names) > 1]
    profiled = {place.names[0]: place.gain for place in bases[0].singles}
    silent = tuple(effect.name for effect in problem.library if effect.name not in profiled)
    found = Candidates(tuple(singles), tuple(pairs), profiled, silent, finished)
    return Explained(alone, noticed, found, within, own)


def _promising_singles(
    problem: Problem,
    grids: GridFeatures,
    error: Discrepancy,
    blank: Fit,
    bases: Sequence[_Base],
    constants: Constants,
) -> list[tuple[_Base, Fit, Place]]:
    """Return single effects to be fitted, each with where its constants begin.

    Those are among them that explain most of a signal on the whole: block by block, a large gap counts as the error of
    the simulator, and what explains nearly all of it gains less than what moves blocks that agree already.
    """
    found = [(base, base.fit, place) for base in bases for place in base.singles[: constants.refined]]
    evenly = _Base(problem, grids, error.evenly_with(blank), blank, blank, None)
    known = {place.names for base, _, place in found if base is bases[0]}
    others = [place for place in evenly.singles[: constants.paired] if place.names not in known]
    return [*found, *((bases[0], blank, place) for place in others)]


def _promising_pairs(
    problem: Problem,
    grids: GridFeatures,
    error: Discrepancy,
    singles: Sequence[Fit],
    about: _Base,
    constants: Constants,
) -> list[tuple[_Base, Fit, Place]]:
    """Return pairs to be fitted, each with where its constants begin: from fitted effects on, and by grids alone.

    A second effect shows where the first leaves most, and is looked for by what that leaves of a signal on the whole:
    block by block, it would count as the error of the simulator.
    """
    weighed = error.evenly_with(singles[0])
    profiles = Profiles(grids_of(problem), grid_signatures(grids, weighed), weighed.whitened)
    first = [_whitened_by(weighed, fit) for fit in singles[: constants.paired]]
    seconds = [(about, fit, place) for fit in first for place in profiles.seconds(fit)]
    most = constants.refined_pairs // 2
    names = [place.names[0] for place in about.singles[: constants.paired]]
    by_grids = [(about, about.fit, place) for place in about.profiles.pairs(names, most)]
    return [*sorted(seconds, key=lambda each: -each[2].gain)[:most], *by_grids]


def fit_part(
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
    signatures = machine.signatures(whitens)
    return fit_jointly(machine, whitens, _start(names, best.values), signatures, constants), signatures.made


def detect_jointly(
    machine: Machine, error: Discrepancy, nothing: Fit, singles: Sequence[Fit], constants: Constants
) -> Detection:
    """Test for a gap beyond the tolerances of the constants and the accuracy of the simulator.

    No healthy runs show how much they scatter along a signature: data sheets, tolerances and the stated accuracy say
    it, in as many degrees of freedom as the simulator's discrepancy has. An effect must explain more than an error of
    that size that lasts for a block; what nothing explains must be larger than it.

    Args:
        machine: Whose simulator has an accuracy.
        error: Of the simulator.
        nothing: The constants alone.
        singles: Effects, each with the constants.
        constants: Of the model.

    """
    given = replace(constants, direction_prior_freedom=constants.discrepancy_freedom)
    by_bin, by_block = error.accurate_to(machine.problem.accuracy)
    alone, whole = _whitened_by(by_block, nothing).left, (by_bin, _whitened_by(by_bin, nothing).left)
    return detect(by_block, alone, [_whitened_by(by_block, fit) for fit in singles], given, whole)


def _constants_alone(
    machine: Machine, error: Discrepancy, blank: Fit, runner: Runner, constants: Constants
) -> tuple[Fit, list[NDArray[np.float64]]]:
    """Return the constants fitted alone, as well as they can be, and their derivatives there.

    What they leave is what is asked about. Where derivatives are dear they are taken once, forward, and updated.
    """
    fit, made = fit_beside_error(machine, error, blank, blank, constants, None)
    runner.count([made])
    slopes = [each.shared for each in error.difference_with(blank).settings]
    if not fit.features:
        return blank, slopes
    steps = constants.calibration_steps if machine.problem.constants else 0
    affordable = _affordable(machine, constants)
    for turn, whitened in enumerate((error.evenly_with, error.difference_with)):
        for step in range(steps):
            difference = whitened(fit)
            if step == 0 and (affordable or turn == 0):
                ends_at = _CENTRAL if affordable else _FORWARD
                work = [(k, machine, difference, fit, ends_at) for k in range(len(machine.settings))]
                answers = runner.map(_slopes_and_runs, work)
                slopes = [each for each, _ in answers]
                runner.count(made for _, made in answers)
            signatures = machine.signatures(difference)
            found = fit_jointly(machine, difference, fit, signatures, constants, slopes)
            runner.count([signatures.made])
            before = _whitened_by(difference, fit).left
            if not found.features or found.left >= before:
                break
            slopes = _updated(slopes, machine, difference, fit, found)
            fit = found
            if before - found.left < _WORTH_GOING_ON:
                break
    return fit, slopes


def _updated(
    slopes: Sequence[NDArray[np.float64]], machine: Machine, difference: Difference, before: Fit, after: Fit
) -> list[NDArray[np.float64]]:
    """Return derivatives that explain the last step as well (Broyden 1965, Math. Comp. 19:577), at no further run."""
    scores = after.scores - before.scores
    step = machine.root @ scores
    if not step.any():
        return list(slopes)
    found = []
    for k, own in enumerate(slopes):
        change = after.features[k] - before.features[k] + difference.settings[k].shared @ scores
        found.append(own + np.outer(change - own @ step, step) / (step @ step))
    return found


class _Base:
    """Effects on their grids, beside constants that are taken as linear about one place."""

    def __init__(
        self,
        problem: Problem,
        grids: GridFeatures,
        difference: Difference,
        fit: Fit,
        weighs: Fit,
        slopes: Sequence[NDArray[np.float64]] | None,
    ) -> None:
        """Look effects up on their grids.

        Args:
            problem: The library.
            grids: What grid points make of the features.
            difference: Whitened about this base.
            fit: The constants that a candidate begins with.
            weighs: Constants whose discrepancy weighs the features first.
            slopes: Derivatives by the constants; None: those at the nominal machine.

        """
        self.fit, self.weighs, self.slopes = fit, weighs, slopes
        self.length = float(difference.whitened @ difference.whitened)
        self.profiles = Profiles(grids_of(problem), grid_signatures(grids, difference), difference.whitened)
        places = [self.profiles.single(name) for name in self.profiles.names]
        self.singles = sorted(places, key=lambda place: -place.gain)


def _bases(
    machine: Machine,
    error: Discrepancy,
    blank: Fit,
    nothing: Fit,
    slopes: Sequence[NDArray[np.float64]],
    grids: GridFeatures,
) -> list[_Base]:
    """Return where effects are looked for: beside constants about nominal, about where they explain most, and between.

    A worn pump is an effect, and constants of its curve as well. Beside constants that have taken an effect up it
    explains nothing more: it is looked for with those that lie beyond their tolerance held at nominal.
    """
    problem = machine.problem
    found = [_Base(problem, grids, error.difference_with(blank), blank, blank, None)]
    away = np.abs(nothing.scores)
    if away.max(initial=0.0) > _FAR:
        weighed = error.difference_with(nothing)
        there = _about(machine, weighed, nothing, slopes)
        found.append(_Base(problem, grids, there, nothing, nothing, slopes))
        beyond = away > _BEYOND
        if beyond.any():
            kept = replace(nothing, scores=np.where(beyond, 0.0, nothing.scores))
            between = _about(machine, weighed, nothing, slopes, held=beyond)
            found.append(_Base(problem, grids, between, kept, nothing, slopes))
    return found


def _about(
    machine: Machine,
    whitens: Difference,
    nothing: Fit,
    slopes: Sequence[NDArray[np.float64]],
    held: NDArray[np.bool_] | None = None,
) -> Difference:
    """Return the difference with constants that are linear about where they explain most alone.

    They keep their priors: a place to linearise at is no knowledge (as in an iterated Kalman filter; Bell and Cathey
    1993, IEEE Trans. Autom. Control 38:294).

    Args:
        machine: What is to be explained.
        whitens: Weighs the features.
        nothing: The constants alone.
        slopes: Derivatives there.
        held: Scores that are held at 0, shape (constants,); None: none.

    """
    columns = [each @ machine.root for each in slopes]
    moved = [
        raw - part + (each - own.shared) @ nothing.scores
        for raw, part, own, each in zip(machine.raw, nothing.features, whitens.settings, columns, strict=True)
    ]
    if held is not None:
        columns = [np.where(held, 0.0, each) for each in columns]
    settings = tuple(replace(own, shared=each) for own, each in zip(whitens.settings, columns, strict=True))
    found = replace(whitens, settings=settings, shared=whitens.by_scatter([each.T for each in columns]).T)
    return replace(found, whitened=found.whiten(moved))


def _whitened_by(difference: Difference, fit: Fit) -> Fit:
    """Return a fit as another whitening sees it."""
    signature = difference.whiten(fit.features)
    free = len(fit.values)
    return replace(
        fit,
        signature=signature,
        left=float(np.square(difference.whitened - signature).sum()),
        jacobian=difference.whiten([each[:, :free].T for each in fit.slopes]).T if fit.slopes else fit.jacobian,
        whitened=difference.whitened,
    )


def _start(names: tuple[str, ...], values: Mapping[str, float], features: Sequence[NDArray[np.float64]] = ()) -> Fit:
    nothing = np.zeros(0)
    return Fit(names, values, nothing, np.inf, np.zeros((0, 0)), nothing, tuple(features))


def _from(problem: Problem, place: Place, base: Fit) -> Fit:
    keys = [key for key, _ in problem.library.parameters(place.names)]
    values = dict(zip(keys, np.concatenate(place.values).tolist(), strict=True))
    return replace(_start(place.names, values), scores=base.scores)


def _until_stopped(
    runner: Runner, function: Callable[..., tuple[Fit, Made]], work: Sequence[tuple[Any, ...]], what: str
) -> tuple[list[tuple[Fit, Made]], bool]:
    """Return answers to several arguments, and whether all were given before a stop."""
    finished = True
    try:
        answers = runner.map(function, work, what)
    except StoppedError as stopped:
        answers, finished = list(stopped.done), False
    runner.count(made for _, made in answers)
    return answers, finished


def _weighed(
    machine: Machine, error: Discrepancy, fits: Sequence[Fit], runner: Runner, constants: Constants, *, gap: bool
) -> tuple[dict[tuple[str, ...], Fit], dict[tuple[str, ...], float], bool]:
    """Return candidates beside the discrepancy that each leaves, their log-likelihoods, and whether all were fitted."""
    count = len(machine.problem.library.effects)

    def scored(fits: Mapping[tuple[str, ...], Fit]) -> dict[tuple[str, ...], float]:
        others = [names for names in fits if names != NONE_OF_THEM]
        scores = error.scores(fits[NONE_OF_THEM], [fits[names] for names in others], count)
        return dict(zip((NONE_OF_THEM, *others), scores, strict=True))

    def likeliest(own: Mapping[tuple[str, ...], float], most: int) -> set[tuple[str, ...]]:
        def odds(names: tuple[str, ...]) -> float:
            return own[names] - constants.pair_penalty * (len(names) - 1)

        chosen = sorted((names for names in own if names != NONE_OF_THEM), key=odds, reverse=True)[:most]
        # A pair is compared with its halves, and so these are fitted as well as it is.
        return {NONE_OF_THEM, *chosen, *((name,) for names in chosen for name in names if (name,) in own)}

    known = {fit.names: fit for fit in fits}
    finished, own = True, scored(known)
    rounds = [(sharpen, most) for most in constants.sharpened] if machine.problem.constants else []
    doubtful = error.left_per_feature(known[max(own, key=lambda names: own[names])]) > constants.doubtful
    if not gap:
        rounds = [(sharpen, 0)]  # no candidate will be named, and none needs derivatives of its own
    elif doubtful and _affordable(machine, constants):
        rounds = [*((way, most) for way in (spread, sharpen) for most in constants.sharpened_in_doubt), *rounds]
    if _are_dear(machine, constants):
        chosen = sorted(likeliest(own, constants.sharpened[0] if gap else 0), key=lambda names: -own[names])
        fits = [known[names] for names in chosen]
        answers, finished = _sharpen_together(machine, error, fits, runner, constants)
        known.update({fit.names: fit for fit, _ in answers if fit.features})
        return known, scored(known), finished
    for function, most in rounds:
        if not finished:
            break
        work = [(machine, error, known[names], constants) for names in likeliest(own, most)]
        answers, finished = _until_stopped(runner, function, work, "constants of the machine")
        known.update({fit.names: fit for fit, _ in answers if fit.features})
        own = scored(known)
    return known, own, finished


def _sharpen_together(
    machine: Machine, error: Discrepancy, fits: Sequence[Fit], runner: Runner, constants: Constants
) -> tuple[list[tuple[Fit, Made]], bool]:
    """Return candidates fitted again with derivatives by the constants where the first of them has come to.

    Where derivatives are dear they are taken once for all that are likely, a setting at a time.
    """
    about = next((fit for fit in fits if fit.names), fits[0])
    difference, settings = error.difference_with(about), range(len(machine.settings))
    try:
        answers = runner.map(
            _slopes_and_runs,
            [(k, machine, difference, about, _FORWARD) for k in settings],
            "constants of the machine",
        )
    except StoppedError:
        return [], False
    runner.count(made for _, made in answers)
    slopes = [each for each, _ in answers]
    work = [(machine, error, fit, constants, slopes) for fit in fits]
    return _until_stopped(runner, _with_slopes, work, "constants of the machine")


def fit_beside_error(
    machine: Machine,
    error: Discrepancy,
    start: Fit,
    before: Fit,
    constants: Constants,
    slopes: Sequence[NDArray[np.float64]] | None,
) -> tuple[Fit, Made]:
    """Return a candidate fitted beside the model discrepancy that it leaves, and the runs that it took.

    Iteratively reweighted least squares: as the fit closes the gap, the discrepancy that weighs it shrinks.

    Args:
        machine: What is to be explained.
        error: Of the simulator.
        start: The candidate and where to begin.
        before: Fit whose discrepancy weighs the features first.
        constants: Of the model.
        slopes: Derivatives by the constants; None: those at the nominal machine.

    """
    difference = error.evenly_with(before)
    signatures, fit = machine.signatures(difference), start
    for _ in range(constants.reweighings):
        found = fit_jointly(machine, difference, fit, signatures, constants, slopes)
        if not found.features:
            break
        fit = found
        difference = error.difference_with(fit)
    return fit, signatures.made


def spread(machine: Machine, error: Discrepancy, fit: Fit, constants: Constants) -> tuple[Fit, Made]:
    """Return a candidate fitted again as `sharpen` does, with what it leaves spread evenly over each signal."""
    return _again(machine, error.evenly_with(fit), fit, constants)


def sharpen(machine: Machine, error: Discrepancy, fit: Fit, constants: Constants) -> tuple[Fit, Made]:
    """Return a candidate fitted again with derivatives of its own, and the runs that it took."""
    return _again(machine, error.difference_with(fit), fit, constants)


def _settled(machine: Machine, error: Discrepancy, fit: Fit, constants: Constants) -> tuple[Fit, Made]:
    """Return a candidate fitted again with derivatives of its own until little more comes of it, and the runs."""
    made = Made(0, 0.0)
    for function in (spread, sharpen):
        fit, more = function(machine, error, fit, constants)
        made = Made(made.runs + more.runs, made.simulated_s + more.simulated_s)
    return fit, made


def _again(machine: Machine, difference: Difference, fit: Fit, constants: Constants) -> tuple[Fit, Made]:
    signatures = machine.signatures(difference)
    slopes = slopes_at(machine, difference, fit, signatures)
    found = fit_jointly(machine, difference, fit, signatures, constants, slopes)
    return (found if found.features else fit), signatures.made


def _with_slopes(
    machine: Machine, error: Discrepancy, fit: Fit, constants: Constants, slopes: Sequence[NDArray[np.float64]]
) -> tuple[Fit, Made]:
    """Return a candidate fitted again with derivatives that were taken beside another one, and the runs."""
    own = [each[:, each.shape[1] - len(machine.problem.constants) :] for each in slopes]
    patient = replace(constants, joint_evaluations=constants.fit_evaluations)
    signatures = machine.signatures(error.difference_with(fit))
    for _ in range(constants.hurried):
        found = fit_jointly(machine, error.difference_with(fit), fit, signatures, patient, own)
        if not found.features:
            break
        fit = found
    return fit, signatures.made
