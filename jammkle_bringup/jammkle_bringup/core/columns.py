"""What a message becomes in a table: one row, its fields as columns whose names end in their units.

Fields of fields are joined by `_`. Where a message lists named things (joints, tendons, channels), each has columns of
its own that begin with its name. Constants of a definition stand as their words. Headers are left out, as their stamp
is the time of the row, and so are variances; so is a measurement whose covariance of -1 says that it is none.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from rosbags.interfaces import Nodetype

from jammkle_common.names import CARRIAGE_JOINT

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

Cell = bool | int | float | str
Row = dict[str, Cell]

_VALUE = "data"
"""The one field of std_msgs/Float32, Bool and the like."""
_HEADER = "std_msgs/msg/Header"
_DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticArray"
_JOINTS = "sensor_msgs/msg/JointState"
_KEYS = ("name", "channel", "child_frame_id", "joint_name", "header.frame_id")
"""Fields that name an entry of a list."""
_NOT_MEASURED = -1.0
"""First element of a covariance whose measurement is none (sensor_msgs/Imu)."""
_LONGEST_ARRAY = 16
"""Most numbers of an array without names that get columns; longer ones are pictures or point clouds."""

_FLUID = "fluid_pressure"
_UNITS = {
    ("sensor_msgs/msg/FluidPressure", _FLUID): "pa",
    ("sensor_msgs/msg/Temperature", "temperature"): "degc",
    ("sensor_msgs/msg/BatteryState", "voltage"): "v",
    ("sensor_msgs/msg/BatteryState", "current"): "a",
    ("sensor_msgs/msg/Imu", "angular_velocity"): "rad_s",
    ("sensor_msgs/msg/Imu", "linear_acceleration"): "m_s2",
    ("geometry_msgs/msg/Wrench", "force"): "n",
    ("geometry_msgs/msg/Wrench", "torque"): "n_m",
    ("geometry_msgs/msg/Twist", "linear"): "m_s",
    ("geometry_msgs/msg/Twist", "angular"): "rad_s",
    ("geometry_msgs/msg/Accel", "linear"): "m_s2",
    ("geometry_msgs/msg/Accel", "angular"): "rad_s2",
    ("geometry_msgs/msg/Pose", "position"): "m",
    ("geometry_msgs/msg/Transform", "translation"): "m",
}
"""Units of fields of standard messages, as their definitions give them; those of this project end in theirs."""

_JOINT_UNITS = {"position": ("rad", "m"), "velocity": ("rad_s", "m_s"), "effort": ("n_m", "n")}
"""Of a joint that turns and of one that slides. The message does not tell which it is: `carriage` alone slides here."""


class RowMaker:
    """Makes rows of the messages of one type, as the definitions in a bag describe it."""

    def __init__(self, topic: str, message_type: str, definitions: Mapping[str, Any]) -> None:
        """Prepare.

        Args:
            topic: Its last part names the value of a message that has no more than that.
            message_type: `package/msg/Name`.
            definitions: Of the bag's types (`typestore.fielddefs` of the bag library).

        """
        self._definitions = definitions
        self._leaf = topic.rpartition("/")[2]
        self._rows: Callable[[Any], Iterator[Row]]
        if message_type == _DIAGNOSTICS:
            self._rows = _diagnostic_rows
        else:
            self._rows = self._single(self._fields(message_type))

    def rows(self, message: Any) -> Iterator[Row]:
        """Make the rows of a message: one, and of /diagnostics one per line."""
        return self._rows(message)

    def _single(self, fill: Callable[[Any, str, Row], None]) -> Callable[[Any], Iterator[Row]]:
        def rows(message: Any) -> Iterator[Row]:
            row: Row = {}
            fill(message, "", row)
            yield {self._leaf: row[_VALUE]} if row.keys() == {_VALUE} else row

        return rows

    def _fields(self, message_type: str) -> Callable[[Any, str, Row], None]:
        """Return what puts the fields of a message into a row, their names behind a prefix."""
        constants, fields = self._definitions[message_type]
        words = {value: name for name, kind, value in constants if kind in {"uint8", "byte"}}
        named = _names_field(fields)
        parts: list[Callable[[Any, str, Row], None]] = []
        for name, (node, inner) in fields:
            if (
                name.endswith(("covariance", "variance"))
                or (node is Nodetype.NAME and inner == _HEADER)
                or name == named
            ):
                continue
            unit = _UNITS.get((message_type, name), "")
            if node is Nodetype.BASE:
                kind = inner[0]
                parts.append(_worded(name, words) if words and kind in {"uint8", "byte"} else _plain(name, unit))
                words = {} if kind in {"uint8", "byte"} else words  # constants are those of the first such field
            elif node is Nodetype.NAME:
                covariance = f"{name}_covariance" if f"{name}_covariance" in dict(fields) else ""
                parts.append(_nested(name, unit, covariance, self._fields(inner)))
            elif named:
                parts.append(_parallel(name, named, _JOINT_UNITS.get(name) if message_type == _JOINTS else None))
            elif inner[0][0] is Nodetype.NAME:
                parts.append(_listed(name, self._fields(inner[0][1])))
            else:
                parts.append(_array(name, unit))

        def fill(message: Any, prefix: str, row: Row) -> None:
            for part in parts:
                part(message, prefix, row)

        return fill


def _names_field(fields: Any) -> str:
    """Return the field that names the entries of the lists beside it, as `name` of JointState; empty if none does."""
    texts = [name for name, (node, inner) in fields if node is Nodetype.SEQUENCE and inner[0][1] == ("string", 0)]
    lists = [name for name, (node, _) in fields if node is Nodetype.SEQUENCE]
    return texts[0] if len(texts) == 1 and len(lists) > 1 else ""


def _plain(name: str, unit: str) -> Callable[[Any, str, Row], None]:
    end = f"{name.removeprefix('fluid_')}_{unit}" if unit else name  # of FluidPressure: pressure_pa

    def fill(message: Any, prefix: str, row: Row) -> None:
        row[prefix + end] = getattr(message, name)

    return fill


def _worded(name: str, words: Mapping[Any, str]) -> Callable[[Any, str, Row], None]:
    def fill(message: Any, prefix: str, row: Row) -> None:
        value = getattr(message, name)
        row[prefix + name] = words.get(value, str(value))

    return fill


def _nested(
    name: str, unit: str, covariance: str, inner: Callable[[Any, str, Row], None]
) -> Callable[[Any, str, Row], None]:
    def fill(message: Any, prefix: str, row: Row) -> None:
        if covariance and getattr(message, covariance)[0] == _NOT_MEASURED:
            return
        if not unit:
            inner(getattr(message, name), f"{prefix}{name}_", row)
            return
        own: Row = {}
        inner(getattr(message, name), f"{prefix}{name}_", own)
        row.update((f"{key}_{unit}", value) for key, value in own.items())

    return fill


def _parallel(name: str, names: str, units: tuple[str, str] | None) -> Callable[[Any, str, Row], None]:
    def fill(message: Any, prefix: str, row: Row) -> None:
        for entry, value in zip(getattr(message, names), getattr(message, name), strict=False):
            unit = f"_{units[entry == CARRIAGE_JOINT]}" if units else ""
            row[f"{prefix}{entry}_{name}{unit}"] = value.item() if hasattr(value, "item") else value

    return fill


def _listed(name: str, inner: Callable[[Any, str, Row], None]) -> Callable[[Any, str, Row], None]:
    def fill(message: Any, prefix: str, row: Row) -> None:
        for number, entry in enumerate(getattr(message, name)):
            own: Row = {}
            inner(entry, "", own)
            key = next((str(own.pop(each)) for each in _KEYS if each in own), f"{name}_{number}")
            row.update((f"{prefix}{key}_{end}", value) for end, value in own.items())

    return fill


def _array(name: str, unit: str) -> Callable[[Any, str, Row], None]:
    def fill(message: Any, prefix: str, row: Row) -> None:
        values = getattr(message, name)
        if len(values) <= _LONGEST_ARRAY:
            end = f"_{unit}" if unit else ""
            for number, value in enumerate(values):
                row[f"{prefix}{name}_{number}{end}"] = value.item() if hasattr(value, "item") else value

    return fill


_LEVELS = ("OK", "WARN", "ERROR", "STALE")


def _diagnostic_rows(message: Any) -> Iterator[Row]:
    """Make a row of each line: its values differ from node to node, so that they stand in one cell, as JSON."""
    for line in message.status:
        level = int(line.level)
        yield {
            "name": line.name,
            "level": _LEVELS[level] if level < len(_LEVELS) else str(level),
            "message": line.message,
            "values": json.dumps({each.key: each.value for each in line.values}),
        }
