"""Lines of the tables on the page and in the terminal, as text."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from jammkle_gap.november.probability import NO_GAP, UNKNOWN
from jammkle_gap.report.quantities import known, noise_units, percent, percents, quantity, span
from jammkle_gap.report.words import candidate_label, label

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from jammkle_gap.november.described import FittedEffect
    from jammkle_gap.november.diagnosis import Diagnosis
    from jammkle_gap.november.where import Place

PHASES = (
    "evacuating", "holding", "venting", "falling", "loading", "unloading", "reversal", "impact", "rebound", "sliding",
    "still", "other", "whole run",
)  # fmt: skip
"""Columns of the heat map, in the order in which things happen; phases of other names stand before the last two."""
WORTH_SHARE = 0.005
"""Signals and probabilities below this are put together."""
_MOST_SIGNATURES = 12
_MOST_RANKED = 15
_ALWAYS_SHOWN = (NO_GAP, UNKNOWN)


def parameter_lines(effects: Sequence[FittedEffect]) -> list[dict[str, str]]:
    """Return one line per parameter of each effect."""
    return [
        {
            "effect": effect.name,
            "subsystem": effect.subsystem,
            "sentence": effect.sentence,
            "parameter": each.name,
            "value": known(each.value, each.interval, each.unit),
            "interval": span(each.value, each.interval, each.unit),
            "remark": "at the end of its range: the truth may lie beyond" if each.at_bound else "",
        }
        for effect in effects
        for each in effect.parameters
    ]


def signal_lines(diagnosis: Diagnosis) -> list[dict[str, Any]]:
    """Return how far the gap closes per signal, the largest gap first."""
    return [
        {
            "signal": each.signal,
            "noise": quantity(each.noise, each.unit),
            "nominal_physical": quantity(each.nominal_physical, each.unit),
            "with_effect_physical": quantity(each.with_effect_physical, each.unit),
            "nominal": noise_units(each.closing.nominal),
            "with_effect": noise_units(each.closing.with_effect),
            "closed": percent(each.closing.closed),
            "interval": percents(each.closing.interval),
            "limit": noise_units(each.limit),
            "off": each.closing.nominal > each.limit,
        }
        for each in sorted(diagnosis.signals, key=lambda one: -one.closing.nominal)
    ]


def heat_map(places: Sequence[Place]) -> dict[str, Any]:
    """Return the shares of signals by phases, signals with the largest share first."""
    shares: dict[str, float] = {}
    for place in places:
        shares[place.signal] = shares.get(place.signal, 0.0) + place.share
    signals = [name for name in sorted(shares, key=lambda name: -shares[name]) if shares[name] >= WORTH_SHARE]
    found = {place.phase for place in places}
    phases = [*(name for name in PHASES[:-2] if name in found), *sorted(found - set(PHASES))]
    phases += [name for name in PHASES[-2:] if name in found]
    cells = {(place.signal, place.phase): place for place in places}
    subsystem = {place.signal: place.subsystem for place in places}
    return {
        "phases": phases,
        "rows": [
            {
                "signal": name,
                "subsystem": subsystem[name],
                "share": percent(shares[name]),
                "cells": [_heat_cell(cells.get((name, phase))) for phase in phases],
            }
            for name in signals
        ],
        "left_out": len(shares) - len(signals),
    }


def _heat_cell(place: Place | None) -> dict[str, Any] | None:
    if place is None:
        return None
    return {
        "share": percent(place.share),
        "interval": percents(place.interval),
        "gap": noise_units(place.gap),
        "strength": round(math.sqrt(min(max(place.share, 0.0), 1.0)), 3),
    }


def horizon_table(diagnosis: Diagnosis) -> dict[str, Any]:
    """Return the gap of each signal at each horizon, for signals that are off at any."""
    horizons = diagnosis.where.horizons
    limits = {each.signal: each.limit for each in diagnosis.signals}
    names = sorted(
        {name for each in horizons for name, gap in each.gaps.items() if gap > limits[name]},
        key=lambda name: -max(each.gaps.get(name, 0.0) for each in horizons),
    )
    return {
        "columns": [_horizon(each.horizon_s) for each in horizons],
        "rows": [
            {"signal": name, "gaps": [noise_units(each.gaps.get(name, math.nan)) for each in horizons]}
            for name in names
        ],
    }


def _horizon(horizon_s: float) -> str:
    if not math.isfinite(horizon_s):
        return "whole run"
    return f"every {quantity(horizon_s, 's')}" if horizon_s > 0.0 else "every sample"


def candidate_lines(diagnosis: Diagnosis) -> list[dict[str, Any]]:
    """Return the set, best first."""
    return [
        {
            "label": candidate_label(each),
            "score": f"{each.score:.0f}",
            "behind": "best" if place == 0 else f"{each.behind:.1f} ± {each.error:.1f}",
            "parameters": "; ".join(
                f"{line['parameter']} {line['value']} ({line['interval']})" for line in parameter_lines(each.effects)
            ),
        }
        for place, each in enumerate(diagnosis.candidates)
    ]


def probability_lines(probabilities: Mapping[str, float]) -> list[dict[str, Any]]:
    """Return the probabilities that matter, largest first, and the rest as one."""
    worth = {name: value for name, value in probabilities.items() if value >= WORTH_SHARE or name in _ALWAYS_SHOWN}
    lines = [{"name": label(name), "value": value} for name, value in sorted(worth.items(), key=lambda one: -one[1])]
    rest = sum(probabilities.values()) - sum(worth.values())
    left = len(probabilities) - len(worth)
    return [*lines, {"name": f"the other {left} together", "value": rest}] if left else lines


def ranking_lines(ranking: Sequence[tuple[tuple[str, ...], float]]) -> list[dict[str, str]]:
    """Return the best candidates that were fitted."""
    best = sorted(ranking, key=lambda one: -one[1])[:_MOST_RANKED]
    return [
        {"label": " + ".join(map(label, names)) or "no effect (nominal)", "score": f"{score:.0f}"}
        for names, score in best
    ]


def signature_lines(diagnosis: Diagnosis) -> list[dict[str, str]]:
    """Return the strongest signatures of signals that are off."""
    off = {each.signal for each in diagnosis.signals if each.closing.nominal > each.limit}
    return [
        {"signal": each.signal, "kind": each.kind, "share": percent(each.share), "sentence": each.sentence}
        for each in diagnosis.signatures
        if each.signal in off
    ][:_MOST_SIGNATURES]
