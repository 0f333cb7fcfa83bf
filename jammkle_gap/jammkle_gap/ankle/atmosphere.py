"""The air that a run begins with: the weather, and what was evacuated already."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np

from jammkle_gap.ankle.phases import pressure_signals
from jammkle_graph import names
from jammkle_graph.constants import STANDARD_ATMOSPHERE_PA

if TYPE_CHECKING:
    from collections.abc import Mapping

    from jammkle_gap.ankle.bag import Samples
    from jammkle_gap.ankle.inputs import AnkleInputs
    from jammkle_gap.core.data import Signal

NOT_VENTED_PA = 3e3
"""Distance from the atmosphere from which on a channel counts as evacuated at the start. Assumed: twenty times the
scatter of the sensors' offsets."""
_WEATHER_PA = 500.0
"""Distance from the standard atmosphere from which on the recording's own is taken. Assumed: three such scatters."""
_VENTED_S = 0.5
"""Time after its solenoid let go at which a channel has vented. Assumed: five times its time constant."""
_AT_START = 5
"""Readings that the pressure at the start is taken from."""
_HIGHEST = 99.0
"""Percentile of the pressure that a vented channel stands at: the readings' noise is above it."""


def weather_pa(topics: Mapping[str, Samples]) -> float | None:
    """Return the pressure of the atmosphere, Pa, told by the channels that stood vented for a while; None if none did.

    Args:
        topics: Of the whole bag, commands among them.

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
            found.append(float(np.percentile(pressure.columns["pressure"][vented], _HIGHEST)))
    return float(np.median(found)) if found else None


def begins_vented(topics: Mapping[str, Samples]) -> bool:
    """Tell whether nothing was evacuated when a bag begins.

    Args:
        topics: Of the whole bag, commands among them.

    """
    weather = weather_pa(topics)
    lowest_pa = (STANDARD_ATMOSPHERE_PA if weather is None else weather) - NOT_VENTED_PA
    sources = (names.MANIFOLD_PRESSURE, *names.PRESSURES.values())
    found = [topics[topic.name].columns["pressure"] for topic in sources if topic.name in topics]
    return all(float(np.median(pressure_pa[:_AT_START])) >= lowest_pa for pressure_pa in found if len(pressure_pa))


def with_air(
    inputs: AnkleInputs, weather: float | None, signals: Mapping[str, Signal], ambient_pa: float, notes: list[str]
) -> AnkleInputs:
    """Return inputs with the atmosphere, and with the start pressures of a run that does not begin vented.

    Args:
        inputs: Of the run.
        weather: Pressure of the atmosphere, Pa, as measured; None: not known, or the bag describes its rig.
        signals: Of the run.
        ambient_pa: Pressure of the atmosphere that the rig is built with, Pa.
        notes: What the reader should know is added.

    """
    if weather is not None and abs(weather - STANDARD_ATMOSPHERE_PA) > _WEATHER_PA:
        ambient_pa = weather
        inputs = dataclasses.replace(inputs, ambient_pa=ambient_pa)
        notes.append(f"atmosphere taken from the vented pressures: {ambient_pa:.0f} Pa")
    first = {
        where: float(np.median(signals[name].values[:_AT_START])) for where, name in pressure_signals(signals).items()
    }
    evacuated = [where for where, value in first.items() if value < ambient_pa - NOT_VENTED_PA]
    if not evacuated:
        return inputs
    notes.append(f"not vented at the start, and begun from the pressures measured then: {', '.join(evacuated)}")
    volumes = ("manifold", *names.CHANNELS)
    return dataclasses.replace(inputs, start_pa=np.array([first.get(where, ambient_pa) for where in volumes]))
