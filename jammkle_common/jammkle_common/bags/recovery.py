"""Make a bag whole that its recorder could not complete, or whose metadata do not fit its files, in place."""

from __future__ import annotations

import contextlib
import dataclasses
import shutil
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from jammkle_common.bags import metadata
from jammkle_common.bags.contents import COMPRESSED, contents_of, files_to_complete, is_held
from jammkle_common.bags.data_section import DataSection, NoMcapError, scanned
from jammkle_common.bags.ending import NO_ROOM, complete
from jammkle_common.bags.reading import messages, open_files, opened
from jammkle_common.bags.storage import MCAP, ROS1, SQLITE, ZSTD, begins_with, merged
from jammkle_common.command.errors import InputError
from jammkle_common.constants import NANOSECONDS_PER_SECOND

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from jammkle_common.bags.contents import Contents
    from jammkle_common.bags.storage import BagFile

_PROGRESS_MESSAGES = 10_000


@dataclass(frozen=True)
class Recovered:
    """What a recovery found and did.

    Attributes:
        bag: The bag that is whole now.
        was_whole: Whether there was nothing to do.
        messages: In the bag.
        duration_s: From the first to the last log time.
        torn_bytes: Cut off at the ends of its files: what was not written as a whole.
        given_up: Messages at the end that were given up, as there was no room for the ending.
        missing: Files of it that are lost: named by its metadata and not there, or without anything in them.
        lacking: Messages that its metadata counted and that are not there.

    """

    bag: Path
    was_whole: bool
    messages: int
    duration_s: float
    torn_bytes: int
    given_up: int
    missing: tuple[str, ...] = ()
    lacking: int = 0

    def as_json(self) -> dict[str, Any]:
        """Return a mapping for JSON."""
        return {**asdict(self), "bag": str(self.bag)}


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
    if target is not None:
        bag = _copied(bag, target)
        contents = dataclasses.replace(contents_of(bag), counted=contents.counted)
    if bag.is_dir():  # what a recorder leaves that died while it wrote it
        (bag / f"{metadata.FILE_NAME}.tmp").unlink(missing_ok=True)
    counted = contents.counted or 0
    contents = _without_empty_files(contents)
    sections: dict[Path, DataSection] = {}
    torn_bytes = given_up = 0
    for path in files_to_complete(contents):
        sections[path], torn, lost = _completed(path, on_progress)
        torn_bytes, given_up = torn_bytes + torn, given_up + lost
    changed = bool(sections)
    if bag.is_dir() and (sections or _needs_metadata(contents)):
        given_up += _write_metadata(contents, sections)
        changed = True
    with opened(bag, quietly=True) as reader:
        count, total = 0, sum(each.msgcount for each in reader.every)
        for count, _ in enumerate(messages(reader, bag, reader.every), 1):
            if count % _PROGRESS_MESSAGES == 0:
                on_progress(count / total)
        return Recovered(
            bag=bag,
            was_whole=not changed,
            messages=count,
            duration_s=(reader.end_time - reader.start_time) / NANOSECONDS_PER_SECOND,
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
    if any(begins_with(path).startswith(ROS1) for path in there):
        msg = f"bag {contents.bag} is of ROS 1: `rosbag reindex` mends it; `jammkle info {contents.bag}` reads it"
        raise InputError(msg)


def _without_empty_files(contents: Contents) -> Contents:
    """Set files aside that hold nothing of a bag, where others do; they count as missing from then on."""
    there = (*contents.files, *contents.unnamed)
    empty = [path for path in there if not begins_with(path).startswith((MCAP, SQLITE, ZSTD))]
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
    before = tuple(filter(None, contents.custom_data.get(metadata.LOST, "").split(", ")))
    return before if len(contents.unnamed) >= len(contents.missing) else (*before, *contents.missing)


def _needs_metadata(contents: Contents) -> bool:
    """Return whether the metadata of a bag whose files are whole do not fit them."""
    if contents.missing or contents.unnamed or contents.unfinished or contents.counted is None:
        return True
    with contextlib.ExitStack() as stack:
        counted = (each.message_count for file in open_files(contents, stack) for each in file.channels)
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


def _completed(path: Path, on_progress: Callable[[float], None]) -> tuple[DataSection, int, int]:
    """Complete one file; return what it holds, how many bytes were cut off, and how many messages given up."""
    try:
        with path.open("rb") as stream:
            section = scanned(stream, on_progress)
        torn = section.size - section.end
        with path.open("r+b", buffering=0) as stream:
            return section, torn, complete(stream, section)
    except NoMcapError as error:
        msg = f"bag file {path} cannot be recovered: {error}"
        raise InputError(msg) from error


def _write_metadata(contents: Contents, sections: Mapping[Path, DataSection]) -> int:
    """Write the metadata; return how many messages at the end were given up, as there was no room for it."""
    bag = contents.bag
    whole = dataclasses.replace(contents, files=tuple(dict.fromkeys((*contents.files, *contents.unnamed))), unnamed=())
    try:
        with contextlib.ExitStack() as stack:
            files = open_files(whole, stack)
            names = [path.name for path in whole.files]
            lost = {metadata.LOST: ", ".join(_lost(contents))} if _lost(contents) else {}
            order = sorted(range(len(files)), key=lambda place: files[place].first_ns)
            text = metadata.made_anew(
                {names[place]: files[place] for place in order},
                {**contents.custom_data, **lost},
                _compression(names, files),
            )
        metadata.write(bag, text)
    except OSError as error:
        last = whole.files[-1]
        section = sections.get(last)
        if error.errno not in NO_ROOM or section is None or not section.chunks:
            raise
        given_up = section.give_up_last_chunk()
        with last.open("r+b", buffering=0) as stream:
            given_up += complete(stream, section)
        return given_up + _write_metadata(contents, sections)
    return 0


def _compression(names: Sequence[str], files: Sequence[BagFile]) -> str:
    """Return what the metadata say of the compression of a bag, by what its files are."""
    if any(name.endswith(COMPRESSED) for name in names):
        return "FILE"
    keys = [{channel.key for channel in file.channels} for file in files]
    first = next(merged(files, keys), None)
    return "MESSAGE" if first is not None and first[-1].startswith(ZSTD) else ""
