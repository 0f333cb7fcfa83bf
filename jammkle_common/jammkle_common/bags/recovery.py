"""Make a bag whole that its recorder could not complete, or whose metadata do not fit its files, in place."""

from __future__ import annotations

import contextlib
import dataclasses
import errno
import io
import shutil
import struct
from collections import Counter
from dataclasses import asdict, dataclass, field
from io import BytesIO
from typing import TYPE_CHECKING, Any, BinaryIO

from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    MessageIndex,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.stream_reader import get_chunk_data_stream

from jammkle_common.bags.contents import (
    COMPRESSED,
    LOST,
    METADATA_NAME,
    contents_of,
    files_to_complete,
    is_held,
    metadata_of,
    write_metadata,
)
from jammkle_common.bags.reading import messages, open_files, opened
from jammkle_common.bags.storage import MCAP, ROS1, ZSTD, begins_as_bag, begins_with, merged
from jammkle_common.bags.times import BagTimes, Span, other_clock
from jammkle_common.command.errors import InputError
from jammkle_common.constants import NANOSECONDS_PER_SECOND

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from pathlib import Path

    from mcap.records import McapRecord

    from jammkle_common.bags.contents import Contents
    from jammkle_common.bags.storage import BagFile

_PROGRESS_MESSAGES = 10_000


@dataclass(frozen=True)
class Recovered:
    """What a recovery found and did."""

    bag: Path
    """The bag that is whole now."""
    was_whole: bool
    """Whether there was nothing to do."""
    messages: int
    duration_s: float
    """From the first to the last log time."""
    data_duration_s: float
    """By the clock of the messages; differs where log times lie apart, or the log has another clock."""
    torn_bytes: int
    """Cut off at the ends of its files: what was not written as a whole."""
    given_up: int
    """Messages at the end that were given up, as there was no room for the ending."""
    missing: tuple[str, ...] = ()
    """Files of it that are lost: named by its metadata and not there, or without anything in them."""
    lacking: int = 0
    """Messages that its metadata counted and that are not there."""

    def as_json(self) -> dict[str, Any]:
        """Return a mapping for JSON."""
        return {**asdict(self), "bag": str(self.bag)}

    def text(self) -> str:
        """Return what people read."""
        clock = other_clock(self.duration_s, self.data_duration_s)
        holds = f"{self.bag}: {self.messages} messages in {self.duration_s:.3f} s{clock}"
        lost = (
            f"; of it {', '.join(self.missing)} {'is' if len(self.missing) == 1 else 'are'} lost"
            if self.missing
            else ""
        )
        if self.was_whole:
            return f"{holds}; {'' if lost else 'it is whole, '}nothing was to be done{lost}"
        is_whole = "it is whole now" if not (lost or self.lacking) else "what is left of it can be read now"
        torn = f"; {self.torn_bytes} bytes at the end were torn and are cut off" if self.torn_bytes else ""
        given_up = f"; {self.given_up} messages at the end were given up for room" if self.given_up else ""
        lacking = f"; {self.lacking} messages that its metadata counted are not there" if self.lacking else ""
        return f"{holds}; {is_whole}{torn}{given_up}{lost}{lacking}"


def recover(bag: Path, on_progress: Callable[[float], None], target: Path | None = None) -> Recovered:
    """Make a bag whole: complete its files, and make its metadata anew where they do not fit the files.

    Args:
        bag: Its folder, with or without a metadata file, or one file.
        on_progress: Called with the share that was read, 0 to 1.
        target: Where the whole bag goes; None: the bag itself is completed.

    Raises:
        InputError: there is no bag, it is being recorded, or it is damaged before its end.
        OSError: it cannot be written.

    """
    contents = contents_of(bag)
    if any(is_held(path) for path in (*contents.files, *contents.unnamed)):
        msg = f"bag {bag} is being recorded: stop its recorder first (Ctrl-C, or SIGINT)"
        raise InputError(msg)
    _check_recoverable(contents)
    if target is None:
        return _made_whole(contents, on_progress)
    try:
        copied = _copied(bag, target)
    except OSError as error:
        msg = f"--output {target} cannot be made: {error.strerror or error}"
        raise InputError(msg) from error
    try:
        return _made_whole(dataclasses.replace(contents_of(copied), counted=contents.counted), on_progress)
    except BaseException as error:
        shutil.rmtree(copied, ignore_errors=True)
        if isinstance(error, InputError):
            msg = f"bag {bag} cannot be recovered into {target}: {str(error).replace(str(copied), str(bag))}"
            raise InputError(msg) from error
        raise


def _made_whole(contents: Contents, on_progress: Callable[[float], None]) -> Recovered:
    """Complete a bag in place, and say what is in it."""
    bag = contents.bag
    if bag.is_dir():  # what a recorder leaves that died while it wrote it
        (bag / f"{METADATA_NAME}.tmp").unlink(missing_ok=True)
    counted = contents.counted or 0
    contents = _without_empty_files(contents)
    sections: dict[Path, DataSection] = {}
    torn_bytes = given_up = 0
    is_only = len((*contents.files, *contents.unnamed)) == 1
    for path in files_to_complete(contents):
        sections[path], torn, lost = _completed(path, on_progress, is_only=is_only)
        torn_bytes, given_up = torn_bytes + torn, given_up + lost
    changed = bool(sections)
    if bag.is_dir() and (sections or _needs_metadata(contents)):
        given_up += _write_metadata_of(contents, sections)
        changed = True
    with opened(bag, quietly=True) as reader:
        total = sum(each.msgcount for each in reader.every)
        span = Span()
        for message in BagTimes(reader).messages(reader.connections):
            span.take(message.time_ns)
            if span.count % _PROGRESS_MESSAGES == 0:
                on_progress(span.count / total)
        count = span.count + sum(1 for _ in messages(reader, bag, reader.left_out))
        return Recovered(
            bag=bag,
            was_whole=not changed,
            messages=count,
            duration_s=(reader.end_time - reader.start_time) / NANOSECONDS_PER_SECOND,
            data_duration_s=span.duration_s,
            torn_bytes=torn_bytes,
            given_up=given_up,
            missing=_lost(contents),
            lacking=max(counted - count, 0),
        )


def _check_recoverable(contents: Contents) -> None:
    """Refuse a bag of which nothing is there, and one of ROS 1."""
    there = (*contents.files, *contents.unnamed)
    if not there:
        msg = f"bag {contents.bag} cannot be recovered: of its files {', '.join(contents.missing)} none is there"
        raise InputError(msg)
    if not any(begins_as_bag(path) or begins_with(path).startswith(ROS1) for path in there):
        msg = f"bag {contents.bag} cannot be recovered: no file of it begins as MCAP or SQLite does"
        raise InputError(msg)
    if any(begins_with(path).startswith(ROS1) for path in there):
        msg = f"bag {contents.bag} is of ROS 1: `rosbag reindex` mends it; `jammkle info {contents.bag}` reads it"
        raise InputError(msg)


def _without_empty_files(contents: Contents) -> Contents:
    """Set files aside that hold nothing of a bag, where others do; they count as missing from then on."""
    there = (*contents.files, *contents.unnamed)
    empty = [path for path in there if not begins_as_bag(path)]
    if not empty or len(empty) == len(there):
        return contents
    for path in empty:
        path.rename(path.with_name(f"{path.name}.empty"))
    return dataclasses.replace(
        contents,
        files=tuple(path for path in contents.files if path not in empty),
        unnamed=tuple(path for path in contents.unnamed if path not in empty),
        missing=(*contents.missing, *(path.name for path in empty)),
    )


def _lost(contents: Contents) -> tuple[str, ...]:
    """Return the names of files that are lost, and not only called otherwise."""
    before = tuple(filter(None, contents.custom_data.get(LOST, "").split(", ")))
    return before if len(contents.unnamed) >= len(contents.missing) else (*before, *contents.missing)


def _needs_metadata(contents: Contents) -> bool:
    """Return whether the metadata of a bag whose files are whole do not fit them."""
    if contents.missing or contents.unnamed or contents.unfinished or contents.counted is None:
        return True
    with contextlib.ExitStack() as stack:
        counted = (each.msgcount for file in open_files(contents, stack) for each in file.channels)
        return contents.counted != sum(counted)


def _copied(bag: Path, target: Path) -> Path:
    if target.exists():
        msg = f"--output {target} exists: nothing is overwritten; choose another one or move it away"
        raise InputError(msg)
    if bag.is_dir():
        shutil.copytree(bag, target)
    else:
        target.mkdir(parents=True)
        kind = "".join(bag.suffixes[-2:]) if bag.suffix == COMPRESSED else bag.suffix
        shutil.copy2(bag, target / f"{target.name}{kind}")
    return target


def _completed(path: Path, on_progress: Callable[[float], None], *, is_only: bool) -> tuple[DataSection, int, int]:
    """Complete one file; return what it holds, how many bytes were cut off, and how many messages given up.

    Nothing is cut off the only file of a bag if no message would be left.
    """
    try:
        with path.open("rb") as stream:
            section = scanned(stream, on_progress)
        if is_only:
            _check_worth(section)
        torn = section.size - section.end
        with path.open("r+b", buffering=0) as stream:
            return section, torn, complete(stream, section)
    except InputError as error:
        msg = f"bag file {path} cannot be recovered: {error}"
        raise InputError(msg) from error


def _check_worth(section: DataSection) -> None:
    """Refuse to cut off all messages that a bag has."""
    if section.given_up_bytes and not section.counts():
        msg = f"its only chunk is compressed, and torn off after {section.given_up_bytes} bytes"
        msg += "; copy it anew from where it is whole"
        raise InputError(msg)


def _write_metadata_of(contents: Contents, sections: Mapping[Path, DataSection]) -> int:
    """Write the metadata; return how many messages at the end were given up, as there was no room for it."""
    bag = contents.bag
    whole = dataclasses.replace(contents, files=tuple(dict.fromkeys((*contents.files, *contents.unnamed))), unnamed=())
    try:
        with contextlib.ExitStack() as stack:
            files = open_files(whole, stack)
            names = [path.name for path in whole.files]
            lost = {LOST: ", ".join(_lost(contents))} if _lost(contents) else {}
            order = sorted(range(len(files)), key=lambda place: files[place].first_ns)
            text = metadata_of(
                {names[place]: files[place] for place in order},
                {**contents.custom_data, **lost},
                _compression(names, files),
            )
        write_metadata(bag, text)
    except OSError as error:
        last = whole.files[-1]
        section = sections.get(last)
        if error.errno not in NO_ROOM or section is None or not section.chunks:
            raise
        given_up = section.give_up_last_chunk()
        with last.open("r+b", buffering=0) as stream:
            given_up += complete(stream, section)
        return given_up + _write_metadata_of(contents, sections)
    return 0


def _compression(names: Sequence[str], files: Sequence[BagFile]) -> str:
    """Return what the metadata say of the compression of a bag, by what its files are."""
    if any(name.endswith(COMPRESSED) for name in names):
        return "FILE"
    keys = [{channel.id for channel in file.channels} for file in files]
    first = next(merged(files, keys), None)
    return "MESSAGE" if first is not None and first[-1].startswith(ZSTD) else ""


HEAD = struct.Struct("<BQ")
MESSAGE = struct.Struct("<HIQ")  # channel, sequence, log time; publish time and data follow
_CHUNK = struct.Struct("<QQQIIQ")  # first and last log time, size, checksum, length of no compression's name, size
_KNOWN = {int(each) for each in Opcode}


@dataclass(frozen=True)
class WrittenChunk:
    """A whole chunk: its entry in the index of the file, and how many messages of each channel it holds."""

    index: ChunkIndex
    counts: dict[int, int]


@dataclass
class DataSection:
    """What an MCAP file holds, up to its ending."""

    end: int = len(MCAP)
    """Offset after the last whole record."""
    size: int = 0
    whole: bool = False
    """Whether the file has its ending."""
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    chunks: list[WrittenChunk] = field(default_factory=list)
    """In the order of the file."""
    loose: Counter[int] = field(default_factory=Counter)
    """Messages of each channel, of a file without chunks."""
    loose_ns: tuple[int, int] = (0, 0)
    """Their first and last log time."""
    attachments: list[AttachmentIndex] = field(default_factory=list)
    metadata: list[MetadataIndex] = field(default_factory=list)
    torn_chunk: bytes = b""
    """What the last chunk begins with so that it holds its whole records alone; empty: it is not torn."""
    given_up_bytes: int = 0
    """Of a chunk that was torn off and is compressed, so that none of it can be read."""

    def counts(self) -> Counter[int]:
        """Return the messages of each channel."""
        total = Counter(self.loose)
        for chunk in self.chunks:
            total.update(chunk.counts)
        return total

    def give_up_last_chunk(self) -> int:
        """Let the data end before the last chunk; return how many messages that costs."""
        dropped = self.chunks.pop()
        self.end, self.whole = dropped.index.chunk_start_offset, False
        self.attachments = [each for each in self.attachments if each.offset < self.end]
        self.metadata = [each for each in self.metadata if each.offset < self.end]
        return sum(dropped.counts.values())

    def span_ns(self) -> tuple[int, int]:
        """Return the first and the last log time; zero without messages."""
        filled = [chunk.index for chunk in self.chunks if chunk.counts]
        if not filled:
            return self.loose_ns
        return min(each.message_start_time for each in filled), max(each.message_end_time for each in filled)


def scanned(stream: BinaryIO, on_progress: Callable[[float], None]) -> DataSection:
    """Read an open file up to its ending, or up to where it was torn off; tell the share that was read, 0 to 1.

    Raises:
        InputError: no MCAP file, or damaged before its last record.

    """
    section = DataSection(size=_end_of_data(stream))
    stream.seek(0)
    if stream.read(len(MCAP)) != MCAP:
        msg = "it is no MCAP file"
        raise InputError(msg)
    for opcode, body in _records(stream, section):
        start = section.end
        if opcode == Opcode.DATA_END:
            stream.seek(-len(MCAP), 2)
            section.whole = stream.read() == MCAP
            break
        try:
            _take(section, opcode, body, start)
        except Exception as error:  # the library lets errors of struct, of codecs and its own through
            if section.size > start + HEAD.size + len(body):
                msg = f"it is damaged at byte {start}, with {section.size - start} bytes from there on: {error}"
                raise InputError(msg) from error
            break
        section.end = start + HEAD.size + len(body)
        if opcode == Opcode.CHUNK or section.loose.total() % _PROGRESS_MESSAGES == 1:
            on_progress(section.end / section.size)
    else:
        stream.seek(section.end)
        _take_torn_chunk(section, stream.read(section.size - section.end))
    return section


_BLOCK = 512
"""Zeros at the end from which on they are of a file system, in place of what it had not written: a sector."""


def _end_of_data(stream: BinaryIO) -> int:
    """Return where a file ends, without the zeros that a file system has left there; no message may reach into them."""
    size = end = stream.seek(0, 2)
    while end:
        begin = max(end - io.DEFAULT_BUFFER_SIZE, 0)
        stream.seek(begin)
        kept = len(stream.read(end - begin).rstrip(b"\0"))
        end = begin + kept
        if kept:
            break
    return end if size - end >= _BLOCK else size


def _take_torn_chunk(section: DataSection, torn: bytes) -> None:
    """Take the whole messages of a chunk that was torn off; of one that is compressed there are none."""
    if len(torn) <= HEAD.size + _CHUNK.size or torn[0] != Opcode.CHUNK:
        return
    if _CHUNK.unpack_from(torn, HEAD.size)[4]:
        section.given_up_bytes = len(torn)
        return
    data = torn[HEAD.size + _CHUNK.size :]
    times_ns, size = list[int](), 0
    while size + HEAD.size <= len(data):
        opcode, length = HEAD.unpack_from(data, size)
        if opcode not in _KNOWN or size + HEAD.size + length > len(data):
            break
        if opcode == Opcode.MESSAGE and length >= MESSAGE.size:
            times_ns.append(MESSAGE.unpack_from(data, size + HEAD.size)[2])
        size += HEAD.size + length
    if not times_ns:
        return
    fields = _CHUNK.pack(min(times_ns), max(times_ns), size, 0, 0, size)
    section.torn_chunk = HEAD.pack(Opcode.CHUNK, len(fields) + size) + fields
    length = len(section.torn_chunk) + size
    chunk = Chunk("", data[:size], max(times_ns), min(times_ns), 0, size)
    section.chunks.append(_chunk(section, chunk, section.end, length))
    section.end += length


def _records(stream: BinaryIO, section: DataSection) -> Iterator[tuple[int, bytes]]:
    """Read whole records; one that is torn off, and zeros that a file system leaves, end it."""
    while len(head := stream.read(HEAD.size)) == HEAD.size:
        opcode, length = HEAD.unpack(head)
        if opcode not in _KNOWN and any(head):
            msg = f"it is damaged at byte {section.end}: {opcode} is no kind of record"
            raise InputError(msg)
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
    elif opcode == Opcode.ATTACHMENT:
        kept = Attachment.read(ReadDataStream(BytesIO(body)))
        times_ns, size = (kept.log_time, kept.create_time), len(kept.data)
        length = HEAD.size + len(body)
        section.attachments.append(AttachmentIndex(start, length, *times_ns, size, kept.name, kept.media_type))
    elif opcode == Opcode.METADATA:
        name = Metadata.read(ReadDataStream(BytesIO(body))).name
        section.metadata.append(MetadataIndex(start, HEAD.size + len(body), name))
    elif opcode == Opcode.MESSAGE:
        if section.chunks:
            msg = "it holds messages in chunks, and beside them"
            raise InputError(msg)
        channel, _, log_ns = MESSAGE.unpack_from(body)
        first_ns, last_ns = section.loose_ns if section.loose else (log_ns, log_ns)
        section.loose_ns = min(first_ns, log_ns), max(last_ns, log_ns)
        section.loose[channel] += 1


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


NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""What writing says on a full disk, beyond a quota, and beyond the largest size of a file."""


def complete(stream: BinaryIO, section: DataSection) -> int:
    """Cut off what is torn and write the ending; chunks are given up, the last one first, where there is no room.

    The file is open for reading and writing, without a buffer; the section is brought up to date.

    Returns:
        How many messages were given up for want of room.

    Raises:
        OSError: it cannot be written, even so.

    """
    given_up = 0
    if section.torn_chunk:
        stream.seek(section.chunks[-1].index.chunk_start_offset)
        _write(stream, section.torn_chunk)
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
    """Return the index records of the last chunk where they were torn off; the file is cut after that chunk then."""
    if not section.chunks:
        return b""
    last = section.chunks[-1]
    indexed_to = last.index.chunk_start_offset + last.index.chunk_length + last.index.message_index_length
    # What follows was written after the indexes, of a recorder that writes any.
    if set(last.index.message_index_offsets) == set(last.counts) or section.end > indexed_to:
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
        attachment_count=len(section.attachments),
        channel_count=len(section.channels),
        channel_message_counts=dict(counts),
        chunk_count=len(section.chunks),
        message_count=counts.total(),
        message_end_time=last_ns,
        message_start_time=first_ns,
        metadata_count=len(section.metadata),
        schema_count=len(section.schemas),
    )
    groups: tuple[tuple[Opcode, Sequence[McapRecord]], ...] = (
        (Opcode.SCHEMA, list(section.schemas.values())),
        (Opcode.CHANNEL, list(section.channels.values())),
        (Opcode.STATISTICS, [statistics]),
        (Opcode.CHUNK_INDEX, [chunk.index for chunk in section.chunks]),
        (Opcode.ATTACHMENT_INDEX, section.attachments),
        (Opcode.METADATA_INDEX, section.metadata),
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
    return _built(builder) + MCAP


def _built(builder: Any) -> bytes:
    """Return what a builder of the library holds; its own method has no types."""
    return bytes(builder.end())


def _write(stream: BinaryIO, data: bytes) -> None:
    """Write all of it: a file without a buffer may take less at a time."""
    view = memoryview(data)
    while view:
        view = view[stream.write(view) :]
