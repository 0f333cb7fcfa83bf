"""The drop rig: a leg on a vertical slide falls 50 mm onto level ground, with one of five feet."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from jammkle_common import names
from jammkle_common.constants import STANDARD_GRAVITY_M_S2
from jammkle_common.parameters import parameter, typed, typed_value
from jammkle_sim.physics.ankle import AnkleParameters, add_ankle
from jammkle_sim.physics.constants import tendon_parameters
from jammkle_sim.physics.feet import (
    JAMMED,
    RIGID_ANKLE,
    SQUASH,
    SQUASH_BALL,
    STANDARD,
    UNJAMMED,
    HardContact,
    SquashBallParameters,
    TipParameters,
    add_rigid_ankle,
    add_squash_ball,
    add_standard_foot,
)
from jammkle_sim.physics.pneumatics import PneumaticParameters
from jammkle_sim.physics.sensors import SensorParameters
from jammkle_sim.rigs.model import (
    add_carriage,
    add_hold,
    add_imu_sensors,
    add_load_cell,
    add_slope,
    ankle_laws,
    compile_with_start,
    hanging,
    new_spec,
    release,
    touch_down_height_m,
    weigh,
)
from jammkle_sim.rigs.options import (
    drop_height_option,
    jammed_vacuum_option,
    mass_option,
    parameter_set_option,
    replaced_within_range,
    run_timestep_option,
    seed_option,
)
from jammkle_sim.rigs.recording import Series, peak_deceleration_m_s2, rebound_m, smoothed
from jammkle_sim.rigs.rig import Event, Rig
from jammkle_sim.rigs.run import LEG_TOPICS, Programme, RigKind, TravelLimit
from jammkle_sim.rigs.vacuum import all_channels

if TYPE_CHECKING:
    from collections.abc import Mapping


FEET = (RIGID_ANKLE, STANDARD, SQUASH_BALL, JAMMED, UNJAMMED)
"""The paper's five, in the order of its table."""
_JAM_S = 0.05
"""When the vacuum is switched on."""
_RELEASE_S = 1.0
"""When the carriage is let go: the vacuum stands by then, and the foot hangs still."""
_REST_S = 1.5
"""Recorded time after the release."""


@dataclass(frozen=True)
class DropOptions:
    """What can be chosen about a drop."""

    foot: str = parameter("unjammed", "What the leg lands on", choices=FEET)
    vacuum_pa: float = jammed_vacuum_option()
    drop_height_m: float = drop_height_option("ground")
    mass_kg: float = mass_option()
    pitch_deg: float = parameter(40.0, "Pitch at which an ankle's foot lands, toe-down", "deg", 0.0, 60.0, flag=False)
    """The paper does not tell the pose. Chosen toe-down so that the ankle has way to yield: 31 m/s^2 takes 16 mm at
    least, which a flat landing on a ball joint does not have; 40 so that the heel does not strike in any repeat."""
    pretension_m: float = parameter(
        0.0005,
        "Extension of the Achilles tendons as the foot hangs; below 0 they are slack",
        "m",
        -0.005,
        0.01,
        flag=False,
    )
    """Chosen, with the toe's lever, so that the means of both ankles come out."""
    friction: float = parameter(0.1, "Coulomb friction between foot and ground", "", 0.0, 2.0)
    """Chosen: from 0.2 on the toe begins to lock at first touch."""
    parameter_set: str = parameter_set_option()
    seed: int = seed_option()
    timestep_s: float = run_timestep_option()


DROP_ANKLE = dataclasses.replace(
    AnkleParameters(),
    toe_m=0.0494,
    contact_time_s=0.008,
    contact_impedance=(0.5, 0.5),
)
"""The ankle as it is dropped. Lever of the toe: chosen so that the means of the jammed and the unjammed ankle, 42.52
and 31.26 m/s^2, come out (1 mm more: 1 and 0.5 m/s^2 less); a rounded toe that lands toe-down touches behind its
tip. Contact: chosen soft, as a printed toe edge is, so that it keeps touching while the foot turns;
then half the time step moves no peak by 1 %."""
HEIGHT_SCATTER_M = 0.0006
"""Standard deviation of the height over repeats. Chosen so that the squash ball scatters as in the paper (by
0.5 m/s^2)."""
PRETENSION_SCATTER_M = 0.0007
"""Standard deviation of the pretension over repeats: tendons that have not yet recovered from the drop before. Chosen
so that the two ankles scatter as in the paper (by 1.0
and 0.7 m/s^2; here 0.8 and 0.6, as with more the heel strikes in some repeats)."""


def scattered(options: DropOptions, numbers: tuple[float, float]) -> DropOptions:
    """Return the options of one repeat: height and pretension differ."""
    height, pretension = numbers
    return replaced_within_range(
        options,
        drop_height_m=options.drop_height_m + HEIGHT_SCATTER_M * height,
        pretension_m=options.pretension_m + PRETENSION_SCATTER_M * pretension,
    )


def drop_rig(options: DropOptions, ankle: AnkleParameters = DROP_ANKLE) -> tuple[Rig, Programme]:
    """Build the rig and what it does.

    Args:
        options: What is dropped, how, from where.
        ankle: Its constants, but for pretension and pose, which are options.

    """
    pitch_rad = math.radians(options.pitch_deg)
    ankle = dataclasses.replace(ankle, achilles_pretension_m=options.pretension_m, hang_pitch_rad=pitch_rad)
    hard, tip, ball = HardContact(), TipParameters(), SquashBallParameters()
    tendon = tendon_parameters(options.parameter_set)
    sensors, pneumatics = SensorParameters(seed=options.seed), PneumaticParameters()
    has_tendons = options.foot in (JAMMED, UNJAMMED)
    spec = new_spec("drop", options.timestep_s)
    add_slope(spec, 0.0, options.friction, ankle.contact_time_s)
    if options.foot == STANDARD:
        start_m, foot_kg = tip.length_m + options.drop_height_m, tip.mass_kg
    elif options.foot == SQUASH_BALL:
        start_m, foot_kg = 2.0 * ball.radius_m + options.drop_height_m, ball.mass_kg
    else:
        start_m = touch_down_height_m(0.0, ankle) + options.drop_height_m
        foot_kg = ankle.foot_mass_kg
    leg_kg = ankle.mass_kg - ankle.foot_mass_kg
    carriage = add_carriage(spec, start_m, options.mass_kg - leg_kg - foot_kg)
    leg = carriage.add_body(name="leg")
    weigh(leg, leg_kg)
    start: dict[str, float] = {}
    if options.foot == RIGID_ANKLE:
        add_rigid_ankle(leg, ankle, hard, options.friction, pitch_rad)
    elif options.foot == STANDARD:
        add_standard_foot(leg, tip, hard, options.friction)
    elif options.foot == SQUASH_BALL:
        add_squash_ball(leg, ball, options.friction)
    else:
        add_ankle(spec, leg, ankle, options.friction)
        start = hanging(ankle)
    add_hold(spec, ankle.contact_time_s)
    add_imu_sensors(spec, sensors)
    add_load_cell(spec, leg)
    rig = Rig(
        name="drop",
        spec=spec,
        model=compile_with_start(spec, start),
        tendon_laws=ankle_laws(tendon, ankle, options.timestep_s)[: len(names.TENDONS) * has_tendons],
        pneumatics=pneumatics,
        sensors=sensors,
        events=(Event(round(_RELEASE_S / options.timestep_s), release),),
        options=options,
        parts={
            "ankle": ankle,
            "hard_contact": hard,
            "standard_foot": tip,
            "squash_ball": ball,
            "tendon": tendon,
            "pneumatics": pneumatics,
            "sensors": sensors,
        },
        tendon_names=names.TENDONS if has_tendons else (),
    )
    programme = Programme(
        duration_s=_RELEASE_S + _REST_S,
        vacuum=(all_channels(_JAM_S, options.vacuum_pa),) if options.foot == JAMMED else (),
        evaluate=_results,
        topics=LEG_TOPICS,
        travel_limit=_walls_meet(options, ball) if options.foot == SQUASH_BALL else None,
    )
    return rig, programme


def _walls_meet(options: DropOptions, ball: SquashBallParameters) -> TravelLimit:
    """Limit the squash, and advise falls whose whole energy spring and cube hold before; with the damper more goes."""
    squash_m = ball.largest_squash_m
    held_j = ball.energy_j(squash_m)
    mass_kg = math.floor(100.0 * held_j / (STANDARD_GRAVITY_M_S2 * (options.drop_height_m + squash_m))) / 100.0
    height_m = math.floor(1e3 * (held_j / (STANDARD_GRAVITY_M_S2 * options.mass_kg) - squash_m)) / 1e3
    ways = [f"{typed('mass_kg', mass_kg)} or less (it is {options.mass_kg:g})"]
    if height_m >= 0.0:
        present = typed_value("drop_height_m", options.drop_height_m)
        ways.append(f"{typed('drop_height_m', height_m)} or less (it is {present:g})")
    return TravelLimit(SQUASH, squash_m, "squash ball is pressed until its walls meet", f"give {' or '.join(ways)}")


def _results(topics: Mapping[str, Series]) -> dict[str, float]:
    cell = topics[names.LOAD_CELL.name]
    height_m = topics[names.JOINT_STATES.name].column(f"{names.CARRIAGE_JOINT}.position")
    return {
        "peak_deceleration_m_s2": peak_deceleration_m_s2(topics[names.IMU.name], _RELEASE_S),
        "peak_force_n": float(-smoothed(cell.column("force_z_n")).min()),
        "lowest_height_m": float(height_m.min()),
        "rebound_m": rebound_m(height_m),
    }


RIG = RigKind(
    "drop",
    "drop a leg on level ground, with one of five feet",
    DropOptions,
    drop_rig,
    scattered,
    DROP_ANKLE,
)
