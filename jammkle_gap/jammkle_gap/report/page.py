"""The page of a diagnosis: one HTML file that needs no network, read in two minutes and then dug into."""

from __future__ import annotations

import base64
import importlib.resources
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import jinja2
from markupsafe import Markup

from jammkle_gap.november.verdict import Verdict
from jammkle_gap.report import tables, words
from jammkle_gap.report.figures import MOST_RECORDINGS, MOST_SIGNALS, overlay_svg, stretches_for
from jammkle_gap.report.quantities import noise_units, percent, percents, quantity
from jammkle_gap.simulated import Simulated

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from jammkle_gap.november.described import Overlay
    from jammkle_gap.november.diagnosis import Diagnosis

_TEMPLATE = "page.html.j2"
_OPEN = 2
"""Signals whose curves are shown at once; the others open on a click."""
_TONES = {
    Verdict.NO_GAP: "good",
    Verdict.EFFECTS: "found",
    Verdict.AMBIGUOUS: "open",
    Verdict.UNKNOWN: "bad",
}


@dataclass(frozen=True)
class Setting:
    """What was asked for."""

    bags: Sequence[str]
    references: Sequence[str]
    rigs: Sequence[str]
    library: str
    """File of the user's own effects; empty for none."""
    effects: int
    """How many effects were on offer."""
    corrected: str
    """File of the corrected simulator."""
    simulated: Simulated = Simulated.WHOLE


def page(diagnosis: Diagnosis, setting: Setting) -> str:
    """Return the page as HTML."""
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["label"] = words.label
    source = importlib.resources.files(__package__).joinpath(_TEMPLATE).read_text(encoding="utf-8")
    overall = diagnosis.gap
    return environment.from_string(source).render(
        verdict=diagnosis.verdict.value.replace("_", " "),
        tone=_TONES[diagnosis.verdict],
        headline=words.headline(diagnosis),
        checks=words.checks(diagnosis),
        explanation=words.explanation(diagnosis),
        reasons=diagnosis.reasons,
        finished=diagnosis.finished,
        setting=setting,
        corrected=words.corrected_note(diagnosis, setting.corrected),
        is_lead=diagnosis.verdict is Verdict.UNKNOWN,
        effects_title=words.effects_title(diagnosis),
        effects=tables.parameter_lines(diagnosis.effects),
        signals=tables.signal_lines(diagnosis),
        overall={
            "nominal": noise_units(overall.nominal),
            "with_effect": noise_units(overall.with_effect),
            "closed": percent(overall.closed),
            "interval": percents(overall.interval),
            "ceiling": noise_units(diagnosis.ceiling),
        },
        regimes=[
            {
                "name": each.regime,
                "nominal": noise_units(each.nominal),
                "with_effect": noise_units(each.with_effect),
                "closed": percent(each.closed),
            }
            for each in diagnosis.regimes
        ],
        heat=tables.heat_map(diagnosis.where.places),
        subsystems=[
            {
                "name": each.name,
                "gap": noise_units(max(each.gaps.values(), default=math.nan)),
                "signal": max(each.gaps, key=lambda name: each.gaps[name], default=""),
                "to_blame": each.to_blame,
            }
            for each in diagnosis.where.subsystems
        ],
        horizons=tables.horizon_table(diagnosis),
        candidates=tables.candidate_lines(diagnosis),
        probabilities=tables.probability_lines(diagnosis.probabilities),
        ranking=tables.ranking_lines(diagnosis.ranking),
        fitted=len(diagnosis.ranking),
        following=diagnosis.next_experiment,
        following_sentence=words.next_sentence(diagnosis),
        formula=diagnosis.formula,
        formula_share=percent(diagnosis.formula.share) if diagnosis.formula is not None else "",
        curves=_figures(diagnosis),
        most_signals=MOST_SIGNALS,
        most_recordings=MOST_RECORDINGS,
        signatures=tables.signature_lines(diagnosis),
        notes=words.notes(diagnosis),
        dropped=dict(sorted(diagnosis.dropped.items())),
        noise=[
            {"signal": each.signal, "noise": quantity(each.noise, each.unit), "source": each.source}
            for each in diagnosis.noise
        ],
        spent={
            "wall": f"{diagnosis.spent.wall_s:.0f}",
            "runs": diagnosis.spent.runs,
            "simulated": f"{diagnosis.spent.simulated_s:.0f}",
        },
    )


def _figures(diagnosis: Diagnosis) -> list[dict[str, Any]]:
    """Return the drawn signals, those that are off most first."""
    gaps = {each.signal: each.closing for each in diagnosis.signals}
    noise = {each.signal: each.noise for each in diagnosis.noise}
    by_signal: dict[str, list[Overlay]] = {}
    for overlay in diagnosis.overlays:
        by_signal.setdefault(overlay.signal, []).append(overlay)
    shown = sorted(by_signal, key=lambda name: -gaps[name].nominal)[:MOST_SIGNALS]
    chosen = {name: _worst(by_signal[name], noise) for name in shown}
    stretches = stretches_for(sum(map(len, chosen.values())))
    return [
        {
            "signal": name,
            "nominal": noise_units(gaps[name].nominal),
            "corrected": noise_units(gaps[name].with_effect),
            "open": place < _OPEN,
            "image": _embedded(overlay_svg(chosen[name], noise[name], stretches)),
        }
        for place, name in enumerate(shown)
    ]


def _worst(overlays: Sequence[Overlay], noise: Mapping[str, float]) -> list[Overlay]:
    """Return the recordings in which a signal is off most, in the order that they were given in."""

    def gap(overlay: Overlay) -> float:
        return float(((overlay.measured - overlay.nominal) ** 2).mean()) / noise[overlay.signal] ** 2

    kept = sorted(overlays, key=gap, reverse=True)[:MOST_RECORDINGS]
    return [overlay for overlay in overlays if any(overlay is each for each in kept)]


def _embedded(svg: str) -> Markup:
    data = base64.b64encode(svg.encode()).decode()
    return Markup("data:image/svg+xml;base64,{}").format(data)
