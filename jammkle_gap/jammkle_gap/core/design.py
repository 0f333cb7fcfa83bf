"""Which experiment would split a credible set, and by how much its members would differ in it."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np
from scipy import stats  # type: ignore[import-untyped]  # carries no types

from jammkle_gap.core.features import layout_of
from jammkle_gap.core.result import NextExperiment
from jammkle_gap.core.simulate import Made, Task, run_task

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_gap.core.data import Recording
    from jammkle_gap.core.features import Layout
    from jammkle_gap.core.fit import Fit
    from jammkle_gap.core.simulate import Problem, Runner

DETECTABLE = (stats.norm.ppf(0.99) + stats.norm.ppf(0.99)) ** 2
"""Squared whitened length that is detected with 99 % power at 1 % false alarms along a known direction."""


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
    blocks: int,
) -> NextExperiment | None:
    """Return the experiment that separates even the two most similar candidates most per second of its length.

    T-optimality for telling models apart (Atkinson and Fedorov 1975, Biometrika 62:57), maximin over pairs, at the
    cost of the time that it takes. Candidates differ in units of the sensors' noise and of the simulator's accuracy,
    an error that lasts for a block of time.

    Args:
        fits: Candidates of the set.
        experiments: On offer.
        problem: Simulator.
        runner: Makes the runs.
        machine: Calibrated constants.
        blocks: Of time, per signal.

    Returns:
        None where there is nothing to split or to offer, or where the hardest pair would differ in none of them by
        what is detected with 99 % power at 1 % false alarms.

    """
    if len(fits) < 2 or not experiments:  # noqa: PLR2004 - one needs no splitting
        return None
    candidates = [(" + ".join(fit.names), {**machine, **fit.machine, **fit.values}) for fit in fits]
    work = [(each, candidates, problem, blocks) for each in experiments]
    answers = runner.map(_tried, work, "planning the next run")
    runner.count(made for _, _, made in answers)
    found = [(squared / each.lasts_s, each) for squared, each, _ in answers if squared > DETECTABLE]
    return max(found, key=lambda each: each[0])[1] if found else None


_Candidate = tuple[str, "Mapping[str, float]"]
"""What it is called, and the values that it is simulated with."""


def _tried(
    experiment: Experiment, candidates: Sequence[_Candidate], problem: Problem, blocks: int
) -> tuple[float, NextExperiment, Made]:
    """Return the least squared whitened distance of two candidates in an experiment, what is said of it, and its runs.

    Only differences count, so that runs are those of a search.
    """
    plan = experiment.plan()
    layout, run = layout_of([plan], problem.bin_s(plan), problem.alignment), problem.coarse(plan)
    made = [run_task(problem.simulator, problem.alignment, Task(run, layout, values)) for _, values in candidates]
    runnable = all(np.isfinite(each).any() for each in made)  # where one cannot be, nothing is separated
    runs = [
        (name, np.nan_to_num(features) if runnable else np.zeros_like(features))
        for (name, _), features in zip(candidates, made, strict=True)
    ]
    lasts_s = max(float(signal.time_s[-1]) for signal in run.signals)
    apart = [_apart(experiment.name, lasts_s, layout, *pair, problem, blocks) for pair in combinations(runs, 2)]
    return *min(apart, key=lambda each: each[0]), Made(len(runs), len(runs) * run.duration_s)


def _apart(
    name: str,
    lasts_s: float,
    layout: Layout,
    first: tuple[str, NDArray[np.float64]],
    second: tuple[str, NDArray[np.float64]],
    problem: Problem,
    blocks: int,
) -> tuple[float, NextExperiment]:
    """Return the squared whitened distance of two candidates in an experiment, and what is said of it."""
    (one, would_be), (other, or_be) = first, second
    apart = layout.by_signal(would_be - or_be)
    ranges = np.ptp(layout.by_signal(would_be), axis=1)
    noise = np.hypot(layout.by_signal(layout.floor), problem.accuracy * ranges[:, np.newaxis])
    squared = np.square(apart / noise).mean(axis=1)
    i = int(np.argmax(squared))
    units, physical = float(np.sqrt(squared[i])), float(np.sqrt(np.square(apart[i]).mean()))
    sentence = (
        f"{one} and {other} differ by {physical:.3g} {layout.units[i]} "
        f"({units:.2g} times what sensor and simulator are uncertain by) in {layout.signals[i]}"
    )
    found = NextExperiment(name, lasts_s, layout.signals[i], units, physical, layout.units[i], sentence)
    return float(squared.sum()) * blocks, found
