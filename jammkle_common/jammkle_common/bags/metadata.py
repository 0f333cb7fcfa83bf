"""The metadata file of a bag, `metadata.yaml` of rosbag2 in version 9: before a recording and after a recovery.

What is recorded to its end gets it from the bag library.
"""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING, Any, Literal

import yaml
from rosbags.rosbag2.metadata import dump_qos_v9, parse_qos
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping
    from pathlib import Path

    from rosbags.interfaces import Qos

    from jammkle_common.bags.storage import BagFile, StoredChannel

FILE_NAME = "metadata.yaml"
VERSION: Literal[9] = 9
UNFINISHED = "jammkle_unfinished"
"""Key in the custom data of a bag whose recorder has not completed it."""
LOST = "jammkle_lost"
"""Key in the custom data of a bag that was recovered without some of its files; their names."""

_NO_TIME_NS = 2**63 - 1
_TOP = "rosbag2_bagfile_information"


def begun(file_name: str, custom_data: Mapping[str, str]) -> str:
    """Return the metadata of a bag that is being recorded: which file, and that it is not finished."""
    return _text({file_name: None}, {**custom_data, UNFINISHED: "its recorder has not completed it"}, "")


def made_anew(files: Mapping[str, BagFile], custom_data: Mapping[str, str], compression: str) -> str:
    """Return the metadata of a bag from its files.

    Args:
        files: By name, open.
        custom_data: What its recorder added.
        compression: `FILE` or `MESSAGE` where each of them is compressed by itself (Zstandard), else empty.

    """
    return _text(files, custom_data, compression)


def read(folder: Path) -> dict[str, Any]:
    """Return what the metadata of a bag say.

    Raises:
        OSError: they are not there, or cannot be read.
        ValueError: they are no text, or not of a bag.
        yaml.YAMLError: they are broken.

    """
    found = yaml.safe_load((folder / FILE_NAME).read_text(encoding="utf-8"))
    said = found.get(_TOP) if isinstance(found, dict) else None
    if not isinstance(said, dict):
        msg = f"it holds no {_TOP}"
        raise ValueError(msg)  # noqa: TRY004 - of the file, as of one that is no YAML
    return said


def write(folder: Path, text: str) -> None:
    """Put the metadata into a bag at one stroke: a reader sees the old one or the new one.

    Raises:
        OSError: it cannot be written; the old one is as it was.

    """
    new = folder / f"{FILE_NAME}.new"
    try:
        new.write_text(text, encoding="utf-8")
        new.replace(folder / FILE_NAME)
    except OSError:
        with contextlib.suppress(OSError):
            new.unlink(missing_ok=True)
        raise


def _text(files: Mapping[str, BagFile | None], custom_data: Mapping[str, str], compression: str) -> str:
    there = {name: file for name, file in files.items() if file is not None}
    filled = [each for each in there.values() if _count(each)]
    first_ns = min((each.first_ns for each in filled), default=_NO_TIME_NS)
    last_ns = max((each.last_ns for each in filled), default=_NO_TIME_NS)
    content = {
        "version": VERSION,
        "storage_identifier": "sqlite3" if any(".db3" in name for name in files) else "mcap",
        "relative_file_paths": list(files),
        **_span(first_ns, last_ns),
        "message_count": sum(_count(each) for each in filled),
        "topics_with_message_count": _topics(there.values()),
        "compression_format": "zstd" if compression else "",
        "compression_mode": compression,
        "files": [
            {
                "path": name,
                **(_span(0, 0) if file is None else _span(file.first_ns, file.last_ns)),
                "message_count": 0 if file is None else _count(file),
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


def _count(file: BagFile) -> int:
    return sum(channel.message_count for channel in file.channels)


def _span(first_ns: int, last_ns: int) -> dict[str, Any]:
    return {
        "duration": {"nanoseconds": last_ns - first_ns},
        "starting_time": {"nanoseconds_since_epoch": first_ns},
    }


def _topics(files: Iterable[BagFile]) -> list[dict[str, Any]]:
    found: dict[tuple[str, str, str], dict[str, Any]] = {}
    for channel in (each for file in files for each in file.channels):
        topic = found.setdefault(
            (channel.topic, channel.message_type, channel.qos),
            {
                "topic_metadata": {
                    "name": channel.topic,
                    "type": channel.message_type,
                    "serialization_format": channel.encoding,
                    "offered_qos_profiles": dump_qos_v9(profiles(channel.qos)),
                    "type_description_hash": channel.type_hash or _type_hash(channel),
                },
                "message_count": 0,
            },
        )
        topic["message_count"] += channel.message_count
    return list(found.values())


def _type_hash(channel: StoredChannel) -> str:
    store = get_typestore(Stores.EMPTY)
    try:
        store.register(get_types_from_msg(channel.definition.decode(), channel.message_type))
        return store.hash_rihs01(channel.message_type)
    except Exception:  # noqa: BLE001 - a definition of another language, or a broken one: the hash may be empty
        return ""
