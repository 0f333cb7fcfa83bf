"""Real data: a small servo swings a pendulum, and a model with dry and viscous friction does not follow.

Measured by others: see data/README.md beside the recordings. Friction that grows with load explains most of all
effects, and more with a larger controller gain; the model has more wrong than that. Motor and friction constants are
known to the tolerances of a data sheet, and are nuisances: else each effect would mend what they were bent to hide.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numba import njit

from jammkle_gap import Effect, EffectParameter, Library, Nuisance, Problem, Recording, Signal, diagnose

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from jammkle_gap import Diagnosis

BIN_S = 0.05
DUTY_PER_RAD = 0.00246
"""Duty cycle per radian of error and unit of gain; as published with the recordings for this servo."""
SUBSTEPS = 5


def one(name: str, subsystem: str, sentence: str, *parameters: tuple[str, str, float, float, float]) -> Effect:
    """Make an effect; every bound is assumed."""
    return Effect(name, subsystem, tuple(EffectParameter(*each, "assumed") for each in parameters), sentence)


DATA_SHEET, GUESSED = "data sheet: 0.52 N m at 1.47 A and 5 V; assumed to a fifth", "assumed to a half"
CONSTANTS = (
    Nuisance("motor.constant", "N m/A", 0.354, 0.07, DATA_SHEET, 0.1, 1.0),
    Nuisance("motor.resistance", "Ohm", 3.4, 0.7, DATA_SHEET, 1.0, 12.0),
    Nuisance("motor.armature", "kg m^2", 0.0015, 0.00075, GUESSED, 0.0002, 0.006),
    Nuisance("dry.torque", "N m", 0.03, 0.015, GUESSED, 0.001, 0.12),
    Nuisance("viscous.coefficient", "N m s", 0.008, 0.004, GUESSED, 0.0005, 0.04),
)
LIBRARY = Library(
    (
        one("load_friction", "friction", "Gears rub more under load.", ("coefficient", "1", 0.0, 0.0, 0.6)),
        one("gain", "controller", "The firmware's gain is another.", ("scale", "1", 1.0, 0.5, 2.0)),
        one(
            "stribeck",
            "friction",
            "It sticks before it slides.",
            ("torque", "N m", 0.0, 0.0, 0.2),
            ("rate", "rad/s", 0.2, 0.05, 2.0),
        ),
        one("delay", "controller", "Commands come late.", ("time", "s", 0.0, 0.0, 0.05)),
        one("payload", "mechanics", "The load weighs more.", ("scale", "1", 1.0, 0.7, 1.4)),
        one("supply", "controller", "The supply sags.", ("scale", "1", 1.0, 0.7, 1.3)),
        one("offset", "sensing", "Zero lies elsewhere.", ("angle", "rad", 0.0, -0.05, 0.05)),
    )
)


@njit(cache=True)  # type: ignore[untyped-decorator]  # numba carries no types
def swing(  # noqa: PLR0913, PLR0917  # compiled: plain numbers only
    on: NDArray[np.bool_],
    goal_rad: NDArray[np.float64],
    step_s: float,
    start_rad: float,
    duty_per_rad: float,
    supply_v: float,
    weight_n_m: float,
    inertia: float,
    numbers: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the angle; `numbers`: motor constant, resistance, dry, viscous, load and stribeck friction, its rate."""
    constant, resistance, dry, viscous, load, stribeck, rate_scale = numbers
    angle, rate, small = start_rad, 0.0, step_s / SUBSTEPS
    angles = np.empty_like(goal_rad)
    for k in range(goal_rad.size):
        angles[k] = angle
        for _ in range(SUBSTEPS):
            duty = min(1.0, max(-1.0, duty_per_rad * (goal_rad[k] - angle)))
            motor = constant / resistance * (supply_v * duty - constant * rate) if on[k] else 0.0
            weight = -weight_n_m * np.sin(angle)
            rub = (
                dry + load * abs(motor - weight) + stribeck * np.exp(-((rate / rate_scale) ** 2)) + viscous * abs(rate)
            )
            free = rate + small * (motor + weight) / inertia
            brake = small * rub / inertia
            rate = 0.0 if abs(free) <= brake else free - brake * np.sign(free)
            angle += small * rate
    return angles


def simulate(recording: Recording, values: Mapping[str, float]) -> dict[str, NDArray[np.float64]]:
    """Play the goal into servo and pendulum."""
    inputs, time_s = recording.inputs, recording.signal("position").time_s
    goal = np.interp(time_s - values.get("delay.time", 0.0), time_s, inputs["goal"]) + values.get("offset.angle", 0.0)
    mass = inputs["mass"] * values.get("payload.scale", 1.0)
    numbers = np.array(
        [
            values.get("motor.constant", 0.354),
            values.get("motor.resistance", 3.4),
            values.get("dry.torque", 0.03),
            values.get("viscous.coefficient", 0.008),
            values.get("load_friction.coefficient", 0.0),
            values.get("stribeck.torque", 0.0),
            values.get("stribeck.rate", 0.2),
        ]
    )
    angle = swing(
        inputs["on"],
        goal,
        float(time_s[1] - time_s[0]),
        inputs["start"],
        DUTY_PER_RAD * inputs["gain"] * values.get("gain.scale", 1.0),
        inputs["supply"] * values.get("supply.scale", 1.0),
        mass * 9.81 * inputs["length"],
        mass * inputs["length"] ** 2 + values.get("motor.armature", 0.0015),
        numbers,
    )
    return {"position": angle}


def load(file: Path) -> Recording:
    """Read one run."""
    data = json.loads(file.read_text())
    column = {key: np.array([entry[key] for entry in data["entries"]]) for key in data["entries"][0]}
    inputs = {
        "goal": column["goal_position"],
        "on": column["torque_enable"].astype(np.bool_),
        "start": float(column["position"][0]),
        "mass": data["mass"],
        "length": data["length"],
        "supply": data["vin"],
        "gain": data["kp"],
    }
    signal = Signal("position", "rad", column["timestamp"].astype(float), column["position"].astype(float))
    return Recording(f"{data['trajectory']}, gain {data['kp']}", (signal,), inputs)


def run(folder: Path) -> Diagnosis:
    """Diagnose all sixteen runs at once; no two had the same trajectory and gain."""
    problem = Problem(simulate, LIBRARY, constants=CONSTANTS, bin_s=lambda _: BIN_S)
    return diagnose([load(file) for file in sorted(folder.glob("*.json"))], problem, jobs=1)


if __name__ == "__main__":
    found = run(Path(sys.argv[1]))
    print(found.verdict.value, *found.reasons, sep="\n")
    for names, probability in found.posterior.items():
        print(f"{probability:8.3f}  {' + '.join(names) or 'none of them'}")
