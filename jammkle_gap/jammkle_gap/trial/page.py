"""The page of a trial: one HTML file that needs no network; figures beside aims first, every case last."""

from __future__ import annotations

import base64
import importlib.resources
from typing import TYPE_CHECKING, Any

import jinja2
from markupsafe import Markup

from jammkle_gap.report.quantities import digits, percent, percents
from jammkle_gap.trial.aims import AIMS, OTHERS, Aim
from jammkle_gap.trial.key import Rung
from jammkle_gap.trial.pictures import calibration_svg, detection_svg
from jammkle_gap.trial.questions import Run
from jammkle_gap.trial.real import as_rows
from jammkle_gap.trial.result import (
    case_as_dict,
    confusion,
    diagnosed_by,
    main_cases,
    outcome_names,
    outcomes_by_kind,
)

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from jammkle_gap.trial.apart import NotApart
    from jammkle_gap.trial.real import RealCase
    from jammkle_gap.trial.result import Result, Way
    from jammkle_gap.trial.scoring import Figure

_TEMPLATE = "page.html.j2"
_NAMES = {Run.WITH: "with references", Run.WITHOUT: "without references"}
_LADDER = ("false_alarms", "wrong_names", "top_1_at_2", "top_1_from_4", "unknown_rejected", "probability_on_truth")
_COMPARED = (
    "false_alarms",
    "wrong_names",
    "unknown_rejected",
    "top_1_at_2",
    "top_1_from_4",
    "top_2_from_4",
    "pairs_exact",
)
_BY_NAME = {aim.figure: aim for aim in (*AIMS, *OTHERS)}


def page(result: Result, pairs: Sequence[NotApart] = (), real: Sequence[RealCase] = ()) -> str:
    """Return the page as HTML.

    Args:
        result: Of the trial.
        pairs: Effects that the rigs' sensors cannot tell apart, as far as that was looked at.
        real: What was said of real recordings, if it was asked.

    """
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    source = importlib.resources.files(__package__).joinpath(_TEMPLATE).read_text(encoding="utf-8")
    first = result.ways[0]
    met = [aim for aim in AIMS if aim.figure in first.figures and aim.is_met(first.figures[aim.figure].value)]
    asked = [aim for aim in AIMS if aim.figure in first.figures]
    return environment.from_string(source).render(
        facts=result.facts,
        diagnosed_by=diagnosed_by(result),
        answers_sha256=result.answers_sha256,
        met=len(met),
        asked=len(asked),
        cases=len(first.cases),
        main=len(main_cases(first.cases)),
        kinds={kind: sum(row.values()) for kind, row in outcomes_by_kind(main_cases(first.cases)).items()},
        ways=[_NAMES[way.run] for way in result.ways],
        aims=[_line(aim, result.ways) for aim in AIMS],
        others=[_line(aim, result.ways) for aim in OTHERS if any(aim.figure in way.figures for way in result.ways)],
        ladder=_ladder(result.ways),
        ladder_figures=[_BY_NAME[name].text for name in _LADDER],
        baselines=_baselines(first.figures, result.baselines),
        baseline_figures=[_BY_NAME[name].text for name in _COMPARED],
        outcome_names=outcome_names(),
        outcomes=[(_NAMES[way.run], outcomes_by_kind(main_cases(way.cases))) for way in result.ways],
        confusions=[(_NAMES[way.run], *confusion(main_cases(way.cases))) for way in result.ways],
        detection=_embedded(detection_svg(result.ways)),
        calibration=_embedded(calibration_svg(result.ways)),
        pairs=[_pair_line(pair) for pair in pairs],
        real=[{**row, "closed": percent(row["closed"]) if row["closed"] is not None else "-"} for row in as_rows(real)],
        lines=[(_NAMES[way.run], [_case_line(case_as_dict(case)) for case in way.cases]) for way in result.ways],
    )


def figure_text(aim: Aim, figure: Figure | None) -> str:
    """Return a figure with its interval and the number of cases that it is of."""
    if figure is None:
        return "-"
    if not aim.is_share:
        return f"{digits(figure.value)} (of {figure.count})"
    interval = f" ({percents(figure.interval)})" if figure.interval is not None else ""
    return f"{percent(figure.value)}{interval} of {figure.count}"


def _line(aim: Aim, ways: Sequence[Way]) -> dict[str, Any]:
    cells = []
    for way in ways:
        figure = way.figures.get(aim.figure)
        tone = ""
        if figure is not None and aim.aim:
            tone = "good-text" if aim.is_met(figure.value) else "bad-text"
        cells.append({"text": figure_text(aim, figure), "tone": tone})
    return {"text": aim.text, "aim": aim.aim, "cells": cells}


def _ladder(ways: Sequence[Way]) -> list[dict[str, Any]]:
    return [
        {
            "rung": rung.value,
            "way": _NAMES[way.run],
            "count": way.counts[rung],
            "cells": [figure_text(_BY_NAME[name], way.rungs[rung].get(name)) for name in _LADDER],
        }
        for rung in Rung
        for way in ways
        if rung in way.rungs
    ]


def _baselines(
    diagnosis: Mapping[str, Figure], baselines: Mapping[str, Mapping[str, Figure]]
) -> list[tuple[str, list[str]]]:
    rows = {"this diagnosis, with references": diagnosis, **baselines}
    return [
        (name, [figure_text(_BY_NAME[each], found.get(each)) for each in _COMPARED]) for name, found in rows.items()
    ]


def _pair_line(pair: NotApart) -> dict[str, str]:
    return {
        "effects": f"{pair.first}, {pair.second}",
        "apart": ", ".join(f"{rig} {percent(share)}" for rig, share in pair.apart.items()),
        "same_signals": ", ".join(pair.same_signals) or "-",
        "told_on": ", ".join(pair.told_on) or "no rig of the trial: it takes another sensor",
    }


def _case_line(line: Mapping[str, Any]) -> dict[str, Any]:
    size = line["size"]
    return {
        **line,
        "size": "-" if size is None else digits(size),
        "probability_on_truth": f"{line['probability_on_truth']:.2f}",
    }


def _embedded(svg: str) -> Markup:
    data = base64.b64encode(svg.encode()).decode()
    return Markup("data:image/svg+xml;base64,{}").format(data)
