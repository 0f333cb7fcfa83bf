"""The landing rig: a leg on a vertical slide, held above a slope, let go, caught by its ankle."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from jammkle_common import names
from jammkle_common.constants import STANDARD_GRAVITY_M_S2
from jammkle_common.parameters import parameter
from jammkle_sim.physics.ankle import AnkleParameters
from jammkle_sim.rigs.model import add_slope, ankle_under_carriage, new_spec, release, touch_down_height_m
from jammkle_sim.rigs.options import (
    drop_height_option,
    jammed_vacuum_option,
    mass_option,
    parameter_set_option,
    release_time_option,
    replaced_within_range,
    run_timestep_option,
    seed_option,
    slope_friction_option,
    slope_option,
    timestep_option,
)
from jammkle_sim.rigs.recording import Series, peak_deceleration_m_s2, smoothed
from jammkle_sim.rigs.rig import Event, Rig
from jammkle_sim.rigs.run import LEG_TOPICS, Programme, RigKind
from jammkle_sim.rigs.vacuum import VacuumStep, all_channels

if TYPE_CHECKING:
    from collections.abc import Mapping


@dataclass(frozen=True)
class LandingOptions:
    """What can be chosen about a landing."""

    slope_deg: float = slope_option()
    friction: float = slope_friction_option()
    drop_height_m: float = drop_height_option("slope")
    release_time_s: float = release_time_option("each start")
    mass_kg: float = mass_option(flag=False)
    parameter_set: str = parameter_set_option()
    seed: int = seed_option()
    timestep_s: float = timestep_option("a whole number of nanoseconds")


def landing_built(options: LandingOptions, ankle: AnkleParameters | None = None) -> Rig:
    """Build the landing rig, with options as they are: a machine may stand a little beyond what can be asked for.

    Args:
        options: What to land on, with what, from where.
        ankle: Constants of the ankle; None: AnkleParameters as they stand.

    """
    ankle = ankle or AnkleParameters()
    spec = new_spec("landing", options.timestep_s)
    add_slope(spec, options.slope_deg, options.friction, ankle.contact_time_s)
    return ankle_under_carriage(
        spec,
        options,
        ankle,
        start_m=touch_down_height_m(options.slope_deg, ankle) + options.drop_height_m,
        mass_kg=options.mass_kg - ankle.mass_kg,
        friction=options.friction,
        events=(Event(round(options.release_time_s / options.timestep_s), release),),
    )


_REST_S = 2.0
"""Recorded time after the touch-down."""
_REACTION_S = 0.02
"""From touch-down to the command to jam, for `jam` = after. Assumed: what a detector on the IMU takes."""


@dataclass(frozen=True)
class LandingRunOptions(LandingOptions):
    """What can be chosen about a landing that is run by itself."""

    release_time_s: float = release_time_option("the start")
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


RIG = RigKind(
    "landing",
    "drop a leg onto a slope; the demo's rig",
    LandingRunOptions,
    landing_rig,
    scattered,
    AnkleParameters(),
)
