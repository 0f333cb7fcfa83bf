"""The tilt: the shank is held still in six poses while the foot hangs free, soft and then jammed."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from jammkle_common import names
from jammkle_common.parameters import parameter
from jammkle_sim.physics.ankle import AnkleParameters
from jammkle_sim.rigs.guide import smooth_course
from jammkle_sim.rigs.model import guided_ankle, new_spec
from jammkle_sim.rigs.options import (
    hang_pitch_option,
    jammed_vacuum_option,
    parameter_set_option,
    replaced_within_range,
    reservoir_option,
    run_timestep_option,
    seed_option,
)
from jammkle_sim.rigs.run import ROBOT_TOPICS, Programme, RigKind
from jammkle_sim.rigs.vacuum import all_channels

if TYPE_CHECKING:
    from collections.abc import Mapping

    from jammkle_sim.rigs.recording import Series
    from jammkle_sim.rigs.rig import Rig

POSES = ((0.0, 0.0), (1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0), (1.0, 1.0))
"""Pitch, toe-down, and roll of the shank, as shares of its tilt."""
_TURN_S = 0.6
"""Time from one pose to the next."""
_JAM_S = 1.0
"""Time in which the vacuum comes to stand, in the last pose."""


@dataclass(frozen=True)
class TiltOptions:
    """What can be chosen about six poses."""

    tilt_deg: float = parameter(40.0, "How far the shank is tilted to each side", "deg", 5.0, 90.0)
    hold_s: float = parameter(1.0, "How long each pose is held", "s", 0.5, 60.0)
    vacuum_pa: float = jammed_vacuum_option()
    hang_pitch_deg: float = hang_pitch_option()
    reservoir_volume_m3: float = reservoir_option()
    parameter_set: str = parameter_set_option()
    seed: int = seed_option()
    timestep_s: float = run_timestep_option()


def scattered(options: TiltOptions, numbers: tuple[float, float]) -> TiltOptions:
    """Return the options of one repeat: the tilt differs by 1 degree (standard deviation, assumed)."""
    return replaced_within_range(options, tilt_deg=options.tilt_deg + numbers[0])


def tilt_rig(options: TiltOptions, ankle: AnkleParameters | None = None) -> tuple[Rig, Programme]:
    """Build the rig and what it does.

    Args:
        options: How it is tilted.
        ankle: Constants of the ankle, whose pose an option adds to; None: AnkleParameters as they stand.

    """
    from scipy.spatial.transform import Rotation  # type: ignore[import-untyped]  # noqa: PLC0415 - see `rigs.guide`

    tilt = math.radians(options.tilt_deg)
    poses = [
        row
        for pitch, roll in POSES
        for row in ((_TURN_S, tilt * pitch, tilt * roll), (options.hold_s, tilt * pitch, tilt * roll))
    ]
    corners = np.array((*poses, (_JAM_S, *poses[-1][1:]), *poses))
    jam_s = float(corners[: len(poses), 0].sum())
    corners[:, 0] = np.cumsum(corners[:, 0])
    end_s = float(corners[-1, 0])
    grid_s = np.arange(round(end_s / options.timestep_s) + 2, dtype=np.float64) * np.float64(options.timestep_s)
    turn = Rotation.from_euler("YX", smooth_course(corners[:, 0], corners[:, 1:], grid_s))
    rig = guided_ankle(new_spec("tilt", options.timestep_s), options, ankle, np.zeros((len(grid_s), 3)), turn)
    programme = Programme(
        duration_s=end_s,
        vacuum=(all_channels(jam_s, options.vacuum_pa),),
        evaluate=_results,
        topics=ROBOT_TOPICS,
    )
    return rig, programme


def _results(topics: Mapping[str, Series]) -> dict[str, float]:
    """How far the foot gives way to gravity, at most."""
    joints = topics[names.JOINT_STATES.name]
    return {
        f"{joint}_sag_rad": float(np.ptp(joints.column(f"{joint}.position"))) for joint in ("ankle_pitch", "ankle_roll")
    }


RIG = RigKind(
    "tilt",
    "hold the shank of a hanging foot still in six poses, soft and jammed",
    TiltOptions,
    tilt_rig,
    scattered,
    AnkleParameters(),
)
