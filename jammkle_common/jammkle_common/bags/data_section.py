"""What an MCAP file holds up to its ending, or up to where it was torn off.

Records: https://mcap.dev/spec.
"""

from __future__ import annotations

import struct
from collections import Counter
from dataclasses import dataclass, field
from io import BytesIO
from typing import TYPE_CHECKING, BinaryIO

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, ChunkIndex, MessageIndex, Schema
from mcap.stream_reader import get_chunk_data_stream

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

MAGIC = b"\x89MCAP0\r\n"
HEAD = struct.Struct("<BQ")
MESSAGE = struct.Struct("<HIQ")  # channel, sequence, log time; publish time and data follow
_KNOWN = {int(each) for each in Opcode}


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
            if section.size > start + HEAD.size + len(body):
                msg = f"it is damaged at byte {start}, with {section.size - start} bytes from there on: {error}"
                raise NoMcapError(msg) from error
            break
        section.end = start + HEAD.size + len(body)
        on_progress(section.end / section.size)
    return section


def _records(stream: BinaryIO, section: DataSection) -> Iterator[tuple[int, bytes]]:
    """Read whole records; one that is torn off, and zeros that a file system leaves, end it."""
    while len(head := stream.read(HEAD.size)) == HEAD.size:
        opcode, length = HEAD.unpack(head)
        if opcode not in _KNOWN and any(head):
            msg = f"it is damaged at byte {section.end}: {opcode} is no kind of record"
            raise NoMcapError(msg)
        if not opcode or section.end + HEAD.size + length > section.size:
            return
        yield opcode, stream.read(length)


def _take(section: DataSection, opcode: int, body: bytes, start: int) -> None:
    if opcode == Opcode.CHUNK:
        section.chunks.append(_chunk(section, Chunk.read(ReadDataStream(BytesIO(body))), start, HEAD.size + len(body)))
    elif opcode == Opcode.MESSAGE_INDEX and section.chunks:
        index = section.chunks[-1].index
        index.message_index_offsets[MessageIndex.read(ReadDataStream(BytesIO(body))).channel_id] = start
        index.message_index_length += HEAD.size + len(body)
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
    for opcode, offset, end, data in records_of(chunk):
        if opcode == Opcode.MESSAGE:
            counts[MESSAGE.unpack_from(data, offset)[0]] += 1
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


def records_of(chunk: Chunk) -> Iterator[tuple[int, int, int, bytes]]:
    """Read opcode, and begin and end in the data, of each record of a chunk, and the data."""
    data = get_chunk_data_stream(chunk, validate_crc=True)[0].read(chunk.uncompressed_size)
    offset = 0
    while offset < len(data):
        opcode, length = HEAD.unpack_from(data, offset)
        begin = offset + HEAD.size
        offset = begin + length
        yield opcode, begin, offset, data
