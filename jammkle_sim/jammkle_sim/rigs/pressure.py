"""The pressure rig: the ankle hangs free while its channels are jammed and vented, again and again."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from jammkle_common import names
from jammkle_common.constants import HELD_VACUUM_PA
from jammkle_common.parameters import parameter
from jammkle_sim.physics.ankle import AnkleParameters
from jammkle_sim.physics.pneumatics import PneumaticParameters
from jammkle_sim.rigs.model import ankle_under_carriage, new_spec
from jammkle_sim.rigs.options import parameter_set_option, replaced_within_range, run_timestep_option, seed_option
from jammkle_sim.rigs.run import Programme, RigKind
from jammkle_sim.rigs.vacuum import VacuumStep

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy as np
    from numpy.typing import NDArray

    from jammkle_sim.rigs.recording import Series
    from jammkle_sim.rigs.rig import Rig

_ALL = "all"
_START_S = 0.2
"""Time before the first cycle, in which the sensors' offsets are seen."""
_HEIGHT_M = 0.3
"""Height of the carriage: nothing is touched."""
_REACHED_PA = 1e3
"""Distance from the set point within which it counts as reached. Assumed."""
VENTED_PA = 5e3
"""Vacuum below which a channel counts as vented, as in the driver."""


@dataclass(frozen=True)
class PressureOptions:
    """What can be chosen about jam and vent cycles."""

    channel: str = parameter("all", "Which channels are evacuated", choices=(_ALL, *names.CHANNELS))
    vacuum_pa: float = parameter(HELD_VACUUM_PA, "Vacuum of each cycle", "Pa", 6e3, 75e3)
    cycles: int = parameter(3, "How many cycles", "", 1, 100)
    jam_time_s: float = parameter(1.0, "How long each cycle holds the vacuum", "s", 0.1, 60.0)
    vent_time_s: float = parameter(0.5, "How long each cycle vents", "s", 0.1, 60.0)
    pump_free_flow_l_min: float = parameter(6.0, "Flow of the pump without vacuum", "l/min", 0.5, 30.0, flag=False)
    pump_ultimate_vacuum_pa: float = parameter(
        80e3, "Vacuum at which the pump stops drawing", "Pa", 20e3, 100e3, flag=False
    )
    valve_dead_time_s: float = parameter(
        0.010, "Time from command to movement of a solenoid", "s", 0.0, 0.1, flag=False
    )
    leak_dm3_s_bar: float = parameter(
        1e-4, "Sonic conductance of the leak into each volume", "dm3/(s bar)", 0.0, 0.05, flag=False
    )
    seed: int = seed_option()
    parameter_set: str = parameter_set_option()
    timestep_s: float = run_timestep_option()


def scattered(options: PressureOptions, numbers: tuple[float, float]) -> PressureOptions:
    """Return the options of one repeat: the valves' dead time differs by 1 ms (standard deviation, assumed)."""
    return replaced_within_range(options, valve_dead_time_s=options.valve_dead_time_s + 0.001 * numbers[0])


def pressure_rig(options: PressureOptions, ankle: AnkleParameters | None = None) -> tuple[Rig, Programme]:
    """Build the rig and what it does.

    Args:
        options: What is jammed, how deep, how often.
        ankle: Constants of the ankle; None: AnkleParameters as they stand.

    """
    ankle = ankle or AnkleParameters()
    rig = ankle_under_carriage(
        new_spec("pressure", options.timestep_s),
        options,
        ankle,
        start_m=_HEIGHT_M,
        mass_kg=ankle.mass_kg,
        friction=0.0,
        pneumatics=PneumaticParameters(
            pump_free_flow_l_min=options.pump_free_flow_l_min,
            pump_ultimate_vacuum_pa=options.pump_ultimate_vacuum_pa,
            valve_dead_time_s=options.valve_dead_time_s,
            leak_conductance_dm3_s_bar=options.leak_dm3_s_bar,
        ),
    )
    channels = names.CHANNELS if options.channel == _ALL else (options.channel,)
    period_s = options.jam_time_s + options.vent_time_s
    starts_s = [_START_S + i * period_s for i in range(options.cycles)]
    schedule = [
        step
        for start_s in starts_s
        for step in (
            VacuumStep(start_s, channels, options.vacuum_pa),
            VacuumStep(start_s + options.jam_time_s, channels, 0.0),
        )
    ]
    programme = Programme(
        duration_s=_START_S + options.cycles * period_s,
        vacuum=tuple(schedule),
        evaluate=lambda topics: _results(topics, options, channels, starts_s),
        topics=(names.JOINT_STATES.name, names.TENDON_STATES.name),
    )
    return rig, programme


def _results(
    topics: Mapping[str, Series], options: PressureOptions, channels: tuple[str, ...], starts_s: list[float]
) -> dict[str, float]:
    """Slowest channel of the slowest cycle; a time is left out where none ever got there.

    What never reached its set point has nothing to vent from that could be compared: it has no time of venting either.
    """
    jam_times_s: list[float] = []
    vent_times_s: list[float] = []
    deepest_pa: list[float] = []
    for channel in channels:
        series = topics[names.PRESSURES[channel].name]
        pressure_pa = series.column("fluid_pressure_pa")
        vacuum_pa = pressure_pa[series.time_s < _START_S].mean() - pressure_pa
        for start_s in starts_s:
            turn_s = start_s + options.jam_time_s
            jamming = (series.time_s >= start_s) & (series.time_s <= turn_s)
            venting = (series.time_s >= turn_s) & (series.time_s <= turn_s + options.vent_time_s)
            reached = vacuum_pa[jamming] >= options.vacuum_pa - _REACHED_PA
            vented = vacuum_pa[venting] < VENTED_PA
            jam_times_s += [moment_s - start_s for moment_s in _first_s(series.time_s[jamming], reached)]
            if reached.any():
                vent_times_s += [moment_s - turn_s for moment_s in _first_s(series.time_s[venting], vented)]
            deepest_pa.append(float(vacuum_pa[jamming].max()))
    results = {"deepest_vacuum_pa": max(deepest_pa), "share_reached": len(jam_times_s) / len(deepest_pa)}
    if jam_times_s:
        results["jam_time_s"] = max(jam_times_s)
    if vent_times_s:
        results["vent_time_s"] = max(vent_times_s)
    return results


def _first_s(time_s: NDArray[np.float64], happened: NDArray[np.bool_]) -> list[float]:
    """Return when something first happened, s, as a list of one; empty if it never did."""
    return [float(time_s[int(happened.argmax())])] if happened.any() else []


RIG = RigKind(
    "pressure",
    "jam and vent the channels of a hanging ankle",
    PressureOptions,
    pressure_rig,
    scattered,
    AnkleParameters(),
)
