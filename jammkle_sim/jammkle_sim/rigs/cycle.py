"""The cycle: the foot hangs free and still while its channels are jammed and vented, each in turn and then together."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from jammkle_common import names
from jammkle_common.parameters import parameter
from jammkle_sim.physics.ankle import AnkleParameters
from jammkle_sim.rigs.model import guided_ankle, new_spec
from jammkle_sim.rigs.options import (
    hang_pitch_option,
    jammed_vacuum_option,
    parameter_set_option,
    reservoir_option,
    run_timestep_option,
    seed_option,
)
from jammkle_sim.rigs.run import ROBOT_TOPICS, Programme, RigKind
from jammkle_sim.rigs.vacuum import VacuumStep

if TYPE_CHECKING:
    from collections.abc import Mapping

    from jammkle_sim.rigs.recording import Series
    from jammkle_sim.rigs.rig import Rig

_START_S = 0.5
"""Time before the first cycle, in which the sensors' offsets are seen."""
_GROUPS = (*((channel,) for channel in names.CHANNELS), names.CHANNELS)
"""Channels of each cycle."""


@dataclass(frozen=True)
class CycleOptions:
    """What can be chosen about a cycle of every channel."""

    vacuum_pa: float = jammed_vacuum_option()
    jam_time_s: float = parameter(1.5, "How long each cycle holds the vacuum", "s", 0.1, 60.0)
    vent_time_s: float = parameter(0.8, "How long each cycle vents", "s", 0.1, 60.0)
    hang_pitch_deg: float = hang_pitch_option()
    reservoir_volume_m3: float = reservoir_option()
    parameter_set: str = parameter_set_option()
    seed: int = seed_option()
    timestep_s: float = run_timestep_option()


def cycle_rig(options: CycleOptions, ankle: AnkleParameters | None = None) -> tuple[Rig, Programme]:
    """Build the rig and what it does.

    Args:
        options: How deep and how long.
        ankle: Constants of the ankle, whose pose an option adds to; None: AnkleParameters as they stand.

    """
    from scipy.spatial.transform import Rotation  # type: ignore[import-untyped]  # noqa: PLC0415 - see `rigs.guide`

    period_s = options.jam_time_s + options.vent_time_s
    schedule = []
    for place, channels in enumerate(_GROUPS):
        start_s = _START_S + place * period_s
        schedule += [
            VacuumStep(start_s, channels, options.vacuum_pa),
            VacuumStep(start_s + options.jam_time_s, channels, 0.0),
        ]
    rows = 3
    spec = new_spec("cycle", options.timestep_s)
    rig = guided_ankle(spec, options, ankle, np.zeros((rows, 3)), Rotation.identity(rows))
    programme = Programme(
        duration_s=_START_S + len(_GROUPS) * period_s,
        vacuum=tuple(schedule),
        evaluate=_results,
        topics=ROBOT_TOPICS,
    )
    return rig, programme


def _results(topics: Mapping[str, Series]) -> dict[str, float]:
    """Deepest vacuum of every channel."""
    found = {}
    for channel, topic in names.PRESSURES.items():
        pressure_pa = topics[topic.name].column("fluid_pressure_pa")
        found[f"{channel}_deepest_vacuum_pa"] = float(pressure_pa[0] - pressure_pa.min())
    return found


RIG = RigKind(
    "cycle",
    "jam and vent each channel of a hanging ankle, then all",
    CycleOptions,
    cycle_rig,
    lambda options, _numbers: options,
    AnkleParameters(),
)
