"""The slip rig: a leg on a free ball joint is pushed down onto a plywood slope, toe uphill, at constant speed."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from jammkle_graph import names
from jammkle_graph.parameters import ParameterError, parameter
from jammkle_sim.physics.ankle import AnkleParameters, add_ankle
from jammkle_sim.physics.constants import tendon_parameters
from jammkle_sim.physics.engine import mujoco
from jammkle_sim.physics.feet import JAMMED, RIGID_ANKLE, UNJAMMED, HardContact, add_rigid_ankle
from jammkle_sim.physics.pneumatics import PneumaticParameters
from jammkle_sim.physics.sensors import SensorParameters
from jammkle_sim.rigs.evaluate import smoothed, work_j
from jammkle_sim.rigs.model import (
    add_carriage,
    add_drive,
    add_imu_sensors,
    add_load_cell,
    add_slope,
    ankle_laws,
    compile_with_start,
    new_spec,
    set_speed,
    touch_down_height_m,
    weigh,
)
from jammkle_sim.rigs.options import (
    jammed_vacuum_option,
    parameter_set_option,
    replaced_within_range,
    run_timestep_option,
    seed_option,
)
from jammkle_sim.rigs.rig import Event, Rig
from jammkle_sim.rigs.run import LEG_TOPICS, Programme, Series
from jammkle_sim.rigs.vacuum import all_channels

if TYPE_CHECKING:
    from collections.abc import Mapping


FEET = (RIGID_ANKLE, JAMMED, UNJAMMED)
"""Feet of the paper's slip test."""
_JAM_S = 0.05
_PUSH_S = 1.0
"""When the carriage starts down: the vacuum stands by then."""
_HOLD_S = 0.5
"""Recorded time after the halt."""
_CLEARANCE_M = 0.001
"""From the toe to the slope at the start."""
_CARRIAGE_KG = 10.0
_SERVO_RAD_S = 700.0
"""Stiff: 100 N move the carriage by 20 um."""
_CELL_KG = 0.2
_BALL_DAMPING_N_M_S = 0.005
"""Viscous friction of the ball joint at the top. Assumed: enough to still the leg's swing. It is not without effect:
the rigid ankle peaks at 35.2 N without it, at 26.0 N with it, at 10.4 N with 0.05; and with it at 8.8 N if pushed at
1 mm/s and 35.1 N at 20 mm/s. So that peak is as much a choice as a result."""


@dataclass(frozen=True)
class SlipOptions:
    """What can be chosen about a slip test."""

    foot: str = parameter("unjammed", "What the leg stands on", choices=FEET)
    vacuum_pa: float = jammed_vacuum_option()
    slope_deg: float = parameter(40.0, "Inclination of the plywood, toe uphill", "deg", 5.0, 50.0)
    friction: float = parameter(0.55, "Coulomb friction between the ankle's foot and the plywood", "", 0.0, 1.0)
    edge_friction: float = parameter(
        0.40, "Coulomb friction between the rigid ankle's toe edge and the plywood; with more it wedges", "", 0.0, 1.0
    )
    """Chosen just below 0.411, from which on the rigid foot wedges in the default geometry: only there does it push
    with a force of the unjammed ankle's order before it slides, as the paper says it does, and that peak hangs on the
    ball joint's assumed damping too. At 0.30 it pushes with a
    third of that; beyond the limit with whatever the rig can bear."""
    speed_m_s: float = parameter(0.005, "Speed of the carriage, down", "m/s", 0.001, 0.05)
    descent_m: float = parameter(0.110, "Way of the carriage from the first touch to the halt", "m", 0.01, 0.12)
    leg_m: float = parameter(0.18, "From the ankle's joint to the ball joint at the top", "m", 0.12, 0.4)
    parameter_set: str = parameter_set_option()
    seed: int = seed_option()
    timestep_s: float = run_timestep_option()


def scattered(options: SlipOptions, numbers: tuple[float, float]) -> SlipOptions:
    """Return the options of one repeat: friction by 0.01, slope by 0.2 degrees (standard deviations, assumed).

    The friction of the rigid edge only ever gets less, as with more the foot wedges and there is no run.
    """
    friction, slope = numbers
    return replaced_within_range(
        options,
        friction=options.friction + 0.01 * friction,
        edge_friction=options.edge_friction - 0.001 * abs(friction),
        slope_deg=options.slope_deg + 0.2 * slope * (options.foot != RIGID_ANKLE),
    )


def slip_rig(options: SlipOptions) -> tuple[Rig, Programme]:
    """Build the rig and what it does.

    Raises:
        ParameterError: the rigid foot would wedge.

    """
    ankle = AnkleParameters()
    if options.foot == RIGID_ANKLE:
        check_slides(options, ankle)
    has_tendons = options.foot != RIGID_ANKLE
    tendon = tendon_parameters(options.parameter_set)
    sensors, pneumatics = SensorParameters(seed=options.seed), PneumaticParameters()
    start_m = touch_down_height_m(options.slope_deg, ankle) + _CLEARANCE_M
    spec = _spec(options, ankle, sensors, start_m)
    halt_s = _PUSH_S + (options.descent_m + _CLEARANCE_M) / options.speed_m_s
    rig = Rig(
        name="slip",
        spec=spec,
        model=compile_with_start(spec, {}, start_m),
        tendon_laws=ankle_laws(tendon, ankle, options.timestep_s)[: len(names.TENDONS) * has_tendons],
        pneumatics=pneumatics,
        sensors=sensors,
        events=(
            Event(round(_PUSH_S / options.timestep_s), lambda data: set_speed(data, -options.speed_m_s)),
            Event(round(halt_s / options.timestep_s), lambda data: set_speed(data, 0.0)),
        ),
        options=options,
        parts={"ankle": ankle, "tendon": tendon, "pneumatics": pneumatics, "sensors": sensors},
        tendon_names=names.TENDONS if has_tendons else (),
    )
    programme = Programme(
        duration_s=halt_s + _HOLD_S,
        vacuum=(all_channels(_JAM_S, options.vacuum_pa),) if options.foot == JAMMED else (),
        evaluate=lambda topics: _results(topics, halt_s),
        topics=LEG_TOPICS,
        overload_advice=(
            f"the foot wedges between slope and ball joint: give less friction (it is {_friction(options):g}), a "
            f"steeper slope (slope_deg {options.slope_deg:g}) or a shorter way (descent_m {options.descent_m:g})"
        ),
    )
    return rig, programme


def wedging_friction(slope_deg: float, leg_m: float, ankle: AnkleParameters) -> float:
    """Return the friction from which on a rigid foot's toe wedges between slope and ball joint.

    A leg without weight carries force only along the line from the toe's contact to the ball joint. If that line lies
    within the cone of friction around the slope's normal no force makes the toe slide.

    Args:
        slope_deg: Inclination, degrees.
        leg_m: From the ankle's joint to the ball joint, m.
        ankle: Geometry.

    """
    slope = math.radians(slope_deg)
    radius_m = ankle.contact_radius_m
    # From the contact to the ball joint, in the upright pose, in which the line is nearest to the normal.
    back_m = ankle.toe_m + radius_m * math.sin(slope)
    up_m = leg_m + ankle.sole_m - radius_m + radius_m * math.cos(slope)
    angle_to_normal = slope - math.atan2(back_m, up_m)
    return max(math.tan(angle_to_normal), 0.0)


def check_slides(options: SlipOptions, ankle: AnkleParameters) -> None:
    """Refuse a rigid foot that wedges.

    Raises:
        ParameterError: with the friction at which it would slide.

    """
    limit = wedging_friction(options.slope_deg, options.leg_m, ankle)
    if options.edge_friction >= limit:
        msg = (
            f"parameter 'edge_friction' is {options.edge_friction:g}; the rigid foot wedges from {limit:.3f} on at a "
            f"slope of {options.slope_deg:g} deg and a leg of {options.leg_m:g} m, and no force makes it slide: give "
            "less friction, a steeper slope or a longer leg"
        )
        raise ParameterError(msg)


def _friction(options: SlipOptions) -> float:
    return options.edge_friction if options.foot == RIGID_ANKLE else options.friction


def _spec(options: SlipOptions, ankle: AnkleParameters, sensors: SensorParameters, start_m: float) -> Any:
    friction = _friction(options)
    spec = new_spec("slip", options.timestep_s)
    add_slope(spec, options.slope_deg, friction, ankle.contact_time_s)
    carriage = add_carriage(spec, start_m, _CARRIAGE_KG)
    cell = carriage.add_body(name="cell", pos=(0.0, 0.0, options.leg_m))
    weigh(cell, _CELL_KG)
    leg = cell.add_body(name="leg", pos=(0.0, 0.0, -options.leg_m))
    leg_kg = ankle.mass_kg - ankle.foot_mass_kg
    leg.mass = leg_kg
    leg.ipos = (0.0, 0.0, ankle.tendon_length_m / 2.0)
    leg.inertia = (leg_kg * ankle.tendon_length_m**2 / 12.0,) * 2 + (leg_kg * ankle.half_width_m**2 / 2.0,)
    leg.explicitinertial = True
    ball = leg.add_joint(name="ball", type=mujoco.mjtJoint.mjJNT_BALL, pos=(0.0, 0.0, options.leg_m))
    ball.damping = (_BALL_DAMPING_N_M_S, 0.0, 0.0)
    if options.foot == RIGID_ANKLE:
        add_rigid_ankle(leg, ankle, HardContact(), friction, 0.0)
    else:
        add_ankle(spec, leg, ankle, friction)
    add_drive(spec, _CARRIAGE_KG, _SERVO_RAD_S)
    add_imu_sensors(spec, sensors)
    add_load_cell(spec, cell)
    return spec


def _results(topics: Mapping[str, Series], halt_s: float) -> dict[str, float]:
    """Push on the slope and its work over the descent: load cell less what hangs on it before the touch."""
    cell = topics[names.LOAD_CELL.name]
    height_m = topics[names.JOINT_STATES.name].column(f"{names.CARRIAGE_JOINT}.position")
    force_n = smoothed(cell.column("force_z_n"))
    push_n = force_n[cell.time_s < _PUSH_S].mean() - force_n
    going_down = (cell.time_s >= _PUSH_S) & (cell.time_s <= halt_s)
    at_peak = int(push_n[going_down].argmax())
    return {
        "peak_force_n": float(push_n[going_down].max()),
        "descent_at_peak_m": float(height_m[going_down][0] - height_m[going_down][at_peak]),
        "mean_force_n": float(push_n[going_down].mean()),
        "energy_n_m": -work_j(height_m[going_down], push_n[going_down]),
        "descent_m": float(height_m[going_down][0] - height_m[going_down][-1]),
        "final_force_n": float(push_n[-1]),
    }
