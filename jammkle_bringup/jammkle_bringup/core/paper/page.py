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
_BY_CONSTRUCTION = (
    "The drop rows are met by construction and do not test the model. Chosen so that they come out: the pose (40° "
    "toe-down), the lever of the toe (49.4 mm), the pretension (0.5 mm) and the arm of the Achilles tendons (37.4 mm) "
    "for the two ankles; the cubic stiffness of the squash ball; the hard contact and the limit of the IMU for the two "
    "clipped rows. The gains of the relaxation were taken over from an earlier fit to the two ankle rows in another "
    "pose (38°, toe at 60 mm). The tensile rows are what the other constants of the tendon were fitted to: eleven "
    "constants, some of them fitted to a reference model as well, to eight different peaks."
)
_SCATTER = (
    "The repeats are not independent: what differs between them follows a low-discrepancy sequence. From seed to seed "
    "the mean of five so scatters by 0.31 to 0.35 of a repeat's standard deviation, where that of independent repeats "
    "scatters by 0.45; the standard errors shown are computed as if they were independent (0.46), and are no measure "
    "of the paper's scatter, as the widths were chosen. "
    "What differs: in the tensile test the clamped length (0.19 mm, chosen so that the A-30 tendon scatters as in the "
    "paper); in the drop test the height (0.6 mm, chosen so that the squash ball does) and the pretension (0.7 mm, "
    "chosen towards the paper's scatter of the two ankles); in the slip test of the two ankles the friction (0.01) and "
    "the slope (0.2°), and of the rigid ankle the friction of its edge alone (0.001, downwards only), all assumed; "
    "everywhere the sensors' noise. The widths are standard deviations."
)
_RIGID_SLIP = (
    "Not reproduced: that the rigid ankle peaks like the unjammed one before it slides. Where it says so above, the "
    "rigid peak is a choice: it depends on the friction of the edge, on the assumed damping of the ball joint (35.2 N "
    "without, 26.0 N with the 0.005 N m s used here, 10.4 N with 0.05) and on the speed (8.8 N at 1 mm/s, 35.1 N at "
    "20 mm/s). The peaks of the other "
    "two are no onset of sliding either: they come when the heel lands flat, for the unjammed ankle after 49 mm, where "
    "its force jumps from 29 to 52 N."
)
_BOUNCE = (
    "Not reproduced: that both ankles are critically damped in the drop while the standard foot and the rigid ankle "
    "bounce significantly. Only peaks were fitted: the simulated jammed ankle leaves the ground again for about 0.1 s."
)
_BREAK = (
    "Not reproduced: the force at the break. At 55 mm the unjammed multi-material tendon bears 116 N in the long term, "
    "and 136 N when pulled at 5 mm/s, where 150 ± 8 N is expected; the fit ends at 20 mm."
)
_NOTES = (_BY_CONSTRUCTION, _RIGID_SLIP, _BOUNCE, _BREAK, _SCATTER, _READINGS, _MEMBRANE, _ASSUMPTIONS)
_TENDON_FREE = ("rigid_ankle", "standard_foot", "squash_ball")
"""Rows in which no tendon takes part. They come out alike with any constants of the tendon: not in the score."""
_REPEATED = "no_membrane_atm"
"""Row that the simulation cannot tell from the one with membrane: counted once."""
_COUNTED = (
    (
        "tensile rows (without the one without membrane, which repeats the one with it)",
        tuple(row.identifier for row in ROWS if row.test == TENSILE_TEST and row.identifier != _REPEATED),
    ),
    (
        "drop rows of the ankle",
        tuple(row.identifier for row in ROWS if row.test == DROP_TEST and row.identifier not in _TENDON_FREE),
    ),
)
"""What the score is of: rows that tendons decide."""


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
        scores=[
            {"text": text, "total": len(counted), "reproduced": _reproduced(findings.rows, counted)}
            for text, counted in _COUNTED
        ],
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
