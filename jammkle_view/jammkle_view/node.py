"""The viewer's node: shows the graph of its namespace on a page, and hands on what is clicked there."""

from __future__ import annotations

import queue
import time
from typing import TYPE_CHECKING

from rclpy.node import Node

from jammkle_common import names
from jammkle_common.command.errors import InputError
from jammkle_common.names import normalised
from jammkle_common.parameters import ParameterError, declare
from jammkle_view.core.ankle import Ankle, RealTimeFactor
from jammkle_view.graph import AnkleSubscriptions, Requests
from jammkle_view.page.live import LivePage
from jammkle_view.page.server import address_of, is_watched, serve
from jammkle_view.parameters import ViewerParameters

if TYPE_CHECKING:
    from rclpy.executors import Executor

    from jammkle_common.runner import StopFlag
    from jammkle_view.core.samples import Request

_WATCHER = f"_{names.VIEWER_NODE}_samples"
"""Node that nobody spins; ROS hides names with an underscore in front."""


class ViewerNode(Node):
    """Shows the ankles of its namespace. `drive` drives it: frame by frame, callbacks in between."""

    def __init__(self) -> None:
        """Make the node and open the page.

        Raises:
            ParameterError: an unknown parameter, a value out of range, or a port that is taken.

        """
        super().__init__(names.VIEWER_NODE, automatically_declare_parameters_from_overrides=True)
        values = declare(self, ViewerParameters)
        self._frame_s = 1.0 / values.frame_rate_hz
        self._known = {name: Ankle() for name in _ankles(values.ankles)}
        self._factor = RealTimeFactor()
        self._requested: queue.SimpleQueue[Request] = queue.SimpleQueue()
        try:
            self._server = serve(values.host, values.port, "Jammkle")
        except InputError as error:
            raise ParameterError(str(error)) from error
        self._page = LivePage(self._server, tuple(self._known), self._requested.put)
        self._requests = Requests(self, lambda text, good: self._page.answer(text, good=good), self._page.show_speed)
        self._watcher = Node(
            _WATCHER, namespace=self.get_namespace(), enable_rosout=False, start_parameter_services=False
        )
        self._inputs = {
            name: AnkleSubscriptions(self, self._watcher, name, ankle, with_base=place == 0)
            for place, (name, ankle) in enumerate(self._known.items())
        }
        self.get_logger().info(f"page: {address_of(self._server)}")

    def drive(self, executor: Executor, stop: StopFlag) -> None:
        """Run until asked to stop."""
        due_s = time.monotonic()
        while not stop:
            left_s = due_s - time.monotonic()
            if left_s > 0.0:
                executor.spin_once(timeout_sec=left_s)
                continue
            executor.spin_once(timeout_sec=0.0)
            self._frame()
            due_s = max(due_s + self._frame_s, time.monotonic())

    def shut_down(self) -> None:
        """Close the page."""
        self._server.stop()

    def destroy_node(self) -> None:
        """Leave the graph."""
        self._watcher.destroy_node()
        super().destroy_node()

    def _frame(self) -> None:
        """Look at what is new, do what was clicked, and show it where somebody looks."""
        now_s = time.monotonic()
        for name, subscriptions in self._inputs.items():
            subscriptions.plot(wanted=name == self._page.chosen)
            subscriptions.look()
        while not self._requested.empty():
            self._requests.carry_out(self._requested.get())
        self._requests.go_on()
        self._factor.note(next(iter(self._known.values())).time_s, now_s)
        if is_watched(self._server):
            self._page.show(self._known, self._factor.value(), now_s)


def _ankles(given: str) -> tuple[str, ...]:
    """Return relative namespaces from a text that parts them by commas; the viewer's own is the empty one.

    Raises:
        ParameterError: one of them is no ROS name.

    """
    try:
        return tuple(normalised(each).lstrip("/") for each in given.split(","))
    except InputError as error:
        msg = f"parameter 'ankles': {error}"
        raise ParameterError(msg) from error
