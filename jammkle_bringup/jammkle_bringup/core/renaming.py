"""Joints and topics that a robot calls by names of its own: read as text, in messages, and in whole bags.

A mapping of joints is text, `theirs=ours` parted by commas, as a parameter or the command line gives it:

    lf_foot_pitch=ankle_pitch, lf_foot_roll=-ankle_roll
"""

from __future__ import annotations

import contextlib
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from mcap.writer import CompressionType, Writer

from jammkle_common.bags.contents import SUFFIX, metadata_of, write_metadata
from jammkle_common.bags.reading import messages, opened
from jammkle_common.bags.storage import open_file
from jammkle_common.command.errors import InputError, Interrupted
from jammkle_common.names import ANKLE_JOINTS, CARRIAGE_JOINT, JOINT_STATES, LEG_JOINTS

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from jammkle_common.bags.reading import BagReader
    from jammkle_common.bags.storage import Connection

KNOWN_JOINTS: tuple[str, ...] = (*ANKLE_JOINTS, *LEG_JOINTS, CARRIAGE_JOINT)
_WORD = re.compile(r"[^\s=,]+")


@dataclass(frozen=True)
class JointRenaming:
    """New names of joints, by the old ones, and the sign with which each counts."""

    new: Mapping[str, tuple[str, float]]

    @classmethod
    def parsed(cls, text: str) -> JointRenaming:
        """Read `theirs=ours, theirs=-ours`; with the minus, theirs counts the other way round.

        Raises:
            InputError: it has another form, a name stands twice, or ours is unknown.

        """
        found = {
            theirs: (ours.removeprefix("-"), -1.0 if ours.startswith("-") else 1.0)
            for theirs, ours in _pairs(text).items()
        }
        _check_ours([name for name, _ in found.values()])
        return cls(found)

    @property
    def reverse(self) -> JointRenaming:
        """The way back, with the same signs."""
        return JointRenaming({new: (old, sign) for old, (new, sign) in self.new.items()})

    def renamed(self, message: Any) -> tuple[list[str], dict[str, list[float]]] | None:
        """Return names and values of the joints that have a new name, in the order of a JointState; None without any.

        Values are those of `position`, `velocity` and `effort`; empty where the message has none of that kind.
        """
        kept = [(place, *self.new[name]) for place, name in enumerate(message.name) if name in self.new]
        if not kept:
            return None
        values = {}
        for kind in ("position", "velocity", "effort"):
            found = getattr(message, kind)
            values[kind] = [sign * float(found[place]) for place, _, sign in kept] if len(found) else []
        return [name for _, name, _ in kept], values


def _pairs(text: str) -> dict[str, str]:
    found: dict[str, str] = {}
    for part in filter(None, (each.strip() for each in text.split(","))):
        theirs, equals, ours = (each.strip() for each in part.partition("="))
        if not equals or not _WORD.fullmatch(theirs) or not _WORD.fullmatch(ours):
            msg = f"'{part}' must be theirs=ours, such as lf_foot_pitch=ankle_pitch"
            raise InputError(msg)
        if theirs in found:
            msg = f"'{theirs}' stands twice: give each name once"
            raise InputError(msg)
        found[theirs] = ours
    return found


def _check_ours(ours: Sequence[str]) -> None:
    for place, name in enumerate(ours):
        if name not in KNOWN_JOINTS:
            msg = f"'{name}' is no joint of ours: use one of {', '.join(KNOWN_JOINTS)}"
            raise InputError(msg)
        if name in ours[:place]:
            msg = f"joint '{name}' would have two names: give it one"
            raise InputError(msg)


_EVERY = 1000
"""Messages between two looks at whether to stop; some milliseconds."""


def rename(
    bag: Path,
    target: Path,
    joints: JointRenaming,
    topics: Mapping[str, str],
    on_progress: Callable[[float], None],
    asked_to_stop: Callable[[], bool],
) -> tuple[int, int]:
    """Write a bag anew; log times, stamps, QoS and custom data stay.

    Args:
        bag: The bag to read.
        target: Folder of the new bag.
        joints: New names of joints, in every message of joint states that holds one of them; others are left out.
        topics: New names of topics, absolute, by the old ones.
        on_progress: Called with the share that is done, 0 to 1.
        asked_to_stop: Looked at between messages.

    Returns:
        How many messages the new bag has, and how many of these have other joints than before.

    Raises:
        InputError: the bag cannot be read, or holds nothing of what is to be renamed.
        OSError: the new one cannot be written.
        Interrupted: asked to stop; what is written by then is not whole.

    """
    with opened(bag) as reader:
        _check(reader, topics)
        try:
            target.mkdir(parents=True)
        except OSError as error:
            msg = f"bag {target} cannot be made: {error.strerror}"
            raise InputError(msg) from error
        path = target / f"{target.name}{SUFFIX}"
        changed, count = 0, sum(each.msgcount for each in reader.every)
        with path.open("wb") as stream:
            writer = Writer(stream, compression=CompressionType.ZSTD)
            writer.start(profile="ros2", library="jammkle")
            targets = {each.id: _added(writer, each, topics) for each in reader.every}
            # what cannot be decoded is written as it is
            for number, (connection, time_ns, data) in enumerate(messages(reader, bag, reader.every)):
                if number % _EVERY == 0:
                    if asked_to_stop():
                        raise Interrupted
                    on_progress(number / count)
                new = _renamed(reader, joints, connection, data)
                changed += new is not None
                writer.add_message(targets[connection.id], time_ns, data if new is None else new, time_ns)
            writer.finish()  # type: ignore[no-untyped-call]  # of the library
        if joints.new and not changed:
            msg = f"bag {bag} has no joint {' or '.join(joints.new)} in its joint states"
            raise InputError(msg)
        with contextlib.closing(open_file(path)) as file:
            write_metadata(target, metadata_of({path.name: file}, reader.custom_data))
        return count, changed


def topics_of(pairs: list[str]) -> dict[str, str]:
    """Read `/theirs=/ours` of each, absolute names.

    Raises:
        InputError: one has another form, or a name stands twice.

    """
    found: dict[str, str] = {}
    for pair in pairs:
        old, equals, new = pair.partition("=")
        if not equals or not old.startswith("/") or not new.startswith("/"):
            msg = f"'{pair}' must be /theirs=/ours, such as /valves/two/pressure=/achilles/pressure"
            raise InputError(msg)
        if old in found or new in found.values():
            msg = f"'{old if old in found else new}' stands twice: give each name once"
            raise InputError(msg)
        found[old] = new
    return found


def _check(reader: BagReader, topics: Mapping[str, str]) -> None:
    known = {connection.topic for connection in reader.every}
    for old, new in topics.items():
        if old not in known:
            msg = f"bag {reader.path} has no topic {old}: it has {', '.join(sorted(known)) or 'none'}"
            raise InputError(msg)
        if new in known - set(topics):
            msg = f"bag {reader.path} has a topic {new} already: {old} cannot be called so"
            raise InputError(msg)


def _added(writer: Writer, connection: Connection, topics: Mapping[str, str]) -> int:
    language = connection.language or ("ros2msg" if connection.definition else "")
    schema = writer.register_schema(connection.msgtype, language, connection.definition) if connection.msgtype else 0
    hints = {"offered_qos_profiles": connection.offered, "topic_type_hash": connection.digest}
    kept = {key: text for key, text in hints.items() if text}
    topic = topics.get(connection.topic, connection.topic)
    return writer.register_channel(topic, connection.encoding, schema, kept)


def _renamed(reader: BagReader, joints: JointRenaming, connection: Connection, data: bytes) -> bytes | None:
    """Return a message of joint states under new names; None: it stays as it is."""
    if not joints.new or connection.why_left_out or connection.msgtype != JOINT_STATES.message_type:
        return None
    message: Any = reader.deserialize(data, connection.msgtype)
    found = joints.renamed(message)
    if found is None:
        return None
    names, values = found
    numbers = {kind: np.array(each, dtype=np.float64) for kind, each in values.items()}
    make = reader.typestore.types[connection.msgtype]
    return reader.serialize(make(header=message.header, name=names, **numbers), connection.msgtype)
