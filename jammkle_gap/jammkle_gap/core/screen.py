"""Screening: every effect on its grid, and with one run at the faulty runs' own inputs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from jammkle_gap.core.profiles import Profiles
from jammkle_gap.core.readings import known_features, sensed_difference
from jammkle_gap.core.response import SILENT
from jammkle_gap.core.signatures import grids_of
from jammkle_gap.core.simulate import Task

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_gap.core.compare import Difference, Setting
    from jammkle_gap.core.profiles import Place
    from jammkle_gap.core.simulate import Problem, Runner


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
    known = {name: [known_features(problem, setting.layout, (name,)) for setting in settings] for name in places}
    names = [name for name in places if not all(each.all() for each in known[name])]
    values = {}
    tasks = [Task(setting.faulty[0], setting.layout, dict(machine)) for setting in settings]
    for name in names:
        keys = [key for key, _ in problem.library.parameters((name,))]
        values[name] = dict(zip(keys, places[name].values[0].tolist(), strict=True))
        tasks += [Task(setting.faulty[0], setting.layout, {**machine, **values[name]}) for setting in settings]
    made = runner.features(tasks, "screening")
    count = len(settings)
    found = {}
    for i, name in enumerate(names, 1):
        parts = []
        for k, setting in enumerate(settings):
            change = np.nan_to_num(made[count * i + k] - made[k])
            sensed = sensed_difference(problem, setting, values[name])
            parts.append(np.where(known[name][k], sensed, change))
        signature = difference.whiten(parts)
        squared = float(signature @ signature)
        # Less than the whole of a signature can be had by a smaller effect; more only up to the bounds.
        share = float(np.clip(signature @ difference.whitened / squared, 0.0, 1.5)) if squared > SILENT else 0.0
        found[name] = share * (2.0 * float(signature @ difference.whitened) - share * squared)
    return found
