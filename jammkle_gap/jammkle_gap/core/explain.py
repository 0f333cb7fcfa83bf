"""The search: which effects explain the difference beside the machine's constants and the simulator's own error."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from jammkle_gap.core.detect import detect
from jammkle_gap.core.fit import Fit, Profiles, grid_signatures
from jammkle_gap.core.joint import CENTRAL, FORWARD, fit_jointly, slopes_in
from jammkle_gap.core.posterior import NONE_OF_THEM
from jammkle_gap.core.signatures import grids_of
from jammkle_gap.core.simulate import Made, StoppedError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_gap.core.constants import Constants
    from jammkle_gap.core.detect import Detection
    from jammkle_gap.core.discrepancy import Discrepancy
    from jammkle_gap.core.fit import GridFeatures, Place
    from jammkle_gap.core.joint import Machine
    from jammkle_gap.core.posterior import Names
    from jammkle_gap.core.scatter import Difference
    from jammkle_gap.core.simulate import Problem, Runner

    Provisional = Callable[[Sequence[tuple[str, float]]], None]
    """Reports which effects explain which share of the squared difference before any is fitted, best first."""

_FAR = 0.5
"""Standard deviations that the constants move alone, from which on effects are looked for there as well."""
_BEYOND = 2.5
"""Standard deviations from nominal from which on a constant may stand for an effect. Chosen: one of 70 constants of a
machine as drawn lies beyond."""
_WORTH_GOING_ON = 4.0
"""What another step must take off the squared whitened residual, for the constants alone to be fitted on: two nats."""
_NESTED = 2
"""Candidates from whose constants those alone are fitted once more."""


def _slopes_and_runs(
    k: int, machine: Machine, difference: Difference, fit: Fit, ends_at: tuple[float, float]
) -> tuple[NDArray[np.float64], Made]:
    signatures = machine.signatures()
    return slopes_in(k, machine, difference, fit, signatures, ends_at), signatures.made


def _affordable(machine: Machine, constants: Constants) -> bool:
    """Return whether derivatives by all constants may be taken as often as they help."""
    return len(machine.problem.constants) * len(machine.settings) <= constants.affordable_derivatives


def _are_dear(machine: Machine, constants: Constants) -> bool:
    """Return whether derivatives by all constants take too long for every candidate to have its own."""
    recorded_s = sum(setting.faulty[0].duration_s for setting in machine.settings)
    return len(machine.problem.constants) * recorded_s > constants.derivatives_s


def _in_time(machine: Machine, error: Discrepancy, constants: Constants) -> Constants:
    """Return constants that make fewer runs where those for derivatives are many already."""
    if not error.without_references:
        # No error is found that would weigh the features anew.
        return replace(constants, joint_evaluations=constants.fit_evaluations, reweighings=1)
    if not _are_dear(machine, constants):
        return constants
    few = constants.hurried
    return replace(constants, refined=constants.refined_beside, joint_evaluations=few, reweighings=few)


@dataclass(frozen=True)
class Explained:
    """Everything that was fitted."""

    nothing: Fit
    """None of the effects: the constants alone, beside scatter."""
    noticed: tuple[Fit, ...]
    """Single effects beside scatter alone: whether there is a gap."""
    within: Fit
    """None of the effects, beside model discrepancy."""
    fits: Mapping[Names, Fit]
    """Effects and pairs beside model discrepancy: which it is."""
    likelihoods: Mapping[Names, float]
    """Logarithms, up to the same constant: of each candidate, and of none of them."""
    silent: tuple[str, ...]
    """Effects that move no feature here."""
    finished: bool
    """False if it was stopped before all that promised something were fitted."""


def explain(
    machine: Machine,
    error: Discrepancy,
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
        error: Of its simulator; holds the difference, whitened by scatter and the priors of the constants.
        grids: What grid points make of the features.
        runner: Makes the runs.
        constants: Of the model.
        provisional: Reports the first answer.

    Raises:
        StoppedError: asked to stop before anything was fitted.

    """
    problem, constants, difference = machine.problem, _in_time(machine, error, constants), error.difference
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
    if problem.constants and error.left_per_feature(nothing) < constants.doubtful:
        # Where little is left, nats decide: constants that a candidate has found may explain more alone, too.
        tried = [nothing, *(fit for each in singles[:_NESTED] for fit in refitted([blank], each))]
        nothing = min(tried, key=lambda fit: _whitened_by(difference, fit).left)
    noticed = tuple(_whitened_by(difference, fit) for fit in singles)
    alone = _whitened_by(difference, nothing)
    pairs: list[Fit] = []
    gap = detect_beside_error(machine, error, alone, noticed, constants).gap
    if finished and singles and gap:
        if error.left_per_feature(singles[0]) > constants.doubtful and _affordable(machine, constants):
            # What it leaves is searched for a second effect, and shall be as little as can be.
            settle = partial(sharpen, evenly=(True, False))
            answers, finished = _until_stopped(runner, settle, [(machine, error, singles[0], constants)], "fitting")
            singles = best_of([*(fit for fit, _ in answers), *singles])
        promising = _promising_pairs(problem, grids, error, singles, bases[min(1, len(bases) - 1)], constants)
        pairs, finished = fitted(promising, "fitting pairs")
    known, own, finished = _weighed(
        machine, error, (nothing, *singles, *pairs), runner, constants, gap=gap, finished=finished
    )
    moving = {place.names[0] for place in bases[0].singles}
    silent = tuple(effect.name for effect in problem.library if effect.name not in moving)
    return Explained(alone, noticed, known.pop(NONE_OF_THEM), known, own, silent, finished)


def least_left(
    machine: Machine, error: Discrepancy, grids: GridFeatures, runner: Runner, constants: Constants
) -> float:
    """Return the squared length of what the best of the most promising effects leaves, with the constants held."""
    constants = _in_time(machine, error, constants)
    blank = _start((), {})
    base = _Base(machine.problem, grids, error.difference, blank, blank, None)
    places = base.singles[: constants.tried_on_machines]
    work = [(machine, error, _from(machine.problem, each, blank), blank, constants, None) for each in places]
    answers = runner.map(fit_beside_error, work, "calibrating")
    runner.count(made for _, made in answers)
    return min((fit.left for fit, _ in answers), default=base.length)


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
    signatures = machine.signatures()
    return fit_jointly(machine, whitens, _start(names, best.values), signatures, constants), signatures.made


def detect_beside_error(
    machine: Machine, error: Discrepancy, nothing: Fit, singles: Sequence[Fit], constants: Constants
) -> Detection:
    """Test for a gap beyond scatter, and without references beyond tolerances and the accuracy of the simulator.

    There no healthy runs show how much they scatter along a signature: data sheets, tolerances and the stated accuracy
    say it, in as many degrees of freedom as the simulator's discrepancy has. An effect must explain more than an error
    of that size that lasts for a block; what nothing explains must be larger than it.

    Args:
        machine: Whose simulator has an accuracy.
        error: Of the simulator.
        nothing: The constants alone.
        singles: Effects, each with the constants.
        constants: Of the model.

    """
    if not error.without_references:
        return detect(error.difference, nothing.left, singles, constants)
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
                ends_at = CENTRAL if affordable else FORWARD
                work = [(k, machine, difference, fit, ends_at) for k in range(len(machine.settings))]
                answers = runner.map(_slopes_and_runs, work)
                slopes = [each for each, _ in answers]
                runner.count(made for _, made in answers)
            signatures = machine.signatures()
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
    machine: Machine,
    error: Discrepancy,
    fits: Sequence[Fit],
    runner: Runner,
    constants: Constants,
    *,
    gap: bool,
    finished: bool,
) -> tuple[dict[Names, Fit], dict[Names, float], bool]:
    """Return candidates beside the discrepancy that each leaves, their log-likelihoods, and whether all were fitted."""
    count = len(machine.problem.library.effects)

    def scored(fits: Mapping[Names, Fit]) -> dict[Names, float]:
        others = [names for names in fits if names != NONE_OF_THEM]
        scores = error.scores(fits[NONE_OF_THEM], [fits[names] for names in others], count)
        return dict(zip((NONE_OF_THEM, *others), scores, strict=True))

    def likeliest(own: Mapping[Names, float], most: int) -> set[Names]:
        def odds(names: Names) -> float:
            return own[names] - constants.pair_penalty * (len(names) - 1)

        chosen = sorted((names for names in own if names != NONE_OF_THEM), key=odds, reverse=True)[:most]
        # A pair is compared with its halves, and so these are fitted as well as it is.
        return {NONE_OF_THEM, *chosen, *((name,) for names in chosen for name in names if (name,) in own)}

    known = {fit.names: fit for fit in fits}
    own = scored(known)
    rounds = [(False, most) for most in constants.sharpened] if machine.problem.constants else []
    doubtful = error.left_per_feature(known[max(own, key=lambda names: own[names])]) > constants.doubtful
    if not gap:
        rounds = [(False, 0)]  # no candidate will be named, and none needs derivatives of its own
    elif doubtful and _affordable(machine, constants):
        rounds = [*((evenly, most) for evenly in (True, False) for most in constants.sharpened_in_doubt), *rounds]
    if finished and _are_dear(machine, constants):
        chosen = sorted(likeliest(own, constants.sharpened[0] if gap else 0), key=lambda names: -own[names])
        fits = [known[names] for names in chosen]
        answers, finished = _sharpen_together(machine, error, fits, runner, constants)
        known.update({fit.names: fit for fit, _ in answers if fit.features})
        return known, scored(known), finished
    for evenly, most in rounds:
        if not finished:
            break
        work = [(machine, error, known[names], constants) for names in likeliest(own, most)]
        answers, finished = _until_stopped(runner, partial(sharpen, evenly=(evenly,)), work, "constants of the machine")
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
    work = [(k, machine, error.difference_with(about), about, FORWARD) for k in range(len(machine.settings))]
    try:
        answers = runner.map(_slopes_and_runs, work, "constants of the machine")
    except StoppedError:
        return [], False
    runner.count(made for _, made in answers)
    slopes = [each[:, each.shape[1] - len(machine.problem.constants) :] for each, _ in answers]
    patient = replace(constants, joint_evaluations=constants.fit_evaluations)
    again = [(machine, error, fit, fit, patient, slopes) for fit in fits]
    return _until_stopped(runner, partial(fit_beside_error, evenly=False), again, "constants of the machine")


def fit_beside_error(
    machine: Machine,
    error: Discrepancy,
    start: Fit,
    before: Fit,
    constants: Constants,
    slopes: Sequence[NDArray[np.float64]] | None,
    *,
    evenly: bool = True,
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
        evenly: Whether what that leaves is spread evenly over each signal at first.

    """
    difference = error.evenly_with(before) if evenly else error.difference_with(before)
    signatures, fit = machine.signatures(), start
    for _ in range(constants.reweighings):
        found = fit_jointly(machine, difference, fit, signatures, constants, slopes)
        if not found.features:
            break
        fit = found
        difference = error.difference_with(fit)
    return fit, signatures.made


def sharpen(
    machine: Machine, error: Discrepancy, fit: Fit, constants: Constants, *, evenly: Sequence[bool]
) -> tuple[Fit, Made]:
    """Return a candidate fitted again with derivatives of its own, and the runs that it took.

    Args:
        machine: What is to be explained.
        error: Of the simulator.
        fit: The candidate.
        constants: Of the model.
        evenly: For each time that it is fitted, whether what it leaves is spread evenly over each signal.

    """
    signatures = machine.signatures()
    for way in evenly:
        difference = error.evenly_with(fit) if way else error.difference_with(fit)
        slopes = [slopes_in(k, machine, difference, fit, signatures) for k in range(len(machine.settings))]
        found = fit_jointly(machine, difference, fit, signatures, constants, slopes)
        fit = found if found.features else fit
    return fit, signatures.made
