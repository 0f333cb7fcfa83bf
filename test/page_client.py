"""What a browser would receive and say: a client of the page that draws nothing, by the protocol of viser itself."""

from __future__ import annotations

import re
import time
from typing import TYPE_CHECKING, Any

import msgspec
import viser
import zstandard
from viser._messages import GuiUpdateMessage, Message, ViewerCameraMessage
from websockets.sync.client import connect
from websockets.typing import Subprotocol

if TYPE_CHECKING:
    from collections.abc import Callable

    from typing_extensions import Self

_HEADER_BYTES = 16
"""Of every frame; its second half is the length of the compressed messages, little endian. Read off viser 1."""
_CAMERA = ViewerCameraMessage(
    (1.0, 0.0, 0.0, 0.0), (1.0, 1.0, 1.0), 1.0, 0.01, 100.0, 800, 1200, (0.0, 0.0, 0.0), (0.0, 0.0, 1.0)
)
TIMEOUT_S = 60.0


class PageClient:
    """One who watches the page: knows its fields, its texts and where the bodies are, and can change a field."""

    def __init__(self, address: str) -> None:
        """Prepare.

        Args:
            address: As `jammkle` prints it: `http://localhost:PORT`.

        """
        self._address = "ws://127.0.0.1:" + re.findall(r":(\d+)", address)[0]
        self.fields: dict[str, dict[str, Any]] = {}
        """What stands in the panels, by its identifier: `type`, `value` where it has one, and its properties."""
        self.positions_m: dict[str, tuple[float, ...]] = {}
        """Where the nodes of the scene are, by path."""
        self.visible: dict[str, bool] = {}
        """Whether they were put into sight or out of it."""
        self.raw: bytes = b""
        """Messages of the latest frame, not decoded."""

    def __enter__(self) -> Self:
        """Connect, as somebody who looks at the page."""
        protocol = Subprotocol(f"viser-v{viser.__version__}")
        self._line = connect(self._address, subprotocols=[protocol], max_size=None)
        self.say(_CAMERA)
        return self

    def __exit__(self, *_error: object) -> None:
        """Close the line."""
        self._line.close()

    def say(self, message: Message) -> None:
        """Send a message."""
        self._line.send(msgspec.msgpack.encode(message.as_serializable_dict()))

    def receive(self, timeout_s: float) -> bool:
        """Take one frame without a look into it; return whether one came in time."""
        try:
            frame = self._line.recv(timeout=max(timeout_s, 0.0))
        except TimeoutError:
            return False
        assert isinstance(frame, bytes)
        size = int.from_bytes(frame[_HEADER_BYTES // 2 : _HEADER_BYTES], "little")
        self.raw = zstandard.ZstdDecompressor().decompress(frame[_HEADER_BYTES : _HEADER_BYTES + size])
        return True

    def take(self, timeout_s: float) -> None:
        """Take one frame and remember what it says."""
        if self.receive(timeout_s):
            for message in msgspec.msgpack.decode(self.raw)["messages"]:
                self._note(message)

    def wait_until(self, holds: Callable[[], bool], what: str, meanwhile: Callable[[], object] = lambda: None) -> None:
        """Take frames until something holds.

        Args:
            holds: Asked after every frame.
            what: For the message, if it never does.
            meanwhile: Called after every frame, too: one more who listens.

        """
        end_s = time.monotonic() + TIMEOUT_S
        while not holds():
            assert time.monotonic() < end_s, f"gave up waiting until {what}; the page says: {self.text()}"
            self.take(0.05)
            meanwhile()

    def text(self) -> str:
        """Return all texts of the panels."""
        return "\n".join(str(field["content"]) for field in self.fields.values() if "content" in field)

    def labels(self) -> list[str]:
        """Return the labels of the fields, as often as they occur."""
        return [str(field["label"]) for field in self.fields.values() if "label" in field]

    def value(self, label: str) -> Any:
        """Return what the field of a label is at."""
        return self.fields[self._field(label)]["value"]

    def change(self, label: str, value: object, place: int = 0) -> None:
        """Put a field to a value, or press that button of a group; `place` counts fields of one label."""
        identifier = self._field(label, place)
        self.fields[identifier]["value"] = value
        self.say(GuiUpdateMessage(identifier, {"value": value}))

    def _field(self, label: str, place: int = 0) -> str:
        found = [identifier for identifier, field in self.fields.items() if field.get("label") == label]
        assert len(found) > place, f"no field '{label}' (number {place}) among {self.labels()}"
        return found[place]

    def _note(self, message: dict[str, Any]) -> None:
        kind = message["type"]
        if kind == "SetPositionMessage":
            self.positions_m[message["name"]] = tuple(message["position"])
        elif kind == "SetSceneNodeVisibilityMessage":
            self.visible[message["name"]] = bool(message["visible"])
        elif kind == "GuiUpdateMessage":
            self.fields.setdefault(message["uuid"], {}).update(message["updates"])
        elif kind == "GuiRemoveMessage":
            self.fields.pop(message["uuid"], None)
        elif kind.startswith("Gui") and "props" in message:
            held = {"type": kind, **message["props"]}
            if "value" in message:
                held["value"] = message["value"]
            self.fields[message["uuid"]] = held
