"""The slip rig: a leg on a free ball joint is pushed down onto a plywood slope, toe uphill, at constant speed."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from jammkle_common import names
from jammkle_common.parameters import ParameterError, parameter, rows, typed
from jammkle_sim.physics.ankle import AnkleParameters, add_ankle, corner_m
from jammkle_sim.physics.constants import tendon_parameters
from jammkle_sim.physics.engine import mujoco
from jammkle_sim.physics.feet import JAMMED, RIGID_ANKLE, UNJAMMED, HardContact, add_rigid_ankle
from jammkle_sim.physics.pneumatics import PneumaticParameters
from jammkle_sim.physics.sensors import SensorParameters
from jammkle_sim.rigs.model import (
    add_carriage,
    add_drive,
    add_imu_sensors,
    add_load_cell,
    add_slope,
    ankle_laws,
    compile_with_start,
    hanging,
    hung,
    new_spec,
    set_speed,
    weigh,
)
from jammkle_sim.rigs.options import (
    jammed_vacuum_option,
    parameter_set_option,
    replaced_within_range,
    run_timestep_option,
    seed_option,
)
from jammkle_sim.rigs.recording import GROUND_CLEARANCE, SMOOTHED_S, Series, smoothed, work_j
from jammkle_sim.rigs.rig import Event, Rig
from jammkle_sim.rigs.run import LEG_TOPICS, Programme, RigKind
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
"""Viscous friction of the ball joint at the top. Assumed. The leg starts hanging still, so that it has no swing to
calm; from 0 to 0.05 the figures stay within the bounds of `SlipOptions.edge_friction`."""
_IMPEDANCE_RATIO = 100.0
"""MuJoCo's impratio. A foot that sticks for ten seconds creeps by 2 to 4 mm with the 10 of the other rigs, by 0.2 to
0.4 mm with this; with 1000 no peak changes by 1 %."""
_HEELS = ("heel_left", "heel_right")
_SLIDING_SLOPE_DEG, _SLIDING_FRICTION = 40.0, 0.55
"""From which slope on and up to which friction an ankle with tendons slides with every leg and vacuum in range: found
by runs at the ends of the ranges."""


@dataclass(frozen=True)
class SlipOptions:
    """What can be chosen about a slip test."""

    foot: str = parameter("unjammed", "What the leg stands on", choices=FEET)
    vacuum_pa: float = jammed_vacuum_option()
    slope_deg: float = parameter(40.0, "Inclination of the plywood, toe uphill", "deg", 5.0, 50.0)
    friction: float = parameter(0.55, "Coulomb friction between the ankle's foot and the plywood", "", 0.0, 1.0)
    edge_friction: float = parameter(
        0.30,
        "Coulomb friction between the rigid ankle's toe edge and the plywood; it wedges from 0.433 on",
        "",
        0.0,
        1.0,
        flag=False,
    )
    """Assumed, and the condition under which the rigid ankle is well-posed: a hard edge on wood, well below the 0.433
    from which on it wedges at the default slope and leg. There it slides at the first touch and pushes with no more
    than its own weight makes: the work over the descent is 0.166 to 0.172 J and the peak at most 4.2 N with time steps
    of 0.2 to 1 ms, a ball joint's damping of 0 to 0.05 N m s and 1 to 5 mm/s (at 10 mm/s: 6 N). No friction makes it
    push like the unjammed ankle, which bears 30 N before it slides: nearer to the limit the peak is the blow of the
    touch and goes with the speed (at 0.43 and 5 mm/s 34 N), and from the limit on, as with the 0.55 of the other feet,
    it is whatever the rig bears."""
    speed_m_s: float = parameter(0.005, "Speed of the carriage, down", "m/s", 0.001, 0.05)
    descent_m: float = parameter(
        0.110, "Way of the carriage from the first touch to the halt", "m", 0.01, 0.12, flag=False
    )
    hang_pitch_deg: float = parameter(
        0.0, "Pitch at which the foot hangs, and the rigid one is fixed, toe-down", "deg", 0.0, 45.0, flag=False
    )
    leg_m: float = parameter(0.18, "From the ankle's joint to the ball joint at the top", "m", 0.12, 0.4, flag=False)
    parameter_set: str = parameter_set_option()
    seed: int = seed_option()
    timestep_s: float = run_timestep_option()


def scattered(options: SlipOptions, numbers: tuple[float, float]) -> SlipOptions:
    """Return the options of one repeat: friction by 0.01, slope by 0.2 degrees (standard deviations, assumed).

    A rigid foot that would wedge by that gets less friction and a steeper slope by as much instead, as there would be
    no run; one that wedges as asked for stays as it is, to be refused.
    """
    friction, slope = numbers
    changed = _changed(options, friction, slope)
    if options.foot != RIGID_ANKLE:
        return changed
    if _wedges(options):
        return options
    return _changed(options, -abs(friction), abs(slope)) if _wedges(changed) else changed


def _changed(options: SlipOptions, friction: float, slope: float) -> SlipOptions:
    return replaced_within_range(
        options,
        friction=options.friction + 0.01 * friction,
        edge_friction=options.edge_friction + 0.01 * friction,
        slope_deg=options.slope_deg + 0.2 * slope,
    )


def _wedges(options: SlipOptions) -> bool:
    return options.edge_friction >= _footing(options, hung(None, options.hang_pitch_deg)).wedging_friction


def slip_rig(options: SlipOptions, ankle: AnkleParameters | None = None) -> tuple[Rig, Programme]:
    """Build the rig and what it does.

    Args:
        options: What stands on the slope, and how it is pushed.
        ankle: Constants of the ankle; None: AnkleParameters as they stand.

    Raises:
        ParameterError: the rigid foot would wedge.

    """
    ankle = hung(ankle, options.hang_pitch_deg)
    if options.foot == RIGID_ANKLE:
        check_slides(options, ankle)
    has_tendons = options.foot != RIGID_ANKLE
    tendon = tendon_parameters(options.parameter_set)
    sensors, pneumatics = SensorParameters(seed=options.seed), PneumaticParameters()
    forward_m, below_m = _footing(options, ankle).contact_m
    start_m = forward_m * math.tan(math.radians(options.slope_deg)) + below_m - options.leg_m + _CLEARANCE_M
    spec = _spec(options, ankle, sensors, start_m)
    halt_s = _PUSH_S + (options.descent_m + _CLEARANCE_M) / options.speed_m_s
    rig = Rig(
        name="slip",
        spec=spec,
        model=compile_with_start(spec, hanging(ankle) if has_tendons else {}, start_m),
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
        overload_advice=_overload_advice(options, ankle),
        watched=_HEELS,
    )
    return rig, programme


def check_slides(options: SlipOptions, ankle: AnkleParameters) -> None:
    """Refuse a rigid foot that wedges.

    Raises:
        ParameterError: with the friction at which it would slide.

    """
    footing = _footing(options, ankle)
    if options.edge_friction >= footing.wedging_friction:
        problem = (
            f"the rigid foot wedges from {footing.wedging_friction:.3f} on at a slope of {options.slope_deg:g} deg and "
            f"a leg of {options.leg_m:g} m, and no force makes it slide: {_ways_out(options, ankle)}"
        )
        raise ParameterError(problem, "edge_friction", options.edge_friction)


def _footing(options: SlipOptions, ankle: AnkleParameters) -> Footing:
    return Footing(options.slope_deg, options.leg_m, ankle)


def _ways_out(options: SlipOptions, ankle: AnkleParameters) -> str:
    largest = {row.name: row.maximum or 0.0 for row in rows(SlipOptions)}
    return ways_out(_footing(options, ankle), options.edge_friction, largest["slope_deg"], largest["leg_m"])


def _overload_advice(options: SlipOptions, ankle: AnkleParameters) -> str:
    if options.foot == RIGID_ANKLE:
        return (
            f"its edge's friction of {options.edge_friction:g} is so near to wedging that the touch alone does it: "
            f"{_ways_out(options, ankle)}"
        )
    return (
        f"the foot wedges between slope and ball joint: give {typed('slope_deg', _SLIDING_SLOPE_DEG)} or more "
        f"(it is {options.slope_deg:g}) and {typed('friction', _SLIDING_FRICTION)} or less (it is {options.friction:g})"
    )


def _friction(options: SlipOptions) -> float:
    return options.edge_friction if options.foot == RIGID_ANKLE else options.friction


def _spec(options: SlipOptions, ankle: AnkleParameters, sensors: SensorParameters, start_m: float) -> Any:
    friction = _friction(options)
    spec = new_spec("slip", options.timestep_s)
    spec.option.impratio = _IMPEDANCE_RATIO
    add_slope(spec, options.slope_deg, friction, ankle.contact_time_s)
    carriage = add_carriage(spec, start_m, _CARRIAGE_KG)
    cell = carriage.add_body(name="cell", pos=(0.0, 0.0, options.leg_m))
    weigh(cell, _CELL_KG)
    leg_kg = ankle.mass_kg - ankle.foot_mass_kg
    tilt = _footing(options, ankle).tilt_rad
    leg = cell.add_body(
        name="leg",
        pos=(-options.leg_m * math.sin(tilt), 0.0, -options.leg_m * math.cos(tilt)),
        quat=(math.cos(tilt / 2.0), 0.0, math.sin(tilt / 2.0), 0.0),
    )
    leg.mass = leg_kg
    leg.ipos = (0.0, 0.0, ankle.tendon_length_m / 2.0)
    leg.inertia = (leg_kg * ankle.tendon_length_m**2 / 12.0,) * 2 + (leg_kg * ankle.half_width_m**2 / 2.0,)
    leg.explicitinertial = True
    ball = leg.add_joint(name="ball", type=mujoco.mjtJoint.mjJNT_BALL, pos=(0.0, 0.0, options.leg_m))
    ball.damping = (_BALL_DAMPING_N_M_S, 0.0, 0.0)
    if options.foot == RIGID_ANKLE:
        # The contact of the ankle's own foot: that of the drop rig was chosen to bounce.
        hard = HardContact(ankle.contact_time_s, damping_ratio=1.0)
        add_rigid_ankle(leg, ankle, hard, friction, ankle.hang_pitch_rad)
    else:
        add_ankle(spec, leg, ankle, friction)
    add_drive(spec, _CARRIAGE_KG, _SERVO_RAD_S)
    add_imu_sensors(spec, sensors)
    add_load_cell(spec, cell)
    return spec


def _results(topics: Mapping[str, Series], halt_s: float) -> dict[str, float]:
    """Push on the slope and its work over the descent: load cell less what hangs on it before the touch.

    Where the heel lands the foot stands flat, the force jumps and the foot starts to slide: the peak before is named
    on its own. A heel that never lands has no descent of its landing.
    """
    cell = topics[names.LOAD_CELL.name]
    height_m = topics[names.JOINT_STATES.name].column(f"{names.CARRIAGE_JOINT}.position")
    force_n = smoothed(cell.column("force_z_n"))
    push_n = force_n[cell.time_s < _PUSH_S].mean() - force_n
    going_down = (cell.time_s >= _PUSH_S) & (cell.time_s <= halt_s)
    at_peak = int(push_n[going_down].argmax())
    landed = topics[GROUND_CLEARANCE].values.min(axis=1) <= 0.0
    heel_s = cell.time_s[int(landed.argmax())] if landed.any() else math.inf
    results = {
        "peak_force_n": float(push_n[going_down].max()),
        "descent_at_peak_m": float(height_m[going_down][0] - height_m[going_down][at_peak]),
        # A smoothed force is the mean of some time around; none of that may be after the landing.
        "peak_before_heel_n": float(push_n[going_down & (cell.time_s < heel_s - SMOOTHED_S)].max()),
        "mean_force_n": float(push_n[going_down].mean()),
        "energy_n_m": -work_j(height_m[going_down], push_n[going_down]),
        "descent_m": float(height_m[going_down][0] - height_m[going_down][-1]),
        "final_force_n": float(push_n[-1]),
    }
    if landed.any():
        results["descent_at_heel_m"] = float(height_m[going_down][0] - height_m[int(landed.argmax())])
    return results


_SAFE_ANGLE_RAD = math.radians(6.0)
"""By how much the line to the ball joint must miss the cone of friction for the foot to be well clear of wedging.
Chosen from runs: nearer to the cone the blow of the first touch decides the force; with so much the load cell bears it
up to the largest speed of the carriage."""
_FRICTIONS_PER_UNIT = 100
_LEGS_PER_M = 100
"""Advised values are whole hundredths of friction, whole degrees, whole centimetres."""


@dataclass(frozen=True)
class Footing:
    """A rigid foot as it stands: what decides whether it wedges."""

    slope_deg: float
    """Inclination of the slope, toe uphill."""
    leg_m: float
    """From the ankle's joint to the ball joint."""
    ankle: AnkleParameters

    @property
    def tilt_rad(self) -> float:
        """Tilt at which leg and foot hang still under the ball joint; positive moves the foot to the heel's side."""
        ankle = self.ankle
        (x_m, _, z_m), pitch = ankle.foot_centre_m, ankle.hang_pitch_rad
        foot_x_m = x_m * math.cos(pitch) + z_m * math.sin(pitch)
        foot_z_m = z_m * math.cos(pitch) - x_m * math.sin(pitch)
        leg_kg = ankle.mass_kg - ankle.foot_mass_kg
        forward_m = ankle.foot_mass_kg * foot_x_m / ankle.mass_kg
        up_m = (leg_kg * ankle.tendon_length_m / 2.0 + ankle.foot_mass_kg * foot_z_m) / ankle.mass_kg
        return math.atan2(forward_m, self.leg_m - up_m)

    @property
    def contact_m(self) -> tuple[float, float]:
        """Where the hanging foot's toe touches the slope: forward of and below the ball joint, m."""
        slope, tilt, radius_m = math.radians(self.slope_deg), self.tilt_rad, self.ankle.contact_radius_m
        toe_m, toe_below_m = corner_m(self.ankle, self.ankle.toe_m)
        down_m = self.leg_m + toe_below_m
        # The centre of the toe's rounded corner, then from there against the slope's normal.
        forward_m = toe_m * math.cos(tilt) - down_m * math.sin(tilt)
        below_m = toe_m * math.sin(tilt) + down_m * math.cos(tilt)
        return forward_m + radius_m * math.sin(slope), below_m + radius_m * math.cos(slope)

    @property
    def angle_to_normal_rad(self) -> float:
        """From the slope's normal to the line from the contact to the ball joint; positive pushes the toe downhill."""
        forward_m, below_m = self.contact_m
        return math.radians(self.slope_deg) - math.atan2(forward_m, below_m)

    @property
    def wedging_friction(self) -> float:
        """Friction from which on the toe wedges; 0 on slopes so gentle that no friction lets it slide down."""
        return max(math.tan(self.angle_to_normal_rad), 0.0)

    @property
    def safe_friction(self) -> float:
        """Largest friction, in hundredths, that is well clear of wedging; below 0 where none is."""
        return math.floor(math.tan(self.angle_to_normal_rad - _SAFE_ANGLE_RAD) * _FRICTIONS_PER_UNIT) / (
            _FRICTIONS_PER_UNIT
        )


def ways_out(footing: Footing, friction: float, steepest_deg: float, longest_m: float) -> str:
    """Say what would let a foot slide that wedges: friction, slope or leg, each only where it helps by itself.

    Args:
        footing: As it stands.
        friction: Of its edge.
        steepest_deg: Largest slope that can be given, degrees.
        longest_m: Longest leg that can be given, m.

    """
    ways: list[str] = []
    if footing.safe_friction > 0.0:
        ways.append(f"{typed('edge_friction', footing.safe_friction)} or less")
    slopes_deg = range(math.ceil(footing.slope_deg), math.floor(steepest_deg) + 1)
    slope_deg = next((each for each in slopes_deg if replace(footing, slope_deg=each).safe_friction >= friction), None)
    if slope_deg is not None:
        ways.append(f"{typed('slope_deg', slope_deg)} or more")
    legs_m = [
        each / _LEGS_PER_M
        for each in range(math.ceil(footing.leg_m * _LEGS_PER_M), math.floor(longest_m * _LEGS_PER_M) + 1)
    ]
    leg_m = next((each for each in legs_m if replace(footing, leg_m=each).safe_friction >= friction), None)
    if leg_m is not None:
        ways.append(f"{typed('leg_m', leg_m)} or more")
    if not ways:
        steep = replace(footing, slope_deg=steepest_deg)
        ways.append(f"{typed('slope_deg', steepest_deg)} with {typed('edge_friction', steep.safe_friction)} or less")
    return "give " + " or ".join(ways)


RIG = RigKind(
    "slip",
    "push a leg down onto a slope until it slides",
    SlipOptions,
    slip_rig,
    scattered,
    AnkleParameters(),
)
