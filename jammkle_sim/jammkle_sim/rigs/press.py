"""The press: the foot is pressed slowly onto the ground and lifted, on toe, heel and either side; soft and then jammed.

It is never pressed flat: tendons do not bear then, and what does is so stiff that force follows the error of a height.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from jammkle_common import names
from jammkle_common.parameters import ParameterError, parameter
from jammkle_sim.physics.ankle import AnkleParameters, corner_m
from jammkle_sim.rigs.guide import smooth_course
from jammkle_sim.rigs.model import add_slope, guided_ankle, hung, new_spec
from jammkle_sim.rigs.options import (
    hang_pitch_option,
    parameter_set_option,
    replaced_within_range,
    reservoir_option,
    run_timestep_option,
    seed_option,
    slope_friction_option,
)
from jammkle_sim.rigs.recording import smoothed
from jammkle_sim.rigs.run import LEG_TOPICS, Programme, RigKind
from jammkle_sim.rigs.vacuum import all_channels

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from scipy.spatial.transform import Rotation  # type: ignore[import-untyped]  # carries no types

    from jammkle_sim.rigs.recording import Series
    from jammkle_sim.rigs.rig import Rig

POSES = ((1.0, 0.3), (-1.0, -0.3), (0.3, 1.0), (-0.3, -1.0))
"""Pitch, toe-down, and roll of the shank in each press, as shares of its tilt: on toe, heel, right and left side. A
little of the other keeps it on one corner: on two, a tenth of a milliradian moves the load from one to the other."""
_CLEARANCE_M = 0.003
"""Between the foot's lowest point and the ground before each press."""
_TURN_S, _HELD_S, _LIFTED_S = 0.6, 0.3, 0.4
"""Time in which the shank is tilted; time it is held down; time it is left alone above, where friction shows in what
the foot does not come back by."""
_JAM_S = 1.0
"""Time in which the vacuum comes to stand."""


@dataclass(frozen=True)
class PressOptions:
    """What can be chosen about a press."""

    tilt_deg: float = parameter(15.0, "How far the shank is tilted for each press", "deg", 5.0, 30.0)
    turn_deg: float = parameter(8.0, "How far the ground turns the foot back, less than the tilt", "deg", 1.0, 25.0)
    sides: str = parameter("yes", "Whether it is pressed on its sides too", choices=("yes", "no"), flag=False)
    way_time_s: float = parameter(0.6, "How long each way down and up takes", "s", 0.1, 10.0)
    friction: float = slope_friction_option()
    vacuum_pa: float = parameter(
        20e3, "Vacuum of the jammed half; at 50 kPa fibres hold, and their friction does not show", "Pa", 5e3, 75e3
    )
    hang_pitch_deg: float = hang_pitch_option()
    reservoir_volume_m3: float = reservoir_option()
    parameter_set: str = parameter_set_option()
    seed: int = seed_option()
    timestep_s: float = run_timestep_option()


def scattered(options: PressOptions, numbers: tuple[float, float]) -> PressOptions:
    """Return the options of one repeat: turn by 0.1 deg, friction by 0.01 (standard deviations, assumed)."""
    return replaced_within_range(
        options, turn_deg=options.turn_deg + 0.1 * numbers[0], friction=options.friction + 0.01 * numbers[1]
    )


def touching_m(turn: Rotation, ankle: AnkleParameters) -> float:
    """Return the height of the ankle's joint at which the foot that hangs from a turned shank first touches, m."""
    corners = [
        (forward_m, side_m, -below_m)
        for forward_m, below_m in (corner_m(ankle, lever_m) for lever_m in (ankle.toe_m, -ankle.heel_m))
        for side_m in (ankle.half_width_m, -ankle.half_width_m)
    ]
    return float(ankle.contact_radius_m - turn.apply(corners)[:, 2].min())


def _pressed(options: PressOptions, pitch: float, roll: float) -> Iterator[tuple[float, float, float, float]]:
    """Give the corners of one press: how long the way there takes, s, pitch and roll, rad, height of the ankle, m."""
    from scipy.spatial.transform import Rotation  # noqa: PLC0415 - see `rigs.guide`

    tilt, turn = math.radians(options.tilt_deg), math.radians(options.turn_deg)
    # The drawn ankle says how the hand moves, whatever hangs on it. The ground turns the foot back toward level.
    drawn = hung(None, options.hang_pitch_deg)
    back = -abs(pitch) if drawn.hang_pitch_rad + tilt * pitch > 0.0 else abs(pitch)
    above_m, below_m = (
        touching_m(Rotation.from_euler("YX", (tilt * pitch + angle * back, (tilt - angle) * roll)), drawn)
        for angle in (0.0, turn)
    )
    above_m += _CLEARANCE_M
    for lasts_s, height_m in (
        (_TURN_S, above_m),
        (options.way_time_s, below_m),
        (_HELD_S, below_m),
        (options.way_time_s, above_m),
        (_LIFTED_S, above_m),
    ):
        yield lasts_s, tilt * pitch, tilt * roll, height_m


def press_rig(options: PressOptions, ankle: AnkleParameters | None = None) -> tuple[Rig, Programme]:
    """Build the rig and what it does.

    Args:
        options: How it is pressed.
        ankle: Constants of the ankle, whose pose an option adds to; None: AnkleParameters as they stand.

    Raises:
        ParameterError: the foot would stand flat.

    """
    from scipy.spatial.transform import Rotation  # noqa: PLC0415 - see `rigs.guide`

    if options.turn_deg >= options.tilt_deg:
        problem = f"it must be less than the tilt of {options.tilt_deg:g} deg, or else the foot stands flat"
        raise ParameterError(problem, "turn_deg", options.turn_deg)
    poses = POSES if options.sides == "yes" else ((1.0, 0.0), (-1.0, 0.0))
    presses = tuple(corner for pose in poses for corner in _pressed(options, *pose))
    start = (0.0, 0.0, 0.0, presses[0][-1])
    corners = np.array((start, *presses, (_JAM_S, *presses[-1][1:]), *presses))
    corners[:, 0] = np.cumsum(corners[:, 0])
    half_s = float(corners[len(presses), 0])
    end_s = float(corners[-1, 0])
    grid_s = np.arange(round(end_s / options.timestep_s) + 2, dtype=np.float64) * np.float64(options.timestep_s)
    pitch_rad, roll_rad, height_m = smooth_course(corners[:, 0], corners[:, 1:], grid_s).T
    position_m = np.column_stack((np.zeros((len(grid_s), 2)), height_m))
    turn = Rotation.from_euler("YX", np.column_stack((pitch_rad, roll_rad)))
    spec = new_spec("press", options.timestep_s)
    add_slope(spec, 0.0, options.friction, (ankle or AnkleParameters()).contact_time_s)
    rig = guided_ankle(spec, options, ankle, position_m, turn, options.friction)
    programme = Programme(
        duration_s=end_s,
        vacuum=(all_channels(half_s, options.vacuum_pa),),
        evaluate=lambda topics: _results(topics, half_s),
        topics=LEG_TOPICS,
        overload_advice="give a smaller --turn-deg",
    )
    return rig, programme


def _results(topics: Mapping[str, Series], half_s: float) -> dict[str, float]:
    """How hard the foot is pressed, at most, soft and jammed."""
    cell = topics[names.LOAD_CELL.name]
    force_n = -smoothed(cell.column("force_z_n"))
    soft = cell.time_s < half_s
    return {"soft_peak_force_n": float(force_n[soft].max()), "jammed_peak_force_n": float(force_n[~soft].max())}


RIG = RigKind(
    "press",
    "press the foot onto the ground and lift it, on toe, heel and either side",
    PressOptions,
    press_rig,
    scattered,
    AnkleParameters(),
)
