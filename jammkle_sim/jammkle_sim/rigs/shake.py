"""The shake: the foot hangs free while the shank is rocked through a sweep in pitch and roll, soft and then jammed."""

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
    replaced_within_range,
    reservoir_option,
    run_timestep_option,
    seed_option,
)
from jammkle_sim.rigs.run import ROBOT_TOPICS, Programme, RigKind
from jammkle_sim.rigs.vacuum import all_channels

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from jammkle_sim.rigs.recording import Series
    from jammkle_sim.rigs.rig import Rig

_REST_S = 0.5
"""Still time before and after each sweep."""
_JAM_S = 1.0
"""Time in which the vacuum comes to stand before the second sweep."""
_GROWS_S = 0.3
"""Time in which a sweep grows to its amplitude, and dies away at its end."""
_PIVOT_M = 0.15
"""What the shank is rocked about, above the ankle: a knee."""


@dataclass(frozen=True)
class ShakeOptions:
    """What can be chosen about a shake."""

    amplitude_deg: float = parameter(12.0, "How far the shank is rocked to either side", "deg", 0.5, 30.0)
    from_hz: float = parameter(
        0.5, "Frequency at which the sweep of the pitch begins; that of the roll ends there", "Hz", 0.1, 10.0
    )
    to_hz: float = parameter(
        6.0, "Frequency at which it ends, growing by the same factor in the same time", "Hz", 0.1, 10.0
    )
    sweep_s: float = parameter(5.0, "How long each of the two sweeps lasts", "s", 1.0, 60.0)
    vacuum_pa: float = jammed_vacuum_option()
    hang_pitch_deg: float = hang_pitch_option()
    reservoir_volume_m3: float = reservoir_option()
    parameter_set: str = parameter_set_option()
    seed: int = seed_option()
    timestep_s: float = run_timestep_option()


def scattered(options: ShakeOptions, numbers: tuple[float, float]) -> ShakeOptions:
    """Return the options of one repeat: amplitude by 2 %, end of the sweep by 1 % (standard deviations, assumed)."""
    return replaced_within_range(
        options,
        amplitude_deg=options.amplitude_deg * (1.0 + 0.02 * numbers[0]),
        to_hz=options.to_hz * (1.0 + 0.01 * numbers[1]),
    )


def shake_rig(options: ShakeOptions, ankle: AnkleParameters | None = None) -> tuple[Rig, Programme]:
    """Build the rig and what it does.

    Args:
        options: How it is rocked.
        ankle: Constants of the ankle, whose pose an option adds to; None: AnkleParameters as they stand.

    """
    from scipy.spatial.transform import Rotation  # type: ignore[import-untyped]  # noqa: PLC0415 - see `rigs.guide`

    jam_s = _REST_S + options.sweep_s + _REST_S
    second_s = jam_s + _JAM_S
    end_s = second_s + options.sweep_s + _REST_S
    time_s = np.arange(round(end_s / options.timestep_s) + 2, dtype=np.float64) * np.float64(options.timestep_s)
    pitch_rad, roll_rad = (
        _swept(time_s - _REST_S, options, one, other) + _swept(time_s - second_s, options, one, other)
        for one, other in ((options.from_hz, options.to_hz), (options.to_hz, options.from_hz))
    )
    turn = Rotation.from_euler("YX", np.column_stack((pitch_rad, roll_rad)))
    spec = new_spec("shake", options.timestep_s)
    rig = guided_ankle(spec, options, ankle, turn.apply((0.0, 0.0, -_PIVOT_M)), turn)
    programme = Programme(
        duration_s=end_s,
        vacuum=(all_channels(jam_s, options.vacuum_pa),),
        evaluate=lambda topics: _results(topics, jam_s),
        topics=ROBOT_TOPICS,
    )
    return rig, programme


def _swept(time_s: NDArray[np.float64], options: ShakeOptions, from_hz: float, to_hz: float) -> NDArray[np.float64]:
    """Return the angle of one sweep, rad, 0 outside of it; its frequency grows, or falls, exponentially."""
    share = np.clip(time_s / options.sweep_s, 0.0, 1.0)
    rate = np.log(to_hz / from_hz)
    turns = from_hz * options.sweep_s * (share if rate == 0.0 else np.expm1(rate * share) / rate)
    near_s = np.minimum(share, 1.0 - share) * options.sweep_s
    grown = 0.5 - 0.5 * np.cos(np.pi * np.clip(near_s / _GROWS_S, 0.0, 1.0))
    angle_rad: NDArray[np.float64] = np.radians(options.amplitude_deg) * grown * np.sin(2.0 * np.pi * turns)
    return angle_rad


def _results(topics: Mapping[str, Series], jam_s: float) -> dict[str, float]:
    """How far the foot swings against the shank, at most, soft and jammed."""
    joints = topics[names.JOINT_STATES.name]
    pitch_rad = joints.column("ankle_pitch.position")
    soft, jammed = pitch_rad[joints.time_s < jam_s], pitch_rad[joints.time_s > jam_s + _JAM_S]
    return {"soft_swing_rad": float(np.ptp(soft)), "jammed_swing_rad": float(np.ptp(jammed))}


RIG = RigKind(
    "shake",
    "rock the shank of a hanging foot through a sweep, soft and jammed",
    ShakeOptions,
    shake_rig,
    scattered,
    AnkleParameters(),
)
