"""The second simulator in the words of the diagnosis: its signals, and what a day does to its machine."""

from __future__ import annotations

import dataclasses
import re
from typing import TYPE_CHECKING, Final

import numpy as np

from jammkle_common.names import CHANNELS, PUMP_DUTY, SOLENOIDS, TENDONS
from jammkle_gap import RESOLUTION, UNITS, AnkleInputs, Nuisance, Recording, Signal, quantity_of
from jammkle_sim.rigs.replay import CommandTrack, Timeline
from studies.blind.reality.machine import Machine, plus, times
from studies.blind.reality.specimen import RUNS

if TYPE_CHECKING:
    from collections.abc import Mapping

    from studies.blind.reality.sensors import RealRun

COMMANDS: Final = frozenset({PUMP_DUTY.name, *(topic.name for topic in SOLENOIDS.values())})
"""Topics of what was commanded, which is the same whatever is wrong, and never lost."""
INSTRUMENTED: Final = ("/tension", "/extension")
"""Ends of the names of signals that no robot measures."""
_COLUMNS: Final = (
    (re.compile(r"linear_acceleration_([xyz])_m_s2"), r"imu/specific_force_\1"),
    (re.compile(r"angular_velocity_([xyz])_rad_s"), r"imu/angular_velocity_\1"),
    (re.compile(r"force_z_n"), "load_cell/force_z"),
    (re.compile(r"(\w+)\.position"), r"\1/position"),
)
"""Columns of a run, and the signals that they are."""
_SOURCE = "the second simulator's own"
DAY: Final = (
    *(
        Nuisance(f"day.{name}", unit, 0.0, sigma, _SOURCE)
        for name, unit, sigma in (
            ("ambient", "Pa", RUNS.ambient_pa),
            ("pump_flow", "1", RUNS.pump_flow),
            ("leak", "1", RUNS.leak),
            ("room", "K", RUNS.offset_k),
        )
    ),
    *(Nuisance(f"day.dead_{each}", "s", 0.0, RUNS.dead_s, _SOURCE) for each in CHANNELS),
    *(Nuisance(f"day.shorter_{each}", "m", 0.0, RUNS.shorter_m, _SOURCE) for each in TENDONS),
    *(Nuisance(f"day.zero_{i}", "Pa", 0.0, RUNS.pressure_drift_pa, _SOURCE) for i in range(1 + len(CHANNELS))),
)
"""Scatter from run to run of a foot that is exercised."""


def built(values: Mapping[str, float]) -> Machine:
    """Return the machine as drawn on a day with deviations by name, those of `DAY`."""

    def more(name: str) -> float:
        return values.get(f"day.{name}", 0.0)

    plain = Machine()
    air = plain.air
    lines = tuple(
        plus(times(line, leak_area_m2=max(1.0 + more("leak"), 0.0)), dead_s=max(more(f"dead_{channel}"), -line.dead_s))
        for channel, line in zip(CHANNELS, air.lines, strict=True)
    )
    pump = times(air.pump, free_flow_m3_s=1.0 + more("pump_flow"))
    air = dataclasses.replace(
        plus(air, ambient_pa=more("ambient"), room_k=more("room")),
        pump=pump,
        lines=lines,
    )
    tendons = tuple(
        plus(make, offset_k=more("room"), shorter_m=more(f"shorter_{name}"))
        for name, make in zip(TENDONS, plain.tendons, strict=True)
    )
    zeroed = tuple(plus(each, offset=more(f"zero_{i}")) for i, each in enumerate(plain.sensors.pressure))
    sensors = dataclasses.replace(plain.sensors, pressure=zeroed)
    return dataclasses.replace(plain, air=air, tendons=tendons, sensors=sensors)


def recording_of_real(run: RealRun, setting: str) -> Recording:
    """Return what a rig's sensors recorded of a run: good for features, but it cannot be simulated again."""
    signals = tuple(each for each in signals_of(run) if not each.name.endswith(INSTRUMENTED))
    nothing = CommandTrack(Timeline(np.zeros(1), np.zeros(1)), {})
    return Recording(run.plan.rig, signals, AnkleInputs(run.plan.rig, (), nothing), setting=setting)


def signals_of(run: RealRun) -> list[Signal]:
    """Return what all sensors recorded of a run."""
    signals = []
    for topic, track in run.topics.items():
        if topic in COMMANDS:
            continue
        rising = np.concatenate([[True], np.diff(np.maximum.accumulate(track.stamp_s)) > 0.0])
        for i, column in enumerate(track.columns):
            name = _signal(topic, column)
            if name:
                quantity = quantity_of(name)
                values = np.asarray(track.values[rising, i], dtype=float)
                step = RESOLUTION.get(quantity, 0.0)
                signals.append(Signal(name, UNITS[quantity], track.stamp_s[rising], values, resolution=step))
    return signals


def _signal(topic: str, column: str) -> str:
    if column == "fluid_pressure_pa":
        return topic
    for pattern, template in _COLUMNS:
        match = pattern.fullmatch(column)
        if match is not None:
            return match.expand(template)
    return ""
