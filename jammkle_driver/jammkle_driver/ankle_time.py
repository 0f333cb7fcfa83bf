"""The time that the driver goes by: the steady clock, and of a simulated ankle the graph's, if somebody keeps that."""

from __future__ import annotations

import time
from functools import partial
from typing import TYPE_CHECKING

from rosgraph_msgs.msg import Clock

from jammkle_driver.conversions import seconds
from jammkle_driver.core.watchdog import Instant
from jammkle_graph.names import CLOCK
from jammkle_graph.qos import subscriber_qos

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.node import Node

CLOCK_TIMEOUT_S = 1.5
"""Silence of /clock after which its maker is gone, s: a paused simulation repeats it every 0.5 s."""


class AnkleTime:
    """Both clocks at one moment."""

    def __init__(self, node: Node) -> None:
        """Look at the clocks of `node`, as if /clock had never been heard."""
        self._node = node
        self._heard_s = 0.0

    def listen(self) -> Callable[[], object]:
        """Hear /clock from now on, and return what ends that."""
        subscription = self._node.create_subscription(Clock, CLOCK.name, self._hear, subscriber_qos(CLOCK), raw=True)
        return partial(self._node.destroy_subscription, subscription)

    def now(self, *, simulated: bool) -> Instant:
        """Return both clocks now; a real ankle does not stand still while somebody pauses the graph's clock."""
        steady_s = time.monotonic()
        if not simulated:
            return Instant(steady_s, steady_s)
        clock = self._node.get_clock()
        runs = not clock.ros_time_is_active or steady_s - self._heard_s < CLOCK_TIMEOUT_S
        return Instant(steady_s, seconds(clock.now()), runs)

    def _hear(self, _serialized: bytes) -> None:
        self._heard_s = time.monotonic()
