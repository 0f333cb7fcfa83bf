"""The tensile rig: one tendon between a clamp and a crosshead that pulls it and comes back."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from jammkle_common import names
from studies.blind.reality.air import PERIOD_S, SetPoint, breathe
from studies.blind.reality.bodies import compiled
from studies.blind.reality.sensors import (
    BadPlanError,
    RealRun,
    Truth,
    encoder_track,
    load_cell_track,
    settings,
    tendon_track,
)
from studies.blind.reality.tendon import BREAK, SHORTER, TENSION, TIME, TORN, tendon_law, tendon_state, tendon_tension_n

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from studies.blind.reality.machine import Machine, Rig
    from studies.blind.reality.sensors import Option, Plan

DEFAULTS: dict[str, Option] = {
    "material": "multi",
    "membrane": "yes",
    "vacuum_pa": 0.0,
    "speed_m_s": 0.005,
    "extension_m": 0.020,
    "mounting_error_m": 0.0,
}
_CHANNEL = names.PERONEAL_LEFT
_TENDON = names.TENDONS_OF_CHANNEL[_CHANNEL][0]
_JAM_S = 0.1
_PULL_S = 1.5
_END_S = 0.1
_COARSE_S, _FINE_S = 5e-4, 1e-4
_FAST_M_S = 0.05
"""Speed of the crosshead above which the steps are fine."""


def tensile(plan: Plan, machine: Machine, seed: int) -> RealRun:
    """Pull a tendon.

    Args:
        plan: Settings of the rig.
        machine: With its faults, on the day of the run.
        seed: Of the run.

    Raises:
        BadPlanError: a setting that there is not, or vacuum without a membrane.

    """
    chosen = settings(plan, DEFAULTS)
    vacuum_pa, speed_m_s = float(chosen["vacuum_pa"]), float(chosen["speed_m_s"])
    if chosen["membrane"] == "no" and vacuum_pa > 0.0:
        msg = f"'vacuum_pa' is {vacuum_pa:g} without a membrane; it must be 0 (or set membrane to yes)"
        raise BadPlanError(msg)
    extension_m = float(chosen["extension_m"])
    duration_s = _PULL_S + 2.0 * extension_m / speed_m_s + _END_S
    duration_s = math.ceil(round(duration_s / PERIOD_S, 6)) * PERIOD_S
    schedule = (SetPoint(_JAM_S, _CHANNEL, vacuum_pa),) if vacuum_pa > 0.0 else ()
    air = breathe(machine, schedule, duration_s, seed)

    step_s = _FINE_S if speed_m_s > _FAST_M_S else _COARSE_S
    time_s = step_s * np.arange(round(duration_s / step_s) + 1, dtype=np.float64)
    rig = machine.rig
    travel_m = _travel_m(time_s, rig, speed_m_s, extension_m)
    held_pa = np.interp(time_s, air.time_s, air.vacuum_pa[:, names.CHANNELS.index(_CHANNEL)])
    mounted_m = rig.mounting_m + float(chosen["mounting_error_m"])
    tension_n, torn = _pull(machine, str(chosen["material"]), travel_m + mounted_m, held_pa, step_s)

    slide = Truth(time_s, travel_m[:, None])
    extension = Truth(time_s, (travel_m + float(chosen["mounting_error_m"]))[:, None])
    force = Truth(time_s, np.column_stack([np.zeros_like(tension_n), np.zeros_like(tension_n), tension_n]))
    topics = {
        **air.topics,
        names.JOINT_STATES.name: encoder_track(
            machine, seed, (names.CARRIAGE_JOINT,), slide, duration_s, (machine.sensors.slide,)
        ),
        names.TENDON_STATES.name: tendon_track(
            machine,
            seed,
            (_TENDON,),
            extension,
            Truth(time_s, tension_n[:, None]),
            Truth(time_s, torn[:, None]),
            duration_s,
        ),
        names.LOAD_CELL.name: load_cell_track(machine, seed, force, duration_s),
    }
    return RealRun(plan, topics)


def _travel_m(time_s: NDArray[np.float64], rig: Rig, speed_m_s: float, extension_m: float) -> NDArray[np.float64]:
    """Return where the crosshead is: up and back, with ramps of its speed and today's late start."""
    real_m_s = speed_m_s * (1.0 + rig.speed_error)
    one_way_s = extension_m / speed_m_s
    start_s = _PULL_S + rig.late_s + rig.start_jitter_s
    ramp_s = min(real_m_s / rig.ramp_m_s2, 0.2 * one_way_s)
    corners_s = np.array([start_s, start_s + ramp_s, start_s + one_way_s - ramp_s, start_s + one_way_s + ramp_s,
                          start_s + 2.0 * one_way_s - ramp_s, start_s + 2.0 * one_way_s])  # fmt: skip
    # The corners' speeds are such that it comes as far as set, whatever the ramps take.
    top_m_s = extension_m * (1.0 + rig.speed_error) / (one_way_s - ramp_s)
    speed = np.interp(time_s, corners_s, [0.0, top_m_s, top_m_s, -top_m_s, -top_m_s, 0.0])
    travel: NDArray[np.float64] = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(time_s))])
    return travel


def _pull(
    machine: Machine, fibres: str, clamped_m: NDArray[np.float64], vacuum_pa: NDArray[np.float64], step_s: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return tension, N, and whether it is torn, at every step."""
    law = tendon_law(machine.tendons[names.TENDONS.index(_TENDON)], step_s, fibres)
    state = tendon_state(law, float(clamped_m[0]))
    tension_n = np.zeros(len(clamped_m))
    tension_n[0] = state.more[TENSION]
    state.more[TIME] = 0.0
    _pull_on(law, state, clamped_m, vacuum_pa, machine.rig.clamp_m_per_n, tension_n)
    if state.more[TORN] == 0.0:
        return tension_n, np.zeros(len(clamped_m))
    torn = np.maximum.accumulate((clamped_m + law.scalars[SHORTER] > 0.8 * law.scalars[BREAK]) & (tension_n == 0.0))
    return tension_n, torn.astype(np.float64)


@compiled
def _pull_on(law: Any, state: Any, clamped_m: Any, vacuum_pa: Any, give_m_n: float, tension_n: Any) -> None:
    """Pull the tendon through all steps but the first; the clamps give way to the force of the step before."""
    for i in range(1, len(clamped_m)):
        extension_m = clamped_m[i] - give_m_n * tension_n[i - 1]
        tension_n[i] = tendon_tension_n(law, state, extension_m, vacuum_pa[i])
