"""The sim-to-real gap: where simulation and robot disagree, and why. What others may use stands in `__all__`."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jammkle_gap.ankle.effects import ankle_library
    from jammkle_gap.ankle.problem import ankle_problem
    from jammkle_gap.ankle.recording import load_recordings
    from jammkle_gap.ankle.repeats import with_settings
    from jammkle_gap.ankle.simulator import Rerun, rerun
    from jammkle_gap.core.constants import Constants
    from jammkle_gap.core.data import BadRecordingError, Phase, Recording, Signal
    from jammkle_gap.core.design import Experiment
    from jammkle_gap.core.diagnose import diagnose
    from jammkle_gap.core.effects import BadEffectError, Effect, EffectParameter, Library, Nuisance
    from jammkle_gap.core.result import Diagnosis, Verdict, as_dict
    from jammkle_gap.core.simulate import InfeasibleError, Problem, SimulatorError
    from jammkle_gap.landing import HiddenEffect

_HOMES = {
    "BadEffectError": "core.effects",
    "BadRecordingError": "core.data",
    "Constants": "core.constants",
    "Diagnosis": "core.result",
    "Effect": "core.effects",
    "EffectParameter": "core.effects",
    "Experiment": "core.design",
    "InfeasibleError": "core.simulate",
    "Library": "core.effects",
    "Nuisance": "core.effects",
    "Phase": "core.data",
    "Problem": "core.simulate",
    "Recording": "core.data",
    "Rerun": "ankle.simulator",
    "HiddenEffect": "landing",
    "Signal": "core.data",
    "SimulatorError": "core.simulate",
    "Verdict": "core.result",
    "ankle_library": "ankle.effects",
    "ankle_problem": "ankle.problem",
    "as_dict": "core.result",
    "diagnose": "core.diagnose",
    "load_recordings": "ankle.recording",
    "rerun": "ankle.simulator",
    "with_settings": "ankle.repeats",
}

__all__ = [
    "BadEffectError",
    "BadRecordingError",
    "Constants",
    "Diagnosis",
    "Effect",
    "EffectParameter",
    "Experiment",
    "HiddenEffect",
    "InfeasibleError",
    "Library",
    "Nuisance",
    "Phase",
    "Problem",
    "Recording",
    "Rerun",
    "Signal",
    "SimulatorError",
    "Verdict",
    "ankle_library",
    "ankle_problem",
    "as_dict",
    "diagnose",
    "load_recordings",
    "rerun",
    "with_settings",
]


def __getattr__(name: str) -> Any:
    """Load what is asked for when it is asked for: the command shall not wait for NumPy."""
    if name not in _HOMES:
        msg = f"module {__name__!r} has no attribute {name!r}"
        raise AttributeError(msg)
    return getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)
