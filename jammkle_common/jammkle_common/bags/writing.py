"""Write messages into a bag (MCAP, metadata version 9)."""

from __future__ import annotations

import contextlib
import os
import shutil
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2 import StoragePlugin, Writer, WriterError
from rosbags.rosbag2.storage_mcap import McapWriter

from jammkle_common.bags.contents import (
    METADATA_VERSION,
    UNFINISHED,
    lock,
    metadata_of,
    write_metadata,
)
from jammkle_common.bags.recovery import recover
from jammkle_common.command.errors import GraphError, InputError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    from rosbags.interfaces import Connection

    from jammkle_common.bags.definitions import MessageDefinitions
    from jammkle_common.names import Delivery

FLUSH_PERIOD_S = 0.5
"""How often a recorder calls `flush`: what a killed one loses is at most this much and what its queues hold."""


@dataclass
class _Topic:
    message_type: str
    offered: Callable[[], Sequence[Qos]]
    connection: Connection | None = None
    count: int = 0


@dataclass(frozen=True)
class BagCounts:
    """How much is in a bag."""

    messages: int
    by_topic: dict[str, int] = field(default_factory=dict)


class BagLog:
    """An open bag. Not safe for use from several threads.

    Whatever was flushed survives the process. `recover` makes a bag whole that was not closed.
    """

    def __init__(self, path: Path, definitions: MessageDefinitions) -> None:
        """Create the bag.

        Raises:
            InputError: the path exists, or cannot be made.

        """
        check_free(path)
        self._path = path
        self._definitions = definitions
        self._topics: dict[str, _Topic] = {}
        self._failure: OSError | None = None
        self._writer = Writer(path, version=METADATA_VERSION, storage_plugin=StoragePlugin.MCAP)
        try:
            self._writer.open()
            lock(self._storage.bio)
            self._write_metadata()
        except (OSError, WriterError) as error:
            msg = f"bag {path} cannot be made: {getattr(error, 'strerror', None) or error}"
            raise InputError(msg) from error

    def add_topic(self, topic: str, message_type: str, offered: Callable[[], Sequence[Qos]]) -> None:
        """Make a topic of type `package/msg/Name` known. It appears in the bag with its first message.

        What its publishers offer is asked for then.

        Raises:
            InputError: the type's definition cannot be found.

        """
        self._definitions.find(message_type)
        self._topics.setdefault(topic, _Topic(message_type, offered))

    def write(self, topic: str, data: bytes, log_ns: int) -> None:
        """Write a serialised message (CDR) of a topic that was added, with its log time, ns.

        Raises:
            OSError: it cannot be written.

        """
        entry = self._topics[topic]
        if entry.connection is None:
            definition = self._definitions.find(entry.message_type)
            entry.connection = self._writer.add_connection(
                topic,
                entry.message_type,
                msgdef=definition.text,
                rihs01=definition.type_hash,
                offered_qos_profiles=entry.offered(),
            )
        entry.count += 1
        with self._noticing_failure():
            self._writer.write(entry.connection, log_ns, data)

    def flush(self) -> None:
        """Hand everything over to the operating system, so that it outlives this process.

        Raises:
            OSError: it cannot be written.

        """
        with self._noticing_failure():
            if self._storage.chunk.msgs:
                self._storage.close_chunk()
            self._storage.bio.flush()

    def set_custom_data(self, key: str, value: str) -> None:
        """Put text into the bag's metadata.

        Raises:
            OSError: it cannot be written.

        """
        if self._writer.custom_data.get(key) != value:
            self._writer.set_custom_data(key, value)
            with self._noticing_failure():
                self._write_metadata()

    def counts(self) -> BagCounts:
        """Return how many messages were written so far."""
        by_topic = {name: entry.count for name, entry in self._topics.items() if entry.count}
        return BagCounts(sum(by_topic.values()), by_topic)

    def close(self) -> BagCounts:
        """Complete the bag.

        A bag that could not be written on is ended where that began.

        Raises:
            GraphError: it could not be written to its end; one line on what is in it.

        """
        if self._failure is None:
            with contextlib.suppress(OSError), self._noticing_failure():
                self._writer.close()
        if self._failure is not None:
            # an open file would be flushed, and fail, once more when Python ends
            with contextlib.suppress(OSError):
                self._writer.abort()
            msg = f"bag {self._path} cannot be written: {self._failure.strerror or self._failure}; {self._ended()}"
            raise GraphError(msg) from self._failure
        return self.counts()

    def discard(self) -> None:
        """Remove the bag: what was written was wrong."""
        with contextlib.suppress(OSError):
            self._writer.abort()
        shutil.rmtree(self._path)

    def fail(self, failure: OSError) -> None:
        """Note why this bag cannot be written on; `close` then ends it here."""
        self._failure = self._failure or failure

    def _ended(self) -> str:
        """End the bag where writing failed, and say in words what is in it."""
        try:
            ended = recover(self._path, lambda _: None)
        except (InputError, OSError) as error:
            return f"nor ended: {error}"
        lost = f"; {ended.given_up} at the end were given up for room" if ended.given_up else ""
        return f"it is whole up to there, with {ended.messages} messages in {ended.duration_s:.1f} s{lost}"

    @property
    def _storage(self) -> McapWriter:
        storage = self._writer.storage
        if not isinstance(storage, McapWriter):
            msg = f"bag {self._path} is closed"
            raise TypeError(msg)
        return storage

    @contextlib.contextmanager
    def _noticing_failure(self) -> Iterator[None]:
        """Note that writing has failed: the file ends in the middle of a record then, and must not go on."""
        if self._failure is not None:
            raise self._failure
        try:
            yield
        except OSError as error:
            self.fail(error)
            raise

    def _write_metadata(self) -> None:
        custom = {**self._writer.custom_data, UNFINISHED: "its recorder has not completed it"}
        write_metadata(self._path, metadata_of({self._storage.path.name: None}, custom))


def check_free(path: Path) -> None:
    """Refuse a bag path that exists, as nothing is ever written over, or one at which no folder can be made.

    Raises:
        InputError: it exists, cannot be looked at, or may not be made where it is to be.

    """
    try:
        exists = path.exists()
        above = next(each for each in path.absolute().parents if each.exists())
    except OSError as error:  # a name too long, a folder that may not be looked into
        msg = f"bag {path} cannot be made: {error.strerror}"
        raise InputError(msg) from error
    if exists:
        msg = f"bag path {path} exists: nothing is overwritten; choose another one or move it away"
        raise InputError(msg)
    if not above.is_dir() or not os.access(above, os.W_OK):
        why = f"there is no permission to write into {above}" if above.is_dir() else f"{above} is no folder"
        msg = f"bag {path} cannot be made: {why}"
        raise InputError(msg)


_NO_TIME = QosTime(0, 0)
"""Of a deadline, lifespan or lease that nobody asks for."""


def bag_delivery(delivery: Delivery) -> Qos:
    """Return what a publisher with this delivery would be recorded with."""
    return Qos(
        QosHistory.KEEP_LAST,
        delivery.depth,
        QosReliability.RELIABLE if delivery.reliable else QosReliability.BEST_EFFORT,
        QosDurability.TRANSIENT_LOCAL if delivery.latched else QosDurability.VOLATILE,
        _NO_TIME,
        _NO_TIME,
        QosLiveliness.SYSTEM_DEFAULT,
        _NO_TIME,
        avoid_ros_namespace_conventions=False,
    )
