"""The next experiment: what separates candidates most per second, or none where nothing would."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from jammkle_gap import Library, Problem, Recording, Signal
from jammkle_gap.core.design import Experiment, next_experiment
from jammkle_gap.core.fit import Fit
from jammkle_gap.core.simulate import InfeasibleError, Runner
from pendulums import effect

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_gap.core.result import NextExperiment

BLOCKS = 8
NOISE = 0.01


def simulate(recording: Recording, values: Mapping[str, float]) -> dict[str, NDArray[np.float64]]:
    """Two effects that differ by what the command asks for, and a constant that makes them differ more."""
    size = values.get("one.share", 0.0) - values.get("two.share", 0.0) + values.get("length", 0.0)
    return {"angle": 1.0 + recording.inputs * size + 0.0 * recording.signals[0].time_s}


BOTH = Library((effect("one", "share", "1", 0.5), effect("two", "share", "1", 0.5)))
OFFER = Problem(simulate, BOTH)
ONE, TWO = (
    Fit((name,), {f"{name}.share": 0.1}, np.zeros(0), 0.0, np.zeros((0, 1)), np.zeros(0)) for name in ("one", "two")
)


def run(name: str, command: float, lasts_s: float = 2.0) -> Experiment:
    """Experiment with a command, which lasts so long."""
    time_s = np.arange(0.0, lasts_s, 0.01)
    signal = Signal("angle", "rad", time_s, np.zeros(time_s.size), NOISE)
    return Experiment(name, lambda: Recording(name, (signal,), command))


def chosen(
    offered: Sequence[Experiment], fits: Sequence[Fit] = (ONE, TWO), problem: Problem = OFFER
) -> NextExperiment | None:
    """What is to be recorded next."""
    return next_experiment(fits, offered, problem, Runner(problem, 1), {}, BLOCKS)


def test_the_run_that_separates_most_per_second_is_named() -> None:
    """Twice the difference is four times the evidence, which five times the length does not earn."""
    long, short = run("far and long", 2.0, 10.0), run("near and short", 1.0)
    found = chosen([long, short])
    assert found is not None
    assert (found.name, found.signal) == ("near and short", "angle")
    assert found.lasts_s == pytest.approx(2.0, abs=0.02)
    assert found.difference_physical == pytest.approx(0.2)
    further = chosen([run("far", 2.0, 6.0), short])
    assert further is not None
    assert further.name == "far"


def test_nothing_is_named_that_would_separate_nothing() -> None:
    """Candidates that would be the same everywhere, or less apart than the simulator is accurate, or only one."""
    assert chosen([run("still", 0.0)]) is None
    assert chosen([run("little", 0.005)]) is None
    assert chosen([run("much", 1.0)]) is not None
    assert chosen([run("much", 1.0)], [ONE]) is None
    # A ramp of the command has a range, of which a coarse simulator knows a half.
    ramp = Experiment("ramp", lambda: replace(run("ramp", 1.0).plan(), inputs=np.linspace(0.0, 1.0, 200)))
    assert chosen([ramp]) is not None
    assert chosen([ramp], problem=replace(OFFER, accuracy=10.0)) is None


def test_a_run_that_a_candidate_cannot_make_separates_nothing() -> None:
    """Where the simulator gives nothing with one of them, the run is not the one to make."""

    def fragile(recording: Recording, values: Mapping[str, float]) -> dict[str, NDArray[np.float64]]:
        if recording.name == "wild" and "one.share" in values:
            msg = "it blows up"
            raise InfeasibleError(msg)
        return simulate(recording, values)

    found = chosen([run("wild", 3.0), run("mild", 1.0)], problem=replace(OFFER, simulator=fragile))
    assert found is not None
    assert found.name == "mild"


def test_each_candidate_keeps_the_constants_that_were_fitted_with_it() -> None:
    """What constants have taken up is no difference between candidates."""
    moved = replace(TWO, machine={"length": 0.2})
    assert chosen([run("much", 1.0)], [ONE, moved]) is None


def test_the_hardest_pair_decides() -> None:
    """A run that separates two of three candidates does not split the set."""
    third = Fit((), {}, np.zeros(0), 0.0, np.zeros((0, 0)), np.zeros(0))
    assert chosen([run("much", 1.0)], [ONE, TWO, third]) is not None
    same = replace(TWO, names=("two", "again"))
    assert chosen([run("much", 1.0)], [ONE, TWO, same]) is None
