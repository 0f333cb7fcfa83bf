"""The metadata file of a bag, `metadata.yaml` of rosbag2 in version 9: before a recording and after a recovery.

What is recorded to its end gets it from the bag library.
"""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import yaml
from rosbags.rosbag2.metadata import dump_qos_v9, parse_qos
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from jammkle_graph.bags.data_section import DataSection

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

FILE_NAME = "metadata.yaml"
VERSION: Literal[9] = 9
UNFINISHED = "jammkle_unfinished"
"""Key in the custom data of a bag whose recorder has not completed it."""

_NO_TIME_NS = 2**63 - 1
_TOP = "rosbag2_bagfile_information"


@dataclass(frozen=True)
class BagFile:
    """One file of a bag: its name inside the folder, and what it holds."""

    name: str
    section: DataSection


def begun(file_name: str, custom_data: Mapping[str, str]) -> str:
    """Return the metadata of a bag that is being recorded: which file, and that it is not finished."""
    return _text([BagFile(file_name, DataSection())], {**custom_data, UNFINISHED: "its recorder has not completed it"})


def recovered(files: Sequence[BagFile], custom_data: Mapping[str, str]) -> str:
    """Return the metadata of a bag from what its files hold."""
    return _text(files, {key: value for key, value in custom_data.items() if key != UNFINISHED})


def custom_data_of(folder: Path) -> dict[str, str]:
    """Return the custom data of a bag; nothing where there is no metadata, or none that can be read."""
    with contextlib.suppress(OSError, yaml.YAMLError, KeyError, TypeError, AttributeError):
        top = yaml.safe_load((folder / FILE_NAME).read_text(encoding="utf-8"))[_TOP]
        return {str(key): str(value) for key, value in (top["custom_data"] or {}).items()}
    return {}


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


def _text(files: Sequence[BagFile], custom_data: Mapping[str, str]) -> str:
    filled = [each.section.span_ns() for each in files if each.section.counts()]
    first_ns = min((span[0] for span in filled), default=_NO_TIME_NS)
    last_ns = max((span[1] for span in filled), default=_NO_TIME_NS)
    topics = _topics(files)
    content = {
        "version": VERSION,
        "storage_identifier": "mcap",
        "relative_file_paths": [each.name for each in files],
        **_span(first_ns, last_ns),
        "message_count": sum(topic["message_count"] for topic in topics),
        "topics_with_message_count": topics,
        "compression_format": "",
        "compression_mode": "",
        "files": [
            {"path": each.name, **_span(*each.section.span_ns()), "message_count": each.section.counts().total()}
            for each in files
        ],
        "custom_data": dict(custom_data) or None,
        "ros_distro": "rosbags",
    }
    return yaml.safe_dump({_TOP: content}, sort_keys=False, allow_unicode=True)


def _span(first_ns: int, last_ns: int) -> dict[str, Any]:
    return {
        "duration": {"nanoseconds": last_ns - first_ns},
        "starting_time": {"nanoseconds_since_epoch": first_ns},
    }


def _topics(files: Sequence[BagFile]) -> list[dict[str, Any]]:
    found: dict[tuple[str, str, str], dict[str, Any]] = {}
    for section in (each.section for each in files):
        counts = section.counts()
        for channel in section.channels.values():
            schema = section.schemas.get(channel.schema_id)
            kind = "" if schema is None else schema.name
            offered = channel.metadata.get("offered_qos_profiles", "")
            topic = found.setdefault(
                (channel.topic, kind, offered),
                {
                    "topic_metadata": {
                        "name": channel.topic,
                        "type": kind,
                        "serialization_format": channel.message_encoding,
                        "offered_qos_profiles": dump_qos_v9(parse_qos(offered)),
                        "type_description_hash": "" if schema is None else _type_hash(kind, schema.data.decode()),
                    },
                    "message_count": 0,
                },
            )
            topic["message_count"] += counts[channel.id]
    return list(found.values())


def _type_hash(message_type: str, definition: str) -> str:
    store = get_typestore(Stores.EMPTY)
    try:
        store.register(get_types_from_msg(definition, message_type))
        return store.hash_rihs01(message_type)
    except Exception:  # noqa: BLE001 - a definition of another language, or a broken one: the hash may be empty
        return ""
