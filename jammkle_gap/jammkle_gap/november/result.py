"""A diagnosis as plain numbers and words, for a file."""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pathlib import Path

    from jammkle_gap.november.closing import Closing
    from jammkle_gap.november.described import FittedEffect
    from jammkle_gap.november.diagnosis import Diagnosis


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
            }
            for each in effect.parameters
        },
    }


def _closing(closing: Closing) -> dict[str, Any]:
    return {
        "nominal": _number(closing.nominal),
        "with_effect": _number(closing.with_effect),
        "floor": 1.0,
        "closed": _number(closing.closed),
        "interval": _interval(closing.interval),
    }


def as_dict(diagnosis: Diagnosis) -> dict[str, Any]:
    """Return the diagnosis as what JSON can hold; gaps are in noise units, intervals are 95 %."""
    following = diagnosis.next_experiment
    formula = diagnosis.formula
    return {
        "verdict": diagnosis.verdict.value,
        "reasons": list(diagnosis.reasons),
        "effects": [_effect(effect) for effect in diagnosis.effects],
        "set": [
            {
                "effects": [_effect(effect) for effect in each.effects],
                "names": list(each.names),
                "score": _number(each.score),
                "behind": _number(each.behind),
                "error": _number(each.error),
            }
            for each in diagnosis.candidates
        ],
        "probabilities": {name: _number(value) for name, value in diagnosis.probabilities.items()},
        "where": [
            {
                "signal": place.signal,
                "phase": place.phase,
                "subsystem": place.subsystem,
                "share": _number(place.share),
                "interval": _interval(place.interval),
                "gap": _number(place.gap),
            }
            for place in diagnosis.where.places
        ],
        "subsystems": [
            {"name": each.name, "gap": _number(each.gap), "gaps": dict(each.gaps), "to_blame": each.to_blame}
            for each in diagnosis.where.subsystems
        ],
        "horizons": [
            {"horizon_s": _number(each.horizon_s), "gaps": dict(each.gaps)} for each in diagnosis.where.horizons
        ],
        "signatures": [
            {
                "signal": each.signal,
                "kind": each.kind,
                "value": _number(each.value),
                "unit": each.unit,
                "share": _number(each.share),
                "sentence": each.sentence,
            }
            for each in diagnosis.signatures
        ],
        "gap": {
            **_closing(diagnosis.gap),
            "ceiling": _number(diagnosis.ceiling),
            "signals": {
                each.signal: {
                    **_closing(each.closing),
                    "counts_as_none": _number(each.limit),
                    "unit": each.unit,
                    "noise": _number(each.noise),
                    "nominal_physical": _number(each.nominal_physical),
                    "with_effect_physical": _number(each.with_effect_physical),
                }
                for each in diagnosis.signals
            },
            "held_out_regimes": [
                {
                    "regime": each.regime,
                    "nominal": _number(each.nominal),
                    "with_effect": _number(each.with_effect),
                    "closed": _number(each.closed),
                }
                for each in diagnosis.regimes
            ],
        },
        "noise": {
            each.signal: {"value": each.noise, "unit": each.unit, "source": each.source} for each in diagnosis.noise
        },
        "formula": None
        if formula is None
        else {"signal": formula.signal, "text": formula.text, "share": _number(formula.share)},
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
        "dropped": dict(diagnosis.dropped),
        "ranking": [{"names": list(names), "score": _number(value)} for names, value in diagnosis.ranking],
        "notes": list(diagnosis.notes),
        "finished": diagnosis.finished,
        "runtime": {
            "wall_s": diagnosis.spent.wall_s,
            "simulator_runs": diagnosis.spent.runs,
            "simulated_s": diagnosis.spent.simulated_s,
        },
    }


def write(diagnosis: Diagnosis, path: Path) -> None:
    """Write the diagnosis as JSON."""
    path.write_text(json.dumps(as_dict(diagnosis), indent=2) + "\n", encoding="utf-8")
