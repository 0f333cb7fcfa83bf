"""One file of a bag, MCAP, SQLite or of ROS 1: its channels, and its messages by log time, whoever recorded it.

What the bag library refuses although it can be read is read here: channels of any encoding, files without chunks,
without an index or without a profile (MCAP); topics without a definition, and what still lies in the journal (SQLite).
Messages of ROS 1 come out as those of ROS 2, whose header has no sequence number.
"""

from __future__ import annotations

import heapq
import sqlite3
import struct
import sys
from collections import Counter
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol
from urllib.parse import quote

from mcap.reader import NonSeekingReader, make_reader
from rosbags.rosbag1 import Reader as Ros1Reader
from rosbags.rosbag2.storage_mcap import ChunkInfo, msgsrc
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator
    from pathlib import Path

    from mcap.records import Channel, Schema
    from rosbags.typesys.store import Typestore

MCAP, SQLITE, ZSTD, ROS1 = b"\x89MCAP0\r\n", b"SQLite format 3\0", b"\x28\xb5\x2f\xfd", b"#ROSBAG V"
"""What files begin with. So does a message that is compressed by itself; one in CDR begins with a zero."""

_WORDS_OF_A_TYPE = 3
_HEADER = "std_msgs/msg/Header"


class Connection(NamedTuple):
    """What a file, or a whole bag, holds of one topic in one type. How it was offered is a hint, and no part of it."""

    id: int
    """Its number there."""
    topic: str
    """Absolute name."""
    msgtype: str
    """`package/msg/Name`; empty where none is named."""
    encoding: str
    """Of its messages: `cdr` is what can be decoded."""
    language: str
    """Of the definition: `ros2msg`, `ros2idl`, or whatever else the file says."""
    definition: bytes
    """Its text, as it stands there; empty where there is none."""
    offered: str
    """QoS of its publishers, as YAML; empty where the file holds none."""
    digest: str
    """Hash of the type, as the file says, or empty."""
    msgcount: int
    why_left_out: str = ""
    """Why its messages cannot be decoded; empty where they can."""


class BagFile(Protocol):
    """An open file. `first_ns` and `last_ns` are its log times, zero without messages."""

    channels: list[Connection]
    first_ns: int
    last_ns: int

    def messages(self, keys: Collection[int]) -> Iterator[tuple[int, int, bytes]]:
        """Read log time, ns, channel and data of the messages of some channels, by log time."""

    def written(self) -> Iterator[tuple[int, Iterable[int]]]:
        """Read channels and log times, ns, of their messages, in the order in which each channel's were written."""

    def close(self) -> None:
        """Give the file back."""


def begins_as_bag(path: Path) -> bool:
    """Return whether a file begins as one of a bag of ROS 2 does, maybe compressed.

    Raises:
        OSError: it cannot be read.

    """
    return begins_with(path).startswith((MCAP, SQLITE, ZSTD))


def begins_with(path: Path) -> bytes:
    """Return the first bytes of a file, enough to know of which kind it is.

    Raises:
        OSError: it cannot be read.

    """
    with path.open("rb") as stream:
        return stream.read(len(SQLITE))


def decompressed(path: Path, target: Path) -> None:
    """Write what a compressed file holds into another one.

    Raises:
        OSError: it cannot be read or written.
        zstd.ZstdError: it is damaged.

    """
    with path.open("rb") as stream, zstd.open(stream, "rb") as source, target.open("wb") as sink:
        while block := source.read(1 << 20):
            sink.write(block)


def open_file(path: Path) -> BagFile:
    """Open a file of any kind.

    Raises:
        ValueError: it is of none.

    """
    head = begins_with(path)
    if head.startswith(MCAP):
        return _Mcap(path)
    if head.startswith(SQLITE):
        return _Sqlite(path)
    if head.startswith(ROS1):
        return _Ros1(path)
    msg = f"{path.name} is neither MCAP nor SQLite, nor a bag of ROS 1"
    raise ValueError(msg)


def plain_data(data: bytes) -> bytes:
    """Return a message as it was serialised, also where it was compressed by itself."""
    return zstd.decompress(data) if data.startswith(ZSTD) else data


_RECORD_HEAD = 9
"""Bytes of kind and length before each record."""
_MESSAGE_INDEX, _INDEX_ENTRY = struct.Struct("<HI"), struct.Struct("<QQ")
"""Channel and size of what follows; log time, and place in the chunk, of each message."""


class _Mcap:
    def __init__(self, path: Path) -> None:
        self._stream: Any = path.open("rb")  # mcap and rosbags name its type differently
        try:
            summary = make_reader(self._stream).get_summary()
            self._chunks = [] if summary is None else summary.chunk_indexes
            counted = summary.statistics if summary is not None and self._chunks else None
            # A summary need not repeat the channels.
            if (
                summary is None
                or counted is None
                or not counted.channel_message_counts.keys() <= summary.channels.keys()
            ):
                self._count()
            else:
                self.first_ns, self.last_ns = counted.message_start_time, counted.message_end_time
                counts = counted.channel_message_counts
                self.channels = [
                    _channel(each, summary.schemas.get(each.schema_id), counts.get(each.id, 0))
                    for each in summary.channels.values()
                ]
        except BaseException:
            self._stream.close()
            raise

    def _count(self) -> None:
        """Read all of a file that does not say what it holds."""
        found: dict[int, tuple[Schema | None, Channel]] = {}
        counts: Counter[int] = Counter()
        times: list[int] = []
        for schema, channel, message in self._unindexed():
            found[channel.id] = (schema, channel)
            counts[channel.id] += 1
            times = [min([*times, message.log_time]), max([*times, message.log_time])]
        self._chunks = []
        self.channels = [_channel(channel, schema, counts[key]) for key, (schema, channel) in found.items()]
        self.first_ns, self.last_ns = times or (0, 0)

    def _unindexed(self, *, log_time_order: bool = True) -> Iterator[Any]:
        self._stream.seek(0)
        return NonSeekingReader(self._stream).iter_messages(log_time_order=log_time_order)

    def messages(self, keys: Collection[int]) -> Iterator[tuple[int, int, bytes]]:
        if not self._chunks:
            for _, channel, message in self._unindexed():
                if channel.id in keys:
                    yield message.log_time, channel.id, message.data
            return
        every = dict.fromkeys(keys, 1)
        sources = [
            msgsrc(chunk, {key: key for key in keys}, 0, 1 << 64, self._stream)  # type: ignore[misc]  # any value will do
            for each in self._chunks
            if not each.message_index_offsets or not every.keys().isdisjoint(each.message_index_offsets)
            for chunk in [
                ChunkInfo(
                    each.message_start_time,
                    each.message_end_time,
                    each.chunk_start_offset,
                    each.chunk_length,
                    each.message_index_offsets,
                    each.message_index_length,
                    each.compression,
                    each.compressed_size,
                    each.uncompressed_size,
                    every,
                )
            ]
        ]
        for time_ns, offset, key, data in heapq.merge(*sources, key=lambda each: each.timestamp):
            if offset:
                yield time_ns, key, data  # type: ignore[misc]  # the numbers given above

    def written(self) -> Iterator[tuple[int, Iterable[int]]]:
        if not self._chunks or not all(each.message_index_offsets for each in self._chunks):
            for _, channel, message in self._unindexed(log_time_order=False):
                yield channel.id, (message.log_time,)
            return
        for each in sorted(self._chunks, key=lambda chunk: chunk.chunk_start_offset):
            for begin in each.message_index_offsets.values():
                self._stream.seek(begin + _RECORD_HEAD)
                key, size = _MESSAGE_INDEX.unpack(self._stream.read(_MESSAGE_INDEX.size))
                entries = _INDEX_ENTRY.iter_unpack(self._stream.read(size))
                yield key, [log_ns for _, log_ns in sorted((place, log_ns) for log_ns, place in entries)]

    def close(self) -> None:
        self._stream.close()


def _channel(channel: Channel, schema: Schema | None, count: int) -> Connection:
    name = "" if schema is None else schema.name
    parts = name.split("/")
    return Connection(
        channel.id,
        channel.topic,
        f"{parts[0]}/msg/{parts[1]}" if len(parts) == _WORDS_OF_A_TYPE - 1 else name,
        channel.message_encoding,
        "" if schema is None else schema.encoding,
        b"" if schema is None else schema.data,
        channel.metadata.get("offered_qos_profiles", ""),
        channel.metadata.get("topic_type_hash", ""),
        count,
    )


class _Sqlite:
    def __init__(self, path: Path) -> None:
        journal = path.with_name(f"{path.name}-wal")
        # a journal that is empty, or not there, need not be looked at: so a folder that cannot be written will do
        way = "mode=ro" if journal.is_file() and journal.stat().st_size else "immutable=1"
        name = quote(str(path.absolute()).encode(errors="surrogateescape"))
        self._base = sqlite3.connect(f"file:{name}?{way}", uri=True)
        try:
            self._look()
        except BaseException:
            self._base.close()
            raise

    def _look(self) -> None:
        known = self._columns("topics")
        if not {"id", "name", "type", "serialization_format"} <= known or "topic_id" not in self._columns("messages"):
            msg = "it holds no tables of a bag"
            raise ValueError(msg)
        self._base.text_factory = lambda text: text.decode(errors="replace")
        texts = {}
        if self._columns("message_definitions"):
            call = "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
            texts = {name: (language, text.encode()) for name, language, text in self._base.execute(call)}
        counts = dict(self._base.execute("SELECT topic_id, count(*) FROM messages GROUP BY topic_id"))
        qos = "offered_qos_profiles" if "offered_qos_profiles" in known else "''"
        type_hash = "type_description_hash" if "type_description_hash" in known else "''"
        rows = self._base.execute(f"SELECT id, name, type, serialization_format, {qos}, {type_hash} FROM topics")  # noqa: S608 - of two words above
        self.channels = [
            Connection(key, topic, kind, encoding, *texts.get(kind, ("", b"")), qos, digest, counts.get(key, 0))
            for key, topic, kind, encoding, qos, digest in rows
        ]
        first, last = self._base.execute("SELECT min(timestamp), max(timestamp) FROM messages").fetchone()
        self.first_ns, self.last_ns = first or 0, last or 0

    def _columns(self, table: str) -> set[str]:
        return {name for _, name, *_ in self._base.execute(f"PRAGMA table_info({table})")}

    def messages(self, keys: Collection[int]) -> Iterator[tuple[int, int, bytes]]:
        marks = ", ".join("?" * len(keys))
        call = f"SELECT timestamp, topic_id, data FROM messages WHERE topic_id IN ({marks}) ORDER BY timestamp, id"  # noqa: S608 - marks alone
        yield from self._base.execute(call, list(keys))

    def written(self) -> Iterator[tuple[int, Iterable[int]]]:
        for key, log_ns in self._base.execute("SELECT topic_id, timestamp FROM messages ORDER BY id"):
            yield key, (log_ns,)

    def close(self) -> None:
        self._base.close()


class _Ros1:
    def __init__(self, path: Path) -> None:
        self._reader = Ros1Reader(path)
        self._reader.open()
        try:
            self._look()
        except BaseException:
            self._reader.close()
            raise

    def _look(self) -> None:
        header = get_typestore(Stores.ROS2_JAZZY).fielddefs[_HEADER]
        self._stores: dict[int, Typestore] = {}
        self.channels = []
        for each in self._reader.connections:
            types = get_types_from_msg(each.msgdef.data, each.msgtype)
            if _HEADER in types:
                types[_HEADER] = header
            store = self._stores[each.id] = get_typestore(Stores.EMPTY)  # a type may be defined twice in a bag
            store.register(types)
            text = store.generate_msgdef(each.msgtype, ros_version=2)[0].encode()
            count = sum(chunk.connection_counts.get(each.id, 0) for chunk in self._reader.chunk_infos)
            topic = f"/{each.topic.removeprefix('/')}"  # as many a script writes it
            self.channels.append(Connection(each.id, topic, each.msgtype, "cdr", "ros2msg", text, "", "", count))
        filled = self._reader.message_count > 0
        self.first_ns, self.last_ns = (self._reader.start_time, self._reader.end_time - 1) if filled else (0, 0)

    def messages(self, keys: Collection[int]) -> Iterator[tuple[int, int, bytes]]:
        wanted = [each for each in self._reader.connections if each.id in keys]
        for connection, time_ns, data in self._reader.messages(wanted) if wanted else ():
            yield time_ns, connection.id, bytes(self._stores[connection.id].ros1_to_cdr(data, connection.msgtype))

    def written(self) -> Iterator[tuple[int, Iterable[int]]]:
        for key, entries in self._reader.indexes.items():
            yield key, [each.time for each in sorted(entries, key=lambda each: (each.chunk_pos, each.offset))]

    def close(self) -> None:
        self._reader.close()


def merged(files: Iterable[BagFile], keys: Iterable[Collection[int]]) -> Iterator[tuple[int, int, int, bytes]]:
    """Read log time, ns, place of the file, channel and data of the messages of several files, by log time.

    A file is not looked into before the log time of its first message has come.
    """

    def source(place: int, file: BagFile, wanted: Collection[int]) -> Iterator[tuple[int, int, int, bytes | None]]:
        yield file.first_ns, place, -1, None
        for time_ns, key, data in file.messages(wanted):
            yield time_ns, place, key, data

    sources = [source(place, *each) for place, each in enumerate(zip(files, keys, strict=True)) if each[1]]
    for time_ns, place, key, data in heapq.merge(*sources, key=lambda each: each[0]):
        if data is not None:
            yield time_ns, place, key, data
