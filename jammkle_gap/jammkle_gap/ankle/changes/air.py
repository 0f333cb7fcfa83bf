"""Changes to pump, valves, lines and their pressure sensors."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

import numpy as np

from jammkle_common.names import CHANNELS
from jammkle_sim.physics import pneumatics
from jammkle_sim.physics.pneumatics import REFERENCE_DENSITY_KG_M3, conductance_kg_s_pa, stable_substeps
from jammkle_sim.rigs.rig import laws_of

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from jammkle_sim.rigs.rig import Rig

VOLUMES = ("manifold", *CHANNELS)
"""Places of the laws' volumes, in order."""


def leak(rig: Rig, values: Mapping[str, float], place: str) -> Rig:
    """Let air of the atmosphere into one volume, by `conductance_dm3_s_bar`."""

    def change(law: Any) -> None:
        law["leak_kg_s_pa"][VOLUMES.index(place)] += conductance_kg_s_pa(values["conductance_dm3_s_bar"])

    return with_air(rig, change)


def wear_pump(rig: Rig, values: Mapping[str, float], _place: str) -> Rig:
    """Scale free flow by `flow_scale`, and the vacuum at which the pump stops by `vacuum_scale`."""

    def change(law: Any) -> None:
        law["pump_free_flow_m3_s"] *= values["flow_scale"]
        law["pump_ultimate_vacuum_pa"] *= values["vacuum_scale"]

    return with_air(rig, change)


def dead_time(rig: Rig, values: Mapping[str, float], place: str) -> Rig:
    """Make a channel's solenoid, or without a place all, slower by `extra_s`, though never quicker than at once."""
    chosen = [CHANNELS.index(place)] if place else list(range(len(CHANNELS)))

    def change(law: Any) -> None:
        dead_times_s = law["valve_dead_time_s"]
        dead_times_s[chosen] = np.maximum(dead_times_s[chosen] + values["extra_s"], 0.0)

    return with_air(rig, change)


def kink(rig: Rig, values: Mapping[str, float], place: str) -> Rig:
    """Scale the conductance of one channel's valve and tube by `conductance_scale`."""

    def change(law: Any) -> None:
        law["valve_kg_s_pa"][CHANNELS.index(place)] *= values["conductance_scale"]

    return with_air(rig, change)


def lengthen_hose(rig: Rig, values: Mapping[str, float], place: str) -> Rig:
    """Put `length_m` more hose between one channel's valve and its tendons: more air, less flow, and later."""
    length_m, i, density_kg_m3 = values["length_m"], CHANNELS.index(place), REFERENCE_DENSITY_KG_M3

    def change(law: Any) -> None:
        law["volume_m3"][i + 1] += pneumatics.hose_volume_m3(length_m)
        before_m3_s_pa = law["valve_kg_s_pa"][i] / density_kg_m3
        law["valve_kg_s_pa"][i] = density_kg_m3 * pneumatics.conductance_behind_hose(before_m3_s_pa, length_m)
        law["valve_dead_time_s"][i] += pneumatics.hose_travel_s(length_m)

    return with_air(rig, change)


def trap_volume(rig: Rig, values: Mapping[str, float], place: str) -> Rig:
    """Add `volume_m3` to one volume."""

    def change(law: Any) -> None:
        law["volume_m3"][VOLUMES.index(place)] += values["volume_m3"]

    return with_air(rig, change)


def offset_pressure(rig: Rig, values: Mapping[str, float], place: str) -> Rig:
    """Let one sensor read `offset_pa` too much."""
    offsets = list(rig.wiring.pressure_offset_pa)
    offsets[VOLUMES.index(place)] += values["offset_pa"]
    return dataclasses.replace(rig, wiring=dataclasses.replace(rig.wiring, pressure_offset_pa=tuple(offsets)))


def with_air(rig: Rig, change: Callable[[Any], None]) -> Rig:
    """Return the rig with another law of the air.

    Args:
        rig: Not touched.
        change: Changes its record of PNEUMATIC_LAW in place.

    """
    law = laws_of(rig).pneumatics.copy()
    change(law[0])
    law["substeps"] = stable_substeps(law)
    return dataclasses.replace(rig, pneumatic_law=law)
