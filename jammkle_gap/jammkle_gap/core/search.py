"""Search: every effect on its grid, then the promising ones and their pairs with the simulator."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from jammkle_gap.core.detect import detect
from jammkle_gap.core.fit import Fit, refine
from jammkle_gap.core.posterior import NONE_OF_THEM
from jammkle_gap.core.profiles import Profiles
from jammkle_gap.core.readings import sensed_difference
from jammkle_gap.core.signatures import grids_of
from jammkle_gap.core.simulate import Made, StoppedError, Task, run_task

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_gap.core.compare import Difference, Setting
    from jammkle_gap.core.constants import Constants
    from jammkle_gap.core.own_error import OwnError
    from jammkle_gap.core.profiles import Place
    from jammkle_gap.core.signatures import Dictionary
    from jammkle_gap.core.simulate import Problem, Runner

    Provisional = Callable[[Sequence[tuple[str, float]]], None]
    """Told which effects explain which share of the squared difference before any is fitted, best first."""


@dataclass(frozen=True)
class Candidates:
    """Effects and pairs that were fitted with the simulator, and every effect on its grid."""

    singles: tuple[Fit, ...]
    """Best first."""
    pairs: tuple[Fit, ...]
    profiled: Mapping[str, float]
    """Gain of every effect on its grid."""
    silent: tuple[str, ...]
    """Effects that move no feature here."""
    finished: bool = True
    """False if it was stopped before all that promised something were fitted."""


class Signatures:
    """Whitened signatures of parameters, with the simulator at the faulty runs' own inputs; remembers its runs."""

    def __init__(
        self,
        problem: Problem,
        settings: Sequence[Setting],
        difference: Difference,
        machine: Mapping[str, float],
    ) -> None:
        """Prepare.

        Args:
            problem: Simulator and sensing.
            settings: Runs; the first faulty one of each setting is run again.
            difference: Whitens.
            machine: Calibrated constants, by name.

        """
        self._problem = problem
        self._settings = settings
        self.difference = difference
        self._machine = dict(machine)
        self._known: dict[tuple[int, tuple[tuple[str, float], ...]], NDArray[np.float64]] = {}
        self._sensed = problem.sensing.effects if problem.sensing is not None else frozenset()
        self.made = Made(0, 0.0)

    def __call__(self, values: Mapping[str, float]) -> NDArray[np.float64]:
        """Return the whitened signature of parameters by key; far off where they are infeasible."""
        parts = self.parts(values)
        if parts is None:
            return np.full(sum(self.difference.sizes), _INFEASIBLE)
        return self.difference.whiten(parts)

    def parts(self, values: Mapping[str, float]) -> list[NDArray[np.float64]] | None:
        """Return the signature in the features of each setting; None where the parameters are infeasible."""
        physical = {key: value for key, value in values.items() if key.partition(".")[0] not in self._sensed}
        sensed = {key: value for key, value in values.items() if key not in physical}
        parts = []
        for k, setting in enumerate(self._settings):
            part = np.zeros(setting.layout.size)
            if physical:
                change = self._simulated(k, physical) - self._simulated(k, {})
                if not np.isfinite(change).any():
                    return None
                part += np.nan_to_num(change)
            if sensed:
                part += sensed_difference(self._problem, setting, sensed)
            parts.append(part)
        return parts

    def _simulated(self, k: int, values: Mapping[str, float]) -> NDArray[np.float64]:
        place = (k, tuple(sorted(values.items())))
        if place not in self._known:
            setting = self._settings[k]
            task = Task(setting.faulty[0], setting.layout, {**self._machine, **values})
            self._known[place] = run_task(self._problem.simulator, self._problem.registrar, task)
            self.made = Made(self.made.runs + 1, self.made.simulated_s + setting.faulty[0].duration_s)
        return self._known[place]


def grid_signatures(
    problem: Problem,
    settings: Sequence[Setting],
    dictionaries: Sequence[Dictionary],
    difference: Difference,
) -> dict[str, NDArray[np.float64]]:
    """Return whitened signatures of every effect's grid points, shape (points, n), those that move nothing left out."""
    sensed = problem.sensing.effects if problem.sensing is not None else frozenset()
    grids = grids_of(problem)
    found = {}
    for effect in problem.library:
        points = grids[effect.name].points
        keys = [effect.key(each) for each in effect.parameters]
        parts = []
        for setting, dictionary in zip(settings, dictionaries, strict=True):
            if effect.name in sensed:
                rows = [
                    sensed_difference(problem, setting, dict(zip(keys, point.tolist(), strict=True)))
                    for point in points
                ]
                parts.append(np.array(rows))
            elif effect.name in dictionary.effects:
                own = dictionary.effects[effect.name]
                parts.append(dictionary.laid(setting.layout, own, problem, setting.faulty[0]))
            else:
                parts.append(np.zeros((len(points), setting.layout.size)))
        whitened = difference.whiten(parts)
        if np.abs(whitened).max() > _SILENT:
            found[effect.name] = whitened
    return found


_INFEASIBLE = 1e6
"""Whitened features of parameters that cannot be simulated: far from everything that is measured."""
_SILENT = 1e-6
"""Whitened feature below which nothing moves: rounding."""


@dataclass(frozen=True)
class Screening:
    """Every effect on its grid, and with one run at the faulty runs' own commands."""

    profiles: Profiles
    places: Mapping[str, Place]
    order: tuple[str, ...]
    """Effects, the most promising first."""
    gains: Mapping[str, float]
    """By how much each shortens the squared difference, at the run's own commands where that was simulated."""
    left: float
    """Squared length of what the most promising one leaves."""


def screen(
    problem: Problem,
    settings: Sequence[Setting],
    signatures: Mapping[str, NDArray[np.float64]],
    difference: Difference,
    machine: Mapping[str, float],
    runner: Runner,
) -> Screening:
    """Look at every effect.

    Args:
        problem: Simulator, library and sensing.
        settings: Runs.
        signatures: Whitened, of every effect's grid points; see `grid_signatures`.
        difference: To be explained.
        machine: Calibrated constants.
        runner: Makes the runs.

    """
    profiles = Profiles(grids_of(problem), signatures, difference.whitened)
    places = {name: profiles.single(name) for name in profiles.names}
    screened = _screened(problem, settings, difference, machine, runner, places)
    gains = {name: max(place.gain, screened.get(name, -np.inf)) for name, place in places.items()}
    # What was simulated at the run's own commands is what counts; sensors' effects need no simulation.
    proven = {name: screened.get(name, place.gain) for name, place in places.items()}
    length = float(difference.whitened @ difference.whitened)
    order = sorted(gains, key=lambda name: -gains[name])
    return Screening(profiles, places, tuple(order), proven, length - max(proven.values(), default=0.0))


def search(
    problem: Problem,
    settings: Sequence[Setting],
    screening: Screening,
    difference: Difference,
    machine: Mapping[str, float],
    runner: Runner,
    constants: Constants,
) -> Candidates:
    """Fit single effects and pairs; what was fitted until a stop is kept.

    Args:
        problem: Simulator, library and sensing.
        settings: Runs.
        screening: Of the same difference.
        difference: To be explained.
        machine: Calibrated constants.
        runner: Makes the runs.
        constants: How many are fitted.

    Raises:
        StoppedError: asked to stop before anything was fitted.

    """
    places = screening.places
    silent = tuple(effect.name for effect in problem.library if effect.name not in places)
    profiled = {name: place.gain for name, place in places.items()}

    def fitted(work: Sequence[Place], what: str) -> tuple[list[Fit], bool]:
        arguments = [(problem, settings, difference, dict(machine), place, constants) for place in work]
        finished = True
        try:
            answers = runner.map(fit_place, arguments, what)
        except StoppedError as stopped:
            answers, finished = list(stopped.done), False
        runner.count(made for _, made in answers)
        return sorted((fit for fit, _ in answers), key=lambda fit: fit.left), finished

    first = screening.order[: constants.refined]
    singles, finished = fitted([places[name] for name in first], "fitting")
    pairs: list[Fit] = []
    # Where there is no gap a pair has nothing to explain.
    if finished and detect(difference, singles, constants).gap:
        pairs, finished = fitted(_promising_pairs(screening.profiles, first, singles, constants), "fitting pairs")
    return Candidates(tuple(singles), tuple(pairs), profiled, silent, finished)


def _promising_pairs(
    profiles: Profiles, first: Sequence[str], singles: Sequence[Fit], constants: Constants
) -> list[Place]:
    """Return pairs to be fitted: from fitted single effects on, and by the grids alone, where both are unknown."""
    beside = [place for fit in singles[: constants.paired] for place in profiles.seconds(fit)]
    beside.sort(key=lambda place: -place.gain)
    found: dict[frozenset[str], Place] = {}
    for most, places in (
        (constants.refined_pairs // 2, beside),
        (constants.refined_pairs, profiles.pairs(first, constants.refined_pairs)),
    ):
        for place in places:
            if len(found) < most:
                found.setdefault(frozenset(place.names), place)
    return list(found.values())


def fit_place(
    problem: Problem,
    settings: Sequence[Setting],
    difference: Difference,
    machine: Mapping[str, float],
    place: Place,
    constants: Constants,
) -> tuple[Fit, Made]:
    """Return a candidate fitted from a place on the mesh, and the runs that it took."""
    signatures = Signatures(problem, settings, difference, machine)
    parameters = problem.library.parameters(place.names)
    start = dict(zip([key for key, _ in parameters], np.concatenate(place.values).tolist(), strict=True))
    if len(parameters) == 1:
        start = _better_start(problem, place, difference, signatures, start)
    fit = refine(difference.whitened, place.names, parameters, start, signatures, constants.fit_evaluations)
    return replace(fit, features=tuple(signatures.parts(fit.values) or ())), signatures.made


def _better_start(
    problem: Problem, place: Place, difference: Difference, signatures: Signatures, start: Mapping[str, float]
) -> dict[str, float]:
    """Return where a fit of one parameter begins: a grid at healthy commands misleads where a controller answers.

    A place that explains little there is compared with the grid's own points, simulated at the commands of the run.
    """

    def left(values: Mapping[str, float]) -> float:
        return float(np.square(difference.whitened - signatures(values)).sum())

    length = float(difference.whitened @ difference.whitened)
    if left(start) < _EXPLAINED * length:
        return dict(start)
    (key,) = start
    points = grids_of(problem)[place.names[0]].points[:, 0].tolist()
    return min([dict(start), *({key: point} for point in points)], key=left)


_EXPLAINED = 0.2
"""Share of the squared difference that a start may leave and be trusted. Chosen: Gauss-Newton takes the rest off."""


def fit_beside(
    problem: Problem,
    settings: Sequence[Setting],
    error: OwnError,
    machine: Mapping[str, float],
    fit: Fit,
    constants: Constants,
) -> tuple[Fit, Made]:
    """Return a candidate fitted anew beside the simulator's own error that it leaves, and the runs that it took."""
    signatures = Signatures(problem, settings, error.beside(fit.features), machine)
    parameters = problem.library.parameters(fit.names)
    for _ in range(constants.reweighings):
        signatures.difference = difference = error.beside(fit.features)
        fit = refine(difference.whitened, fit.names, parameters, fit.values, signatures, constants.fit_evaluations)
        fit = replace(fit, features=tuple(signatures.parts(fit.values) or ()))
    return fit, signatures.made


def reweighed(
    problem: Problem,
    settings: Sequence[Setting],
    error: OwnError,
    machine: Mapping[str, float],
    candidates: Sequence[Candidates],
    runner: Runner,
    constants: Constants,
) -> tuple[Candidates, dict[tuple[str, ...], float]]:
    """Fit candidates anew, each beside the simulator's own error that it leaves.

    Args:
        problem: Simulator, library and sensing.
        settings: Runs.
        error: Of the simulator.
        machine: Calibrated constants.
        candidates: Found in several ways; of those with the same effects the most likely is kept.
        runner: Makes the runs.
        constants: How often.

    Returns:
        The candidates, and the log-likelihood of each, and of none of them.

    """
    work = [fit for each in candidates for fit in (*each.singles, *each.pairs) if fit.features]
    arguments = [(problem, settings, error, dict(machine), fit, constants) for fit in work]
    answers = runner.map(fit_beside, arguments, "weighing the simulator's own error")
    runner.count(made for _, made in answers)
    fits = [fit for fit, _ in answers if fit.features]
    unknown, *scores = error.scores(fits)
    kept: dict[frozenset[str], Fit] = {}
    own = {NONE_OF_THEM: unknown}
    for fit, score in sorted(zip(fits, scores, strict=True), key=lambda item: -item[1]):
        if kept.setdefault(frozenset(fit.names), fit) is fit:
            own[fit.names] = score
    singles = tuple(fit for fit in kept.values() if len(fit.names) == 1)
    pairs = tuple(fit for fit in kept.values() if len(fit.names) > 1)
    return replace(candidates[0], singles=singles, pairs=pairs), own


def _screened(
    problem: Problem,
    settings: Sequence[Setting],
    difference: Difference,
    machine: Mapping[str, float],
    runner: Runner,
    places: Mapping[str, Place],
) -> dict[str, float]:
    """Return the gain of each effect with one run at the faulty run's own commands, scaled to fit best.

    A regulator answers a fault, so that a grid at healthy commands misleads: a signature is trusted once it was
    simulated at the commands of the run itself.
    """
    sensed = problem.sensing.effects if problem.sensing is not None else frozenset()
    names = [name for name in places if name not in sensed]
    tasks = [Task(setting.faulty[0], setting.layout, dict(machine)) for setting in settings]
    for name in names:
        keys = [key for key, _ in problem.library.parameters((name,))]
        values = dict(zip(keys, places[name].values[0].tolist(), strict=True))
        tasks += [Task(setting.faulty[0], setting.layout, {**machine, **values}) for setting in settings]
    made = runner.features(tasks, "screening")
    count = len(settings)
    found = {}
    for i, name in enumerate(names, 1):
        parts = [np.nan_to_num(made[count * i + k] - made[k]) for k in range(count)]
        signature = difference.whiten(parts)
        squared = float(signature @ signature)
        # Less than the whole of a signature can be had by a smaller effect; more only up to the bounds.
        share = float(np.clip(signature @ difference.whitened / squared, 0.0, 1.5)) if squared > _SILENT else 0.0
        found[name] = share * (2.0 * float(signature @ difference.whitened) - share * squared)
    return found
