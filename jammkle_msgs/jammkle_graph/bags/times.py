"""When a message of a bag was made: by its own stamp, else by /clock, else by its log time.

A bag of a simulation that ran four times as fast as real time, logged by the clock of the machine, holds a second of
data in every quarter of a second of log. Its stamps and /clock know that.
"""

from __future__ import annotations

import enum
import struct
from typing import TYPE_CHECKING, Any

from rosbags.interfaces import Nodetype

from jammkle_graph.constants import NANOSECONDS_PER_SECOND
from jammkle_graph.names import CLOCK

if TYPE_CHECKING:
    from jammkle_graph.bags.reading import BagReader, Connection

_BEGINS_WITH_TIME = ("std_msgs/msg/Header", "builtin_interfaces/msg/Time")
_LITTLE, _BIG = struct.Struct("<iI"), struct.Struct(">iI")
_AT = 4  # after the four bytes that say how the message is serialised (CDR)
_OTHER_EPOCH_NS = 60 * NANOSECONDS_PER_SECOND
"""Difference of log and stamp from which on they are taken for two clocks: no message is under way for a minute."""


class TimeOf(enum.Enum):
    """Where the times of a topic come from."""

    STAMP = "stamp"
    """Stamps in the messages."""
    CLOCK = "/clock"
    """The last tick of /clock before each message."""
    LOG = "log"
    """When the recorder took them."""


class BagTimes:
    """Tells the time of each message of a bag that is read in the order of its log."""

    def __init__(self, reader: BagReader) -> None:
        """Look at the types of an open bag."""
        self._stamped = {
            name: _begins_with_time(reader.typestore.fielddefs, name)
            for name in {each.msgtype for each in reader.connections}
        }
        self._tick_ns = _first_tick_ns(reader)
        self._ahead_ns: int | None = None

    def source(self, connection: Connection) -> TimeOf:
        """Return where the times of a topic come from; one whose stamps are zero has those of the next best."""
        if self._stamped[connection.msgtype]:
            return TimeOf.STAMP
        return TimeOf.LOG if self._tick_ns is None else TimeOf.CLOCK

    def time_ns(self, connection: Connection, log_ns: int, data: bytes) -> int:
        """Return when a message was made, ns. Call it for every message, and in the order of the log."""
        stamp_ns = 0
        if self._stamped[connection.msgtype]:
            stamp_ns = _stamp_ns(data)
            if connection.topic == CLOCK.name:
                self._tick_ns = stamp_ns
                return stamp_ns
        if stamp_ns:
            if self._ahead_ns is None:
                self._ahead_ns = log_ns - stamp_ns if abs(log_ns - stamp_ns) > _OTHER_EPOCH_NS else 0
            return stamp_ns
        return log_ns - (self._ahead_ns or 0) if self._tick_ns is None else self._tick_ns


def _first_tick_ns(reader: BagReader) -> int | None:
    """Return the time that holds until the second tick of /clock; None without /clock."""
    clocks = [each for each in reader.connections if each.topic == CLOCK.name and each.msgcount]
    return next((_stamp_ns(data) for _, _, data in reader.messages(clocks)), None) if clocks else None


def _stamp_ns(data: bytes) -> int:
    seconds, nanoseconds = (_LITTLE if data[1] & 1 else _BIG).unpack_from(data, _AT)
    return int(seconds) * NANOSECONDS_PER_SECOND + int(nanoseconds)


def _begins_with_time(definitions: Any, message_type: str) -> bool:
    """Return whether messages of a type begin with a header, or with a time as /clock does."""
    _, fields = definitions[message_type]
    if not fields:
        return False
    kind, inner = fields[0][1]
    return kind is Nodetype.NAME and inner in _BEGINS_WITH_TIME
