"""Classes of messages by name: those of ROS, or, where no ROS is installed, plain ones with the same fields.

Rigs write bags without a graph, and on machines without ROS; what fills a message need not know which of the two it
fills. Plain messages cannot be published.
"""

from __future__ import annotations

import importlib
from typing import Any

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
)
"""Python modules that come with ROS, or are built with it, and may not be there."""


def message_class(message_type: str) -> Any:
    """Return the class of `package/msg/Name`: of ROS where that is installed, else a plain one.

    Raises:
        InputError: the type is neither installed nor one of the standard ones.

    """
    package, folder, name = message_type.split("/")
    try:
        return getattr(importlib.import_module(f"{package}.{folder}"), name)
    except ModuleNotFoundError as error:
        if str(error.name).partition(".")[0] not in ROS_MODULES:
            raise
    from jammkle_common.bags.plain import plain_class  # noqa: PLC0415 - a node shall not wait for the bag library

    return plain_class(message_type)
