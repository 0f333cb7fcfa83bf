"""What an ankle's sensors and tendons give, read from the memory of its laws; checks of what its actuators are told."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from jammkle_common.names import CHANNELS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jammkle_sim.physics import records


@dataclass(frozen=True)
class ImuSample:
    """What the IMU gives now, in its own frame."""

    specific_force_m_s2: tuple[float, float, float]
    """Acceleration less gravity: +g along z at rest."""
    angular_velocity_rad_s: tuple[float, float, float]


@dataclass(frozen=True)
class TendonSample:
    """One tendon, without noise."""

    name: str
    extension_m: float
    """Beyond the free length; negative when slack."""
    extension_rate_m_s: float
    tension_n: float
    broken: bool


def imu_sample(states: records.States) -> ImuSample:
    """Return the latest output of the IMU, noise, range and filter included."""
    x, y, z, roll, pitch, yaw = states.imu["second"][0].tolist()
    return ImuSample((x, y, z), (roll, pitch, yaw))


def tendon_samples(names: Sequence[str], states: records.States) -> tuple[TendonSample, ...]:
    """Return every tendon, in the order of its names."""
    return tuple(
        TendonSample(
            name,
            float(state["extension_m"]),
            float(state["rate_m_s"]),
            float(state["tension_n"]),
            bool(state["broken"] > 0.0),
        )
        for name, state in zip(names, states.tendons, strict=True)
    )


def check_duty(duty: float) -> None:
    """Refuse a pump's duty that is none.

    Raises:
        ValueError: below 0, above 1, or not a number.

    """
    if not 0.0 <= duty <= 1.0:
        msg = f"pump duty is {duty}; it must be 0 to 1"
        raise ValueError(msg)


def channel_index(channel: str) -> int:
    """Return the place of a channel among CHANNELS.

    Raises:
        ValueError: there is no such channel.

    """
    if channel not in CHANNELS:
        msg = f"channel '{channel}' does not exist; known are: {', '.join(CHANNELS)}"
        raise ValueError(msg)
    return CHANNELS.index(channel)
