"""Which experiment would split a credible set, and by how much its members would differ in it."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from jammkle_gap.core.features import layout_of
from jammkle_gap.core.result import NextExperiment
from jammkle_gap.core.simulate import Task

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from jammkle_gap.core.data import Recording
    from jammkle_gap.core.fit import Fit
    from jammkle_gap.core.simulate import Problem, Runner


@dataclass(frozen=True)
class Experiment:
    """A run that could be made."""

    name: str
    plan: Callable[[], Recording]
    """Gives a recording as it would be: inputs, and signals with the times at which they would be measured; the values
    of these are not looked at."""


def next_experiment(
    fits: Sequence[Fit],
    experiments: Sequence[Experiment],
    problem: Problem,
    runner: Runner,
    machine: Mapping[str, float],
) -> NextExperiment | None:
    """Return the experiment in which even the two most similar candidates differ most.

    T-optimality for telling models apart (Atkinson and Fedorov 1975, Biometrika 62:57), maximin over pairs.

    Args:
        fits: Candidates of the set.
        experiments: On offer.
        problem: Simulator.
        runner: Makes the runs.
        machine: Calibrated constants.

    Returns:
        None where there is nothing to split or to offer.

    """
    if len(fits) < 2 or not experiments:  # noqa: PLR2004 - one needs no splitting
        return None
    plans = [(each.name, each.plan()) for each in experiments]
    layouts = [layout_of([run], problem.bin_s(run), problem.alignment) for _, run in plans]
    tasks = [
        Task(run, layout, {**machine, **fit.values})
        for (_, run), layout in zip(plans, layouts, strict=True)
        for fit in fits
    ]
    made = iter(runner.features(tasks, "planning the next run"))
    best: NextExperiment | None = None
    for (name, _), layout in zip(plans, layouts, strict=True):
        runs = [next(made) for _ in fits]
        hardest: NextExperiment | None = None
        for (one, first), (two, second) in combinations(zip(fits, runs, strict=True), 2):
            apart = layout.by_signal(np.nan_to_num(first - second))
            noise = layout.by_signal(layout.floor)
            units = np.sqrt(np.square(apart / noise).mean(axis=1))
            i = int(np.argmax(units))
            physical = float(np.sqrt(np.square(apart[i]).mean()))
            between = f"{' + '.join(one.names)} and {' + '.join(two.names)}"
            sentence = (
                f"{between} differ by {physical:.3g} {layout.units[i]} ({units[i]:.2g} times the sensor's noise) "
                f"in {layout.signals[i]}"
            )
            found = NextExperiment(name, layout.signals[i], float(units[i]), physical, layout.units[i], sentence)
            if hardest is None or found.difference < hardest.difference:
                hardest = found
        if hardest is not None and (best is None or hardest.difference > best.difference):
            best = hardest
    return best
