"""Effects of sensors and clocks, which act on readings and not on the simulator: exact, however wrong that is.

A healthy sensor's readings in a faulty run are not known, but those of the references are, and by how much they would
differ: a regulator that answers a fault takes other steps than in the references, and the simulator is run with both.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from jammkle_gap.core.features import features_of, measured
from jammkle_gap.core.simulate import Made, simulated

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_gap.core.compare import Setting
    from jammkle_gap.core.data import Recording
    from jammkle_gap.core.features import Layout
    from jammkle_gap.core.simulate import Problem, Runner

_REFERENCES = 2
"""References whose readings are taken. Chosen: their own scatter is far below an effect."""


def with_readings(settings: Sequence[Setting], problem: Problem, runner: Runner) -> tuple[Setting, ...]:
    """Return the settings with what healthy sensors would have read in the first faulty run of each.

    Args:
        settings: Runs. Without references the faulty run's own readings stand for them.
        problem: Simulator and sensing; without sensing nothing is done.
        runner: Counts the runs.

    Raises:
        SimulatorError: the simulator failed.

    """
    if problem.sensing is None:
        return tuple(settings)
    found = []
    for setting in settings:
        run, references = setting.faulty[0], setting.references[:_REFERENCES]
        readings = [measured(run)]
        if references:
            made, *others = (simulated(problem.simulator, each, {}) for each in (run, *references))
            runner.count([Made(1, each.duration_s) for each in (run, *references)])
            readings = [
                _healthy(problem, run, made, reference, other)
                for reference, other in zip(references, others, strict=True)
            ]
        features = np.array([features_of(setting.layout, run, each, problem.registrar) for each in readings])
        found.append(replace(setting, readings=tuple(readings), reading_features=features))
    return tuple(found)


def _healthy(
    problem: Problem,
    run: Recording,
    made: Mapping[str, NDArray[np.float64]],
    reference: Recording,
    other: Mapping[str, NDArray[np.float64]],
) -> dict[str, NDArray[np.float64]]:
    """Return what healthy sensors would have read in a run, by signal, at its times.

    Args:
        problem: Says which signals are registered at events; a difference of simulations would double an impact that
            comes a little later, so that these are as in the reference.
        run: At whose inputs.
        made: Its simulation.
        reference: Whose readings are taken.
        other: Its simulation.

    """
    readings = measured(run)
    for signal in run.signals:
        name = signal.name
        if name not in measured(reference):
            continue
        known = reference.signal(name)
        by_clock = problem.registrar is None or not problem.registrar.events_of(run, name)
        if by_clock and name in made and name in other:
            left = np.interp(signal.time_s, known.time_s, known.values - other[name])
            readings[name] = made[name] + left
        else:
            readings[name] = np.interp(signal.time_s, known.time_s, known.values)
    return readings


def known_features(problem: Problem, layout: Layout, effects: Iterable[str]) -> NDArray[np.bool_]:
    """Return which features sensing says for any of some effects, and the simulator does not, shape (n,).

    Args:
        problem: With or without sensing.
        layout: Of the features. Events are sensing's where all signals are.
        effects: By name.

    """
    known = np.zeros(layout.size, dtype=bool)
    for effect in effects:
        if problem.sensing is None or effect not in problem.sensing.effects:
            continue
        signals = np.array([problem.sensing.knows(effect, name) for name in layout.signals])
        known[: layout.bins * len(signals)] |= np.repeat(signals, layout.bins)
        known[layout.bins * len(signals) :] |= signals.all()
    return known


def sensed_difference(problem: Problem, setting: Setting, values: Mapping[str, float]) -> NDArray[np.float64]:
    """Return what sensing's effects change in the features of a setting that it knows, shape (n,).

    Args:
        problem: With or without sensing.
        setting: With readings.
        values: Parameters by key; those of other effects are passed over.

    """
    if problem.sensing is None:
        return np.zeros(setting.layout.size)
    values = {key: value for key, value in values.items() if key.partition(".")[0] in problem.sensing.effects}
    if not values:
        return np.zeros(setting.layout.size)
    found, run = [], setting.faulty[0]
    for before, features in zip(setting.readings, setting.reading_features, strict=True):
        after = problem.sensing(run, before, values)
        found.append(features_of(setting.layout, run, after, problem.registrar) - features)
    mean: NDArray[np.float64] = np.nan_to_num(np.mean(found, axis=0))
    return mean
