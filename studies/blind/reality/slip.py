"""The slip rig: a leg on a ball joint is pushed down onto a plywood slope, toe uphill, at constant speed.

The paper has no number of it. The plan's slope, friction, leg and speed are the declared ones.
"""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING

import numpy as np

from jammkle_common.names import CHANNELS
from studies.blind.reality.air import PERIOD_S, together
from studies.blind.reality.bodies import WOOD_N_M15, WOOD_S_M, hertz, turned_about_y
from studies.blind.reality.legs import Scene, Stand, ankle_law, free_lengths_m, move
from studies.blind.reality.machine import PLAIN, stream
from studies.blind.reality.sensors import BadPlanError, settings

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from studies.blind.reality.bodies import Law
    from studies.blind.reality.machine import Machine
    from studies.blind.reality.sensors import Option, Plan, RealRun

RIGID_ANKLE, JAMMED, UNJAMMED = "rigid_ankle", "jammed", "unjammed"
FEET = (RIGID_ANKLE, JAMMED, UNJAMMED)
DEFAULTS: dict[str, Option] = {
    "foot": UNJAMMED,
    "vacuum_pa": 50e3,
    "slope_deg": 40.0,
    "friction": 0.55,
    "edge_friction": 0.30,
    "speed_m_s": 0.005,
    "descent_m": 0.110,
    "leg_m": 0.18,
}
_JAM_S, _PUSH_S, _HOLD_S = 0.05, 1.0, 0.5
_CLEARANCE_M = 0.001
"""From the toe to the slope at the start."""
_STEP_S = 5e-4
_CARRIAGE_KG, _CELL_KG = 10.0, 0.2
"""Declared."""
_SPINDLE_RAD_S, _SPINDLE_DAMPING = 700.0, 0.5
"""Carriage on its spindle: declared that 100 N move it by 20 um; its damping is assumed."""
_RAMP_S = 0.010
"""In which the spindle comes to speed. Assumed."""
_PIVOT_N_M_S = 0.005
"""Of the ball joint at the top. Declared."""
_FRICTION, _SLOPE_RAD = 0.01, math.radians(0.2)
"""Standard deviations over runs. Declared."""


def slip(plan: Plan, machine: Machine, seed: int) -> RealRun:
    """Push a leg down a slope.

    Args:
        plan: Settings of the rig.
        machine: With its faults, on the day of the run.
        seed: Of the run.

    Raises:
        BadPlanError: a setting or a foot that there is not.

    """
    chosen = settings(plan, DEFAULTS)
    foot = str(chosen["foot"])
    if foot not in FEET:
        msg = f"'foot' is {foot}; it must be one of {', '.join(FEET)}"
        raise BadPlanError(msg)
    rougher, steeper = stream(seed, "slip").standard_normal(2)
    planned = float(chosen["edge_friction"] if foot == RIGID_ANKLE else chosen["friction"])
    slope_rad = math.radians(float(chosen["slope_deg"]))
    leg_m, speed_m_s = float(chosen["leg_m"]), float(chosen["speed_m_s"])
    tilt_rad = _hanging_rad(machine, leg_m)
    touch_m = _touch_m(machine, tilt_rad, slope_rad, leg_m)
    stand = Stand(
        mass_kg=_CARRIAGE_KG + _CELL_KG + PLAIN.ankle_kg,
        toe_m=machine.leg.toe_m,
        friction=max(planned + _FRICTION * rougher, 0.0),
        slope_rad=slope_rad + _SLOPE_RAD * steeper,
        touch_m=touch_m,
        pivot_m=leg_m,
    )
    start_m = touch_m + _CLEARANCE_M
    push_s = _PUSH_S + machine.rig.late_s
    halt_s = push_s + (float(chosen["descent_m"]) + _CLEARANCE_M) / speed_m_s
    real_m_s = speed_m_s * (1.0 + machine.rig.speed_error)

    def drive_m(time_s: NDArray[np.float64]) -> NDArray[np.float64]:
        corners_s = np.array([0.0, push_s, push_s + _RAMP_S, halt_s, halt_s + _RAMP_S, halt_s + 10.0])
        # The way of a speed that ramps up and down, from the integral of its corners.
        speeds = np.array([0.0, 0.0, real_m_s, real_m_s, 0.0, 0.0])
        ways = np.concatenate([[0.0], np.cumsum(np.diff(corners_s) * (speeds[1:] + speeds[:-1]) / 2.0)])
        at = np.clip(np.searchsorted(corners_s, time_s, side="right") - 1, 0, len(corners_s) - 2)
        since_s = time_s - corners_s[at]
        gain = np.diff(speeds)[at] / np.diff(corners_s)[at]
        found: NDArray[np.float64] = start_m - (ways[at] + speeds[at] * since_s + gain * since_s**2 / 2.0)
        return found

    scene = Scene(
        law=_law(machine, foot, stand),
        height_m=start_m,
        leg_pitch_rad=tilt_rad,
        foot_pitch_rad=machine.leg.hung_rad,
        free_m=free_lengths_m(machine.ankle, machine.leg.hung_rad, machine.ankle.achilles_pretension_m),
        has_tendons=foot != RIGID_ANKLE,
        schedule=together(_JAM_S, CHANNELS, float(chosen["vacuum_pa"])) if foot == JAMMED else (),
        duration_s=math.ceil(round((halt_s + _HOLD_S) / PERIOD_S, 6)) * PERIOD_S,
        release_s=0.0,
        drive_m=drive_m,
        step_s=_STEP_S,
    )
    return move(plan, scene, machine, seed)


def _law(machine: Machine, foot: str, stand: Stand) -> Law:
    law = ankle_law(machine, stand, hertz(WOOD_N_M15 * machine.leg.sole_n_m15 / PLAIN.sole_n_m15, WOOD_S_M))
    stiffness_n_m = _CARRIAGE_KG * _SPINDLE_RAD_S**2
    return dataclasses.replace(
        law,
        cell_kg=_CELL_KG,
        leg_is_free=1.0,
        foot_is_free=0.0 if foot == RIGID_ANKLE else 1.0,
        pivot_viscous_n_m_s=_PIVOT_N_M_S,
        drive_n_m=stiffness_n_m,
        drive_n_s_m=2.0 * _SPINDLE_DAMPING * stiffness_n_m / _SPINDLE_RAD_S,
    )


def _hanging_rad(machine: Machine, leg_m: float) -> float:
    """Return the pitch of the leg as it hangs: the centre of leg and foot is below the pivot."""
    ankle, leg = machine.ankle, machine.leg
    leg_kg = leg.ankle_kg - ankle.foot_kg
    forward_m = ankle.foot_kg * ankle.foot_centre_m[0] / leg.ankle_kg
    up_m = (leg_kg * ankle.tendon_length_m / 2.0 + ankle.foot_kg * ankle.foot_centre_m[2]) / leg.ankle_kg
    return math.atan2(forward_m, leg_m - up_m)


def _touch_m(machine: Machine, tilt_rad: float, slope_rad: float, leg_m: float) -> float:
    """Return where the carriage is as the tilted foot first touches the slope through the origin."""
    cosine, sine = math.cos(tilt_rad), math.sin(tilt_rad)
    ankle = np.array([-leg_m * sine, 0.0, -leg_m * cosine])
    turn = np.array([[cosine, 0.0, sine], [0.0, 1.0, 0.0], [-sine, 0.0, cosine]])
    leg = machine.leg.as_built()
    centres = ankle + leg.corners_m(leg.toe_m) @ turned_about_y(leg.hung_rad).T @ turn.T
    out = np.array([-math.sin(slope_rad), 0.0, math.cos(slope_rad)])
    return float((leg.corner_radius_m - centres @ out).max() / out[2]) - leg_m
