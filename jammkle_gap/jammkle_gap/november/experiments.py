"""Which experiment would split a set of candidates, and by how much they would differ in it."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from jammkle_gap.november.runs import run_or_none
from jammkle_gap.november.scoring import STANDARD_ERRORS, difference

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from jammkle_gap.november.recording import Recording
    from jammkle_gap.november.scoring import Score
    from jammkle_gap.november.simulator import Simulator


@dataclass(frozen=True)
class Experiment:
    """A run that could be made."""

    name: str
    plan: Callable[[], Recording]
    """Gives a recording as it would be: inputs, and signals with the times at which they would be measured; the values
    of these are not looked at."""


@dataclass(frozen=True)
class NextExperiment:
    """What to record next."""

    name: str
    signal: str
    """Where the candidates that are hardest to tell apart differ most."""
    difference: float
    """Root mean square between them there, in noise units."""
    difference_physical: float
    unit: str
    sentence: str


def next_experiment(
    chosen: Sequence[Score],
    experiments: Sequence[Experiment],
    recordings: Sequence[Recording],
    simulator: Simulator,
    noise: Mapping[str, float],
) -> NextExperiment | None:
    """Return the experiment in which even the two most alike candidates differ most.

    Where none is offered, the runs that were made are: then it says how often to repeat one.

    Args:
        chosen: The candidates of the set, best first.
        experiments: On offer.
        recordings: Those that were made.
        simulator: As diagnosed.
        noise: Standard deviation per signal; for signals that only a plan has, the noise it gives counts.

    """
    if len(chosen) < 2:  # noqa: PLR2004  # one needs no splitting
        return None
    plans = [(each.name, each.plan()) for each in experiments] or [(each.name, each) for each in recordings]
    best: NextExperiment | None = None
    for name, recording in plans:
        found = _hardest(name, recording, chosen, simulator, noise)
        if found is not None and (best is None or found.difference > best.difference):
            best = found
    if best is None or experiments:
        return best
    apart = difference(chosen[0], chosen[1])
    times = (STANDARD_ERRORS * apart.error / max(apart.nats, 1e-3)) ** 2
    sentence = (
        f"repeat '{best.name}' {int(np.ceil(times))} times: {best.sentence}"
        if times < 100.0  # noqa: PLR2004  # nobody repeats a run more often
        else f"no run made so far tells them apart; the best of them is '{best.name}', where {best.sentence}"
    )
    return NextExperiment(best.name, best.signal, best.difference, best.difference_physical, best.unit, sentence)


def _hardest(
    name: str, recording: Recording, chosen: Sequence[Score], simulator: Simulator, noise: Mapping[str, float]
) -> NextExperiment | None:
    noise = {**{signal.name: signal.noise for signal in recording.signals if signal.noise > 0.0}, **noise}
    runs = [run_or_none(simulator, recording, score.fit.space.values(score.fit.point)) for score in chosen]
    hardest: NextExperiment | None = None
    for (one, first), (two, second) in combinations(zip(chosen, runs, strict=True), 2):
        if first is None or second is None:  # what such a run would show, nobody can say
            return None
        apart = {
            signal: float(np.sqrt(np.mean((first[signal] - second[signal]) ** 2)))
            for signal in first
            if signal in noise and signal in second
        }
        if not apart:
            continue
        signal = max(apart, key=lambda each: apart[each] / noise[each])
        units, unit = apart[signal] / noise[signal], recording.signal(signal).unit
        between = f"{' + '.join(one.names) or 'no effect'} and {' + '.join(two.names) or 'no effect'}"
        sentence = f"{between} differ by {apart[signal]:.3g} {unit} ({units:.2g} times the noise) in {signal}"
        if hardest is None or units < hardest.difference:
            hardest = NextExperiment(name, signal, units, apart[signal], unit, sentence)
    return hardest
