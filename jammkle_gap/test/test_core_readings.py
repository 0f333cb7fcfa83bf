"""Effects of sensors act on what a healthy sensor would have read in the faulty run."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from jammkle_gap import Library, Problem, Recording, Signal
from jammkle_gap.core.fit import Signatures
from jammkle_gap.core.scatter import settings_of
from jammkle_gap.core.signatures import sensed_difference, with_readings
from jammkle_gap.core.simulate import Runner
from pendulums import Sensed, effect

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

TIMES_S = 0.01 * np.arange(200)
WRONG = 0.3 * np.cos(2.0 * np.pi * TIMES_S)
"""What the simulator has wrong anyway."""
HEALTHY, ANSWER = np.sin(3.0 * TIMES_S), np.sin(3.0 * TIMES_S + 0.8)
"""What a regulator does on a healthy machine, and how it answers a late sensor."""


def late(read: NDArray[np.float64], values: Mapping[str, float]) -> NDArray[np.float64]:
    """Read late."""
    return np.interp(TIMES_S - values["late.by"], TIMES_S, read)


def simulate(recording: Recording, values: Mapping[str, float]) -> dict[str, NDArray[np.float64]]:
    """Follow the command; a signal that it does not know is left out."""
    del values
    return {"level": 2.0 * recording.inputs}


def run(name: str, command: NDArray[np.float64], late_s: float = 0.0) -> Recording:
    """Return a run of a machine that the simulator has a little wrong."""
    level = np.interp(TIMES_S - late_s, TIMES_S, 2.0 * command + WRONG)
    signals = (Signal("level", "m", TIMES_S, level, 0.01), Signal("other", "m", TIMES_S, WRONG, 0.01))
    return Recording(name, signals, command, setting="same")


PROBLEM = Problem(simulate, Library((effect("late", "by", "s", 0.2),)), sensing=Sensed("late", late))
RUNNER = Runner(PROBLEM, 1)


def test_a_regulators_answer_is_no_part_of_a_late_sensor() -> None:
    """Readings are the reference's, moved by what the simulator says of the other commands."""
    settings = settings_of([run("faulty", ANSWER, 0.05)], [run("healthy", HEALTHY)], PROBLEM)
    (setting,) = with_readings(settings, PROBLEM, RUNNER)
    assert setting.readings[0]["level"] == pytest.approx(2.0 * ANSWER + WRONG)
    assert setting.readings[0]["other"] == pytest.approx(WRONG)
    expected = 2.0 * (np.interp(TIMES_S - 0.05, TIMES_S, ANSWER) - ANSWER)
    expected += np.interp(TIMES_S - 0.05, TIMES_S, WRONG) - WRONG
    found = setting.layout.by_signal(sensed_difference(PROBLEM, setting, {"late.by": 0.05}))[0]
    # A bin may begin a sample earlier or later by rounding.
    assert found == pytest.approx(expected.reshape(-1, 2).mean(axis=1)[: len(found)], abs=0.02)


def test_without_references_what_is_simulated_stands_in() -> None:
    """A gain acts on what has no noise: else it would be fitted by scaling the noise away."""
    faulty = run("faulty", ANSWER, 0.05)
    (setting,) = with_readings(settings_of([faulty], [], PROBLEM), PROBLEM, RUNNER)
    assert setting.readings[0]["level"] == pytest.approx(simulate(faulty, {})["level"])


def test_a_problem_without_sensing_needs_no_readings() -> None:
    """Nothing is simulated for it."""
    problem = Problem(simulate, PROBLEM.library)
    runner = Runner(problem, 1)
    assert with_readings(settings_of([run("one", ANSWER)], [], problem), problem, runner)[0].readings == ()
    assert runner.runs == 0


def test_an_effect_that_sensing_knows_in_part_is_simulated_for_the_rest() -> None:
    """The level follows a late command as measured, beside a simulated effect; the other signal is simulated."""

    def both(recording: Recording, values: Mapping[str, float]) -> dict[str, NDArray[np.float64]]:
        command = np.interp(TIMES_S - values.get("late.by", 0.0), TIMES_S, recording.inputs)
        gain = 1.0 + values.get("gain.by", 0.0)
        return {"level": 2.0 * gain * command, "other": gain * command}

    library = Library((effect("late", "by", "s", 0.2), effect("gain", "by", "1", 0.5)))
    problem = Problem(both, library, sensing=Sensed("late", late, only="level"))
    settings = settings_of([run("faulty", ANSWER, 0.05)], [run("healthy", HEALTHY)], problem)
    runner = Runner(problem, 1)
    settings = with_readings(settings, problem, runner)
    values = {"late.by": 0.05, "gain.by": 0.1}
    (found,) = Signatures(problem, settings, {}).parts(values) or ()
    level, other = settings[0].layout.by_signal(found)
    command = np.interp(TIMES_S - 0.05, TIMES_S, ANSWER)
    shifted = np.interp(TIMES_S - 0.05, TIMES_S, 2.0 * ANSWER + WRONG) - 2.0 * ANSWER - WRONG

    def binned(values: NDArray[np.float64]) -> NDArray[np.float64]:
        bins: NDArray[np.float64] = values.reshape(-1, 2).mean(axis=1)[: len(level)]
        return bins

    assert level == pytest.approx(binned(shifted + 0.2 * ANSWER), abs=0.02)
    assert other == pytest.approx(binned(1.1 * command - ANSWER), abs=0.02)


def test_a_late_sensor_reads_what_the_machine_at_hand_does() -> None:
    """Beside constants: a machine that goes twice as far as drawn is read late by twice as much."""

    def moved(recording: Recording, values: Mapping[str, float]) -> dict[str, NDArray[np.float64]]:
        return {"level": (2.0 + values.get("further", 0.0)) * recording.inputs}

    problem = Problem(moved, PROBLEM.library, sensing=Sensed("late", late))
    runner = Runner(problem, 1)
    settings = with_readings(settings_of([run("faulty", ANSWER, 0.05)], [], problem), problem, runner)
    signatures = Signatures(problem, settings, {})
    (found,) = signatures.parts({"late.by": 0.15}, {"further": 2.0}) or ()
    level = settings[0].layout.by_signal(found)[0]
    expected = 4.0 * np.interp(TIMES_S - 0.15, TIMES_S, ANSWER) - 2.0 * ANSWER
    assert level == pytest.approx(expected.reshape(-1, 2).mean(axis=1)[: len(level)], abs=0.1)
    before = signatures.made.runs
    signatures.parts({"late.by": 0.1}, {"further": 2.0})
    assert signatures.made.runs == before  # the same machine, read otherwise
