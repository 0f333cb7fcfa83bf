"""The page of a trial: one HTML file that needs no network; figures beside aims first, every case last."""

from __future__ import annotations

import base64
import importlib.resources
from typing import TYPE_CHECKING, Any

import jinja2
from markupsafe import Markup

from jammkle_gap.report.words import digits, percent, percents
from studies.blind.aims import AIMS, BY_RIG, OTHERS, Aim
from studies.blind.key import Rung
from studies.blind.pictures import calibration_svg, detection_svg
from studies.blind.real import as_rows
from studies.blind.result import case_as_dict, diagnosed_by
from studies.blind.tables import confusion, outcome_names, outcomes_by_kind
from studies.blind.tasks import CEILINGS, ONE_IN
from studies.blind.ways import main_cases
from studies.blind.whitened import FALSE_ALARMS, HEALTHY, POWER

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from studies.blind.apart import NotApart
    from studies.blind.real import RealCase
    from studies.blind.result import Result
    from studies.blind.scoring import Figure
    from studies.blind.ways import Way

_TEMPLATE = "page.html.j2"
_LADDER = ("false_alarms", "wrong_names", "top_1_at_2", "top_1_from_4", "unknown_rejected", "probability_on_truth")
_COMPARED = (
    "false_alarms",
    "wrong_among_named",
    "unknown_rejected",
    "top_1_at_2",
    "top_1_from_4",
    "ranked_at_2",
    "ranked_from_4",
    "top_2_from_4",
    "pairs_exact",
)
_BY_CAUSE = ("detected_at_2", "top_1_from_2", "ranked_from_2", "top_2_from_2", "unknown_rejected")
_NO_WORSE = ("top_1_at_2", "top_1_from_4")
"""Figures in which no rig may be worse than the ranking by error on the same cases."""
_BY_NAME = {aim.figure: aim for aim in (*AIMS, *OTHERS)} | {
    "ranked_from_2": Aim("ranked_from_2", "right name most probable, twice and above", "")
}


def page(result: Result, pairs: Sequence[NotApart] = (), real: Sequence[RealCase] = ()) -> str:
    """Return the page as HTML.

    Args:
        result: Of the trial.
        pairs: Effects that were declared equivalent, and what would split them.
        real: What was said of real recordings, if it was asked.

    """
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    source = importlib.resources.files(__package__).joinpath(_TEMPLATE).read_text(encoding="utf-8")
    first = result.ways[0]
    met = [aim for aim in AIMS if aim.figure in first.figures and aim.is_met(first.figures[aim.figure].value)]
    asked = [aim for aim in AIMS if aim.figure in first.figures]
    ceiling = result.ceiling or ()
    return environment.from_string(source).render(
        facts=result.facts,
        diagnosed_by=diagnosed_by(result),
        answers_sha256=result.answers_sha256,
        met=len(met),
        asked=len(asked),
        cases=len(first.cases),
        main=len(main_cases(first.cases)),
        kinds={kind: sum(row.values()) for kind, row in outcomes_by_kind(main_cases(first.cases)).items()},
        ways=[way.name for way in result.ways],
        sampled=len(result.ways) > 1 and len(result.ways[1].cases) < len(first.cases),
        one_in=ONE_IN,
        ceilings=CEILINGS,
        healthy=HEALTHY,
        power=percent(POWER),
        alarms=percent(FALSE_ALARMS),
        aims=[_line(aim, result.ways) for aim in AIMS],
        others=[_line(aim, result.ways) for aim in OTHERS if any(aim.figure in way.figures for way in result.ways)],
        rig_figures=[_BY_NAME[name].text for name in BY_RIG],
        rigs=_rigs(first, result.baselines),
        cause_figures=[_BY_NAME[name].text for name in _BY_CAUSE],
        causes=[(name, _cells(found, _BY_CAUSE)) for name, found in first.effects.items()],
        ladder=_ladder(result.ways[:1]),
        ladder_figures=[_BY_NAME[name].text for name in _LADDER],
        ceiling_ways=[way.name for way in ceiling],
        ceiling=[_line(aim, ceiling) for aim in (*AIMS, *OTHERS) if any(aim.figure in way.figures for way in ceiling)],
        baselines=[(way.name, _cells(way.figures, _COMPARED)) for way in (first, *result.baselines)],
        baseline_figures=[_BY_NAME[name].text for name in _COMPARED],
        outcome_names=outcome_names(),
        outcomes=[(way.name, outcomes_by_kind(main_cases(way.cases))) for way in result.ways],
        confusions=[(way.name, *confusion(main_cases(way.cases))) for way in result.ways],
        detection=_embedded(detection_svg(result.ways)),
        calibration=_embedded(calibration_svg(result.ways)),
        pairs=[_pair_line(pair) for pair in pairs],
        real=[{**row, "closed": percent(row["closed"]) if row["closed"] is not None else "-"} for row in as_rows(real)],
        lines=[(way.name, [_case_line(case_as_dict(case)) for case in way.cases]) for way in result.ways],
    )


def figure_text(aim: Aim, figure: Figure | None) -> str:
    """Return a figure with its interval and the number of cases that it is of."""
    if figure is None:
        return "-"
    if not aim.is_share:
        return f"{digits(figure.value)} (of {figure.count})"
    interval = f" ({percents(figure.interval)})" if figure.interval is not None else ""
    return f"{percent(figure.value)}{interval} of {figure.count}"


def _cells(found: Mapping[str, Figure], names: Sequence[str]) -> list[str]:
    return [figure_text(_BY_NAME[name], found.get(name)) for name in names]


def _line(aim: Aim, ways: Sequence[Way]) -> dict[str, Any]:
    cells = []
    for way in ways:
        figure = way.figures.get(aim.figure)
        tone = ""
        if figure is not None and aim.aim:
            tone = "good-text" if aim.is_met(figure.value) else "bad-text"
        cells.append({"text": figure_text(aim, figure), "tone": tone})
    return {"text": aim.text, "aim": aim.aim, "cells": cells}


def _rigs(first: Way, baselines: Sequence[Way]) -> list[dict[str, Any]]:
    """Return a line per rig, and below it the ranking by error on the same cases, which should be no better."""
    lines = []
    simple = baselines[0]
    for rig, found in first.rigs.items():
        other = simple.rigs.get(rig, {})
        tones = [
            "bad-text"
            if name in _NO_WORSE and name in found and name in other and found[name].value < other[name].value
            else ""
            for name in BY_RIG
        ]
        own = [{"text": text, "tone": tone} for text, tone in zip(_cells(found, BY_RIG), tones, strict=True)]
        lines.append({"rig": rig, "who": "this diagnosis", "cells": own})
        cells = [{"text": text, "tone": ""} for text in _cells(other, BY_RIG)]
        lines.append({"rig": "", "who": simple.name, "cells": cells})
    return lines


def _ladder(ways: Sequence[Way]) -> list[dict[str, Any]]:
    return [
        {"rung": rung.value, "way": way.name, "count": way.counts[rung], "cells": _cells(way.rungs[rung], _LADDER)}
        for rung in Rung
        for way in ways
        if rung in way.rungs
    ]


def _pair_line(pair: NotApart) -> dict[str, str]:
    return {
        "effects": f"{pair.first}, {pair.second}",
        "declared": ", ".join(f"{rig} {count} of {total}" for rig, (count, total) in pair.declared.items()),
        "way_out": pair.way_out,
    }


def _case_line(line: Mapping[str, Any]) -> dict[str, Any]:
    return {
        **line,
        "size": "-" if line["size"] is None else digits(line["size"]),
        "scatter": "-" if line["scatter"] is None else digits(line["scatter"]),
        "p_value": "-" if line["p_value"] is None else f"{line['p_value']:.2g}",
        "probability_on_truth": f"{line['probability_on_truth']:.2f}",
        "members": " | ".join(" + ".join(names) for names in line["set"]),
    }


def _embedded(svg: str) -> Markup:
    data = base64.b64encode(svg.encode()).decode()
    return Markup("data:image/svg+xml;base64,{}").format(data)
