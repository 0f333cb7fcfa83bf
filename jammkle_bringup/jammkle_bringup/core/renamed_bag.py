"""A bag under the names that this project knows: joints, and topics."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np
from mcap.writer import CompressionType, Writer

from jammkle_bringup.core.renaming import RenamingError
from jammkle_common.bags.contents import (
    SUFFIX,
    metadata_of,
    write_metadata,
)
from jammkle_common.bags.reading import messages, opened
from jammkle_common.bags.storage import open_file
from jammkle_common.command.errors import InputError, Interrupted
from jammkle_common.names import JOINT_STATES

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    from jammkle_bringup.core.renaming import JointRenaming
    from jammkle_common.bags.reading import BagReader, Connection

_EVERY = 1000
"""Messages between two looks at whether to stop; some milliseconds."""


@dataclass(frozen=True)
class RenamingRequest:
    """What is to be renamed.

    Attributes:
        bag: The bag to read.
        target: Folder of the new bag.
        joints: New names of joints, in every message of joint states that holds one of them; the others are left out.
        topics: New names of topics, absolute, by the old ones.

    """

    bag: Path
    target: Path
    joints: JointRenaming
    topics: Mapping[str, str]


@dataclass(frozen=True)
class RenamedBag:
    """What a renaming has done.

    Attributes:
        bag: The new bag.
        messages: In it.
        joint_messages: Of these, with other joints than before.
        topics: New names by the old ones.

    """

    bag: Path
    messages: int
    joint_messages: int
    topics: Mapping[str, str]

    def as_json(self) -> dict[str, Any]:
        """Return a mapping for JSON."""
        return {
            "bag": str(self.bag),
            "messages": self.messages,
            "joint_messages": self.joint_messages,
            "topics": dict(self.topics),
        }


def rename(
    request: RenamingRequest, on_progress: Callable[[float], None], asked_to_stop: Callable[[], bool]
) -> RenamedBag:
    """Write the bag anew; log times, stamps, QoS and custom data stay.

    Args:
        request: What is to be renamed.
        on_progress: Called with the share that is done, 0 to 1.
        asked_to_stop: Looked at between messages.

    Raises:
        InputError: the bag cannot be read, or holds nothing of what is to be renamed.
        OSError: the new one cannot be written.
        Interrupted: asked to stop; what is written by then is not whole.

    """
    with opened(request.bag) as reader:
        _check(reader, request)
        try:
            request.target.mkdir(parents=True)
        except OSError as error:
            msg = f"bag {request.target} cannot be made: {error.strerror}"
            raise InputError(msg) from error
        path = request.target / f"{request.target.name}{SUFFIX}"
        with path.open("wb") as stream:
            changed = _write(reader, stream, request, on_progress, asked_to_stop)
        if request.joints.new and not changed:
            msg = f"bag {request.bag} has no joint {' or '.join(request.joints.new)} in its joint states"
            raise InputError(msg)
        with contextlib.closing(open_file(path)) as file:
            write_metadata(request.target, metadata_of({path.name: file}, reader.custom_data, ""))
        count = sum(each.msgcount for each in reader.every)
        return RenamedBag(request.target, count, changed, dict(request.topics))


def topics_of(pairs: list[str]) -> dict[str, str]:
    """Read `/theirs=/ours` of each, absolute names.

    Raises:
        RenamingError: one has another form, or a name stands twice.

    """
    found: dict[str, str] = {}
    for pair in pairs:
        old, equals, new = pair.partition("=")
        if not equals or not old.startswith("/") or not new.startswith("/"):
            msg = f"'{pair}' must be /theirs=/ours, such as /valves/two/pressure=/achilles/pressure"
            raise RenamingError(msg)
        if old in found or new in found.values():
            msg = f"'{old if old in found else new}' stands twice: give each name once"
            raise RenamingError(msg)
        found[old] = new
    return found


def _check(reader: BagReader, request: RenamingRequest) -> None:
    known = {connection.topic for connection in reader.every}
    for old, new in request.topics.items():
        if old not in known:
            msg = f"bag {request.bag} has no topic {old}: it has {', '.join(sorted(known)) or 'none'}"
            raise InputError(msg)
        if new in known - set(request.topics):
            msg = f"bag {request.bag} has a topic {new} already: {old} cannot be called so"
            raise InputError(msg)


def _write(
    reader: BagReader,
    stream: BinaryIO,
    request: RenamingRequest,
    on_progress: Callable[[float], None],
    asked_to_stop: Callable[[], bool],
) -> int:
    """Write all messages, those that cannot be decoded as they are; return how many have other joints."""
    writer = Writer(stream, compression=CompressionType.ZSTD)
    writer.start(profile="ros2", library="jammkle")
    targets = {each.id: _added(writer, each, request) for each in reader.every}
    changed, total = 0, max(sum(each.msgcount for each in reader.every), 1)
    for count, (connection, time_ns, data) in enumerate(messages(reader, request.bag, reader.every)):
        if count % _EVERY == 0:
            if asked_to_stop():
                raise Interrupted
            on_progress(count / total)
        new = _renamed(reader, request.joints, connection, data)
        changed += new is not None
        writer.add_message(targets[connection.id], time_ns, data if new is None else new, time_ns)
    writer.finish()  # type: ignore[no-untyped-call]  # of the library
    return changed


def _added(writer: Writer, connection: Connection, request: RenamingRequest) -> int:
    language = connection.language or ("ros2msg" if connection.definition else "")
    schema = writer.register_schema(connection.msgtype, language, connection.definition) if connection.msgtype else 0
    hints = {"offered_qos_profiles": connection.offered, "topic_type_hash": connection.digest}
    kept = {key: text for key, text in hints.items() if text}
    topic = request.topics.get(connection.topic, connection.topic)
    return writer.register_channel(topic, connection.encoding, schema, kept)


def _renamed(reader: BagReader, joints: JointRenaming, connection: Connection, data: bytes) -> bytes | None:
    """Return a message of joint states under new names; None: it stays as it is."""
    if not joints.new or connection.why_left_out or connection.msgtype != JOINT_STATES.message_type:
        return None
    message: Any = reader.deserialize(data, connection.msgtype)
    found = joints.renamed(message)
    if found is None:
        return None
    make = reader.typestore.types[connection.msgtype]
    values = (np.array(each, dtype=np.float64) for each in (found.position, found.velocity, found.effort))
    return reader.serialize(make(message.header, list(found.name), *values), connection.msgtype)
