"""Search: the promising effects and their pairs, fitted with the simulator."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import minimize_scalar  # type: ignore[import-untyped]  # carries no types

from jammkle_gap.core.detect import detect
from jammkle_gap.core.fit import Fit, Signatures, refine
from jammkle_gap.core.signatures import grids_of
from jammkle_gap.core.simulate import StoppedError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from jammkle_gap.core.constants import Constants
    from jammkle_gap.core.fit import Place, Profiles, Screening
    from jammkle_gap.core.scatter import Difference, Setting
    from jammkle_gap.core.simulate import Made, Problem, Runner

    Provisional = Callable[[Sequence[tuple[str, float]]], None]
    """Reports which effects explain which share of the squared difference before any is fitted, best first."""


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

    def fitted(
        function: Callable[..., tuple[Fit, Made]], work: Sequence[Place | Fit], what: str
    ) -> tuple[list[Fit], bool]:
        arguments = [(problem, settings, difference, dict(machine), each, constants) for each in work]
        finished = True
        try:
            answers = runner.map(function, arguments, what)
        except StoppedError as stopped:
            answers, finished = list(stopped.done), False
        runner.count(made for _, made in answers)
        return sorted((fit for fit, _ in answers), key=lambda fit: fit.left), finished

    first = screening.order[: constants.refined]
    singles, finished = fitted(fit_place, [places[name] for name in first], "fitting")
    doubtful = [
        fit
        for fit in singles[: constants.paired]
        if len(fit.values) == 1 and fit.left > constants.doubtful * difference.healthy * difference.whitened.size
    ]
    if finished and doubtful:
        sharpened, finished = fitted(sharpened_fit, doubtful, "fitting")
        done = {fit.names for fit in sharpened}
        singles = sorted([*sharpened, *(fit for fit in singles if fit.names not in done)], key=lambda fit: fit.left)
    pairs: list[Fit] = []
    length = float(difference.whitened @ difference.whitened)
    # Where there is no gap a pair has nothing to explain.
    if finished and detect(difference, length, singles, constants).gap:
        promising = _promising_pairs(screening.profiles, first, singles, constants)
        pairs, finished = fitted(fit_place, promising, "fitting pairs")
    return Candidates(tuple(singles), tuple(pairs), profiled, silent, finished)


def _promising_pairs(
    profiles: Profiles, first: Sequence[str], singles: Sequence[Fit], constants: Constants
) -> list[Place]:
    """Return pairs to be fitted: from fitted single effects on, and by the grids alone, where both are unknown."""
    with_fitted = [place for fit in singles[: constants.paired] for place in profiles.seconds(fit)]
    with_fitted.sort(key=lambda place: -place.gain)
    found: dict[frozenset[str], Place] = {}
    for most, places in (
        (constants.refined_pairs // 2, with_fitted),
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
    fit = refine(difference.whitened, place.names, parameters, start, signatures, constants)
    return replace(fit, features=tuple(signatures.parts(fit.values) or ())), signatures.made


def sharpened_fit(
    problem: Problem,
    settings: Sequence[Setting],
    difference: Difference,
    machine: Mapping[str, float],
    fit: Fit,
    constants: Constants,
) -> tuple[Fit, Made]:
    """Return a fit of one parameter or a better one beside it, and the runs that it took.

    Gauss-Newton takes a signature for straight. Where it bends, as that of a line that is almost shut, a search between
    the neighbouring points of the grid goes on (Brent 1973, Algorithms for Minimization without Derivatives, ch. 5).
    """
    signatures = Signatures(problem, settings, difference, machine)
    ((key, parameter),) = problem.library.parameters(fit.names)
    value = fit.values[key]
    points = {*grids_of(problem)[fit.names[0]].points[:, 0].tolist(), parameter.null}
    low = max((point for point in points if point < value), default=parameter.minimum)
    high = min((point for point in points if point > value), default=parameter.maximum)
    found = minimize_scalar(
        lambda at: float(np.square(difference.whitened - signatures({key: float(at)})).sum()),
        bounds=(low, high),
        method="bounded",
        options={"maxiter": constants.fit_evaluations, "xatol": constants.fit_tolerance * (high - low)},
    )
    if found.fun >= fit.left:
        return fit, signatures.made
    start = {key: float(found.x)}
    better = refine(difference.whitened, fit.names, [(key, parameter)], start, signatures, constants)
    return replace(better, features=tuple(signatures.parts(better.values) or ())), signatures.made
