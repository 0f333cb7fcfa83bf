"""The landing rig: a leg on a vertical slide, held above a slope, let go, caught by its ankle.

The paper has no such test. The plan's slope, friction and height are the declared ones.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from jammkle_common.constants import STANDARD_GRAVITY_M_S2
from jammkle_common.names import CHANNELS
from studies.blind.reality.air import PERIOD_S, together
from studies.blind.reality.bodies import WOOD_N_M15, WOOD_S_M, hertz
from studies.blind.reality.legs import Scene, Stand, ankle_law, free_lengths_m, move
from studies.blind.reality.machine import PLAIN, stream
from studies.blind.reality.sensors import BadPlanError, settings

if TYPE_CHECKING:
    from studies.blind.reality.machine import Machine
    from studies.blind.reality.sensors import Option, Plan, RealRun

DEFAULTS: dict[str, Option] = {
    "slope_deg": 40.0,
    "friction": 0.55,
    "drop_height_m": 0.05,
    "release_time_s": 1.0,
    "mass_kg": 1.8,
    "jam": "after",
    "vacuum_pa": 50e3,
}
JAMS = ("never", "before", "after")
_REST_S, _REACTION_S = 2.0, 0.02
_STEP_S = 1e-4
RUNS = {"drop_height_m": 0.0005, "friction": 0.01}
"""Standard deviations over runs. Declared."""


def landing(plan: Plan, machine: Machine, seed: int) -> RealRun:
    """Land a leg.

    Args:
        plan: Settings of the rig.
        machine: With its faults, on the day of the run.
        seed: Of the run.

    Raises:
        BadPlanError: a setting or a time to jam that there is not.

    """
    chosen = settings(plan, DEFAULTS)
    if chosen["jam"] not in JAMS:
        msg = f"'jam' is {chosen['jam']}; it must be one of {', '.join(JAMS)}"
        raise BadPlanError(msg)
    higher, rougher = stream(seed, "landing").standard_normal(2)
    slope_rad, fall_m = math.radians(float(chosen["slope_deg"])), float(chosen["drop_height_m"])
    touch_m = machine.leg.as_built().touch_height_m(machine.leg.toe_m, machine.leg.hung_rad, slope_rad)
    stand = Stand(
        mass_kg=float(chosen["mass_kg"]),
        toe_m=machine.leg.toe_m,
        friction=max(float(chosen["friction"]) + RUNS["friction"] * rougher, 0.0),
        slope_rad=slope_rad,
        touch_m=touch_m,
    )
    release_s = float(chosen["release_time_s"])
    landed_s = release_s + math.sqrt(2.0 * fall_m / STANDARD_GRAVITY_M_S2)
    jam_s = {"before": 0.0, "after": landed_s + _REACTION_S}.get(str(chosen["jam"]))
    stiffness = WOOD_N_M15 * machine.leg.sole_n_m15 / PLAIN.sole_n_m15
    scene = Scene(
        law=ankle_law(machine, stand, hertz(stiffness, WOOD_S_M)),
        height_m=touch_m + max(fall_m + RUNS["drop_height_m"] * higher, 0.0),
        leg_pitch_rad=0.0,
        foot_pitch_rad=machine.leg.hung_rad,
        free_m=free_lengths_m(machine.ankle, machine.leg.hung_rad, machine.ankle.achilles_pretension_m),
        has_tendons=True,
        schedule=() if jam_s is None else together(jam_s, CHANNELS, float(chosen["vacuum_pa"])),
        duration_s=max(1, round((landed_s + _REST_S) / PERIOD_S)) * PERIOD_S,
        release_s=release_s + round(machine.rig.late_s, 3),
        drive_m=None,
        step_s=_STEP_S,
    )
    return move(plan, scene, machine, seed)
