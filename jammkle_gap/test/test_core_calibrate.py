"""The machine's constants are fitted to its references, and a diagnosis stands on them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from scipy import stats

from jammkle_gap import (
    Constants,
    Effect,
    EffectParameter,
    Library,
    Nuisance,
    Problem,
    Recording,
    Signal,
    Verdict,
    diagnose,
)
from jammkle_gap.core.calibrate import Calibration, calibrate
from jammkle_gap.core.scatter import Scatter, settings_of
from jammkle_gap.core.simulate import Runner
from pendulums import LIBRARY, PROBLEM, infeasible, machine

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

TIMES_S = 0.01 * np.arange(200)
NOISE = 0.01


class Counted:
    """A spring that bends as the square of its stiffness; a lamp beside it moves nothing. Counts its runs."""

    def __init__(self) -> None:
        self.asked: list[dict[str, float]] = []

    def __call__(self, recording: Recording, values: Mapping[str, float]) -> dict[str, NDArray[np.float64]]:
        del recording
        self.asked.append(dict(values))
        return {"way": np.sin(TIMES_S) / values.get("spring.stiffness", 1.0) ** 2}


EFFECT = Effect("rub", "bearing", (EffectParameter("torque", "N m", 0.0, 0.0, 1.0, "assumed"),), "Oil it.")


def problem(simulator: Counted) -> Problem:
    spring = Nuisance("spring.stiffness", "1", 1.0, 0.1, "drawing", 0.5, 2.0)
    lamp = Nuisance("lamp.power", "1", 1.0, 0.1, "drawing")
    return Problem(simulator, Library((EFFECT,)), constants=(spring, lamp))


def run(name: str, stiffness: float) -> Recording:
    noise = np.random.default_rng(len(name)).normal(0.0, NOISE, TIMES_S.size)
    values = np.sin(TIMES_S) / stiffness**2 + noise
    return Recording(name, (Signal("way", "m", TIMES_S, values, noise=NOISE),), setting="alone")


def calibrated(given: Problem) -> Calibration:
    """Return the calibration to two references of a spring of 1.25, with nominal slopes that know the lamp is idle."""
    settings = settings_of([run("one", 1.25)], [run("two", 1.25), run("three", 1.25)], given)
    layout = settings[0].layout
    scatter = Scatter(np.square(layout.floor), np.zeros((layout.size, 0)), np.zeros(0))
    bend = -2.0 * 0.1 * np.sin(layout.time_s)
    slopes = np.stack([bend, np.zeros(layout.size)], axis=1)
    return calibrate(settings, [scatter], [slopes], given, Runner(given, 1), Constants())


def test_constants_are_found_and_those_that_move_nothing_not_simulated_again() -> None:
    """The spring is within a hundredth; the lamp is asked for never, the nominal slopes having said that it is idle."""
    simulator = Counted()
    found = calibrated(problem(simulator))
    assert found.values["spring.stiffness"] == pytest.approx(1.25, abs=0.01)
    assert found.after < found.before / 100.0
    assert all("lamp.power" not in each for each in simulator.asked)
    # Nominal, a step, and then two runs for the slope, and a step; halvings aside.
    assert len(simulator.asked) <= 2 + 3 * 2 + 3


def test_a_constant_is_calibrated_up_to_its_bound() -> None:
    """Where no whole step leads on: the slope is that of the step which there is room for."""
    given = problem(Counted())
    spring = replace(given.constants[0], maximum=1.26)
    found = calibrated(replace(given, constants=(spring, *given.constants[1:])))
    assert found.values["spring.stiffness"] == pytest.approx(1.25, abs=0.005)


def test_runs_that_are_made_coarsely_give_slopes_alone() -> None:
    """What coarse runs have wrong throughout is in none of their differences; what is left is asked of fine ones."""

    def simulate(recording: Recording, values: Mapping[str, float]) -> dict[str, NDArray[np.float64]]:
        return {"way": Counted()(recording, values)["way"] + (3.0 if recording.name == "coarse" else 0.0)}

    given = replace(problem(Counted()), simulator=simulate, coarse=lambda each: replace(each, name="coarse"))
    found = calibrated(given)
    assert found.values["spring.stiffness"] == pytest.approx(1.25, abs=0.01)
    assert found.after < found.before / 100.0


def test_a_constant_is_reported_where_it_is_used() -> None:
    """One whose references lie beyond its bounds is at the bound, in deviations too, and not where nothing is run."""
    given = problem(Counted())
    spring, lamp = given.constants
    found = calibrated(replace(given, constants=(replace(spring, minimum=0.9, maximum=1.1), lamp)))
    assert found.values["spring.stiffness"] == pytest.approx(1.1)
    assert found.deviations["spring.stiffness"] == pytest.approx(1.0)


@pytest.mark.parametrize("count", [5, 0])
def test_a_machine_that_cannot_make_all_runs_is_not_calibrated(count: int) -> None:
    """Its simulation blows up at the inputs of one faulty run: the nominal machine is compared with, and no error."""
    made = machine(23)
    made.constants = {"arm.mass": 1.12, "servo.stiffness": 1.0}
    runs, references = made.record(3, {"rubbing.torque": 0.1}), made.record(count)
    fragile = infeasible(lambda run, values: run.name == runs[-1].name and values.get("arm.mass", 1.0) > 1.04)
    found = diagnose(runs, replace(PROBLEM, simulator=fragile), references=references, jobs=1)
    assert all(abs(each) == 0.0 for each in found.calibration.values())
    assert found.verdict is not Verdict.NO_GAP


CASES, HEALTHY = 50, 30
RUNS, REFERENCES = 3, 5
SURE = 0.999
"""Probability with which a binomial count of a property that holds passes."""


@dataclass(frozen=True)
class Case:
    """One fault, and what was said of it."""

    truth: str
    first: str
    probability: float
    """Of the truth."""
    in_set: bool
    known_to: float
    """Error of its parameter in half-widths of its 90 % interval; NaN where it is not in the set."""
    below: float
    """Rank of the true parameter in its posterior, 0 to 1; NaN where it is not in the set."""


@pytest.fixture(scope="module", name="cases")
def simulated() -> list[Case]:
    """Draw faults of any size from a tenth of the range up, in machines whose constants are those of the drawing."""
    random = np.random.default_rng(77)
    found = []
    for number in range(CASES):
        effect = LIBRARY.effects[number % len(LIBRARY.effects)]
        parameter = effect.parameters[0]
        value = parameter.maximum * random.uniform(0.1, 0.6)
        made = machine(3000 + number)
        made.constants = {}
        runs = made.record(RUNS, {effect.key(parameter): value})
        answer = diagnose(runs, PROBLEM, references=made.record(REFERENCES), jobs=1)
        fitted = [each for each in answer.candidates if each.names == (effect.name,)]
        error = below = np.nan
        if fitted:
            (number_found,) = fitted[0].effects[0].parameters
            half = max(number_found.interval[1] - number_found.value, number_found.value - number_found.interval[0])
            error = (value - number_found.value) / half
            below = float(stats.norm.cdf(error * stats.norm.ppf(0.95)))
        first = "+".join(next(iter(answer.posterior)))
        probability = answer.posterior.get((effect.name,), 0.0)
        found.append(Case(effect.name, first, probability, bool(fitted), error, below))
    return found


def test_false_alarms_of_whole_diagnoses_are_as_rare_as_stated() -> None:
    """Machines with constants of their own, no fault: within a binomial chance of the stated one in a hundred."""
    alarms = 0
    for seed in range(HEALTHY):
        made = machine(5000 + seed)
        found = diagnose(made.record(RUNS), PROBLEM, references=made.record(REFERENCES), jobs=1)
        alarms += found.verdict is not Verdict.NO_GAP
    assert alarms <= stats.binom.ppf(SURE, HEALTHY, 0.01)


def test_the_true_effect_comes_first(cases: list[Case]) -> None:
    """Of faults that are all clear, in nine of ten."""
    assert np.mean([case.first == case.truth for case in cases]) >= 0.9


def test_probabilities_are_those_of_being_right(cases: list[Case]) -> None:
    """The sum of what was given to the first candidates is the number that were right, within its standard error."""
    right = sum(case.first == case.truth for case in cases)
    given = [max(case.probability, 1.0 - case.probability) for case in cases]
    spread = np.sqrt(sum(p * (1.0 - p) for p in given)) + 1.0
    assert right >= sum(given) - 3.0 * spread


def test_sets_hold_the_truth_as_often_as_stated(cases: list[Case]) -> None:
    """Nineteen of twenty, within a binomial chance of one in a thousand."""
    assert sum(case.in_set for case in cases) >= stats.binom.ppf(1.0 - SURE, CASES, 0.95)


def test_intervals_cover_what_they_say(cases: list[Case]) -> None:
    """Nine of ten; neither far too narrow nor far too wide."""
    errors = np.array([case.known_to for case in cases if case.in_set])
    inside = int((np.abs(errors) <= 1.0).sum())
    assert stats.binom.ppf(1.0 - SURE, len(errors), 0.9) <= inside
    assert np.abs(errors).mean() > 0.15


def test_ranks_of_the_truth_are_even(cases: list[Case]) -> None:
    """Simulation-based calibration: no bias, and no pile at the ends (Talts et al. 2018, arXiv:1804.06788)."""
    ranks = np.array([case.below for case in cases if case.in_set])
    counts = np.histogram(ranks, bins=4, range=(0.0, 1.0))[0]
    assert abs(ranks.mean() - 0.5) < 3.5 / np.sqrt(12.0 * len(ranks))
    assert stats.binom.ppf(SURE, len(ranks), 0.3) >= max(counts[0], counts[-1])
