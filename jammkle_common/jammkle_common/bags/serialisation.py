"""Messages to CDR, as the middleware puts them on the wire.

The middleware's own function for this leaves spare bytes behind some messages, and whatever was in memory between the
fields: readers refuse such messages, and the same run would not give the same bytes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

if TYPE_CHECKING:
    from jammkle_common.bags.definitions import MessageDefinitions


class Serialiser:
    """Serialises messages of any installed type."""

    def __init__(self, definitions: MessageDefinitions) -> None:
        """Take definitions from `definitions`, each when it is first needed."""
        self._definitions = definitions
        self._store = get_typestore(Stores.EMPTY)

    def serialised(self, message_type: str, message: Any) -> bytes:
        """Return a message as CDR, little endian.

        Args:
            message_type: `package/msg/Name`.
            message: Anything with the attributes that the type names.

        Raises:
            InputError: the type's definition cannot be found.

        """
        if message_type not in self._store.types:
            found = get_types_from_msg(self._definitions.find(message_type).text, message_type)
            self._store.register({name: known for name, known in found.items() if name not in self._store.types})
        return bytes(self._store.serialize_cdr(self._plain(message_type, message), message_type))

    def _plain(self, message_type: str, message: Any) -> Any:
        """Return a message in the classes of the bag library."""
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
