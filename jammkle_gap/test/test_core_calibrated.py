"""What the probabilities, intervals and error rates are worth, on simulated pendulums that follow the model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from scipy import stats

from jammkle_gap import Verdict, diagnose
from pendulums import LIBRARY, PROBLEM, machine

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
