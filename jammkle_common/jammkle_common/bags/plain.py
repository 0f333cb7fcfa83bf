"""Messages without ROS: plain classes with the fields of a definition, for bags alone."""

from __future__ import annotations

import dataclasses
import functools
from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from jammkle_common.bags.definitions import MessageDefinitions, share_folders

_ZEROS: dict[str, Any] = {"string": "", "bool": False, "float32": 0.0, "float64": 0.0}
_DEFAULTS: dict[str, dict[str, Any]] = {"geometry_msgs/msg/Quaternion": {"w": 1.0}}
"""Fields that do not begin at zero, by type: the bag library does not keep the defaults of a definition."""


@functools.cache
def plain_class(message_type: str) -> type:
    """Return a class whose messages begin as those of ROS do, every field at its default.

    Raises:
        InputError: as `message_class`.

    """
    store = get_typestore(Stores.ROS2_JAZZY)
    if message_type not in store.types:
        found = get_types_from_msg(MessageDefinitions(share_folders()).find(message_type).text, message_type)
        store.register({name: known for name, known in found.items() if name not in store.types})
    constants, fields = store.fielddefs[message_type]
    given = _DEFAULTS.get(message_type, {})
    members = [
        (name, Any, dataclasses.field(default_factory=functools.partial(_first, given.get(name), kind)))
        for name, kind in fields
    ]
    return dataclasses.make_dataclass(
        message_type.rpartition("/")[2], members, namespace={name: value for name, _, value in constants}
    )


def _first(given: Any, kind: Any) -> Any:
    """Return what a field of a new message holds; `kind` is the bag library's description of it."""
    if given is not None:
        return given
    node, inner = kind
    if node is Nodetype.NAME:
        return plain_class(inner)()
    if node is Nodetype.BASE:
        return _ZEROS.get(inner[0], 0)
    if node is Nodetype.ARRAY and inner[0][0] is Nodetype.BASE:
        return np.zeros(inner[1], dtype=inner[0][1][0])
    return []
