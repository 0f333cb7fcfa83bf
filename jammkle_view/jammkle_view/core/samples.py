"""What the page takes from messages, in SI units, whether they come from the graph or from a bag."""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping


class ChannelState(enum.IntEnum):
    """State of a channel, with the numbers of jammkle_msgs/ChannelJamState."""

    UNKNOWN = 0
    UNJAMMED = 1
    JAMMING = 2
    JAMMED = 3
    VENTING = 4
    FAULT = 5


class EventKind(enum.IntEnum):
    """What the controller felt, with the numbers of jammkle_msgs/ContactEvent."""

    UNKNOWN = 0
    IMPACT = 1
    SLIP = 2
    LIFTOFF = 3
    SETTLED = 4
    SWING = 5


@dataclass(frozen=True)
class Joints:
    """Positions of joints by name, rad or m."""

    time_s: float
    positions: Mapping[str, float]


@dataclass(frozen=True)
class Tendons:
    """Pull of tendons by name, N, and which of them are broken."""

    time_s: float
    tensions_n: Mapping[str, float]
    broken: frozenset[str]


@dataclass(frozen=True)
class Pressure:
    """Absolute pressure at one sensor, Pa."""

    time_s: float
    topic: str
    pressure_pa: float


@dataclass(frozen=True)
class Imu:
    """Specific force, m/s^2, and angular velocity, rad/s, in the frame of the IMU."""

    time_s: float
    specific_force_m_s2: tuple[float, float, float]
    angular_velocity_rad_s: tuple[float, float, float]


@dataclass(frozen=True)
class Base:
    """Where the body that carries a robot is, m, and how it is turned, as a quaternion (w, x, y, z)."""

    time_s: float
    position_m: tuple[float, float, float]
    rotation: tuple[float, float, float, float]


@dataclass(frozen=True)
class Channel:
    """What the driver says of one channel. Vacuums are gauge, Pa; NaN: not measured."""

    state: ChannelState
    commanded_vacuum_pa: float
    measured_vacuum_pa: float
    reason: str


@dataclass(frozen=True)
class JamReport:
    """What the driver says of all channels."""

    time_s: float
    emergency_stopped: bool
    channels: Mapping[str, Channel]


@dataclass(frozen=True)
class Event:
    """Something that the controller felt."""

    time_s: float
    kind: EventKind
    magnitude: float
    unit: str
    detection_delay_s: float


@dataclass(frozen=True)
class Description:
    """The text of sim_parameters: which rig is simulated, and all its parameters, as YAML."""

    text: str


Sample = Joints | Tendons | Pressure | Imu | Base | JamReport | Event | Description
"""Anything that the page takes."""
