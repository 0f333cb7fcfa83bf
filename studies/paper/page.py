"""The page: tables and figures of the paper beside the simulation, and what was chosen so that rows come out."""

from __future__ import annotations

import base64
import importlib.resources
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import jinja2
from markupsafe import Markup

from jammkle_sim.physics.ankle import AnkleParameters
from jammkle_sim.physics.feet import HardContact, SquashBallParameters
from jammkle_sim.physics.sensors import SensorParameters
from jammkle_sim.rigs.drop import DROP_ANKLE, HEIGHT_SCATTER_M, PRETENSION_SCATTER_M, DropOptions
from jammkle_sim.rigs.slip import Footing, SlipOptions
from studies.paper.runs import PARAMETER_SETS
from studies.paper.tables import DROP_TEST, RELATIVE, ROWS, SLIP_CLAIMS, STANDARD_ERRORS, TENSILE_TEST

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from studies.paper.comparison import ClaimComparison, HangingComparison, RowComparison, SlipStatistic, Statistic
    from studies.paper.figures import Picture
    from studies.paper.refit import FitResult

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
_REPEATED = "no_membrane_atm"
"""Row that the simulation cannot tell from the one with membrane: counted once."""
_COUNTED = tuple(row.identifier for row in ROWS if row.test == TENSILE_TEST and row.identifier != _REPEATED)
"""What the score is of. No drop row: each has something of its own that was chosen for it."""


@dataclass(frozen=True)
class Findings:
    """Everything the page shows."""

    seed: int
    repeats: int
    rows: Sequence[RowComparison]
    claims: Sequence[ClaimComparison]
    slips: Sequence[SlipStatistic]
    hanging: Sequence[HangingComparison]
    """The slip test on feet that hang."""
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
    slip = SlipOptions()
    return environment.from_string(source).render(
        seed=findings.seed,
        repeats=findings.repeats,
        standard_errors=STANDARD_ERRORS,
        relative=RELATIVE,
        total=len(_COUNTED),
        reproduced=_reproduced(findings.rows, _COUNTED),
        glance=glance,
        figures=figures,
        figure=_figure,
        tables=[_table(findings, *table) for table in _TABLES],
        claims=_claims(findings),
        feet=_feet(findings.slips),
        hanging=[_hanging(each) for each in findings.hanging],
        refuted=not any(each.holds for each in findings.hanging),
        broken=findings.broken,
        pi=math.pi,
        drop=DropOptions(),
        drop_ankle=DROP_ANKLE,
        height_scatter_m=HEIGHT_SCATTER_M,
        pretension_scatter_m=PRETENSION_SCATTER_M,
        ball=SquashBallParameters(),
        hard=HardContact(),
        sensors=SensorParameters(),
        slip=slip,
        slip_ankle=AnkleParameters(),
        footing=Footing(slip.slope_deg, slip.leg_m, AnkleParameters()),
        refit=_refit(findings.fit),
    )


def _reproduced(rows: Sequence[RowComparison], counted: Sequence[str]) -> dict[str, int]:
    """Count, by parameter set, which of the rows so named are reproduced."""
    return {
        each: sum(row.reproduced for row in rows if row.parameter_set == each and row.row.identifier in counted)
        for each in PARAMETER_SETS
    }


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
            "paper_largest": f"{row.largest:.3f}",
            "paper_mean": f"{row.mean:.3f}",
            "paper_se": f"{row.standard_error:.3f}",
            "sets": [_cells(by_key[row.identifier, each], digits, error_digits) for each in PARAMETER_SETS],
            "why": findings.reasons[row.identifier],
        }
        for row in ROWS
        if row.test == test
    ]
    return {"test": test, "title": title, "paper": paper, "text": text, "lines": lines}


def _cells(row: RowComparison, digits: int, error_digits: int) -> dict[str, Any]:
    return {
        "largest": f"{row.simulated.largest:.{digits}f}",
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
            {
                "before_heel": _with_error(slip.before_heel_n, 1),
                "peak": _with_error(slip.peak_n, 1),
                "energy": _with_error(slip.energy_j, 2),
            }
        )
    return [{"title": title, "sets": cells} for title, cells in sets.items()]


def _hanging(compared: HangingComparison) -> dict[str, Any]:
    held = [claim.text for claim in SLIP_CLAIMS if compared.claims.get(claim.identifier, (False, ""))[0]]
    return {
        "pitch": f"{compared.slip.pitch_deg:g}°",
        "friction": f"{compared.slip.friction:.2f}",
        "feet": [
            "wedges" if found is None else f"{found[0]:.1f} N, {found[1]:.2f} J" for found in compared.figures.values()
        ],
        "held": "; ".join(held) if held else "-" if compared.claims else "a rigid foot that wedges has no peak",
    }


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
