"""Which files a bag has, judged against its metadata: the one place that every verb goes by.

The files are what was recorded. The metadata, `metadata.yaml` of rosbag2 in version 9, say which of them there were and
how many messages they held, and may be older than the files, of another name, or not there.
"""

from __future__ import annotations

import contextlib
import fcntl
import re
from dataclasses import dataclass, field
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any, BinaryIO, Literal

import yaml
from rosbags.rosbag2.metadata import dump_qos_v9, parse_qos
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from jammkle_common.bags.storage import MCAP, begins_as_bag
from jammkle_common.command.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping
    from pathlib import Path

    from rosbags.interfaces import Qos

    from jammkle_common.bags.storage import BagFile, Connection

SUFFIX = ".mcap"
"""Of the files that a recorder of ours writes, and that can be completed."""
_KINDS = (SUFFIX, ".db3")
COMPRESSED = ".zstd"


@dataclass(frozen=True)
class Contents:
    """Files and metadata of a bag."""

    bag: Path
    """As it was given: a folder, or one file."""
    files: tuple[Path, ...]
    """What is to be read, in the order of their names."""
    missing: tuple[str, ...] = ()
    """Names of files that the metadata name and that are not there."""
    unnamed: tuple[Path, ...] = ()
    """Files that are there, of a bag whose metadata do not name them."""
    counted: int | None = None
    """Messages that the metadata count; None where there are no metadata, or none that can be read."""
    custom_data: dict[str, str] = field(default_factory=dict)
    """What the recorder added, without the mark of an unfinished bag."""
    unfinished: bool = False
    """Whether it bears that mark."""
    unreadable: str = ""
    """Why the metadata cannot be read; empty otherwise."""


def holds_a_bag(folder: Path) -> bool:
    """Return whether a folder has what a recorder leaves, finished or not."""
    return folder.is_dir() and ((folder / METADATA_NAME).is_file() or bool(_files_in(folder)))


def contents_of(bag: Path) -> Contents:
    """Return the files of a bag.

    Raises:
        InputError: there is no bag.
        OSError: it cannot be looked into.

    """
    if not bag.exists():
        msg = f"bag {bag} does not exist"
        raise InputError(msg)
    if not bag.is_dir():
        return Contents(bag, (bag,))
    there = _files_in(bag)
    if not holds_a_bag(bag):
        msg = f"{bag} is not a bag: it holds no {METADATA_NAME}, and no file *{' or *'.join(_KINDS)}"
        raise InputError(msg)
    said, unreadable = _said(bag)
    if not there and unreadable:
        msg = f"{bag} is not a bag: it holds no file *{' or *'.join(_KINDS)}"
        msg += f", and its {METADATA_NAME} cannot be read: {unreadable}"
        raise InputError(msg)
    custom = _custom(said)
    unfinished = custom.pop(UNFINISHED, None) is not None
    named = list(dict.fromkeys(PurePath(str(each)).name for each in _list(said, "relative_file_paths")))
    if not named:
        kinds = {each.with_suffix("").suffix if each.suffix == COMPRESSED else each.suffix for each in there}
        if len(kinds) > 1:
            msg = f"bag {bag} holds files of two kinds ({', '.join(each.name for each in there)}) and no metadata that"
            msg += " tell which it is made of: move those away that are not to be read"
            raise InputError(msg)
        return Contents(bag, there, custom_data=custom, unfinished=unfinished, unreadable=unreadable)
    missing = tuple(name for name in named if not (bag / name).is_file())
    unnamed = tuple(each for each in there if each.name not in named)
    count = said.get("message_count")
    return Contents(
        bag,
        # a file that is missing may be there under another name
        there if missing else tuple(bag / name for name in named),
        missing,
        unnamed,
        count if isinstance(count, int) else None,
        custom,
        unfinished,
        unreadable,
    )


def files_to_complete(contents: Contents) -> list[Path]:
    """Return the MCAP files of a bag that lack their ending.

    Raises:
        OSError: one cannot be read.

    """
    return [path for path in (*contents.files, *contents.unnamed) if path.suffix == SUFFIX and not _has_ending(path)]


def check_finished(contents: Contents) -> None:
    """Refuse a bag that is still being recorded, or that its recorder could not complete.

    Raises:
        InputError: as said.
        OSError: it cannot be looked into.

    """
    bag = contents.bag
    if not contents.unfinished and not files_to_complete(contents):
        return
    if any(is_held(path) for path in contents.files):
        msg = f"bag {bag} is still being recorded: stop its recorder first (Ctrl-C, or SIGINT)"
        raise InputError(msg)
    if not any(begins_as_bag(path) for path in (*contents.files, *contents.unnamed)):
        msg = f"bag {bag} cannot be read: no file of it begins as MCAP or SQLite does"
        raise InputError(msg)
    msg = f"bag {bag} was not completed, as its recorder was killed or found no room: `jammkle recover {bag}` mends it"
    raise InputError(msg)


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


def _has_ending(path: Path) -> bool:
    with path.open("rb") as stream:
        size = stream.seek(0, 2)
        stream.seek(max(0, size - len(MCAP)))
        return size > len(MCAP) and stream.read() == MCAP


def checked_count(contents: Contents, count: int) -> str:
    """Compare what the files of a bag hold with what its metadata say; return what is worth a word, empty if nothing.

    Raises:
        InputError: messages are missing.

    """
    bag, counted = contents.bag, contents.counted
    fewer = counted is not None and count < counted
    if contents.missing and (fewer or len(contents.unnamed) < len(contents.missing)):
        lacking = f"bag {bag} lacks {', '.join(contents.missing)}: its files hold {count} messages"
        msg = f"{lacking} where its {METADATA_NAME} says {counted}; {_way_out(bag)}"
        raise InputError(msg)
    if fewer:
        msg = f"bag {bag} is damaged: its files hold {count} messages where its {METADATA_NAME} says {counted}"
        msg += f"; {_way_out(bag)}"
        raise InputError(msg)
    if contents.unreadable:
        return f"bag {bag}: its {METADATA_NAME} cannot be read and is not used: {contents.unreadable}"
    if contents.unnamed and not contents.missing:
        extra = ", ".join(each.name for each in contents.unnamed)
        said = f"bag {bag}: {extra} is not named by its {METADATA_NAME} and left out"
        return f"{said}; `jammkle recover {bag}` takes it in"
    if counted is not None and count > counted:
        return f"bag {bag}: its {METADATA_NAME} says {counted} messages where its files hold {count}; these count"
    return ""


def _way_out(bag: Path) -> str:
    return f"copy them anew, or let `jammkle recover {bag}` make a bag of what is there"


def _files_in(bag: Path) -> tuple[Path, ...]:
    """Return the files of a folder in the order of their numbers; of one and its compressed copy the first."""
    found = [each for each in bag.iterdir() if each.is_file() and _is_of_a_bag(each)]
    plain = {each.name for each in found}
    kept = [each for each in found if each.suffix != COMPRESSED or each.stem not in plain]
    return tuple(sorted(kept, key=lambda each: [int(part) if part.isdigit() else part for part in _parts(each.name)]))


def _parts(name: str) -> Iterable[str]:
    return re.split(r"(\d+)", name)


def _is_of_a_bag(path: Path) -> bool:
    plain = path.with_suffix("") if path.suffix == COMPRESSED else path
    return plain.suffix in _KINDS


def _said(bag: Path) -> tuple[dict[str, Any], str]:
    """Return what the metadata say, and why they cannot be read; nothing where there are none."""
    try:
        return read_metadata(bag), ""
    except FileNotFoundError:
        return {}, ""
    except (OSError, ValueError, yaml.YAMLError) as error:
        return {}, " ".join(str(error).split())


def _list(said: dict[str, Any], key: str) -> list[Any]:
    found = said.get(key)
    return found if isinstance(found, list) else []


def _custom(said: dict[str, Any]) -> dict[str, str]:
    found = said.get("custom_data")
    return {str(key): str(value) for key, value in found.items()} if isinstance(found, dict) else {}


METADATA_NAME = "metadata.yaml"
METADATA_VERSION: Literal[9] = 9
UNFINISHED = "jammkle_unfinished"
"""Key in the custom data of a bag whose recorder has not completed it."""
LOST = "jammkle_lost"
"""Key in the custom data of a bag that was recovered without some of its files; their names."""

_NO_TIME_NS = 2**63 - 1
_TOP = "rosbag2_bagfile_information"


def read_metadata(folder: Path) -> dict[str, Any]:
    """Return what the metadata of a bag say.

    Raises:
        OSError: they are not there, or cannot be read.
        ValueError: they are no text, or not of a bag.
        yaml.YAMLError: they are broken.

    """
    found = yaml.safe_load((folder / METADATA_NAME).read_text(encoding="utf-8"))
    said = found.get(_TOP) if isinstance(found, dict) else None
    if not isinstance(said, dict):
        msg = f"it holds no {_TOP}"
        raise ValueError(msg)  # noqa: TRY004 - of the file, as of one that is no YAML
    return said


def write_metadata(folder: Path, text: str) -> None:
    """Put the metadata into a bag at one stroke: a reader sees the old one or the new one.

    Raises:
        OSError: it cannot be written; the old one is as it was.

    """
    new = folder / f"{METADATA_NAME}.new"
    try:
        new.write_text(text, encoding="utf-8")
        new.replace(folder / METADATA_NAME)
    except OSError:
        with contextlib.suppress(OSError):
            new.unlink(missing_ok=True)
        raise


def metadata_of(files: Mapping[str, BagFile | None], custom_data: Mapping[str, str], compression: str = "") -> str:
    """Return the metadata of a bag from its files.

    Args:
        files: By name, open; None: it is being recorded.
        custom_data: What its recorder added.
        compression: `FILE` or `MESSAGE` where each of them is compressed by itself (Zstandard), else empty.

    """
    there = {name: file for name, file in files.items() if file is not None}
    filled = [each for each in there.values() if _message_count(each)]
    first_ns = min((each.first_ns for each in filled), default=_NO_TIME_NS)
    last_ns = max((each.last_ns for each in filled), default=_NO_TIME_NS)
    content = {
        "version": METADATA_VERSION,
        "storage_identifier": "sqlite3" if any(".db3" in name for name in files) else "mcap",
        "relative_file_paths": list(files),
        **_time_span(first_ns, last_ns),
        "message_count": sum(_message_count(each) for each in filled),
        "topics_with_message_count": _topic_entries(there.values()),
        "compression_format": "zstd" if compression else "",
        "compression_mode": compression,
        "files": [
            {
                "path": name,
                **(_time_span(0, 0) if file is None else _time_span(file.first_ns, file.last_ns)),
                "message_count": 0 if file is None else _message_count(file),
            }
            for name, file in files.items()
        ],
        "custom_data": dict(custom_data) or None,
        "ros_distro": "rosbags",
    }
    return yaml.safe_dump({_TOP: content}, sort_keys=False, allow_unicode=True)


def profiles(text: str) -> list[Qos]:
    """Return QoS profiles that stand in a bag as YAML; none where they cannot be read, as they are a hint."""
    try:
        return parse_qos(text)
    except Exception:  # noqa: BLE001 - the library lets errors of several kinds through
        return []


def _message_count(file: BagFile) -> int:
    return sum(channel.msgcount for channel in file.channels)


def _time_span(first_ns: int, last_ns: int) -> dict[str, Any]:
    return {
        "duration": {"nanoseconds": last_ns - first_ns},
        "starting_time": {"nanoseconds_since_epoch": first_ns},
    }


def _topic_entries(files: Iterable[BagFile]) -> list[dict[str, Any]]:
    found: dict[tuple[str, str, str], dict[str, Any]] = {}
    for channel in (each for file in files for each in file.channels):
        topic = found.setdefault(
            (channel.topic, channel.msgtype, channel.offered),
            {
                "topic_metadata": {
                    "name": channel.topic,
                    "type": channel.msgtype,
                    "serialization_format": channel.encoding,
                    "offered_qos_profiles": dump_qos_v9(profiles(channel.offered)),
                    "type_description_hash": channel.digest or _type_hash(channel),
                },
                "message_count": 0,
            },
        )
        topic["message_count"] += channel.msgcount
    return list(found.values())


def _type_hash(channel: Connection) -> str:
    store = get_typestore(Stores.EMPTY)
    try:
        store.register(get_types_from_msg(channel.definition.decode(), channel.msgtype))
        return store.hash_rihs01(channel.msgtype)
    except Exception:  # noqa: BLE001 - a definition of another language, or a broken one: the hash may be empty
        return ""
