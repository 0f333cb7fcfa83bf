"""The page of a trial: one HTML file that needs no network; figures beside aims first, every case last."""

from __future__ import annotations

import base64
import io
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import jinja2
import matplotlib as mpl
from markupsafe import Markup
from matplotlib.figure import Figure as Sheet

from jammkle_common.command.results import STYLE
from studies.blind.cases import SIZES
from studies.blind.score import Outcome, main_cases

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from studies.blind.score import Case, Figure, WayScore


@dataclass(frozen=True)
class Row:
    """One figure of the score: its name there, what it says, and what it should be."""

    name: str
    text: str
    aim: str = ""
    least: float = float("-inf")
    most: float = float("inf")

    def is_met(self, value: float) -> bool:
        """Return whether a value is as it should be."""
        return self.least <= value <= self.most

    def shown(self, figures: Mapping[str, Figure]) -> str:
        """Return a figure with its interval, the number of cases that it is of, and whether an aim is met."""
        found = figures.get(self.name)
        if found is None:
            return "-"
        text = f"{found.value:.3g} of {found.count}"
        if found.interval is not None:
            low, high = found.interval
            text = f"{100 * found.value:.0f} % ({100 * low:.0f} to {100 * high:.0f} %) of {found.count}"
        return f"{text}, {'met' if self.is_met(found.value) else 'not met'}" if self.aim else text


FIGURES: Final = (
    Row("false_alarms", "false alarms of healthy machines", "at most 1 %", most=0.01),
    Row("top_1_from_4", "right name first, four times what an ideal one needs and above", "at least 95 %", 0.95),
    Row("top_1_at_2", "right name first, twice what an ideal one needs", "at least 80 %", 0.8),
    Row("pairs_exact", "pairs named exactly", "at least 60 %", 0.6),
    Row("pairs_in_set", "pairs named, or in the set", "at least 85 %", 0.85),
    Row("unknown_rejected", "outside the library and visible: said to be unknown", "at least 85 %", 0.85),
    Row("wrong_among_named", "wrong names among those named for certain", "at most 3 %", most=0.03),
    Row("probability_on_truth", "mean probability on the truth", "at least 0.85", 0.85),
    Row("calibration_error", "calibration error of the posterior", "below 0.05", most=0.05),
    Row("coverage", "sets that hold the truth", "at least 95 %", 0.95),
    Row("set_size", "mean size of a set", "below 1.6", most=1.6),
    Row("closed_of_ceiling", "gap closed, of what the ceiling closes", "at least 0.9", 0.9),
    Row("intervals_90", "90 % intervals that hold the truth", "85 to 95 %", 0.85, 0.95),
    Row("left_out_unnamed", "each effect left out once: nothing named for certain", "at least 95 %", 0.95),
    Row("top_1", "right name first, all that an ideal detector sees"),
    Row("top_2", "right name among two, all that an ideal detector sees"),
    Row("top_1_at_0", "right name first, less than an ideal detector needs"),
    Row("top_1_at_1", "right name first, just what an ideal detector needs"),
    Row("top_1_from_2", "right name first, twice and above"),
    Row("top_2_from_2", "right name among two, twice and above"),
    Row("ranked_from_2", "right name most probable whether or not a gap was seen, twice and above"),
    *(Row(f"detected_at_{size:g}", f"seen, {size:g} times what an ideal detector needs") for size in (0.0, *SIZES)),
    Row("pairs_first", "pairs first in the set"),
    Row("wrong_names", "wrong names among all cases"),
    Row("wrong_sets", "sets without the truth, among all cases"),
    Row("sets_exact", "sets that are complete without a false member (DXC 2026)"),
    Row("unknown_unnamed", "outside the library and visible: nothing named for certain"),
    Row("unknown_below_1", "outside the library, less than an ideal detector needs: said to be unknown"),
    Row("left_out_unknown", "each effect left out once: said to be unknown"),
    Row("midrun_safe", "change in mid-run: no wrong name, no wrong set"),
    Row("located", "right subsystem, twice and above, of those seen"),
    Row("refused", "refused"),
    Row("probability_on_truth_from_2", "mean probability on the truth, healthy or twice and above"),
    Row("probability_on_truth_of_faults_from_2", "mean probability on the truth, faults of twice and above"),
    Row("closed_of_oracle", "gap closed, of what the true effect closes"),
    Row("parameter_error", "error of a parameter, of its true size (median)"),
    Row("wall_s", "wall time of a diagnosis, s (median)"),
    Row("cpu_s", "processor time of a diagnosis, s (median)"),
    Row("simulator_runs", "simulator runs of a diagnosis (median)"),
)
"""In the order of the page; those with an aim first."""
_BY_PART = ("false_alarms", "detected_at_2", "top_1_at_2", "top_1_from_4", "top_2_from_2", "ranked_from_2",
            "pairs_exact", "unknown_rejected", "wrong_among_named", "coverage", "set_size")  # fmt: skip


def page(ways: Sequence[WayScore], others: Sequence[WayScore], facts: Mapping[str, Any]) -> str:
    """Return the page as HTML."""
    first, every = ways[0], [*ways, *others]
    rows = {row.name: row for row in FIGURES}
    aims = [row for row in FIGURES if row.aim and row.name in first.figures]
    tables = [
        ("Figures and aims", ["figure", "aim", *(way.name for way in every)], [
            [row.text, row.aim, *(row.shown(way.figures) for way in every)]
            for row in FIGURES if any(row.name in way.figures for way in every)
        ]),
        ("Rig by rig, cause by cause", ["part", "way", "cases", *(rows[name].text for name in _BY_PART)], [
            [part, way.name, str(way.parts[part][0]), *(rows[name].shown(way.parts[part][1]) for name in _BY_PART)]
            for part in first.parts for way in (first, others[0]) if part in way.parts
        ]),
        ("What became of the cases", ["way", "what is true", *(each.value for each in Outcome)], [
            [way.name, kind, *(str(row[each.value] or "") for each in Outcome)]
            for way in every for kind, row in way.outcomes.items()
        ]),
        ("Confusion matrix", *_confusion(main_cases(first.cases))),
        *((f"Every case: {way.name}", list(case_row(way.cases[0])),
           [[_text(each) for each in case_row(case).values()] for case in way.cases]) for way in every if way.cases),
    ]  # fmt: skip
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    return environment.from_string(Path(__file__).with_name("page.html.j2").read_text(encoding="utf-8")).render(
        met=sum(row.is_met(first.figures[row.name].value) for row in aims),
        asked=len(aims),
        facts={**facts, "in the figures": f"{len(main_cases(first.cases))} of {len(first.cases)} cases"},
        tables=tables,
        picture=_picture(ways),
    )


def _confusion(cases: Sequence[Case]) -> tuple[list[str], list[list[str]]]:
    pairs = [(case.label, case.answer.label) for case in cases]
    said = sorted({name for _, name in pairs}, key=lambda name: (name.isupper(), name))
    rows = [[row, *(str(pairs.count((row, name)) or "") for name in said)] for row in sorted({row for row, _ in pairs})]
    return ["what is true", *said], rows


def case_row(case: Case) -> dict[str, Any]:
    """Return one line of the table of cases, as plain numbers and texts."""
    name, value = case.likeliest
    return {
        "case": case.name,
        "rung": case.truth.rung.value,
        "kind": case.truth.kind.value,
        "rig": ", ".join(case.truth.rigs),
        "truth": case.label,
        "what": case.truth.what,
        "size": case.truth.size,
        "named": case.answer.label,
        "set": [sorted(names) for names in case.answer.candidates],
        "p_value": case.answer.p_value,
        "probability_on_truth": case.probability,
        "likeliest": name,
        "likeliest_probability": value,
        "located": case.answer.located,
        "outcome": case.outcome.value,
        "problem": case.answer.problem,
    }


def _text(value: Any) -> str:
    if isinstance(value, list):
        return " | ".join(" + ".join(names) for names in value)
    return "-" if value is None else f"{value:.3g}" if isinstance(value, float) else str(value)


def _picture(ways: Sequence[WayScore]) -> Markup:
    """Draw shares of single effects seen and named first, by size, and how often stated probabilities came true."""
    with mpl.rc_context(STYLE):
        sheet = Sheet(figsize=(11.0, 3.6))
        seen, named, calibrated = sheet.subplots(1, 3)
        for axes, prefix, title in ((seen, "detected_at", "seen"), (named, "top_1_at", "right name first")):
            for way in ways:
                there = [size for size in SIZES if f"{prefix}_{size:g}" in way.figures]
                _points(axes, there, [way.figures[f"{prefix}_{size:g}"] for size in there], way.name)
            axes.set(xscale="log", xlabel="size [what an ideal detector needs]", ylabel="share", title=title)
            axes.set_xticks(SIZES, [f"{size:g}" for size in SIZES])
        for way in ways:
            _points(calibrated, [each.stated for each in way.bins], [each.true for each in way.bins], way.name)
        calibrated.plot([0, 1], [0, 1], color="#999999", linestyle=":")
        calibrated.set(xlabel="probability that was stated", ylabel="share that came true", title="calibration")
        calibrated.legend(loc="upper left", fontsize="x-small")
        file = io.BytesIO()
        sheet.tight_layout()
        sheet.savefig(file, format="svg", metadata={"Date": None, "Creator": None})
    return Markup("data:image/svg+xml;base64,{}").format(base64.b64encode(file.getvalue()).decode())


def _points(axes: Any, x: Sequence[float], figures: Sequence[Figure], name: str) -> None:
    ends = [each.interval or (each.value, each.value) for each in figures]
    y = [each.value for each in figures]
    low = [max(value - end[0], 0.0) for value, end in zip(y, ends, strict=True)]
    high = [max(end[1] - value, 0.0) for value, end in zip(y, ends, strict=True)]
    axes.errorbar(x, y, [low, high], fmt="o-", markersize=4, label=name)
