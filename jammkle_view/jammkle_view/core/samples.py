"""What passes between graph and page, in SI units: samples made of messages, and what is requested of the graph.

Messages of rclpy and of a bag's reader have the same fields.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any

from jammkle_common import names

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping


class _Reported(enum.IntEnum):
    """Numbers of a message; one that a later version may add is UNKNOWN, 0."""

    @classmethod
    def _missing_(cls, _value: object) -> _Reported:
        return cls(0)


class ChannelState(_Reported):
    """State of a channel, with the numbers of jammkle_msgs/ChannelJamState."""

    UNKNOWN = 0
    UNJAMMED = 1
    JAMMING = 2
    JAMMED = 3
    VENTING = 4
    FAULT = 5


class EventKind(_Reported):
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
    """Pull of tendons by name, N, which of them are broken, and their lengths beyond the free one, m."""

    time_s: float
    tensions_n: Mapping[str, float]
    broken: frozenset[str]
    extensions_m: Mapping[str, float] = field(default_factory=dict)


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
class Landing:
    """What the controller chose for a touch-down, and what it takes to have come of it. Vacuums are gauge, Pa."""

    time_s: float
    chosen_vacuum_pa: float
    reached_vacuum_pa: float
    travel_m: float
    """Of the Achilles pair until a hanging foot is flat on level ground."""
    why: str


@dataclass(frozen=True)
class Description:
    """The text of sim_parameters: which rig is simulated, and all its parameters, as YAML."""

    text: str


Sample = Joints | Tendons | Pressure | Imu | Base | JamReport | Event | Landing | Description
"""Anything that the page takes."""


@dataclass(frozen=True)
class Jam:
    """Jam channels of an ankle to a vacuum; no channel named means all."""

    ankle: str
    channels: tuple[str, ...]
    vacuum_pa: float


@dataclass(frozen=True)
class Unjam:
    """Vent channels of an ankle; no channel named means all."""

    ankle: str
    channels: tuple[str, ...]


class Action(enum.Enum):
    """What else an ankle's nodes can be asked for."""

    READ_SPEED = "read how fast the simulation is to run"

    AUTO_ON = "let the controller decide"
    AUTO_OFF = "let nobody but the page decide"
    EMERGENCY_STOP = "emergency stop"
    CLEAR_FAULT = "clear fault"
    PAUSE = "pause"
    GO_ON = "go on"
    RESET = "reset"


@dataclass(frozen=True)
class Ask:
    """Ask an ankle's nodes for something."""

    ankle: str
    action: Action


@dataclass(frozen=True)
class SetSim:
    """Set a parameter of the simulation."""

    ankle: str
    name: str
    value: float


Request = Jam | Unjam | Ask | SetSim


_S_PER_NS = 1e-9
_BROKEN = 2
"""TendonState.BROKEN."""


def _stamp_s(message: Any) -> float:
    stamp = message.header.stamp
    return float(stamp.sec) + float(stamp.nanosec) * _S_PER_NS


def _xyz(vector: Any) -> tuple[float, float, float]:
    return float(vector.x), float(vector.y), float(vector.z)


def _joints(message: Any) -> Joints:
    positions = (float(value) for value in message.position)
    return Joints(_stamp_s(message), dict(zip(message.name, positions, strict=False)))


def _tendons(message: Any) -> Tendons:
    return Tendons(
        _stamp_s(message),
        {tendon.name: float(tendon.tension_n) for tendon in message.tendons},
        frozenset(tendon.name for tendon in message.tendons if tendon.condition == _BROKEN),
        {tendon.name: float(tendon.extension_m) for tendon in message.tendons},
    )


def _imu(message: Any) -> Imu:
    return Imu(_stamp_s(message), _xyz(message.linear_acceleration), _xyz(message.angular_velocity))


def _base(message: Any) -> Base:
    pose = message.pose.pose
    return Base(_stamp_s(message), _xyz(pose.position), (float(pose.orientation.w), *_xyz(pose.orientation)))


def _pressure(topic: str, message: Any) -> Pressure:
    return Pressure(_stamp_s(message), topic, float(message.fluid_pressure))


def _jam_report(message: Any) -> JamReport:
    return JamReport(
        _stamp_s(message),
        bool(message.emergency_stopped),
        {
            each.channel: Channel(
                ChannelState(int(each.state)),
                float(each.commanded_vacuum_pa),
                float(each.measured_vacuum_pa),
                str(each.reason),
            )
            for each in message.channels
        },
    )


def _event(message: Any) -> Event:
    kind = EventKind(int(message.type))
    return Event(_stamp_s(message), kind, float(message.magnitude), message.unit, float(message.detection_delay_s))


def _landing(message: Any) -> Landing:
    chosen_pa, reached_pa = float(message.chosen_vacuum_pa), float(message.reached_vacuum_pa)
    return Landing(_stamp_s(message), chosen_pa, reached_pa, float(message.travel_m), str(message.why))


def _description(message: Any) -> Description:
    return Description(str(message.data))


TAKERS: dict[str, Callable[[Any], Sample]] = {
    names.JOINT_STATES.name: _joints,
    names.TENDON_STATES.name: _tendons,
    names.IMU.name: _imu,
    names.ODOMETRY.name: _base,
    **{topic.name: partial(_pressure, topic.name) for topic in (names.MANIFOLD_PRESSURE, *names.PRESSURES.values())},
    names.JAM_STATE.name: _jam_report,
    names.CONTACT_EVENTS.name: _event,
    names.LANDING.name: _landing,
    names.SIM_PARAMETERS.name: _description,
}
"""What a message of each topic becomes."""
