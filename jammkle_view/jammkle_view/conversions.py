"""From messages to samples: the one place. Messages of rclpy and of a bag's reader have the same fields."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

from jammkle_common import names
from jammkle_view.core.samples import (
    Base,
    Channel,
    ChannelState,
    Description,
    Event,
    EventKind,
    Imu,
    JamReport,
    Joints,
    Pressure,
    Tendons,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from jammkle_view.core.samples import Sample

_S_PER_NS = 1e-9
_BROKEN = 2
"""TendonState.BROKEN."""


def _stamp_s(message: Any) -> float:
    stamp = message.header.stamp
    return float(stamp.sec) + float(stamp.nanosec) * _S_PER_NS


def _joints(message: Any) -> Joints:
    positions = (float(value) for value in message.position)
    return Joints(_stamp_s(message), dict(zip(message.name, positions, strict=False)))


def _tendons(message: Any) -> Tendons:
    return Tendons(
        _stamp_s(message),
        {tendon.name: float(tendon.tension_n) for tendon in message.tendons},
        frozenset(tendon.name for tendon in message.tendons if tendon.condition == _BROKEN),
    )


def _imu(message: Any) -> Imu:
    force, rate = message.linear_acceleration, message.angular_velocity
    return Imu(
        _stamp_s(message),
        (float(force.x), float(force.y), float(force.z)),
        (float(rate.x), float(rate.y), float(rate.z)),
    )


def _base(message: Any) -> Base:
    place, turn = message.pose.pose.position, message.pose.pose.orientation
    return Base(
        _stamp_s(message),
        (float(place.x), float(place.y), float(place.z)),
        (float(turn.w), float(turn.x), float(turn.y), float(turn.z)),
    )


def _pressure(topic: str, message: Any) -> Pressure:
    return Pressure(_stamp_s(message), topic, float(message.fluid_pressure))


def _jam_report(message: Any) -> JamReport:
    return JamReport(
        _stamp_s(message),
        bool(message.emergency_stopped),
        {
            each.channel: Channel(
                _known_state(each.state),
                float(each.commanded_vacuum_pa),
                float(each.measured_vacuum_pa),
                str(each.reason),
            )
            for each in message.channels
        },
    )


def _known_state(number: int) -> ChannelState:
    return ChannelState(number) if number in ChannelState._value2member_map_ else ChannelState.UNKNOWN


def _event(message: Any) -> Event:
    number = int(message.type)
    kind = EventKind(number) if number in EventKind._value2member_map_ else EventKind.UNKNOWN
    return Event(_stamp_s(message), kind, float(message.magnitude), message.unit, float(message.detection_delay_s))


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
    names.SIM_PARAMETERS.name: _description,
}
"""What a message of each topic becomes."""
