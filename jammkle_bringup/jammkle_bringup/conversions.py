"""Between ROS messages or middleware types and what bringup works with. The only place for both."""

from __future__ import annotations

import importlib
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from diagnostic_msgs.msg import DiagnosticStatus

from jammkle_common.command.errors import InputError
from jammkle_common.constants import NANOSECONDS_PER_SECOND
from jammkle_msgs.msg import ChannelJamState

if TYPE_CHECKING:
    from diagnostic_msgs.msg import DiagnosticArray
    from rosgraph_msgs.msg import Clock

    from jammkle_msgs.msg import JamState

_PA_PER_KPA = 1000.0
_PARTS = 3

_STATES = {
    ChannelJamState.UNKNOWN: "UNKNOWN",
    ChannelJamState.UNJAMMED: "UNJAMMED",
    ChannelJamState.JAMMING: "JAMMING",
    ChannelJamState.JAMMED: "JAMMED",
    ChannelJamState.VENTING: "VENTING",
    ChannelJamState.FAULT: "FAULT",
}
_LEVELS = {
    DiagnosticStatus.OK: "OK",
    DiagnosticStatus.WARN: "WARN",
    DiagnosticStatus.ERROR: "ERROR",
    DiagnosticStatus.STALE: "STALE",
}


@dataclass(frozen=True)
class ChannelStatus:
    """One channel for people: vacuums in kPa, gauge, positive; None where nothing is measured."""

    channel: str
    state: str
    commanded_vacuum_kpa: float
    measured_vacuum_kpa: float | None
    reason: str


@dataclass(frozen=True)
class JamStatus:
    """What the driver says of all channels."""

    stamp_s: float
    emergency_stopped: bool
    manifold_vacuum_kpa: float | None
    channels: tuple[ChannelStatus, ...]


@dataclass(frozen=True)
class HealthStatus:
    """One line of /diagnostics for people."""

    name: str
    level: str
    message: str
    values: dict[str, str]


def message_class(message_type: str) -> type[Any]:
    """Return the Python class of `package/msg/Name`.

    Raises:
        InputError: the type is not installed.

    """
    parts = message_type.split("/")
    try:
        if len(parts) == _PARTS:
            found: type[Any] = getattr(importlib.import_module(f"{parts[0]}.{parts[1]}"), parts[2])
            return found
    except (ImportError, AttributeError):
        pass
    msg = f"type {message_type} is not installed here: build its package and source the workspace"
    raise InputError(msg)


def clock_ns(clock: Clock) -> int:
    """Return simulated time, ns."""
    return int(clock.clock.sec) * NANOSECONDS_PER_SECOND + int(clock.clock.nanosec)


def jam_status(state: JamState) -> JamStatus:
    """Return a jam_state in kPa."""
    return JamStatus(
        stamp_s=state.header.stamp.sec + state.header.stamp.nanosec / NANOSECONDS_PER_SECOND,
        emergency_stopped=state.emergency_stopped,
        manifold_vacuum_kpa=_measured_kpa(state.manifold_vacuum_pa),
        channels=tuple(
            ChannelStatus(
                channel=channel.channel,
                state=_STATES.get(channel.state, str(channel.state)),
                commanded_vacuum_kpa=channel.commanded_vacuum_pa / _PA_PER_KPA,
                measured_vacuum_kpa=_measured_kpa(channel.measured_vacuum_pa),
                reason=channel.reason,
            )
            for channel in state.channels
        ),
    )


def health_status(array: DiagnosticArray) -> tuple[HealthStatus, ...]:
    """Return the lines of a /diagnostics message."""
    return tuple(
        HealthStatus(
            line.name,
            _LEVELS.get(line.level, "UNKNOWN"),
            line.message,
            {value.key: value.value for value in line.values},
        )
        for line in array.status
    )


def pa_from_kpa(kilopascal: float) -> float:
    """Return Pa."""
    return kilopascal * _PA_PER_KPA


def _measured_kpa(pascal: float) -> float | None:
    return None if math.isnan(pascal) else pascal / _PA_PER_KPA
