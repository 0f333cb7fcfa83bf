"""Give an MCAP file the ending that its recorder could not write: killed, or on a full disk.

What a recorder writes goes to the file chunk by chunk, each with its index. Without the ending (index of the chunks,
footer) readers refuse the file, although every whole chunk is there. A record that was torn off is cut off.
Records: https://mcap.dev/spec.
"""

from __future__ import annotations

import contextlib
import errno
import struct
from collections import Counter
from dataclasses import dataclass, field
from io import BytesIO
from typing import TYPE_CHECKING, BinaryIO

from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    MessageIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.stream_reader import get_chunk_data_stream

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from mcap.records import McapRecord

MAGIC = b"\x89MCAP0\r\n"
_HEAD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQ")  # channel, sequence, log time; publish time and data follow
_KNOWN = {int(each) for each in Opcode}
NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""What writing says on a full disk, beyond a quota, and beyond the largest size of a file."""


class NoMcapError(ValueError):
    """The file is not what a recorder of MCAP leaves behind; the message says why."""


@dataclass(frozen=True)
class WrittenChunk:
    """A whole chunk: its entry in the index of the file, and how many messages of each channel it holds."""

    index: ChunkIndex
    counts: dict[int, int]


@dataclass
class DataSection:
    """What an MCAP file holds, up to its ending.

    Attributes:
        end: Offset after the last whole record.
        size: Bytes of the file.
        whole: Whether the file has its ending.
        schemas: By their number.
        channels: By their number.
        chunks: In the order of the file.

    """

    end: int = len(MAGIC)
    size: int = 0
    whole: bool = False
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    chunks: list[WrittenChunk] = field(default_factory=list)

    def counts(self) -> Counter[int]:
        """Return the messages of each channel."""
        total: Counter[int] = Counter()
        for chunk in self.chunks:
            total.update(chunk.counts)
        return total

    def give_up_last_chunk(self) -> int:
        """Let the data end before the last chunk; return how many messages that costs."""
        dropped = self.chunks.pop()
        self.end, self.whole = dropped.index.chunk_start_offset, False
        return sum(dropped.counts.values())

    def span_ns(self) -> tuple[int, int]:
        """Return the first and the last log time; zero without messages."""
        filled = [chunk.index for chunk in self.chunks if chunk.counts]
        if not filled:
            return 0, 0
        return min(each.message_start_time for each in filled), max(each.message_end_time for each in filled)


def scanned(stream: BinaryIO, on_progress: Callable[[float], None]) -> DataSection:
    """Read a file up to its ending, or up to where it was torn off.

    Args:
        stream: The file, open for reading.
        on_progress: Called with the share that was read, 0 to 1.

    Raises:
        NoMcapError: no MCAP file, not in chunks, or damaged before its last record.

    """
    section = DataSection(size=stream.seek(0, 2))
    stream.seek(0)
    if stream.read(len(MAGIC)) != MAGIC:
        msg = "it is no MCAP file"
        raise NoMcapError(msg)
    for opcode, body in _records(stream, section):
        start = section.end
        if opcode == Opcode.DATA_END:
            stream.seek(-len(MAGIC), 2)
            section.whole = stream.read() == MAGIC
            break
        try:
            _take(section, opcode, body, start)
        except Exception as error:  # the library lets errors of struct, of codecs and its own through
            if section.size > start + _HEAD.size + len(body):
                msg = f"it is damaged at byte {start}, with {section.size - start} bytes from there on: {error}"
                raise NoMcapError(msg) from error
            break
        section.end = start + _HEAD.size + len(body)
        on_progress(section.end / section.size)
    return section


def complete(stream: BinaryIO, section: DataSection) -> int:
    """Cut off what is torn and write the ending; chunks are given up, the last one first, where there is no room.

    Args:
        stream: The file, open for reading and writing, without a buffer.
        section: What it holds; brought up to date.

    Returns:
        How many messages were given up for want of room.

    Raises:
        OSError: it cannot be written, even so.

    """
    given_up = 0
    while True:
        stream.truncate(section.end)
        stream.seek(section.end)
        try:
            _write(stream, _missing_indexes(stream, section))
            _write(stream, _ending(section, stream.tell()))
        except OSError as error:
            if error.errno not in NO_ROOM or not section.chunks:
                with contextlib.suppress(OSError):
                    stream.truncate(section.end)
                raise
            given_up += section.give_up_last_chunk()
        else:
            section.whole = True
            return given_up


def _records(stream: BinaryIO, section: DataSection) -> Iterator[tuple[int, bytes]]:
    """Read whole records; one that is torn off, and zeros that a file system leaves, end it."""
    while len(head := stream.read(_HEAD.size)) == _HEAD.size:
        opcode, length = _HEAD.unpack(head)
        if opcode not in _KNOWN and any(head):
            msg = f"it is damaged at byte {section.end}: {opcode} is no kind of record"
            raise NoMcapError(msg)
        if not opcode or section.end + _HEAD.size + length > section.size:
            return
        yield opcode, stream.read(length)


def _take(section: DataSection, opcode: int, body: bytes, start: int) -> None:
    if opcode == Opcode.CHUNK:
        section.chunks.append(_chunk(section, Chunk.read(ReadDataStream(BytesIO(body))), start, _HEAD.size + len(body)))
    elif opcode == Opcode.MESSAGE_INDEX and section.chunks:
        index = section.chunks[-1].index
        index.message_index_offsets[MessageIndex.read(ReadDataStream(BytesIO(body))).channel_id] = start
        index.message_index_length += _HEAD.size + len(body)
    elif opcode in {Opcode.SCHEMA, Opcode.CHANNEL}:
        _know(section, opcode, body)
    elif opcode == Opcode.MESSAGE:
        msg = "its messages are not in chunks"
        raise NoMcapError(msg)


def _know(section: DataSection, opcode: int, body: bytes) -> None:
    if opcode == Opcode.SCHEMA:
        schema = Schema.read(ReadDataStream(BytesIO(body)))
        section.schemas[schema.id] = schema
    else:
        channel = Channel.read(ReadDataStream(BytesIO(body)))
        section.channels[channel.id] = channel


def _chunk(section: DataSection, chunk: Chunk, start: int, length: int) -> WrittenChunk:
    counts: Counter[int] = Counter()
    for opcode, offset, end, data in _inside(chunk):
        if opcode == Opcode.MESSAGE:
            counts[_MESSAGE.unpack_from(data, offset)[0]] += 1
        elif opcode in {Opcode.SCHEMA, Opcode.CHANNEL}:
            _know(section, opcode, data[offset:end])
    index = ChunkIndex(
        chunk_length=length,
        chunk_start_offset=start,
        compression=chunk.compression,
        compressed_size=len(chunk.data),
        message_end_time=chunk.message_end_time,
        message_index_length=0,
        message_index_offsets={},
        message_start_time=chunk.message_start_time,
        uncompressed_size=chunk.uncompressed_size,
    )
    return WrittenChunk(index, dict(counts))


def _inside(chunk: Chunk) -> Iterator[tuple[int, int, int, bytes]]:
    """Read opcode, and begin and end in the data, of each record of a chunk, and the data."""
    data = get_chunk_data_stream(chunk, validate_crc=True)[0].read(chunk.uncompressed_size)
    offset = 0
    while offset < len(data):
        opcode, length = _HEAD.unpack_from(data, offset)
        begin = offset + _HEAD.size
        offset = begin + length
        yield opcode, begin, offset, data


def _missing_indexes(stream: BinaryIO, section: DataSection) -> bytes:
    """Return the index records of the last chunk where they were torn off; the file is cut after that chunk."""
    if not section.chunks:
        return b""
    last = section.chunks[-1]
    if set(last.index.message_index_offsets) == set(last.counts):
        return b""
    stream.seek(last.index.chunk_start_offset + _HEAD.size)
    chunk = Chunk.read(ReadDataStream(stream))
    entries: dict[int, list[tuple[int, int]]] = {}
    for opcode, offset, _, data in _inside(chunk):
        if opcode == Opcode.MESSAGE:
            channel, _, log_time = _MESSAGE.unpack_from(data, offset)
            entries.setdefault(channel, []).append((log_time, offset - _HEAD.size))
    section.end = last.index.chunk_start_offset + last.index.chunk_length
    stream.truncate(section.end)
    stream.seek(section.end)
    builder = RecordBuilder()
    last.index.message_index_offsets.clear()
    for channel, found in entries.items():
        last.index.message_index_offsets[channel] = section.end + builder.count
        MessageIndex(channel, found).write(builder)
    last.index.message_index_length = builder.count
    return bytes(builder.end())


def _ending(section: DataSection, begin: int) -> bytes:
    """Return what stands from `begin` on: end of the data, summary, footer."""
    counts, (first_ns, last_ns) = section.counts(), section.span_ns()
    statistics = Statistics(
        attachment_count=0,
        channel_count=len(section.channels),
        channel_message_counts=dict(counts),
        chunk_count=len(section.chunks),
        message_count=counts.total(),
        message_end_time=last_ns,
        message_start_time=first_ns,
        metadata_count=0,
        schema_count=len(section.schemas),
    )
    groups: tuple[tuple[Opcode, Sequence[McapRecord]], ...] = (
        (Opcode.SCHEMA, list(section.schemas.values())),
        (Opcode.CHANNEL, list(section.channels.values())),
        (Opcode.STATISTICS, [statistics]),
        (Opcode.CHUNK_INDEX, [chunk.index for chunk in section.chunks]),
    )
    builder = RecordBuilder()
    DataEnd(data_section_crc=0).write(builder)
    summary_start = begin + builder.count
    offsets = []
    for opcode, records in groups:
        group_start = begin + builder.count
        for record in records:
            record.write(builder)
        if records:
            offsets.append(SummaryOffset(opcode, group_start, begin + builder.count - group_start))
    summary_offset_start = begin + builder.count
    for offset in offsets:
        offset.write(builder)
    Footer(summary_start=summary_start, summary_offset_start=summary_offset_start, summary_crc=0).write(builder)
    return bytes(builder.end()) + MAGIC


def _write(stream: BinaryIO, data: bytes) -> None:
    """Write all of it: a file without a buffer may take less at a time."""
    view = memoryview(data)
    while view:
        view = view[stream.write(view) :]
