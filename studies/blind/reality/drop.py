"""The drop rig: a leg on a vertical slide falls onto level ground, with one of five feet."""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING

from jammkle_common.names import CHANNELS
from studies.blind.reality.air import together
from studies.blind.reality.bodies import HARD_N_M15, HARD_S_M, SquashBall, hertz
from studies.blind.reality.legs import Scene, Stand, ankle_law, free_lengths_m, move, tip_law
from studies.blind.reality.machine import PLAIN, stream
from studies.blind.reality.sensors import BadPlanError, settings

if TYPE_CHECKING:
    from studies.blind.reality.bodies import Law
    from studies.blind.reality.machine import Machine
    from studies.blind.reality.sensors import Option, Plan, RealRun

RIGID_ANKLE, STANDARD, SQUASH_BALL, JAMMED, UNJAMMED = "rigid_ankle", "standard", "squash_ball", "jammed", "unjammed"
FEET = (RIGID_ANKLE, STANDARD, SQUASH_BALL, JAMMED, UNJAMMED)
DEFAULTS: dict[str, Option] = {
    "foot": UNJAMMED,
    "vacuum_pa": 50e3,
    "drop_height_m": 0.05,
    "mass_kg": 1.8,
    "pitch_deg": 40.0,
    "pretension_m": 0.0005,
    "friction": 0.1,
}
_JAM_S, _RELEASE_S, _DURATION_S = 0.05, 1.0, 2.5
_STEP_S = 1e-4
_TIP_KG, _TIP_RADIUS_M, _TIP_M = 0.020, 0.010, 0.020
"""The standard foot's printed tip. Declared."""
_HEIGHT_M = 0.0005
"""Standard deviation of the height over runs. Calibrated to the squash ball's row: repeats differ by 0.5 m/s^2."""
_PRETENSION_M = 0.0005
"""Standard deviation of the pretension over runs: tendons that have not recovered from the drop before. Chosen so that
the heel strikes in no repeat; the ankles then differ by 0.3 m/s^2, where the paper's differ by 0.7 and 1.0."""
_FRICTION = 0.05
"""Relative standard deviation of the floor's friction over runs. Assumed."""


def drop(plan: Plan, machine: Machine, seed: int) -> RealRun:
    """Drop a leg.

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
    draw = stream(seed, "drop")
    higher, tighter, rougher = draw.standard_normal(3)
    fall_m = max(float(chosen["drop_height_m"]) + _HEIGHT_M * higher, 0.0)
    pretension_m = float(chosen["pretension_m"]) + _PRETENSION_M * tighter
    friction = float(chosen["friction"]) * math.exp(_FRICTION * rougher)
    pitch_rad = math.radians(float(chosen["pitch_deg"])) + machine.leg.hung_rad
    has_tendons = foot in {JAMMED, UNJAMMED}
    ball = SquashBall()
    if foot == STANDARD:
        touch_m, toe_m = _TIP_M, _TIP_M - _TIP_RADIUS_M
    elif foot == SQUASH_BALL:
        touch_m, toe_m = 2.0 * ball.radius_m, ball.radius_m
    else:
        toe_m = PLAIN.dropped_toe_m
        # The height is set with the foot as it hangs and as it was built.
        touch_m = machine.leg.as_built().touch_height_m(machine.leg.dropped_toe_m, pitch_rad, 0.0)
    stand = Stand(float(chosen["mass_kg"]), toe_m, friction, 0.0, touch_m)
    scene = Scene(
        law=_law(machine, foot, stand, ball),
        height_m=touch_m + fall_m,
        leg_pitch_rad=0.0,
        foot_pitch_rad=0.0 if foot in {STANDARD, SQUASH_BALL} else pitch_rad,
        free_m=free_lengths_m(machine.ankle, pitch_rad, pretension_m),
        has_tendons=has_tendons,
        schedule=together(_JAM_S, CHANNELS, float(chosen["vacuum_pa"])) if foot == JAMMED else (),
        duration_s=_DURATION_S,
        release_s=_RELEASE_S + round(machine.rig.late_s, 3),
        drive_m=None,
        step_s=_STEP_S,
    )
    return move(plan, scene, machine, seed)


def _law(machine: Machine, foot: str, stand: Stand, ball: SquashBall) -> Law:
    if foot == STANDARD:
        return tip_law(machine, stand, _TIP_KG, _TIP_RADIUS_M, hertz(HARD_N_M15, HARD_S_M))
    if foot == SQUASH_BALL:
        return tip_law(machine, stand, ball.mass_kg, ball.radius_m, ball.press())
    toe_m = stand.toe_m + machine.leg.dropped_toe_m - PLAIN.dropped_toe_m
    stand = dataclasses.replace(stand, toe_m=toe_m)
    if foot == RIGID_ANKLE:
        return dataclasses.replace(ankle_law(machine, stand, hertz(HARD_N_M15, HARD_S_M)), foot_is_free=0.0)
    return ankle_law(machine, stand)
