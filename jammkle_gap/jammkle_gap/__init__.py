"""The sim-to-real gap: where simulation and robot disagree, and why. What others may use stands in `__all__`."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jammkle_gap.ankle.corrected import Correction
    from jammkle_gap.ankle.effects import ankle_library
    from jammkle_gap.ankle.inputs import AnkleInputs
    from jammkle_gap.ankle.problem import ankle_problem, experiments
    from jammkle_gap.ankle.recording import load_recordings, recording_of_run
    from jammkle_gap.ankle.repeats import with_settings
    from jammkle_gap.ankle.sensors import RESOLUTION, UNITS, quantity_of
    from jammkle_gap.ankle.simulator import Rerun, rerun
    from jammkle_gap.core.conclude import Evidence, conclude
    from jammkle_gap.core.constants import Constants
    from jammkle_gap.core.data import BadRecordingError, Phase, Recording, Signal
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
    from jammkle_gap.mujoco.runs import BadRobotError, Run, run_of_arrays, run_of_csv

_HOMES = {
    "AnkleInputs": "ankle.inputs",
    "BadEffectError": "core.effects",
    "BadRecordingError": "core.data",
    "BadRobotError": "mujoco.runs",
    "Constants": "core.constants",
    "Correction": "ankle.corrected",
    "Diagnosis": "core.result",
    "Effect": "core.effects",
    "EffectParameter": "core.effects",
    "Evidence": "core.conclude",
    "Experiment": "core.design",
    "HiddenEffect": "landing",
    "InfeasibleError": "core.simulate",
    "Layout": "core.features",
    "Library": "core.effects",
    "Modifier": "mujoco.modifier",
    "Nuisance": "core.effects",
    "Phase": "core.data",
    "Problem": "core.simulate",
    "Profiles": "core.fit",
    "RESOLUTION": "ankle.sensors",
    "Recording": "core.data",
    "Rerun": "ankle.simulator",
    "RobotDiagnosis": "mujoco.diagnosing",
    "Run": "mujoco.runs",
    "Runner": "core.simulate",
    "Signal": "core.data",
    "SimulatorError": "core.simulate",
    "UNITS": "ankle.sensors",
    "Verdict": "core.result",
    "Whitener": "core.scatter",
    "ankle_library": "ankle.effects",
    "ankle_problem": "ankle.problem",
    "as_dict": "core.result",
    "cache_folder": "core.signatures",
    "conclude": "core.conclude",
    "diagnose": "core.diagnose",
    "diagnose_mujoco": "mujoco.diagnosing",
    "evidence_of": "core.diagnose",
    "experiments": "ankle.problem",
    "features_of": "core.features",
    "grid_signatures": "core.fit",
    "grids_of": "core.signatures",
    "layout_of": "core.features",
    "load_recordings": "ankle.recording",
    "measured": "core.features",
    "quantity_of": "ankle.sensors",
    "recording_of_run": "ankle.recording",
    "rerun": "ankle.simulator",
    "run_of_arrays": "mujoco.runs",
    "run_of_csv": "mujoco.runs",
    "with_settings": "ankle.repeats",
}

__all__ = [
    "RESOLUTION",
    "UNITS",
    "AnkleInputs",
    "BadEffectError",
    "BadRecordingError",
    "BadRobotError",
    "Constants",
    "Correction",
    "Diagnosis",
    "Effect",
    "EffectParameter",
    "Evidence",
    "Experiment",
    "HiddenEffect",
    "InfeasibleError",
    "Layout",
    "Library",
    "Modifier",
    "Nuisance",
    "Phase",
    "Problem",
    "Profiles",
    "Recording",
    "Rerun",
    "RobotDiagnosis",
    "Run",
    "Runner",
    "Signal",
    "SimulatorError",
    "Verdict",
    "Whitener",
    "ankle_library",
    "ankle_problem",
    "as_dict",
    "cache_folder",
    "conclude",
    "diagnose",
    "diagnose_mujoco",
    "evidence_of",
    "experiments",
    "features_of",
    "grid_signatures",
    "grids_of",
    "layout_of",
    "load_recordings",
    "measured",
    "quantity_of",
    "recording_of_run",
    "rerun",
    "run_of_arrays",
    "run_of_csv",
    "with_settings",
]


def __getattr__(name: str) -> Any:
    """Load what is asked for when it is asked for: the command shall not wait for NumPy."""
    if name not in _HOMES:
        msg = f"module {__name__!r} has no attribute {name!r}"
        raise AttributeError(msg)
    return getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)
