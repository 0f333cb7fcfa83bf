"""What a node says of its health, and the message of it. Does not import rclpy."""

from __future__ import annotations

import enum
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from jammkle_common.messages import message_class

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

DiagnosticArray = message_class("diagnostic_msgs/msg/DiagnosticArray")
DiagnosticStatus = message_class("diagnostic_msgs/msg/DiagnosticStatus")
KeyValue = message_class("diagnostic_msgs/msg/KeyValue")


COMMANDS_LINE = " commands"
"""How a simulation's line on what an ankle was commanded ends, after the ankle's name where there are several."""


LOCKSTEP_LINE = ": lockstep"
"""How the name of a simulation's line on who is in step ends; its values have the full names of the nodes as keys."""


class Level(enum.Enum):
    """Severity, as in diagnostic_msgs."""

    OK = DiagnosticStatus.OK
    WARN = DiagnosticStatus.WARN
    ERROR = DiagnosticStatus.ERROR
    STALE = DiagnosticStatus.STALE


@dataclass(frozen=True)
class Health:
    """One line of health: what it is about, how bad, one sentence, and values for people (with units in the key)."""

    about: str
    level: Level
    message: str
    values: Mapping[str, str] = field(default_factory=dict)


def diagnostic_array(stamp: Any, node_name: str, hardware_id: str, health: Sequence[Health]) -> Any:
    """Return health as a diagnostic_msgs/DiagnosticArray.

    Args:
        stamp: The graph's time, builtin_interfaces/Time.
        node_name: Absolute name of the node that reports.
        hardware_id: What the health is about, as in diagnostic_msgs.
        health: The lines.

    """
    array = DiagnosticArray()
    array.header.stamp = stamp
    array.status = [
        DiagnosticStatus(
            name=f"{node_name}: {line.about}",
            level=line.level.value,
            message=line.message,
            hardware_id=hardware_id,
            values=[KeyValue(key=key, value=value) for key, value in line.values.items()],
        )
        for line in health
    ]
    return array
