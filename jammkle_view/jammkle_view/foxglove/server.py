"""The WebSocket server of foxglove-sdk, with a channel for each topic. Knows no ROS."""

from __future__ import annotations

import queue
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import foxglove
from foxglove.websocket import Capability, ServerListener

from jammkle_common.command.errors import InputError

if TYPE_CHECKING:
    from jammkle_common.bags.definitions import MessageDefinition

_ENCODING = "cdr"
_DEFINED_AS = "ros2msg"


@dataclass(frozen=True)
class Wanted:
    """Somebody has begun to look at a topic, or the last one has ceased to."""

    topic: str
    begins: bool


class ForwardingServer:
    """Offers topics to the app, and says which of them somebody looks at."""

    def __init__(self, host: str, port: int, name: str) -> None:
        """Listen.

        Args:
            host: Address.
            port: TCP port.
            name: What the app shows.

        Raises:
            InputError: the port is taken.

        """
        self._channels: dict[str, Any] = {}
        self._lookers: dict[str, set[int]] = {}
        self._wishes: queue.SimpleQueue[Wanted] = queue.SimpleQueue()
        self._context = foxglove.Context()
        try:
            self._server = foxglove.start_server(
                name=name,
                host=host,
                port=port,
                capabilities=[Capability.Time],
                server_listener=_Listener(self),
                context=self._context,
            )
        except (OSError, RuntimeError) as error:
            msg = f"the connection for Foxglove cannot listen on {host} port {port}: {error}; choose another port"
            raise InputError(msg) from error
        self.address = f"ws://{'localhost' if host.startswith('127.') else host}:{self._server.port}"
        """What to type into the app on this machine."""

    def offer(self, topic: str, message_type: str, definition: MessageDefinition) -> None:
        """Offer a topic; once is enough.

        Args:
            topic: Full name.
            message_type: `package/msg/Name`.
            definition: Of the type.

        """
        if topic not in self._channels:
            schema = foxglove.Schema(name=message_type, encoding=_DEFINED_AS, data=definition.text.encode())
            self._channels[topic] = foxglove.Channel(
                topic, schema=schema, message_encoding=_ENCODING, context=self._context
            )

    def forward(self, topic: str, data: bytes, time_ns: int) -> None:
        """Send a serialised message to all who look at its topic."""
        self._channels[topic].log(data, log_time=time_ns)

    def tell_time(self, time_ns: int) -> None:
        """Tell the app what time it is on the graph."""
        self._server.broadcast_time(time_ns)

    def wanted(self) -> list[Wanted]:
        """Return what has changed since the last call."""
        found = []
        while not self._wishes.empty():
            found.append(self._wishes.get())
        return found

    def stop(self) -> None:
        """Stop listening."""
        self._server.stop()

    def looked_at(self, topic: str, client: int) -> None:
        """Note that somebody has begun to look; every one who does must get what is latched."""
        self._lookers.setdefault(topic, set()).add(client)
        self._wishes.put(Wanted(topic, begins=True))

    def left(self, topic: str, client: int) -> None:
        """Note that somebody looks no longer."""
        lookers = self._lookers.get(topic, set())
        lookers.discard(client)
        if not lookers:
            self._wishes.put(Wanted(topic, begins=False))


class _Listener(ServerListener):
    """Hears of the app's subscriptions, in a thread of the server's."""

    def __init__(self, server: ForwardingServer) -> None:
        self._server = server

    def on_subscribe(self, client: Any, channel: Any) -> None:
        self._server.looked_at(channel.topic, client.id)

    def on_unsubscribe(self, client: Any, channel: Any) -> None:
        self._server.left(channel.topic, client.id)
