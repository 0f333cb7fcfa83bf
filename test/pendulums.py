"""A pendulum on a servo, for tests of the diagnosis: its simulator, effects, scatter, and machines made of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numba import njit

from jammkle_gap import Effect, EffectParameter, InfeasibleError, Library, Nuisance, Problem, Recording, Signal

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import NDArray

    Simulator = Callable[[Recording, Mapping[str, float]], dict[str, NDArray[np.float64]]]

STEP_S, STEPS, SUBSTEPS = 0.01, 250, 4
TIMES_S = STEP_S * np.arange(STEPS)
NOISE_RAD = 0.004
SETTINGS_HZ = {"slow": 0.5, "fast": 1.2}


@njit(cache=True)  # type: ignore[untyped-decorator]  # numba carries no types
def swing(
    command: NDArray[np.float64], start: float, rub: float, mass: float, stiffness: float, drag: float
) -> NDArray[np.float64]:
    """Return the angle, rad."""
    angle, rate = start, 0.0
    angles = np.empty_like(command)
    for k in range(command.size):
        angles[k] = angle
        for _ in range(SUBSTEPS):
            torque = stiffness * (command[k] - angle) - drag * rate - 0.98 * mass * np.sin(angle)
            rate += STEP_S / SUBSTEPS * (torque - rub * np.tanh(50.0 * rate)) / (0.022 * mass)
            angle += STEP_S / SUBSTEPS * rate
    return angles


def simulate(recording: Recording, values: Mapping[str, float]) -> dict[str, NDArray[np.float64]]:
    """Play the recording's command."""
    late_s = values.get("delay.time", 0.0)
    command = np.interp(TIMES_S - late_s, TIMES_S, recording.inputs)
    mass = (1.0 + values.get("load.share", 0.0)) * (1.0 + values.get("twin.share", 0.0)) * values.get("arm.mass", 1.0)
    angle = swing(
        command,
        values.get("start.angle", 0.0),
        0.02 + values.get("rubbing.torque", 0.0) + values.get("run.rub", 0.0),
        mass,
        3.0 * values.get("servo.stiffness", 1.0) * (1.0 - values.get("weak.share", 0.0)),
        0.15 + values.get("oil.drag", 0.0),
    )
    return {"angle": angle}


def effect(name: str, parameter: str, unit: str, most: float) -> Effect:
    """Return an effect with one parameter that is off at 0."""
    return Effect(name, "pendulum", (EffectParameter(parameter, unit, 0.0, 0.0, most, "assumed"),), f"Check {name}.")


def infeasible(where: Callable[[Recording, Mapping[str, float]], bool]) -> Simulator:
    """Return the simulator, which cannot be run at some values."""

    def limited(recording: Recording, values: Mapping[str, float]) -> dict[str, NDArray[np.float64]]:
        if where(recording, values):
            raise InfeasibleError
        return simulate(recording, values)

    return limited


class Sensed:
    """An effect of sensors, which acts on what was measured; of one signal alone, or of all."""

    def __init__(
        self, name: str, act: Callable[[NDArray[np.float64], Mapping[str, float]], NDArray[np.float64]], only: str = ""
    ) -> None:
        self.effects = frozenset({name})
        self._act, self._only = act, only

    def without_references(self) -> Sensed:
        return self

    def knows(self, effect: str, signal: str) -> bool:
        del effect
        return self._only in {signal, ""}

    def __call__(
        self, recording: Recording, measured: Mapping[str, NDArray[np.float64]], values: Mapping[str, float]
    ) -> dict[str, NDArray[np.float64]]:
        del recording
        return {name: self._act(each, values) if self.knows("", name) else each for name, each in measured.items()}


TWIN = effect("twin", "share", "1", 0.8)
"""Does what `load` does."""
LIBRARY = Library((
    effect("rubbing", "torque", "N m", 0.4),
    effect("delay", "time", "s", 0.05),
    effect("load", "share", "1", 0.8),
    effect("weak", "share", "1", 0.6),
    effect("oil", "drag", "N m s", 0.2),
))  # fmt: skip
SCATTER = (
    Nuisance("start.angle", "rad", 0.0, 0.005, "assumed"),
    Nuisance("run.rub", "N m", 0.0, 0.003, "assumed", -0.02, 0.02),
)
CONSTANTS = (
    Nuisance("arm.mass", "1", 1.0, 0.05, "assumed"),
    Nuisance("servo.stiffness", "1", 1.0, 0.05, "assumed"),
)
PROBLEM = Problem(simulate, LIBRARY, SCATTER, CONSTANTS)


@dataclass
class Machine:
    """Stands in for a real pendulum: its constants are another's, and no two of its runs are the same."""

    random: np.random.Generator
    constants: Mapping[str, float]

    def record(
        self, count: int, effects: Mapping[str, float] | None = None, settings: Sequence[str] = tuple(SETTINGS_HZ)
    ) -> list[Recording]:
        """Return some runs of each setting, with noise and scatter."""
        return [self.run(setting, effects or {}) for setting in settings for _ in range(count)]

    def run(self, setting: str, effects: Mapping[str, float]) -> Recording:
        """Return one run."""
        command = 0.5 * np.sin(2.0 * np.pi * SETTINGS_HZ[setting] * TIMES_S)
        blank = Recording(setting, (), command, setting=setting)
        scatter = {each.name: each.null + each.sigma * self.random.standard_normal() for each in SCATTER}
        angle = simulate(blank, {**self.constants, **scatter, **effects})["angle"]
        angle = angle + self.random.normal(0.0, NOISE_RAD, STEPS)
        return Recording(setting, (Signal("angle", "rad", TIMES_S, angle, NOISE_RAD),), command, setting=setting)


def machine(seed: int) -> Machine:
    """Return a machine drawn from the priors of its constants."""
    random = np.random.default_rng(seed)
    return Machine(random, {each.name: each.null + each.sigma * random.standard_normal() for each in CONSTANTS})
