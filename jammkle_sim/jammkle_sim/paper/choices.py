"""What was chosen so that the drop test comes out, and what the slip test declares: values from the code itself."""

from __future__ import annotations

import math
from dataclasses import dataclass

from jammkle_sim.physics.ankle import AnkleParameters
from jammkle_sim.physics.feet import HardContact, SquashBallParameters
from jammkle_sim.physics.sensors import SensorParameters
from jammkle_sim.rigs.drop import DROP_ANKLE, HEIGHT_SCATTER_M, PRETENSION_SCATTER_M, DropOptions
from jammkle_sim.rigs.slip import SlipOptions
from jammkle_sim.rigs.wedging import Footing

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
