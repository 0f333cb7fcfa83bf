"""A live connection for the Foxglove app: a WebSocket server with a channel per topic, and the node that feeds it."""

from __future__ import annotations

import functools
import queue
import time
from typing import TYPE_CHECKING, Any

import foxglove
from foxglove.websocket import Capability, ServerListener
from rclpy.node import Node

from jammkle_common import names
from jammkle_common.bags.definitions import MessageDefinitions, Serialiser, share_folders
from jammkle_common.command.errors import InputError
from jammkle_common.messages import installed_class, transform_of
from jammkle_common.parameters import ParameterError, declare
from jammkle_common.qos import belongs, strongest
from jammkle_view.parameters import FoxgloveParameters

if TYPE_CHECKING:
    from nav_msgs.msg import Odometry
    from rclpy.executors import Executor
    from rclpy.qos import QoSProfile
    from rclpy.subscription import Subscription

    from jammkle_common.bags.definitions import MessageDefinition
    from jammkle_common.runner import StopFlag

_ENCODING = "cdr"
_DEFINED_AS = "ros2msg"


class ForwardingServer(ServerListener):
    """Offers topics to the app, and says which of them somebody looks at, as a thread of the library's tells it."""

    def __init__(self, host: str, port: int, name: str) -> None:
        """Listen on a TCP port, under a name that the app shows.

        Raises:
            InputError: the port is taken.

        """
        self._channels: dict[str, Any] = {}
        self._lookers: dict[str, set[int]] = {}
        self._requested: queue.SimpleQueue[tuple[str, bool]] = queue.SimpleQueue()
        self._context = foxglove.Context()
        try:
            self._server = foxglove.start_server(
                name=name,
                host=host,
                port=port,
                capabilities=[Capability.Time],
                server_listener=self,
                context=self._context,
            )
        except (OSError, RuntimeError) as error:
            msg = f"the connection for Foxglove cannot listen on {host} port {port}: {error}; choose another port"
            raise InputError(msg) from error
        self.address = f"ws://{'localhost' if host.startswith('127.') else host}:{self._server.port}"
        """What to type into the app on this machine."""

    def offer(self, topic: str, message_type: str, definition: MessageDefinition) -> None:
        """Offer a topic, by its full name, of a type `package/msg/Name`; once is enough."""
        if topic not in self._channels:
            schema = foxglove.Schema(name=message_type, encoding=_DEFINED_AS, data=definition.text.encode())
            self._channels[topic] = foxglove.Channel(
                topic, schema=schema, message_encoding=_ENCODING, context=self._context
            )

    def forward(self, topic: str, data: bytes, time_ns: int) -> None:
        """Send a serialised message to all who look at its topic."""
        self._channels[topic].log(data, log_time=time_ns)

    def send_time(self, time_ns: int) -> None:
        """Send the app the time of the graph."""
        self._server.broadcast_time(time_ns)

    def wanted(self) -> list[tuple[str, bool]]:
        """Return the topics at which somebody has begun to look since the last call, or the last one has ceased to."""
        found = []
        while not self._requested.empty():
            found.append(self._requested.get())
        return found

    def stop(self) -> None:
        """Stop listening."""
        self._server.stop()

    def on_subscribe(self, client: Any, channel: Any) -> None:
        """Note that somebody has begun to look; every one who does must get what is latched."""
        self._lookers.setdefault(channel.topic, set()).add(client.id)
        self._requested.put((channel.topic, True))

    def on_unsubscribe(self, client: Any, channel: Any) -> None:
        """Note that somebody looks no longer."""
        lookers = self._lookers.get(channel.topic, set())
        lookers.discard(client.id)
        if not lookers:
            self._requested.put((channel.topic, False))


TRANSFORM_SUFFIX = "/tf"
"""Behind the name of an odometry: its pose as a transform. The app draws a robot by transforms alone, and `/tf` is only
there where somebody publishes it."""

_LOOK_PERIOD_S = 0.2
"""How often it is looked for new topics, and the time is sent; discovery takes about as long."""
_SPIN_S = 0.02
_QUEUE_DEPTH = 100


class FoxgloveNode(Node):
    """Forwards the topics of its namespace. `drive` drives it."""

    def __init__(self) -> None:
        """Make the node and listen.

        Raises:
            ParameterError: an unknown parameter, a value out of range, or a port that is taken.

        """
        super().__init__(names.FOXGLOVE_NODE, automatically_declare_parameters_from_overrides=True)
        values = declare(self, FoxgloveParameters)
        try:
            self._server = ForwardingServer(values.host, values.port, f"Jammkle {self.get_namespace()}")
        except InputError as error:
            raise ParameterError(str(error)) from error
        self._definitions = MessageDefinitions(share_folders())
        self._serialiser = Serialiser(self._definitions)
        self._types: dict[str, str] = {}
        self._forwarded: dict[str, tuple[QoSProfile, Subscription]] = {}
        self.get_logger().info(f"Foxglove: {self._server.address}")

    def drive(self, executor: Executor, stop: StopFlag) -> None:
        """Run until asked to stop."""
        next_look_s = time.monotonic()
        while not stop:
            executor.spin_once(timeout_sec=_SPIN_S)
            self._follow_requests()
            if time.monotonic() >= next_look_s:
                next_look_s = time.monotonic() + _LOOK_PERIOD_S
                self._offer_new()
                self._follow_publishers()
                self._server.send_time(self._now_ns())

    def shut_down(self) -> None:
        """Stop listening."""
        self._server.stop()

    def _now_ns(self) -> int:
        return int(self.get_clock().now().nanoseconds)

    def _offer_new(self) -> None:
        for name, types in self.get_topic_names_and_types():
            if name in self._types or not belongs(self.get_namespace(), name) or not self.count_publishers(name):
                continue
            self._types[name] = types[0]
            self._offer(name, types[0])
            if types[0] == names.ODOMETRY.message_type:
                self._offer(f"{name}{TRANSFORM_SUFFIX}", names.TF.message_type)

    def _offer(self, name: str, message_type: str) -> None:
        try:
            self._server.offer(name, message_type, self._definitions.find(message_type))
        except InputError as error:
            self.get_logger().warning(f"{name} is not forwarded: {error}")

    def _follow_requests(self) -> None:
        """Subscribe where somebody looks; anew for each who comes, so that he gets what is latched."""
        for topic, begins in self._server.wanted():
            if topic in self._forwarded:
                self.destroy_subscription(self._forwarded.pop(topic)[1])
            if begins:
                self._subscribe(topic)

    def _follow_publishers(self) -> None:
        """Subscribe anew where publishers have come or gone, so that what is asked for is what all of them offer."""
        for name, (qos, subscription) in list(self._forwarded.items()):
            source = self._source(name)
            if self.count_publishers(source) and self._qos(source) != qos:
                self.destroy_subscription(subscription)
                self._subscribe(name)

    def _source(self, name: str) -> str:
        return name if name in self._types else name.removesuffix(TRANSFORM_SUFFIX)

    def _qos(self, source: str) -> QoSProfile:
        return strongest([each.qos_profile for each in self.get_publishers_info_by_topic(source)], _QUEUE_DEPTH)

    def _subscribe(self, name: str) -> None:
        source = self._source(name)
        take = functools.partial(self._take if source == name else self._take_pose, name)
        qos = self._qos(source)
        try:
            kind = installed_class(self._types[source])
        except InputError as error:
            self.get_logger().warning(f"{name} is not forwarded: {error}")
            return
        self._forwarded[name] = qos, self.create_subscription(kind, source, take, qos, raw=source == name)

    def _take(self, name: str, data: bytes) -> None:
        self._server.forward(name, data, self._now_ns())

    def _take_pose(self, name: str, odometry: Odometry) -> None:
        data = self._serialiser.serialised(names.TF.message_type, transform_of(odometry))
        self._server.forward(name, data, self._now_ns())
