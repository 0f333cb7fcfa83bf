"""The landing rig on its own, without the graph: released, caught by its ankle, jammed at a time of its own."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from jammkle_common import names
from jammkle_common.constants import STANDARD_GRAVITY_M_S2
from jammkle_common.parameters import parameter
from jammkle_sim.rigs.evaluate import peak_deceleration_m_s2, smoothed
from jammkle_sim.rigs.landing import LandingOptions, landing_built
from jammkle_sim.rigs.options import (
    jammed_vacuum_option,
    release_time_option,
    replaced_within_range,
    run_timestep_option,
)
from jammkle_sim.rigs.run import LEG_TOPICS, Programme, Series
from jammkle_sim.rigs.vacuum import VacuumStep, all_channels

if TYPE_CHECKING:
    from collections.abc import Mapping

    from jammkle_sim.physics.ankle import AnkleParameters
    from jammkle_sim.rigs.rig import Rig

_REST_S = 2.0
"""Recorded time after the touch-down."""
_REACTION_S = 0.02
"""From touch-down to the command to jam, for `jam` = after. Assumed: what a detector on the IMU takes."""


@dataclass(frozen=True)
class LandingRunOptions(LandingOptions):
    """What can be chosen about a landing that is run by itself."""

    release_time_s: float = release_time_option("the start", 3600.0)
    timestep_s: float = run_timestep_option()
    jam: str = parameter(
        "after",
        "When the ankle is jammed: never, before the release, after touch-down",
        choices=("never", "before", "after"),
    )
    vacuum_pa: float = jammed_vacuum_option()


def scattered(options: LandingRunOptions, numbers: tuple[float, float]) -> LandingRunOptions:
    """Return the options of one repeat: height by 0.5 mm, friction by 0.01 (standard deviations, assumed)."""
    height, friction = numbers
    return replaced_within_range(
        options,
        drop_height_m=options.drop_height_m + 0.0005 * height,
        friction=options.friction + 0.01 * friction,
    )


def landing_rig(options: LandingRunOptions, ankle: AnkleParameters | None = None) -> tuple[Rig, Programme]:
    """Build the rig and what it does.

    Args:
        options: What to land on, with what, from where.
        ankle: Constants of the ankle; None: AnkleParameters as they stand.

    """
    rig = landing_built(options, ankle)
    touch_down_s = options.release_time_s + math.sqrt(2.0 * options.drop_height_m / STANDARD_GRAVITY_M_S2)
    vacuum: dict[str, tuple[VacuumStep, ...]] = {
        "never": (),
        "before": (all_channels(0.0, options.vacuum_pa),),
        "after": (all_channels(touch_down_s + _REACTION_S, options.vacuum_pa),),
    }
    programme = Programme(
        duration_s=touch_down_s + _REST_S,
        vacuum=vacuum[options.jam],
        evaluate=lambda topics: _results(topics, options.release_time_s),
        topics=LEG_TOPICS,
    )
    return rig, programme


def _results(topics: Mapping[str, Series], release_s: float) -> dict[str, float]:
    cell, joints = topics[names.LOAD_CELL.name], topics[names.JOINT_STATES.name]
    height_m = joints.column(f"{names.CARRIAGE_JOINT}.position")
    return {
        "peak_deceleration_m_s2": peak_deceleration_m_s2(topics[names.IMU.name], release_s),
        "peak_force_n": float(-smoothed(cell.column("force_z_n")).min()),
        "lowest_height_m": float(height_m.min()),
        "final_height_m": float(height_m[-1]),
        "final_pitch_rad": float(joints.column("ankle_pitch.position")[-1]),
    }
