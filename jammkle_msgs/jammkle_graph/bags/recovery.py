"""Make a bag whole that its recorder could not complete, from its MCAP files, in place."""

from __future__ import annotations

import contextlib
import fcntl
import shutil
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, BinaryIO

from jammkle_graph.bags import metadata
from jammkle_graph.bags.data_section import MAGIC, DataSection, NoMcapError, scanned
from jammkle_graph.bags.ending import NO_ROOM, complete
from jammkle_graph.bags.metadata import BagFile
from jammkle_graph.command.errors import InputError
from jammkle_graph.constants import NANOSECONDS_PER_SECOND

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

SUFFIX = ".mcap"


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

    """

    bag: Path
    was_whole: bool
    messages: int
    duration_s: float
    torn_bytes: int
    given_up: int

    def as_json(self) -> dict[str, Any]:
        """Return a mapping for JSON."""
        return {**asdict(self), "bag": str(self.bag)}


def lock(stream: BinaryIO) -> None:
    """Hold a file as its recorder; the kernel gives it back when the recorder ends, however it ends."""
    with contextlib.suppress(OSError):  # a file system without locks
        fcntl.flock(stream.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)


def is_held(path: Path) -> bool:
    """Return whether a recorder writes a file at this moment."""
    try:
        with path.open("rb") as stream:
            fcntl.flock(stream.fileno(), fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False
    return False


def files_of(bag: Path) -> list[Path]:
    """Return the MCAP files of a bag's folder, or the one that the path names itself."""
    return sorted(bag.glob(f"*{SUFFIX}")) if bag.is_dir() else [bag]


def is_unfinished(bag: Path) -> bool:
    """Return whether a bag of MCAP lacks its ending.

    Raises:
        OSError: it cannot be looked into.

    """
    return any(not _has_ending(path) for path in files_of(bag) if path.suffix == SUFFIX) or (
        bag.is_dir() and metadata.UNFINISHED in metadata.custom_data_of(bag)
    )


def recover(bag: Path, on_progress: Callable[[float], None], target: Path | None = None) -> Recovered:
    """Make a bag whole.

    Args:
        bag: Its folder, with or without a metadata file, or one MCAP file.
        on_progress: Called with the share that was read, 0 to 1.
        target: Where the whole bag goes; None: the bag itself is completed.

    Raises:
        InputError: there is no bag, it is being recorded, or it is damaged before its end.
        OSError: it cannot be written.

    """
    found = files_of(bag) if bag.exists() else []
    if not found:
        msg = f"bag {bag} does not exist" if not bag.exists() else f"{bag} is not a bag: it holds no *{SUFFIX}"
        raise InputError(msg)
    for path in found:
        if is_held(path):
            msg = f"bag {bag} is being recorded: stop its recorder first (Ctrl-C, or SIGINT)"
            raise InputError(msg)
    if target is not None:
        bag, found = _copied(bag, target)
    whole = not is_unfinished(bag) and (not bag.is_dir() or (bag / metadata.FILE_NAME).is_file())
    if bag.is_dir():  # what a recorder leaves that died while it wrote it
        (bag / f"{metadata.FILE_NAME}.tmp").unlink(missing_ok=True)
    done: list[BagFile] = []
    torn_bytes = given_up = 0
    for place, path in enumerate(found):

        def show(share: float, *, place: int = place) -> None:
            on_progress((place + share) / len(found))

        section, torn, lost = _completed(path, show)
        torn_bytes, given_up = torn_bytes + torn, given_up + lost
        done.append(BagFile(path.name, section))
    if bag.is_dir() and not whole:
        given_up += _write_metadata(bag, done)
    spans = [each.section.span_ns() for each in done if each.section.counts()]
    first_ns, last_ns = (min(span[0] for span in spans), max(span[1] for span in spans)) if spans else (0, 0)
    return Recovered(
        bag=bag,
        was_whole=whole,
        messages=sum(each.section.counts().total() for each in done),
        duration_s=(last_ns - first_ns) / NANOSECONDS_PER_SECOND,
        torn_bytes=torn_bytes,
        given_up=given_up,
    )


def _copied(bag: Path, target: Path) -> tuple[Path, list[Path]]:
    if target.exists():
        msg = f"--output {target} exists: nothing is overwritten; choose another one or move it away"
        raise InputError(msg)
    if bag.is_dir():
        shutil.copytree(bag, target)
    else:
        target.mkdir(parents=True)
        shutil.copy2(bag, target / f"{target.name}{SUFFIX}")
    return target, files_of(target)


def _completed(path: Path, on_progress: Callable[[float], None]) -> tuple[DataSection, int, int]:
    """Complete one file; return what it holds, how many bytes were cut off, and how many messages given up."""
    try:
        with path.open("rb") as stream:
            section = scanned(stream, on_progress)
        if section.whole:
            return section, 0, 0
        torn = section.size - section.end
        with path.open("r+b", buffering=0) as stream:
            return section, torn, complete(stream, section)
    except NoMcapError as error:
        msg = f"bag file {path} cannot be recovered: {error}"
        raise InputError(msg) from error


def _write_metadata(bag: Path, files: Sequence[BagFile]) -> int:
    """Write the metadata; return how many messages at the end were given up, as there was no room for it."""
    try:
        metadata.write(bag, metadata.recovered(files, metadata.custom_data_of(bag)))
    except OSError as error:
        last = files[-1]
        if error.errno not in NO_ROOM or not last.section.chunks:
            raise
        given_up = last.section.give_up_last_chunk()
        with (bag / last.name).open("r+b", buffering=0) as stream:
            given_up += complete(stream, last.section)
        return given_up + _write_metadata(bag, files)
    return 0


def _has_ending(path: Path) -> bool:
    with path.open("rb") as stream:
        size = stream.seek(0, 2)
        stream.seek(max(0, size - len(MAGIC)))
        return size > len(MAGIC) and stream.read() == MAGIC


def unfinished_text(bag: Path) -> str:
    """Return the line for a bag that lacks its ending."""
    if any(is_held(path) for path in files_of(bag)):
        return f"bag {bag} is still being recorded: stop its recorder first (Ctrl-C, or SIGINT)"
    return f"bag {bag} was not completed, as its recorder was killed or found no room: `jammkle recover {bag}` mends it"
