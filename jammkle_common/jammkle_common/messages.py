"""Messages with or without ROS: their classes by name, health as diagnostics, a pose as a transform.

Where no ROS is installed, classes are plain ones with the same fields.

Rigs write bags without a graph, and on machines without ROS; what fills a message need not know which of the two it
fills. Plain messages cannot be published.
"""

from __future__ import annotations

import enum
import functools
import importlib
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from jammkle_common.command.errors import InputError
from jammkle_common.names import TF

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

ROS_MODULES = (
    "rclpy",
    "jammkle_msgs",
    "action_msgs",
    "builtin_interfaces",
    "diagnostic_msgs",
    "geometry_msgs",
    "lifecycle_msgs",
    "nav_msgs",
    "rcl_interfaces",
    "rosgraph_msgs",
    "sensor_msgs",
    "std_msgs",
    "std_srvs",
    "tf2_msgs",
    "trajectory_msgs",
)
"""Python modules that come with ROS, or are built with it, and may not be there."""


def installed_class(message_type: str) -> Any:
    """Return the class of `package/msg/Name`, of ROS: one that can be subscribed to.

    Raises:
        InputError: it is not installed.

    """
    package, _, name = message_type.replace("/", ".").rpartition(".")
    try:
        return getattr(importlib.import_module(package), name)
    except (ImportError, AttributeError, ValueError) as error:
        msg = f"type {message_type} is not installed here: build its package and source the workspace"
        raise InputError(msg) from error


def message_class(message_type: str) -> Any:
    """Return the class of `package/msg/Name`: of ROS where that is installed, else a plain one.

    Raises:
        InputError: its package is neither installed nor one of `ROS_MODULES`, or has no such type.

    """
    try:
        return installed_class(message_type)
    except InputError as error:
        missing = error.__cause__
        if not isinstance(missing, ModuleNotFoundError) or str(missing.name).partition(".")[0] not in ROS_MODULES:
            raise
    from jammkle_common.bags.definitions import plain_class  # noqa: PLC0415 - a node shall not wait for the bag library

    return plain_class(message_type)


DiagnosticArray = message_class("diagnostic_msgs/msg/DiagnosticArray")
DiagnosticStatus = message_class("diagnostic_msgs/msg/DiagnosticStatus")
KeyValue = message_class("diagnostic_msgs/msg/KeyValue")


COMMANDS_LINE = " commands"
"""How a simulation's line on what an ankle was commanded ends, after the ankle's name where there are several."""


POLICY_LINE, AUTOMATIC = ": policy", "automatic"
"""How the name of a controller's line on its policy ends, and the key of its value that says whether jamming is
automatic: true or false."""


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
    """Return the health of a node, by its absolute name, at a builtin_interfaces/Time, as a DiagnosticArray."""
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


def transform_of(odometry: Any) -> Any:
    """Return a `nav_msgs/Odometry` as the `tf2_msgs/TFMessage` that puts its child frame into its frame (REP-105).

    Where `tf2_msgs` is not installed, a plain message with the same fields.
    """
    kind, stamped_kind = _kinds()
    stamped = stamped_kind(header=odometry.header, child_frame_id=odometry.child_frame_id)
    place, moved = odometry.pose.pose.position, stamped.transform.translation
    moved.x, moved.y, moved.z = place.x, place.y, place.z
    stamped.transform.rotation = odometry.pose.pose.orientation
    return kind(transforms=[stamped])


@functools.cache
def _kinds() -> tuple[Any, Any]:
    return message_class(TF.message_type), message_class("geometry_msgs/msg/TransformStamped")
