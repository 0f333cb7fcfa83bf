"""The pressure rig: the ankle hangs free while its channels are jammed and vented, again and again."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from jammkle_common import names
from jammkle_common.constants import HELD_VACUUM_PA
from studies.blind.reality.breathing import HISTORY_S, breathe
from studies.blind.reality.hanging import JOINTS, hang
from studies.blind.reality.options import BadPlanError, settings
from studies.blind.reality.record import RealRun
from studies.blind.reality.regulator import together
from studies.blind.reality.sensors import Truth, encoder_track, tendon_track

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from studies.blind.reality.faults import Era
    from studies.blind.reality.instruments import Sensor
    from studies.blind.reality.machine import Machine
    from studies.blind.reality.record import Option, Plan

_ALL = "all"
DEFAULTS: dict[str, Option] = {
    "channel": _ALL,
    "vacuum_pa": HELD_VACUUM_PA,
    "cycles": 3,
    "jam_time_s": 1.0,
    "vent_time_s": 0.5,
}
FIXED: dict[str, Option] = {
    "pump_free_flow_l_min": 6.0,
    "pump_ultimate_vacuum_pa": 80e3,
    "valve_dead_time_s": 0.010,
    "leak_dm3_s_bar": 1e-4,
}
_START_S = 0.2
_HEIGHT_M = 0.3


def pressure(plan: Plan, periods: Sequence[Era], seed: int) -> RealRun:
    """Jam and vent.

    Args:
        plan: Settings of the rig.
        periods: The machine over time, on the day of the run.
        seed: Of the run.

    Raises:
        BadPlanError: a setting that there is not.

    """
    chosen = settings(plan, DEFAULTS, FIXED)
    if chosen["channel"] not in (_ALL, *names.CHANNELS):
        msg = f"'channel' is {chosen['channel']}; it must be {_ALL} or one of {', '.join(names.CHANNELS)}"
        raise BadPlanError(msg)
    channels = names.CHANNELS if chosen["channel"] == _ALL else (str(chosen["channel"]),)
    jam_s, vacuum_pa = float(chosen["jam_time_s"]), float(chosen["vacuum_pa"])
    period_s = jam_s + float(chosen["vent_time_s"])
    starts_s = [_START_S + cycle * period_s for cycle in range(int(chosen["cycles"]))]
    schedule = [
        point
        for start_s in starts_s
        for point in (*together(start_s, channels, vacuum_pa), *together(start_s + jam_s, channels, 0.0))
    ]
    duration_s = round((_START_S + len(starts_s) * period_s) * 100.0) / 100.0
    air = breathe(periods, schedule, duration_s, seed)
    motion = hang(periods, air.vacuum_pa, HISTORY_S)

    carriage_m = np.full((len(air.time_s), 1), _HEIGHT_M)
    joints = Truth(air.time_s, np.column_stack([motion.angle_rad, carriage_m]))
    choices: tuple[Callable[[Machine], Sensor], ...] = (
        *((lambda machine: machine.sensors.angle,) * len(JOINTS)),
        lambda machine: machine.sensors.slide,
    )
    topics = {
        **air.topics,
        names.JOINT_STATES.name: encoder_track(
            periods, seed, (*JOINTS, names.CARRIAGE_JOINT), joints, duration_s, choices
        ),
        names.TENDON_STATES.name: tendon_track(
            periods,
            seed,
            names.TENDONS,
            Truth(air.time_s, motion.extension_m),
            Truth(air.time_s, motion.tension_n),
            Truth(air.time_s, np.zeros_like(motion.tension_n)),
            duration_s,
        ),
    }
    return RealRun(plan, topics)
