"""Types of messages: their definitions as a bag embeds them, from a bag, or without ROS as plain classes; to CDR.

A bag opens anywhere, as it holds the text of each definition as written, with comments, and its hash. What a bag does
not define is taken from ROS 2 Jazzy, else as it is installed.
"""

from __future__ import annotations

import dataclasses
import functools
import os
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, TypesysError, get_types_from_idl, get_types_from_msg, get_typestore

from jammkle_common.command.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from rosbags.typesys.store import Typestore

    from jammkle_common.bags.storage import Connection

_SEPARATOR = "=" * 80 + "\n"
_PARTS = 3


@dataclass(frozen=True)
class MessageDefinition:
    """What a bag says of one type: the text of it and of all that it is made of (ros2msg), and its RIHS01 hash."""

    text: str
    type_hash: str


_BROUGHT = Path(__file__).parents[1] / "share"
"""Definitions of the project's own messages beside its code, as a wheel brings them where no ROS is."""


def share_folders() -> tuple[Path, ...]:
    """Return the share folders of the sourced workspaces, of this Python environment and of the wheel."""
    prefixes = [Path(prefix) for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if prefix]
    return (*(prefix / "share" for prefix in (*prefixes, Path(sys.prefix))), _BROUGHT)


class MessageDefinitions:
    """Finds definitions in installed packages and, for what is not there, in the tables of the bag library."""

    def __init__(self, shares: Sequence[Path]) -> None:
        """Look in the given share folders, first one first."""
        self._shares = tuple(shares)
        self._jazzy = get_typestore(Stores.ROS2_JAZZY)
        self._known: dict[str, MessageDefinition] = {}

    def find(self, message_type: str) -> MessageDefinition:
        """Return the definition of `package/msg/Name`.

        Raises:
            InputError: the type is neither installed nor one of the standard ones.

        """
        if message_type not in self._known:
            texts = self._texts(message_type)
            if texts is None:
                self._known[message_type] = self._standard(message_type)
            else:
                self._known[message_type] = _assembled(message_type, texts)
        return self._known[message_type]

    def _texts(self, message_type: str) -> dict[str, str] | None:
        """Return the text of a type and of all types inside it, or None if it is not installed.

        A standard type inside it comes from the bag library where it is not installed, as on a machine without ROS.
        """
        texts: dict[str, str] = {}
        pending = [message_type]
        while pending:
            name = pending.pop(0)
            if name in texts:
                continue
            text = self._text(name)
            if text is None and not texts:
                return None
            if text is None:
                text = self._standard(name).text.partition(_SEPARATOR)[0]
            texts[name] = text
            pending += sorted(set(_types_in_fields(get_types_from_msg(text, name)[name])))
        return texts

    def _text(self, message_type: str) -> str | None:
        parts = message_type.split("/")
        if len(parts) != _PARTS:
            return None
        package, folder, name = parts
        for share in self._shares:
            file = share / package / folder / f"{name}.msg"
            if file.is_file():
                return file.read_text(encoding="utf-8")
        return None

    def _standard(self, message_type: str) -> MessageDefinition:
        try:
            text, _ = self._jazzy.generate_msgdef(message_type, ros_version=2)
            return MessageDefinition(text, self._jazzy.hash_rihs01(message_type))
        except (KeyError, TypesysError):
            msg = f"type {message_type} is not installed here: build its package and source the workspace"
            raise InputError(msg) from None


def _assembled(message_type: str, texts: dict[str, str]) -> MessageDefinition:
    """Put texts together as rosbag2 does, and hash the type they define."""
    store = get_typestore(Stores.EMPTY)
    for name, text in texts.items():
        store.register(get_types_from_msg(text, name))
    inner = [
        f"{_SEPARATOR}MSG: {name.replace('/msg/', '/')}\n{text.rstrip()}\n"
        for name, text in texts.items()
        if name != message_type
    ]
    text = "".join([f"{texts[message_type].rstrip()}\n", *inner])
    return MessageDefinition(text, store.hash_rihs01(message_type))


_IDL_LANGUAGES = ("ros2idl", "omgidl")


class UndecodableError(ValueError):
    """Messages of a channel cannot be decoded; the message says why."""


class KnownTypes:
    """Fills a store of types, channel by channel."""

    def __init__(self, store: Typestore) -> None:
        """Fill this store."""
        self._store = store
        self._jazzy = get_typestore(Stores.ROS2_JAZZY)
        self._installed = MessageDefinitions(share_folders())
        self._seen: set[tuple[str, bytes]] = set()

    def add(self, channel: Connection) -> None:
        """Make the type of a channel known, with all that it is made of.

        Raises:
            UndecodableError: a definition is missing or broken, or another channel has another type of that name.

        """
        name = channel.msgtype
        if (name, channel.definition) in self._seen:
            return
        if not name:
            msg = "it names no type"
            raise UndecodableError(msg)
        used = self._with_all_inside(name, self._defined(channel))
        for each, fields in used.items():
            before = self._store.fielddefs.get(each)
            if before is not None and before[1] != fields[1]:
                msg = f"type {each} in it is defined otherwise than for another topic"
                raise UndecodableError(msg)
        try:
            self._store.register({each: fields for each, fields in used.items() if each not in self._store.fielddefs})
        except Exception as error:
            msg = f"the definition of its type {name} cannot be used: {one_line(error)}"
            raise UndecodableError(msg) from error
        self._seen.add((name, channel.definition))

    def _defined(self, channel: Connection) -> dict[str, Any]:
        if not channel.definition.strip() and channel.msgtype not in self._store.fielddefs:
            return {}
        try:
            text = channel.definition.decode()
            if channel.language in _IDL_LANGUAGES:
                return _from_idl(text)
            if text.strip():
                return dict(get_types_from_msg(text, channel.msgtype))
        except Exception as error:
            msg = f"the definition of its type {channel.msgtype} cannot be read: {one_line(error)}"
            raise UndecodableError(msg) from error
        return {}

    def differs(self, channel: Connection) -> bool:
        """Return whether a channel defines its type otherwise than ROS 2 Jazzy does, which knows it."""
        usual = self._jazzy.fielddefs.get(channel.msgtype)
        try:
            own = self._defined(channel).get(channel.msgtype)
        except UndecodableError:
            return False
        return usual is not None and own is not None and usual[1] != own[1]

    def lacking(self, channel: Connection) -> str:
        """Return a field, with its type, that a channel's definition lacks of the usual one; empty: none."""
        for name, (_, fields) in self._with_all_inside(channel.msgtype, self._defined(channel)).items():
            try:
                (_, usual) = (
                    self._jazzy.fielddefs.get(name) or get_types_from_msg(self._installed.find(name).text, name)[name]
                )
            except InputError:
                continue  # a type that nobody here knows
            own = {field for field, _ in fields}
            for field, _ in usual:
                if field not in own:
                    return f"{name} has no field '{field}'"
        return ""

    def _with_all_inside(self, name: str, defined: dict[str, Any]) -> dict[str, Any]:
        """Return a type and all that it is made of, from what the bag defines, else from elsewhere."""
        used: dict[str, Any] = {}
        pending = [name]
        while pending:
            each = pending.pop()
            if each in used:
                continue
            if each not in defined:
                defined = {**self._elsewhere(each, name), **defined}
            used[each] = defined[each]
            pending += _types_in_fields(used[each])
        return used

    def _elsewhere(self, name: str, wanted: str) -> dict[str, Any]:
        for store in (self._store, self._jazzy):
            if name in store.fielddefs:
                return {name: store.fielddefs[name]}
        try:
            return dict(get_types_from_msg(self._installed.find(name).text, name))
        except InputError as error:
            inside = "" if name == wanted else f", which is in its type {wanted},"
            msg = f"the bag holds no definition of {name}{inside} and none is installed"
            raise UndecodableError(msg) from error


def _from_idl(text: str) -> dict[str, Any]:
    found: dict[str, Any] = {}
    parts = text.split(_SEPARATOR)
    for part in parts[1:] if text.startswith(f"{_SEPARATOR}IDL: ") else parts:
        found.update(get_types_from_idl(part.partition("\n")[2] if part.startswith("IDL: ") else part))
    return found


def _types_in_fields(definition: Any) -> Iterator[str]:
    for _, (node, inner) in definition[1]:
        kind = (node, inner) if node in (Nodetype.BASE, Nodetype.NAME) else inner[0]
        if kind[0] is Nodetype.NAME:
            yield kind[1]


def one_line(error: Exception) -> str:
    """Return what an error says, without line breaks; its class where it says nothing."""
    return " ".join(str(error).split()) or type(error).__name__


_ZEROS: dict[str, Any] = {"string": "", "bool": False, "float32": 0.0, "float64": 0.0}
_DEFAULTS: dict[str, dict[str, Any]] = {"geometry_msgs/msg/Quaternion": {"w": 1.0}}
"""Fields that do not begin at zero, by type: the bag library does not keep the defaults of a definition."""


@functools.cache
def plain_class(message_type: str) -> type:
    """Return a class whose messages begin as those of ROS do, every field at its default.

    Raises:
        InputError: as `message_class`.

    """
    store = get_typestore(Stores.ROS2_JAZZY)
    if message_type not in store.types:
        found = get_types_from_msg(MessageDefinitions(share_folders()).find(message_type).text, message_type)
        store.register({name: known for name, known in found.items() if name not in store.types})
    constants, fields = store.fielddefs[message_type]
    given = _DEFAULTS.get(message_type, {})
    members = [
        (name, Any, dataclasses.field(default_factory=functools.partial(_first, given.get(name), kind)))
        for name, kind in fields
    ]
    return dataclasses.make_dataclass(
        message_type.rpartition("/")[2], members, namespace={name: value for name, _, value in constants}
    )


def _first(given: Any, kind: Any) -> Any:
    """Return what a field of a new message holds; `kind` is the bag library's description of it."""
    if given is not None:
        return given
    node, inner = kind
    if node is Nodetype.NAME:
        return plain_class(inner)()
    if node is Nodetype.BASE:
        return _ZEROS.get(inner[0], 0)
    if node is Nodetype.ARRAY and inner[0][0] is Nodetype.BASE:
        return np.zeros(inner[1], dtype=inner[0][1][0])
    return []


class Serialiser:
    """Serialises messages of any installed type."""

    def __init__(self, definitions: MessageDefinitions) -> None:
        """Take definitions from `definitions`, each when it is first needed."""
        self._definitions = definitions
        self._store = get_typestore(Stores.EMPTY)

    def serialised(self, message_type: str, message: Any) -> bytes:
        """Return a message of `package/msg/Name`, anything with its attributes, as CDR, little endian.

        Raises:
            InputError: the type's definition cannot be found.

        """
        if message_type not in self._store.types:
            found = get_types_from_msg(self._definitions.find(message_type).text, message_type)
            self._store.register({name: known for name, known in found.items() if name not in self._store.types})
        return bytes(self._store.serialize_cdr(self._plain(message_type, message), message_type))

    def _plain(self, message_type: str, message: Any) -> Any:
        _, fields = self._store.fielddefs[message_type]
        values = [self._value(kind, getattr(message, name)) for name, kind in fields]
        return self._store.types[message_type](*values)

    def _value(self, kind: Any, value: Any) -> Any:
        node, inner = kind
        if node is Nodetype.NAME:
            return self._plain(inner, value)
        if node is Nodetype.BASE:
            return value[0] if isinstance(value, bytes) else value  # a `byte` is bytes in rclpy, a number in a bag
        (element, name), _ = inner
        if element is Nodetype.NAME:
            return [self._plain(name, each) for each in value]
        return list(value) if name[0] == "string" else np.asarray(value, dtype=_DTYPES.get(name[0], name[0]))


_DTYPES = {"byte": "uint8", "char": "uint8"}
"""Where NumPy has another name."""
