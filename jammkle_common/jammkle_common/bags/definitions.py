"""Message definitions to embed in a bag, so that it opens anywhere: text as written, with comments, and type hash."""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore

from jammkle_common.command.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Sequence

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
            pending += sorted(_types_inside(name, text))
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


def _types_inside(name: str, text: str) -> set[str]:
    """Return the names of the message types that the fields of one definition have."""
    _, fields = get_types_from_msg(text, name)[name]
    return {inner for _, field in fields for inner in _names_in(field)}


def _names_in(field: object) -> set[str]:
    """Return message names in a field description of the bag library: nested `(kind, argument)` pairs."""
    names: set[str] = set()
    if isinstance(field, tuple):
        for part in field:
            if isinstance(part, str) and part.count("/") == _PARTS - 1:
                names.add(part)
            else:
                names |= _names_in(part)
    return names
