"""The sim-to-real gap: where simulation and robot disagree, and why. What others may use stands in `__all__`."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jammkle_gap.ankle.effects import ankle_library
    from jammkle_gap.ankle.inputs import AnkleInputs
    from jammkle_gap.ankle.problem import ankle_problem, experiments
    from jammkle_gap.ankle.recording import load_recordings, recording_of_run
    from jammkle_gap.ankle.repeats import with_settings
    from jammkle_gap.ankle.sensors import RESOLUTION, UNITS, quantity_of
    from jammkle_gap.ankle.simulator import rerun
    from jammkle_gap.core.conclude import Evidence, conclude
    from jammkle_gap.core.constants import Constants
    from jammkle_gap.core.data import BadRecordingError, Recording, Signal
    from jammkle_gap.core.design import Experiment
    from jammkle_gap.core.diagnose import diagnose, evidence_of
    from jammkle_gap.core.effects import BadEffectError, Effect, EffectParameter, Library, Nuisance
    from jammkle_gap.core.features import Layout, features_of, layout_of, measured
    from jammkle_gap.core.fit import Profiles, grid_signatures
    from jammkle_gap.core.result import Diagnosis, Verdict, as_dict
    from jammkle_gap.core.scatter import Whitener
    from jammkle_gap.core.signatures import cache_folder, grids_of
    from jammkle_gap.core.simulate import InfeasibleError, Problem, Runner, SimulatorError
    from jammkle_gap.landing import HiddenEffect
    from jammkle_gap.mujoco.diagnosing import RobotDiagnosis, diagnose_mujoco
    from jammkle_gap.mujoco.modifier import Modifier
    from jammkle_gap.mujoco.runs import BadRobotError, Run, run_of_arrays

_EXPORTS = {
    "ankle.effects": ("ankle_library",),
    "ankle.inputs": ("AnkleInputs",),
    "ankle.problem": ("ankle_problem", "experiments"),
    "ankle.recording": ("load_recordings", "recording_of_run"),
    "ankle.repeats": ("with_settings",),
    "ankle.sensors": ("RESOLUTION", "UNITS", "quantity_of"),
    "ankle.simulator": ("rerun",),
    "core.conclude": ("Evidence", "conclude"),
    "core.constants": ("Constants",),
    "core.data": ("BadRecordingError", "Recording", "Signal"),
    "core.design": ("Experiment",),
    "core.diagnose": ("diagnose", "evidence_of"),
    "core.effects": ("BadEffectError", "Effect", "EffectParameter", "Library", "Nuisance"),
    "core.features": ("Layout", "features_of", "layout_of", "measured"),
    "core.fit": ("Profiles", "grid_signatures"),
    "core.result": ("Diagnosis", "Verdict", "as_dict"),
    "core.scatter": ("Whitener",),
    "core.signatures": ("cache_folder", "grids_of"),
    "core.simulate": ("InfeasibleError", "Problem", "Runner", "SimulatorError"),
    "landing": ("HiddenEffect",),
    "mujoco.diagnosing": ("RobotDiagnosis", "diagnose_mujoco"),
    "mujoco.modifier": ("Modifier",),
    "mujoco.runs": ("BadRobotError", "Run", "run_of_arrays"),
}
"""Names by the module that they come from."""
_HOMES = {name: module for module, exported in _EXPORTS.items() for name in exported}

__all__ = [
    "RESOLUTION", "UNITS", "AnkleInputs", "BadEffectError", "BadRecordingError", "BadRobotError", "Constants",
    "Diagnosis", "Effect", "EffectParameter", "Evidence", "Experiment", "HiddenEffect", "InfeasibleError", "Layout",
    "Library", "Modifier", "Nuisance", "Problem", "Profiles", "Recording", "RobotDiagnosis", "Run", "Runner",
    "Signal", "SimulatorError", "Verdict", "Whitener", "ankle_library", "ankle_problem", "as_dict", "cache_folder",
    "conclude", "diagnose", "diagnose_mujoco", "evidence_of", "experiments", "features_of", "grid_signatures",
    "grids_of", "layout_of", "load_recordings", "measured", "quantity_of", "recording_of_run", "rerun",
    "run_of_arrays", "with_settings",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    """Load what is asked for when it is asked for: the command shall not wait for NumPy."""
    if name not in _HOMES:
        msg = f"module {__name__!r} has no attribute {name!r}"
        raise AttributeError(msg)
    return getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)
