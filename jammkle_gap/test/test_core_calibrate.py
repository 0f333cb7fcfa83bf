"""Calibration: the constants of a machine are found, and what moves nothing is not simulated again."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from jammkle_gap import (
    Constants,
    Effect,
    EffectParameter,
    InfeasibleError,
    Library,
    Nuisance,
    Problem,
    Recording,
    Signal,
    Verdict,
    diagnose,
)
from jammkle_gap.core.calibrate import calibrate
from jammkle_gap.core.scatter import Scatter, settings_of
from jammkle_gap.core.simulate import Runner
from pendulums import PROBLEM, machine, simulate

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


def test_constants_are_found_and_those_that_move_nothing_not_simulated_again() -> None:
    """The spring is within a hundredth; the lamp is asked for never, the nominal slopes having said that it is idle."""
    simulator = Counted()
    given = problem(simulator)
    settings = settings_of([run("one", 1.25)], [run("two", 1.25), run("three", 1.25)], given)
    layout = settings[0].layout
    scatter = Scatter(np.square(layout.floor), np.zeros((layout.size, 0)), 1, np.zeros(0))
    bend = -2.0 * 0.1 * np.sin(layout.time_s)
    slopes = np.stack([bend, np.zeros(layout.size)], axis=1)
    found = calibrate(settings, [scatter], [slopes], given, Runner(given, 1), Constants())
    assert found.values["spring.stiffness"] == pytest.approx(1.25, abs=0.01)
    assert found.after < found.before / 100.0
    assert all("lamp.power" not in each for each in simulator.asked)
    # Nominal, a step, and then slope and step; halvings aside.
    assert len(simulator.asked) <= 2 + 2 * 3 + 3


@pytest.mark.parametrize("count", [5, 0])
def test_a_machine_that_cannot_make_all_runs_is_not_calibrated(count: int) -> None:
    """Its simulation blows up at the inputs of one faulty run: the nominal machine is compared with, and no error."""
    made = machine(23)
    made.constants = {"arm.mass": 1.12, "servo.stiffness": 1.0}
    runs, references = made.record(3, {"rubbing.torque": 0.1}), made.record(count)

    def fragile(recording: Recording, values: Mapping[str, float]) -> dict[str, NDArray[np.float64]]:
        if recording.name == runs[-1].name and values.get("arm.mass", 1.0) > 1.04:
            raise InfeasibleError
        return simulate(recording, values)

    found = diagnose(runs, replace(PROBLEM, simulator=fragile), references=references, jobs=1)
    assert all(abs(each) == 0.0 for each in found.calibration.values())
    assert found.verdict is not Verdict.NO_GAP
