"""Types of the messages of a bag: from the definitions in it, else of ROS 2 Jazzy, else as they are installed."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

from jammkle_common.bags.definitions import MessageDefinitions, share_folders
from jammkle_common.command.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rosbags.typesys.store import Typestore

    from jammkle_common.bags.storage import StoredChannel

_SEPARATOR = "=" * 80 + "\n"
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

    def add(self, channel: StoredChannel) -> None:
        """Make the type of a channel known, with all that it is made of.

        Raises:
            UndecodableError: a definition is missing or broken, or another channel has another type of that name.

        """
        name = channel.message_type
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
            msg = f"the definition of its type {name} cannot be used: {_line(error)}"
            raise UndecodableError(msg) from error
        self._seen.add((name, channel.definition))

    def _defined(self, channel: StoredChannel) -> dict[str, Any]:
        """Return what the definition of a channel holds."""
        if not channel.definition.strip() and channel.message_type not in self._store.fielddefs:
            return {}
        try:
            text = channel.definition.decode()
            if channel.language in _IDL_LANGUAGES:
                return _from_idl(text)
            if text.strip():
                return dict(get_types_from_msg(text, channel.message_type))
        except Exception as error:
            msg = f"the definition of its type {channel.message_type} cannot be read: {_line(error)}"
            raise UndecodableError(msg) from error
        return {}

    def differs(self, channel: StoredChannel) -> bool:
        """Return whether a channel defines its type otherwise than ROS 2 Jazzy does, which knows it."""
        usual = self._jazzy.fielddefs.get(channel.message_type)
        try:
            own = self._defined(channel).get(channel.message_type)
        except UndecodableError:
            return False
        return usual is not None and own is not None and usual[1] != own[1]

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
            pending += _types_inside(used[each])
        return used

    def _elsewhere(self, name: str, wanted: str) -> dict[str, Any]:
        """Return a type that the bag does not define."""
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


def _types_inside(definition: Any) -> Iterator[str]:
    for _, (node, inner) in definition[1]:
        kind = (node, inner) if node in (Nodetype.BASE, Nodetype.NAME) else inner[0]
        if kind[0] is Nodetype.NAME:
            yield kind[1]


def _line(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__
