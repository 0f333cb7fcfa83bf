"""A diagnosis as JSON."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jammkle_gap.core.result import Closing, Diagnosis, FittedEffect


def as_dict(diagnosis: Diagnosis) -> dict[str, Any]:
    """Return the diagnosis as what JSON can hold; gaps are in healthy scatter, intervals are 90 %."""
    following = diagnosis.next_experiment
    return {
        "verdict": diagnosis.verdict.value,
        "reasons": list(diagnosis.reasons),
        "effects": [_effect(each) for each in diagnosis.effects],
        "set": [
            {
                "names": list(each.names),
                "probability": _number(each.probability),
                "explained": _number(each.explained),
                "equivalents": list(each.equivalents),
                "effects": [_effect(effect) for effect in each.effects],
            }
            for each in diagnosis.candidates
        ],
        "posterior": [
            {"names": list(names), "probability": _number(value)} for names, value in diagnosis.posterior.items()
        ],
        "conformal": {name: _number(value) for name, value in diagnosis.conformal.items()},
        "gap_probability": _number(diagnosis.gap_probability),
        "p_value": _number(diagnosis.p_value),
        "false_alarm_rate": diagnosis.false_alarm_rate,
        "where": [
            {
                "signal": each.signal,
                "phase": each.phase,
                "share": _number(each.share),
                "interval": _interval(each.interval),
                "gap": _number(each.gap),
            }
            for each in diagnosis.where
        ],
        "subsystems": {name: _number(value) for name, value in diagnosis.subsystems.items()},
        "gap": {
            **_closing(diagnosis.gap),
            "signals": {
                each.signal: {
                    "unit": each.unit,
                    "nominal": _number(each.nominal),
                    "corrected": _number(each.corrected),
                    "nominal_physical": _number(each.nominal_physical),
                    "corrected_physical": _number(each.corrected_physical),
                    "scatter_physical": _number(each.scatter_physical),
                }
                for each in diagnosis.signals
            },
            "held_out": [{"setting": each.setting, **_closing(each.closing)} for each in diagnosis.held_out],
        },
        "classes": [list(each) for each in diagnosis.classes],
        "silent": list(diagnosis.silent),
        "calibration": {name: _number(value) for name, value in diagnosis.calibration.items()},
        "references_left": _number(diagnosis.references_left),
        "next_experiment": None
        if following is None
        else {
            "name": following.name,
            "signal": following.signal,
            "difference": _number(following.difference),
            "difference_physical": _number(following.difference_physical),
            "unit": following.unit,
            "sentence": following.sentence,
        },
        "notes": list(diagnosis.notes),
        "finished": diagnosis.finished,
        "runtime": {
            "wall_s": diagnosis.spent.wall_s,
            "simulator_runs": diagnosis.spent.runs,
            "simulated_s": diagnosis.spent.simulated_s,
        },
    }


def _number(value: float) -> float | None:
    """Return a number that JSON has; None for those that it has not."""
    return float(value) if math.isfinite(value) else None


def _interval(interval: tuple[float, float]) -> list[float | None]:
    return [_number(value) for value in interval]


def _effect(effect: FittedEffect) -> dict[str, Any]:
    return {
        "name": effect.name,
        "subsystem": effect.subsystem,
        "check": effect.sentence,
        "parameters": {
            each.name: {
                "value": _number(each.value),
                "unit": each.unit,
                "interval": _interval(each.interval),
                "at_bound": each.at_bound,
                "detectable": _number(each.detectable),
            }
            for each in effect.parameters
        },
    }


def _closing(closing: Closing) -> dict[str, Any]:
    return {
        "nominal": _number(closing.nominal),
        "corrected": _number(closing.corrected),
        "closed": _number(closing.closed),
        "interval": _interval(closing.interval),
    }
