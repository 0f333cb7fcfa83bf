"""The ceiling: the same diagnosis with the reality itself as the simulator, and its own faults as the library.

What it misses no better physics would find. It starts from the machine as drawn and calibrates it to the references, as
the diagnosis does; it knows of the machine at hand, of its day and of its noise no more than that.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import lru_cache
from importlib import resources
from typing import TYPE_CHECKING, Final

import numpy as np

from jammkle_gap.ankle.alignment import AnkleAlignment
from jammkle_gap.ankle.inputs import inputs_of
from jammkle_gap.ankle.problem import bin_s
from jammkle_gap.ankle.repeats import group_of
from jammkle_gap.core.constants import Constants
from jammkle_gap.core.effects import Effect, EffectParameter, Library
from jammkle_gap.core.simulate import InfeasibleError, Problem
from studies.blind.ceiling_machine import CONSTANTS, DAY, SETTABLE, built, with_planned
from studies.blind.reality.faults import FaultSetting, eras
from studies.blind.reality.machine import STILL
from studies.blind.reality.options import BadPlanError
from studies.blind.reality.record import Plan
from studies.blind.reality.run import RIGS
from studies.blind.reality.table import FAULTS
from studies.blind.whitened import signals_of

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from jammkle_gap.core.data import Recording

CEILING_CONSTANTS: Final = Constants(contact_runs=20, refined=5, refined_pairs=5, fit_evaluations=3)
"""Fewer fits than the diagnosis makes: the reality takes ten times as long as the simulator."""
_NAMED: Final = {fault.effect: fault for fault in FAULTS.values() if fault.effect is not None}
"""Faults by the name of the library's effect."""
_KEPT = 256
"""Runs that are remembered: repeats of a setting are the same here."""

Values = tuple[tuple[str, float], ...]


@dataclass(frozen=True)
class CeilingSimulator:
    """The reality without noise; fulfils `core.simulate.Simulator`."""

    def __call__(self, recording: Recording, values: Mapping[str, float]) -> dict[str, NDArray[np.float64]]:
        """Run the plan of a recording again; see `core.simulate.Simulator`."""
        inputs = inputs_of(recording)
        told = tuple((name, value) for name, value in inputs.options if name in SETTABLE[inputs.rig])
        made = _run(inputs.rig, told, tuple(sorted(values.items())))
        return {
            signal.name: np.interp(signal.time_s, *made[signal.name])
            for signal in recording.signals
            if signal.name in made
        }


def ceiling_problem() -> Problem:
    """Return the problem that is handed to the diagnosis."""
    return Problem(
        simulator=CeilingSimulator(),
        library=Library(tuple(_effect(name) for name in _NAMED)),
        scatter=DAY,
        constants=CONSTANTS,
        alignment=AnkleAlignment(),
        bin_s=bin_s,
        version=_version(),
        group_of=group_of,
    )


def _effect(name: str) -> Effect:
    fault = _NAMED[name]
    parameters = tuple(
        EffectParameter(key, row.unit, row.null, row.minimum, row.maximum, "the reality's")
        for key, row in fault.parameters.items()
    )
    return Effect(name, fault.subsystem, parameters, f"The reality's fault '{fault.name}'.")


@lru_cache(maxsize=_KEPT)
def _run(rig: str, told: Values, values: Values) -> dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Return times and values by signal.

    Raises:
        InfeasibleError: no such run can be made.

    """
    given = dict(values)
    options = with_planned(rig, dict(told), given)
    by_fault: dict[str, dict[str, float]] = {}
    for key, value in given.items():
        effect, _, parameter = key.partition(".")
        if effect in _NAMED:
            fault = _NAMED[effect]
            row = fault.parameters[parameter]
            # A grid's end may lie beyond a bound by rounding.
            by_fault.setdefault(fault.name, {})[parameter] = min(max(value, row.minimum), row.maximum)
    faults = [FaultSetting(name, each) for name, each in by_fault.items()]
    try:
        made = RIGS[rig](Plan(rig, options), eras(built(given), faults, FAULTS), STILL)
    except (BadPlanError, FloatingPointError, ZeroDivisionError) as error:
        raise InfeasibleError(str(error)) from error
    return {signal.name: (signal.time_s, signal.values) for signal in signals_of(made)}


@lru_cache(maxsize=1)
def _version() -> str:
    digest = hashlib.blake2b(b"ceiling", digest_size=16)
    for package in ("studies.blind.reality", "studies.blind"):
        for each in sorted(resources.files(package).iterdir(), key=lambda file: file.name):
            if each.name.endswith(".py") and (package == "studies.blind.reality" or each.name.startswith("ceiling")):
                digest.update(each.name.encode() + each.read_bytes())
    return digest.hexdigest()
