"""The node behind the connection: subscribes to what somebody looks at in the app, and to nothing else."""

from __future__ import annotations

import functools
import time
from typing import TYPE_CHECKING

from rclpy.node import Node

from jammkle_common import names
from jammkle_common.bags.definitions import MessageDefinitions, Serialiser, share_folders
from jammkle_common.command.errors import InputError
from jammkle_common.messages import message_class, transform_of
from jammkle_common.parameters import ParameterError, declare
from jammkle_common.qos import belongs, strongest
from jammkle_view.foxglove.parameters import FoxgloveParameters
from jammkle_view.foxglove.server import ForwardingServer

if TYPE_CHECKING:
    from nav_msgs.msg import Odometry
    from rclpy.executors import Executor
    from rclpy.subscription import Subscription

    from jammkle_common.runner import StopFlag

TRANSFORM_SUFFIX = "/tf"
"""Behind the name of an odometry: its pose as a transform. The app draws a robot by transforms alone, and `/tf` is only
there where somebody publishes it."""

_LOOK_PERIOD_S = 0.2
"""How often it is looked for new topics, and the time is told; discovery takes about as long."""
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
        self._forwarded: dict[str, Subscription] = {}
        self.get_logger().info(f"Foxglove: {self._server.address}")

    def drive(self, executor: Executor, stop: StopFlag) -> None:
        """Run until asked to stop."""
        next_look_s = time.monotonic()
        while not stop:
            executor.spin_once(timeout_sec=_SPIN_S)
            self._follow_wishes()
            if time.monotonic() >= next_look_s:
                next_look_s = time.monotonic() + _LOOK_PERIOD_S
                self._offer_new()
                self._server.tell_time(self._now_ns())

    def shut_down(self) -> None:
        """Stop listening."""
        self._server.stop()

    def _now_ns(self) -> int:
        return int(self.get_clock().now().nanoseconds)

    def _offer_new(self) -> None:
        """Offer topics that have appeared."""
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

    def _follow_wishes(self) -> None:
        """Subscribe where somebody looks; anew for each who comes, so that he gets what is latched."""
        for wanted in self._server.wanted():
            old = self._forwarded.pop(wanted.topic, None)
            if old is not None:
                self.destroy_subscription(old)
            if wanted.begins:
                self._subscribe(wanted.topic)

    def _subscribe(self, name: str) -> None:
        source = name if name in self._types else name.removesuffix(TRANSFORM_SUFFIX)
        take = functools.partial(self._take if source == name else self._take_pose, name)
        qos = strongest([each.qos_profile for each in self.get_publishers_info_by_topic(source)], _QUEUE_DEPTH)
        try:
            kind = message_class(self._types[source])
        except InputError as error:
            self.get_logger().warning(f"{name} is not forwarded: {error}")
            return
        self._forwarded[name] = self.create_subscription(kind, source, take, qos, raw=source == name)

    def _take(self, name: str, data: bytes) -> None:
        self._server.forward(name, data, self._now_ns())

    def _take_pose(self, name: str, odometry: Odometry) -> None:
        data = self._serialiser.serialised(names.TF.message_type, transform_of(odometry))
        self._server.forward(name, data, self._now_ns())
