"""The air that a run begins with: the weather, and what was evacuated already."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np

from jammkle_common import names
from jammkle_common.constants import STANDARD_ATMOSPHERE_PA
from jammkle_gap.ankle.phases import pressure_signals
from jammkle_sim.rigs.replay import Timeline

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from jammkle_gap.ankle.bag import Samples
    from jammkle_gap.ankle.inputs import AnkleInputs
    from jammkle_gap.core.data import Signal

NOT_VENTED_PA = 3e3
"""Distance from the atmosphere from which on a channel counts as evacuated at the start. Assumed: twenty times the
scatter of the sensors' offsets."""
_ALTITUDE_PA = 2e3
"""Distance from the standard atmosphere from which on a bag that describes its rig is not taken at its word. Assumed:
no weather at sea level does more, 200 m of height do."""
_VENTED_S = 0.5
"""Time after its solenoid let go at which a channel has vented. Assumed: five times its time constant."""
_SOURCES = {"manifold": names.MANIFOLD_PRESSURE, **names.PRESSURES}
"""Topics of the pressures by volume, in the order of the simulation."""
_AT_START = 5
"""Readings that the pressure at the start is taken from."""
_HIGHEST = 99.0
"""Percentile of the pressure that a vented channel stands at: the readings' noise is above it."""


def weather_pa(topics: Mapping[str, Samples], *, described: bool = False) -> float | None:
    """Return the pressure of the atmosphere, Pa, by the channels that stood vented for a while; None if none did.

    Args:
        topics: Of the whole bag, commands among them.
        described: The bag says what its rig was built with: None, but far from there.

    """
    found = []
    for channel, topic in names.PRESSURES.items():
        pressure, solenoid = topics.get(topic.name), topics.get(names.SOLENOIDS[channel].name)
        if pressure is None or not len(pressure.stamp_s):
            continue
        vented = np.ones(len(pressure.stamp_s), dtype=bool)
        if solenoid is not None:
            drawing = np.concatenate(([0.0], solenoid.columns["data"])) > 0.0
            for back_s in (0.0, _VENTED_S):
                at = np.searchsorted(solenoid.log_s, pressure.stamp_s - back_s, side="right")
                vented &= ~drawing[at]
        if vented.any():
            found.append(float(np.median(pressure.columns["pressure"][vented])))
    weather = float(np.median(found)) if found else None
    is_as_described = weather is None or abs(weather - STANDARD_ATMOSPHERE_PA) <= _ALTITUDE_PA
    return None if described and is_as_described else weather


def begins_vented(topics: Mapping[str, Samples]) -> bool:
    """Tell whether nothing was evacuated when a bag begins.

    Args:
        topics: Of the whole bag, commands among them.

    """
    begun = [(each, topics[topic.name]) for each, topic in _SOURCES.items() if topic.name in topics]
    solenoids = {
        channel: Timeline(topics[topic.name].log_s, topics[topic.name].columns["data"])
        for channel, topic in names.SOLENOIDS.items()
        if topic.name in topics
    }
    weather = weather_pa(topics)
    ambient_pa = STANDARD_ATMOSPHERE_PA if weather is None else weather
    return not any(
        _is_evacuated(where, each.stamp_s, each.columns["pressure"], solenoids, ambient_pa)
        for where, each in begun
        if len(each.stamp_s)
    )


def with_air(
    inputs: AnkleInputs, weather: float | None, signals: Mapping[str, Signal], ambient_pa: float, notes: list[str]
) -> AnkleInputs:
    """Return inputs with the atmosphere, and with the start pressures of a run that does not begin vented.

    Args:
        inputs: Of the run, with its commands.
        weather: Pressure of the atmosphere that the run was made in, Pa; None: that which the rig is built with.
        signals: Of the run.
        ambient_pa: Pressure of the atmosphere that the rig is built with, Pa.
        notes: What the reader should know is added.

    """
    if weather is not None:
        inputs = dataclasses.replace(inputs, ambient_pa=weather)
        if abs(weather - ambient_pa) > _ALTITUDE_PA:
            notes.append(f"atmosphere taken from the vented pressures: {weather:.0f} Pa")
        ambient_pa = weather
    begun = {where: signals[name] for where, name in pressure_signals(signals).items()}
    solenoids = inputs.commands.solenoids
    evacuated = [
        where for where, each in begun.items() if _is_evacuated(where, each.time_s, each.values, solenoids, ambient_pa)
    ]
    if not evacuated:
        return inputs
    notes.append(f"not vented at the start, and begun from the pressures measured then: {', '.join(evacuated)}")
    first_pa = {where: _first_pa(each.time_s, each.values, solenoids) for where, each in begun.items()}
    start_pa = np.array([first_pa.get(where, ambient_pa) for where in _SOURCES])
    return dataclasses.replace(inputs, start_pa=start_pa)


def _is_evacuated(
    where: str,
    time_s: NDArray[np.float64],
    pressure_pa: NDArray[np.float64],
    solenoids: Mapping[str, Timeline],
    ambient_pa: float,
) -> bool:
    """Tell whether a volume is evacuated as its readings begin: below what it reads later, or drawn by a solenoid.

    A sensor that only reads low reads as low when its channel is vented.
    """
    first_pa = _first_pa(time_s, pressure_pa, solenoids)
    if first_pa < float(np.percentile(pressure_pa, _HIGHEST)) - NOT_VENTED_PA:
        return True
    lines = [line for channel, line in solenoids.items() if where in {channel, "manifold"}]
    is_drawn = any(line.at(float(time_s[0])) > 0.0 for line in lines)
    return is_drawn and first_pa < ambient_pa - NOT_VENTED_PA


def _first_pa(
    time_s: NDArray[np.float64], pressure_pa: NDArray[np.float64], solenoids: Mapping[str, Timeline]
) -> float:
    """Return what a sensor reads as its readings begin, Pa: the median of a few, none after the first switching."""
    switched_s = [float(line.time_s[line.time_s > time_s[0]].min(initial=np.inf)) for line in solenoids.values()]
    count = int(np.searchsorted(time_s, min(switched_s, default=np.inf)))
    return float(np.median(pressure_pa[: max(min(count, _AT_START), 1)]))
