"""The posterior: how probable each candidate is, and none of them, with conformal p-values beside."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
from matplotlib.figure import Figure

from jammkle_common.command.results import STYLE
from jammkle_gap.core.equivalence import class_names, class_of
from jammkle_gap.core.posterior import by_class
from jammkle_gap.core.result import Verdict
from jammkle_gap.report import words
from jammkle_gap.report.parameters import parameter_lines
from jammkle_gap.report.quantities import percent, probability
from jammkle_gap.report.rendering import TEXT, embedded, rendered

if TYPE_CHECKING:
    from collections.abc import Sequence

    from markupsafe import Markup

    from jammkle_gap.core.result import Diagnosis
    from jammkle_gap.report.asked import Asked

MOST_BARS = 8
"""Candidates with a bar of their own; the rest is one bar."""
_WORTH = 0.002
"""Probability from which on a candidate has a bar."""
_FRAME_IN = 0.55
"""Height of the chart beside its bars, inches."""
_IN_SET, _OUTSIDE, _NONE = "#1f5fa8", "#b9c4d0", "#a15c00"


@dataclass(frozen=True)
class Bar:
    """One bar of the chart."""

    label: str
    probability: float
    colour: str
    conformal: float | None = None
    """p-value; None: not known."""


def bars_of(diagnosis: Diagnosis) -> list[Bar]:
    """Return the bars, most probable first, one for each equivalence class; none of them always has one."""
    classes = class_names(diagnosis.classes)
    kept = {class_of(each.names, classes) for each in diagnosis.candidates}
    members: dict[tuple[str, ...], list[str]] = {}
    single: dict[tuple[str, ...], float | None] = {}
    for names in diagnosis.posterior:
        key = class_of(names, classes)
        members.setdefault(key, []).append(words.names_label(names))
        single.setdefault(key, diagnosis.conformal.get(names[0]) if len(names) == 1 else None)
    found: list[Bar] = []
    rest, left = 0.0, 0
    for key, value in by_class(diagnosis.posterior, classes).items():
        if key and (len(found) >= MOST_BARS or value < _WORTH):
            rest, left = rest + value, left + 1
            continue
        colour = _NONE if not key else _IN_SET if key in kept else _OUTSIDE
        found.append(Bar(" = ".join(members[key]), value, colour, single[key]))
    return [*found, Bar(f"the other {left} together", rest, _OUTSIDE)] if left else found


def section(diagnosis: Diagnosis, asked: Asked) -> Markup:
    """Return the section as HTML."""
    return rendered(
        __package__,
        "posterior.html.j2",
        chart=_chart(bars_of(diagnosis)) if diagnosis.posterior else "",
        has_gap=diagnosis.verdict is not Verdict.NO_GAP,
        offered=len(asked.sentences),
        library=asked.library,
        has_conformal=bool(diagnosis.conformal),
        candidates=[_line(diagnosis, each) for each in diagnosis.candidates],
    )


def _line(diagnosis: Diagnosis, candidate: Any) -> dict[str, str]:
    p_value = diagnosis.conformal.get(candidate.names[0]) if len(candidate.names) == 1 else None
    return {
        "label": words.candidate_label(candidate),
        "probability": probability(candidate.probability),
        "explained": percent(candidate.explained) if candidate.names else "",
        "conformal": "" if p_value is None else f"{p_value:.2g}",
        "parameters": "; ".join(
            f"{line['parameter']} {line['value']} ({line['interval']})" for line in parameter_lines(candidate.effects)
        ),
    }


def _chart(bars: Sequence[Bar]) -> Markup:
    with mpl.rc_context({**STYLE, **TEXT, "axes.grid": False}):
        figure = Figure(figsize=(7.5, _FRAME_IN + 0.3 * len(bars)))
        figure.subplots_adjust(left=0.46, right=0.86, top=0.99, bottom=0.42 / (_FRAME_IN + 0.3 * len(bars)))
        axes = figure.subplots()
        places = list(range(len(bars)))
        axes.barh(places, [each.probability for each in bars], color=[each.colour for each in bars], height=0.66)
        axes.set_yticks(places, [_cut(each.label) for each in bars])
        axes.invert_yaxis()
        axes.set_xlim(0.0, 1.0)
        axes.set_xlabel("probability, given a gap")
        axes.tick_params(axis="y", length=0)
        for place, each in zip(places, bars, strict=True):
            told = "" if each.conformal is None else f"   p {each.conformal:.2g}"
            axes.text(each.probability + 0.01, place, f"{probability(each.probability)}{told}", va="center", fontsize=8)
        return embedded(figure)


def _cut(text: str, most: int = 52) -> str:
    return text if len(text) <= most else f"{text[: most - 3]}..."
