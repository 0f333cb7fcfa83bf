"""Give an MCAP file the ending that its recorder could not write: killed, or on a full disk.

What a recorder writes goes to the file chunk by chunk, each with its index. Without the ending (index of the chunks,
footer) readers refuse the file, although every whole chunk is there. A record that was torn off is cut off.
"""

from __future__ import annotations

import contextlib
import errno
from typing import TYPE_CHECKING, Any, BinaryIO

from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Chunk, DataEnd, Footer, MessageIndex, Statistics, SummaryOffset

from jammkle_common.bags.data_section import HEAD, MAGIC, MESSAGE, records_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mcap.records import McapRecord

    from jammkle_common.bags.data_section import DataSection

NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""What writing says on a full disk, beyond a quota, and beyond the largest size of a file."""


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


def _missing_indexes(stream: BinaryIO, section: DataSection) -> bytes:
    """Return the index records of the last chunk where they were torn off; the file is cut after that chunk."""
    if not section.chunks:
        return b""
    last = section.chunks[-1]
    if set(last.index.message_index_offsets) == set(last.counts):
        return b""
    stream.seek(last.index.chunk_start_offset + HEAD.size)
    chunk = Chunk.read(ReadDataStream(stream))
    entries: dict[int, list[tuple[int, int]]] = {}
    for opcode, offset, _, data in records_of(chunk):
        if opcode == Opcode.MESSAGE:
            channel, _, log_time = MESSAGE.unpack_from(data, offset)
            entries.setdefault(channel, []).append((log_time, offset - HEAD.size))
    section.end = last.index.chunk_start_offset + last.index.chunk_length
    stream.truncate(section.end)
    stream.seek(section.end)
    builder = RecordBuilder()
    last.index.message_index_offsets.clear()
    for channel, found in entries.items():
        last.index.message_index_offsets[channel] = section.end + builder.count
        MessageIndex(channel, found).write(builder)
    last.index.message_index_length = builder.count
    return _built(builder)


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
    return _built(builder) + MAGIC


def _built(builder: Any) -> bytes:
    """Return what a builder of the library holds; its own method has no types."""
    return bytes(builder.end())


def _write(stream: BinaryIO, data: bytes) -> None:
    """Write all of it: a file without a buffer may take less at a time."""
    view = memoryview(data)
    while view:
        view = view[stream.write(view) :]
