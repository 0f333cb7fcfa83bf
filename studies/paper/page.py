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

    from studies.paper.comparison import ClaimComparison, RowComparison, SlipStatistic, Statistic
    from studies.paper.figures import Picture
    from studies.paper.refit import FitResult

_MM, _MS = 1e3, 1e3
_ANKLES = "the two ankles"
_HARD = "rigid ankle, standard foot"
_BALL = "squash ball"


@dataclass(frozen=True)
class Choice:
    """One thing of the drop rig that the paper does not tell."""

    what: str
    value: str
    so_that: str
    """What it was chosen for, to follow `chosen so that`."""
    feet: str
    """Whose row it decides."""


def drop_choices() -> tuple[Choice, ...]:
    """Return everything of the drop rig that was chosen so that something comes out, as it now stands in the code."""
    options, hard, ball = DropOptions(), HardContact(), SquashBallParameters()
    softness, depth = DROP_ANKLE.contact_impedance
    return (
        Choice(
            "pose at landing",
            f"{options.pitch_deg:g}° toe-down",
            "the ankle has way to yield, and the heel strikes in no repeat",
            _ANKLES,
        ),
        Choice(
            "lever of the toe", f"{DROP_ANKLE.toe_m * _MM:.1f} mm", "both means come out, with the two below", _ANKLES
        ),
        Choice("pretension of the Achilles tendons", f"{options.pretension_m * _MM:.1f} mm", "as above", _ANKLES),
        Choice("arm of the Achilles tendons", f"{DROP_ANKLE.achilles_arm_m * _MM:.1f} mm", "as above", _ANKLES),
        Choice(
            "contact of the toe",
            f"{DROP_ANKLE.contact_time_s * _MS:g} ms, impedance {softness:g} to {depth:g}",
            "the toe keeps touching while the foot turns, and half the time step moves no peak by 1 %",
            _ANKLES,
        ),
        Choice("friction of the floor", f"{options.friction:g}", "the toe does not lock at the first touch", "all"),
        Choice(
            "stiffness of the squash ball, cubic part",
            f"{ball.cubic_stiffness_n_m3:.1e} N/m³",
            "its mean comes out, with the damping below",
            _BALL,
        ),
        Choice(
            "damping of the squash ball",
            f"{ball.damping_n_s_m:g} N s/m",
            "as above; the leg then rebounds to 22 % of the height, where the rules of the game ask 12 % of a ball by "
            "itself",
            _BALL,
        ),
        Choice(
            "contact of the hard feet",
            f"{hard.time_s * _MS:g} ms, damping ratio {hard.damping_ratio:g}",
            "they clip the sensor for some milliseconds and bounce",
            _HARD,
        ),
        Choice(
            "range of the accelerometer",
            f"{SensorParameters().acceleration_limit_m_s2:.2f} m/s² raw",
            "what is clipped reads as in the paper",
            _HARD,
        ),
        Choice(
            "scatter of the height",
            f"{HEIGHT_SCATTER_M * _MM:.1f} mm",
            "the squash ball scatters as in the paper",
            "all, standard error",
        ),
        Choice(
            "scatter of the pretension",
            f"{PRETENSION_SCATTER_M * _MM:.1f} mm",
            "the ankles scatter towards the paper's",
            f"{_ANKLES}, standard error",
        ),
    )


def slip_condition() -> str:
    """Return under which condition the rigid ankle of the slip test is well-posed, with its friction and the limit."""
    options = SlipOptions()
    ankle = AnkleParameters()
    footing = Footing(options.slope_deg, options.leg_m, ankle)
    limit, margin_deg = footing.wedging_friction, math.degrees(footing.angle_to_normal_rad)
    return (
        f"Declared condition of the rigid ankle: the friction of its edge on the plywood is {options.edge_friction:g} "
        f"(assumed; option --edge-friction of jammkle rig slip), the limit from which on it wedges so that no force "
        f"moves it is {limit:.3f} (the tangent of the {margin_deg:.1f}° between the slope's normal and the line from "
        f"toe to ball joint). The two other feet have {options.friction:g}, with which a rigid foot wedges. The leg "
        f"starts hanging still. Contact, lever of the toe, {ankle.toe_m * _MM:g} mm, and pretension of the Achilles "
        f"tendons, {ankle.achilles_pretension_m * _MM:g} mm, are assumed, and not those chosen for the drop test."
    )


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
_READINGS = (
    "The paper's 80 mm of fibre against sections of 30 and 55 mm are read as 5 mm of the stiff section inside the end "
    "plate; its three solenoids for four tendons as left, right, and the Achilles pair."
)
_MEMBRANE = (
    "The membrane carries no load of its own in the simulation, so that the row without membrane repeats the row with "
    "it; the paper finds the two equal within their errors."
)
_ASSUMPTIONS = (
    "What is neither fitted nor listed as chosen, such as both frictions and the ball joint of the slip test and "
    "everything pneumatic, is assumed: the paper says nothing of it. It stands with its source in jammkle_sim/physics "
    "and jammkle_sim/rigs."
)
_BY_CONSTRUCTION = (
    "The drop rows are met by construction: what was chosen so that they come out is listed below their table, and "
    "none of them is counted as reproduced. The gains of the relaxation were taken over from an earlier fit to the "
    "two ankle rows in another pose (38°, toe at 60 mm). The tensile rows are what the other constants of the tendon "
    "were fitted to: eleven constants, some of them fitted to a reference model as well, to eight different peaks."
)
_SCATTER = (
    "The repeats are not independent: what differs between them follows a low-discrepancy sequence. From seed to seed "
    "the mean of five so scatters by 0.31 to 0.35 of a repeat's standard deviation, where that of independent repeats "
    "scatters by 0.45; the standard errors shown are computed as if they were independent (0.46), and are no measure "
    "of the paper's scatter, as the widths were chosen. What differs: in the tensile test the clamped length (0.19 "
    "mm, chosen so that the A-30 tendon scatters as in the paper); in the drop test height and pretension, as listed "
    "there; in the slip test the friction (0.01) and the slope (0.2°), both assumed; everywhere the sensors' noise. "
    "The widths are standard deviations."
)
_RIGID_SLIP = (
    "Not reproduced: that the rigid ankle peaks like the unjammed one before it slides. A light leg on a free ball "
    "joint bears force only along the line from toe to joint. Below the friction that wedges it, it slides at the "
    "first touch and pushes with what its own weight makes: 0.166 to 0.172 J and at most 4.2 N for time steps of 0.2 "
    "to 1 ms, a ball joint's damping of 0 to 0.05 N m s and 1 to 5 mm/s. Nearer to the limit the peak is the blow of "
    "the touch and goes with the speed: at 5 mm/s 13 N with a friction of 0.40, 34 N with 0.43. From the limit on it "
    "does not slide, and its peak is what the rig bears: a drive that gives way at 30 N, or at 60 N, makes it that. "
    "Only a friction known to 0.005, or a limit of the rig's force, both chosen for it, would give the claimed peak. "
    "The two other claims hold with every friction of the edge up to 0.43, where the rigid ankle takes up 0.24 J. "
    "Feet that hang toe-down as in the drop test do not reproduce it: by 40 degrees and with one friction for all, up "
    "to 0.58 all three slide at the first touch (at 0.55 rigid 2.1, unjammed and jammed 2.2 N); from 0.59 on the rigid "
    "one wedges, where unjammed and jammed slide at 104 and 142 N (friction of 0.65)."
)
_HEEL = (
    "The two ankles stand on the toe without sliding until the heel lands flat; there the force jumps, and the foot "
    "slides from there on. What the claims compare is the peak before; the peak of the whole descent stands beside "
    "it."
)
_BOUNCE = (
    "Not reproduced: that both ankles are critically damped in the drop while the standard foot and the rigid ankle "
    "bounce significantly. Only peaks were fitted: both simulated ankles leave the ground again, the jammed one for "
    "about 0.1 s and once more, the unjammed one for 0.06 s."
)
_BREAK = (
    "Not known: the force at the break. The paper prints none, and the fit ends at 20 mm. At 55 mm the unjammed "
    "multi-material tendon bears 116 N in the long term, and 136 N when pulled at 5 mm/s. The 150 ± 8 N that an "
    "elastic model of the same rows gives is met only with fibres as stiff as at 20 mm of that pull."
)
_NOTES = (_BY_CONSTRUCTION, _RIGID_SLIP, _HEEL, _BOUNCE, _BREAK, _SCATTER, _READINGS, _MEMBRANE, _ASSUMPTIONS)
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
        total=len(_COUNTED),
        reproduced=_reproduced(findings.rows, _COUNTED),
        glance=glance,
        figures=figures,
        figure=_figure,
        tables=[_table(findings, *table) for table in _TABLES],
        claims=_claims(findings),
        feet=_feet(findings.slips),
        slip_condition=slip_condition(),
        choices={DROP_TEST: drop_choices()},
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
