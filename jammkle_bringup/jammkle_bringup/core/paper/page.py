"""One HTML page that needs nothing but itself: tables, figures, claims, notes."""

from __future__ import annotations

import base64
import importlib.resources
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import jinja2
from markupsafe import Markup

from jammkle_bringup.core.paper.comparison import RELATIVE, STANDARD_ERRORS
from jammkle_bringup.core.paper.experiments import PARAMETER_SETS
from jammkle_sim.paper_tables import DROP_TEST, ROWS, SLIP_CLAIMS, TENSILE_TEST

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from jammkle_bringup.core.paper.comparison import ClaimComparison, RowComparison, SlipStatistic, Statistic
    from jammkle_bringup.core.paper.drawing import Picture
    from jammkle_sim.fit.refit import FitResult

_TEMPLATE = "page.html.j2"
_TABLES = (
    (
        TENSILE_TEST,
        "Tensile test of one tendon",
        "Table II",
        "Peak force, N, while the tendon is pulled to 20 mm at 5 mm/s and let back.",
    ),
    (
        DROP_TEST,
        "Drop test of five feet",
        "Table III",
        (
            "Peak upward acceleration less gravity, m/s², of 1.8 kg that falls 50 mm. The paper marks the rigid ankle "
            "and the standard foot as clipped by the sensor."
        ),
    ),
)
_DIGITS = {TENSILE_TEST: (2, 3), DROP_TEST: (3, 3)}
"""Decimals of a mean and of a standard error."""
_MANY_ERRORS = 100.0
_NO_BREAK = "\N{NO-BREAK SPACE}"
_SLIP_CONDITION = (
    "A rigid foot under a ball joint either slides at once or wedges so that no force moves it; the friction of its "
    "edge is declared (option --edge-friction of jammkle rig slip), not measured, and its peak force hangs on it."
)
_READINGS = (
    "The paper's 80 mm of fibre against sections of 30 and 55 mm are read as 5 mm of the stiff section inside the end "
    "plate; its three solenoids for four tendons as left, right, and the Achilles pair."
)
_MEMBRANE = (
    "The membrane carries no load of its own in the simulation, so that the row without membrane repeats the row with "
    "it; the paper finds the two equal within their errors."
)
_ASSUMPTIONS = (
    "The pose of the foot at landing, its levers, the floor's friction, the ball joint of the slip test and everything "
    "pneumatic are assumptions: the paper says nothing of them. They stand with their sources in jammkle_sim/physics "
    "and jammkle_sim/rigs."
)
_SCATTER = (
    "The scatter between simulated repeats comes from what a rig cannot set exactly (clamping, height, pitch, "
    "friction), and from the sensors' noise."
)
_NOTES = (_READINGS, _MEMBRANE, _ASSUMPTIONS, _SCATTER)


@dataclass(frozen=True)
class Findings:
    """Everything the page shows."""

    seed: int
    repeats: int
    rows: Sequence[RowComparison]
    claims: Sequence[ClaimComparison]
    slips: Sequence[SlipStatistic]
    pictures: Sequence[Picture]
    reasons: Mapping[str, str]
    """Why the printed constants miss or do not, one sentence per identifier of a row or claim."""
    broken: Sequence[str]
    """Runs in which tendons tore."""
    fit: FitResult | None = None
    """The fit, if it was done again."""


def page(findings: Findings) -> str:
    """Return the page as HTML."""
    environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True)
    source = importlib.resources.files(__package__).joinpath(_TEMPLATE).read_text(encoding="utf-8")
    glance, *figures = findings.pictures
    return environment.from_string(source).render(
        seed=findings.seed,
        repeats=findings.repeats,
        standard_errors=STANDARD_ERRORS,
        relative=RELATIVE,
        total=len(ROWS),
        reproduced={
            parameter_set: sum(row.reproduced for row in findings.rows if row.parameter_set == parameter_set)
            for parameter_set in PARAMETER_SETS
        },
        glance=glance,
        figures=figures,
        figure=_figure,
        tables=[_table(findings, *table) for table in _TABLES],
        claims=_claims(findings),
        feet=_feet(findings.slips),
        slip_condition=_SLIP_CONDITION,
        notes=[*_NOTES, *(f"A tendon tore: {line}." for line in findings.broken)],
        refit=_refit(findings.fit),
    )


def _figure(picture: Picture) -> Markup:
    data = base64.b64encode(picture.svg.encode()).decode()
    source = Markup(' <span class="source">{}</span>').format(picture.paper) if picture.paper else Markup()
    return Markup(
        '<figure id="figure-{}"><h3>{}{}</h3><img alt="{}" src="data:image/svg+xml;base64,{}">'
        "<figcaption>{}</figcaption></figure>"
    ).format(picture.identifier, picture.title, source, picture.title, data, picture.caption.replace("`", ""))


def _table(findings: Findings, test: str, title: str, paper: str, text: str) -> dict[str, Any]:
    digits, error_digits = _DIGITS[test]
    by_key = {(row.row.identifier, row.parameter_set): row for row in findings.rows}
    lines = [
        {
            "identifier": row.identifier,
            "title": row.title.replace(" kPa", f"{_NO_BREAK}kPa"),
            "paper_mean": f"{row.mean:.3f}",
            "paper_se": f"{row.standard_error:.3f}",
            "sets": [_cells(by_key[row.identifier, each], digits, error_digits) for each in PARAMETER_SETS],
            "why": findings.reasons[row.identifier],
        }
        for row in ROWS
        if row.test == test
    ]
    return {"title": title, "paper": paper, "text": text, "lines": lines}


def _cells(row: RowComparison, digits: int, error_digits: int) -> dict[str, Any]:
    return {
        "mean": f"{row.simulated.mean:.{digits}f}",
        "standard_error": _number(row.simulated.standard_error, error_digits),
        "z": _signed(row.z),
        "reproduced": row.reproduced,
    }


def _claims(findings: Findings) -> list[dict[str, Any]]:
    by_key = {(claim.claim.identifier, claim.parameter_set): claim for claim in findings.claims}
    return [
        {
            "identifier": claim.identifier,
            "text": f"{claim.text[0].upper()}{claim.text[1:]}",
            "sets": [by_key[claim.identifier, each] for each in PARAMETER_SETS],
            "why": findings.reasons[claim.identifier],
        }
        for claim in SLIP_CLAIMS
    ]


def _feet(slips: Sequence[SlipStatistic]) -> list[dict[str, Any]]:
    sets: dict[str, list[dict[str, str]]] = {}
    for slip in slips:
        sets.setdefault(slip.title, []).append(
            {"peak": _with_error(slip.peak_n, 1), "energy": _with_error(slip.energy_j, 2)}
        )
    return [{"title": title, "sets": cells} for title, cells in sets.items()]


def _refit(fit: FitResult | None) -> dict[str, Any] | None:
    if fit is None:
        return None
    verdict = "reproduces the committed constants" if fit.reproduces_committed else "does NOT give the committed ones"
    return {
        "text": f"From the start values, after {fit.evaluations} sets of constants that were tried, the fit {verdict}: "
        f"the largest difference is {fit.largest_deviation:.2%}. The fast law then differs from the reference model "
        f"by {fit.reference_rms_n:.2f} N in the root mean square over load and return.",
        "constants": [
            {
                "name": constant.unknown.name,
                "unit": "" if constant.unknown.unit == "1" else constant.unknown.unit,
                "committed": f"{constant.committed:.5g}",
                "fitted": f"{constant.fitted:.5g}",
                "deviation": f"{constant.deviation:+.2%}",
                "fitted_to": constant.unknown.fitted_to,
            }
            for constant in fit.constants
        ],
    }


def _signed(z: float) -> str:
    return f"{z:+.0f}" if abs(z) >= _MANY_ERRORS else f"{round(z, 1) + 0.0:+.1f}"  # 0 added: no -0.0


def _number(value: float, digits: int) -> str:
    return "-" if math.isnan(value) else f"{value:.{digits}f}"


def _with_error(statistic: Statistic, digits: int) -> str:
    if math.isnan(statistic.standard_error):
        return f"{statistic.mean:.{digits}f}"
    return f"{statistic.mean:.{digits}f} ± {statistic.standard_error:.{digits}f}"
