"""The landing rig on its own, without the graph: released, caught by its ankle, jammed at a time of its own."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from jammkle_graph import names
from jammkle_graph.parameters import parameter
from jammkle_sim.physics.constants import GRAVITY_M_S2, TENDON_SETS
from jammkle_sim.rigs.evaluate import peak_deceleration_m_s2, smoothed
from jammkle_sim.rigs.landing import LandingOptions, landing_parts
from jammkle_sim.rigs.run import Programme, Series
from jammkle_sim.rigs.vacuum import VacuumStep, all_channels

if TYPE_CHECKING:
    from collections.abc import Mapping

    from jammkle_sim.rigs.rig import Rig

_REST_S = 2.0
"""Recorded time after the touch-down."""
_REACTION_S = 0.02
"""From touch-down to the command to jam, for `jam` = after. Assumed: what a detector on the IMU takes."""


@dataclass(frozen=True)
class LandingRunOptions:
    """What can be chosen about a landing that is run by itself."""

    jam: str = parameter(
        "after",
        "When the ankle is jammed: never, before the release, after touch-down",
        choices=("never", "before", "after"),
    )
    vacuum_pa: float = parameter(50e3, "Vacuum of the jammed ankle", "Pa", 5e3, 75e3)
    slope_deg: float = parameter(40.0, "Inclination of the slope to land on", "deg", 0.0, 50.0)
    friction: float = parameter(0.55, "Coulomb friction between foot and slope", "", 0.0, 2.0)
    drop_height_m: float = parameter(0.05, "Fall of the foot's lowest point onto the slope", "m", 0.0, 0.5)
    release_time_s: float = parameter(1.0, "Time after the start at which the carriage is released", "s", 0.0, 60.0)
    mass_kg: float = parameter(1.8, "Mass of all that falls, ankle included", "kg", 0.5, 20.0)
    parameter_set: str = parameter(
        "fitted",
        "Constants of the tendons: fitted to the paper's measurements, or as printed in it",
        choices=tuple(TENDON_SETS),
    )
    seed: int = parameter(0, "Seed of all sensor noise and of the scatter", "", 0, 2**31 - 1)
    timestep_s: float = parameter(0.0005, "Length of a simulation step; must divide 1 ms", "s", 1e-4, 1e-3)


def scattered(options: LandingRunOptions, numbers: tuple[float, float]) -> LandingRunOptions:
    """Return the options of one repeat: height by 0.5 mm, friction by 0.01 (standard deviations, assumed)."""
    height, friction = numbers
    return dataclasses.replace(
        options,
        drop_height_m=min(max(options.drop_height_m + 0.0005 * height, 0.0), 0.5),
        friction=min(max(options.friction + 0.01 * friction, 0.0), 2.0),
    )


def landing_rig(options: LandingRunOptions) -> tuple[Rig, Programme]:
    """Build the rig and what it does."""
    rig = landing_parts(
        LandingOptions(
            slope_deg=options.slope_deg,
            drop_height_m=options.drop_height_m,
            mass_kg=options.mass_kg,
            friction=options.friction,
            release_time_s=options.release_time_s,
            seed=options.seed,
            parameter_set=options.parameter_set,
            timestep_s=options.timestep_s,
        )
    )
    rig = dataclasses.replace(rig, description={**rig.description, "options": dataclasses.asdict(options)})
    touch_down_s = options.release_time_s + math.sqrt(2.0 * options.drop_height_m / GRAVITY_M_S2)
    vacuum: dict[str, tuple[VacuumStep, ...]] = {
        "never": (),
        "before": (all_channels(0.0, options.vacuum_pa),),
        "after": (all_channels(touch_down_s + _REACTION_S, options.vacuum_pa),),
    }
    programme = Programme(
        duration_s=touch_down_s + _REST_S,
        vacuum=vacuum[options.jam],
        evaluate=lambda topics: _results(topics, options.release_time_s),
        topics=(names.IMU.name, names.JOINT_STATES.name, names.TENDON_STATES.name, names.LOAD_CELL.name),
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
