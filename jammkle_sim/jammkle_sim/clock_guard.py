"""One /clock on a graph: a simulation that finds another one's when it starts gives way, with one line.

`jammkle up` lets a second simulation join the clock of the first; this is for those that are started by hand, by other
users or on other machines, and for those that are started together.
"""

from __future__ import annotations

import time
import uuid
from typing import TYPE_CHECKING

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rosgraph_msgs.msg import Clock as ClockMessage

from jammkle_common.names import CLOCK
from jammkle_common.namespace import resolved
from jammkle_common.qos import subscriber_qos

if TYPE_CHECKING:
    from rclpy.executors import Executor
    from rclpy.node import Node
    from rclpy.topic_endpoint_info import TopicEndpointInfo

LOOK_S = 0.5
"""How long a simulation looks for another clock before it makes its own. Assumed; one is seen in 0.15 s as a rule."""
_YOUNG_S = 5.0
"""Age up to which it still gives way, s of the machine's steady clock: at times others are seen only with their next
announcement, which the DDS of ROS 2 (Fast DDS) sends every 3 s. Later it is the other that came later."""
_PARTICIPANT = slice(12)
"""Bytes of an endpoint's identity that all endpoints of one process share (DDSI-RTPS 2.5, 9.3.1: the GUID's prefix)."""
_PERIOD_S = 0.25
_PATIENCE_S = 4.0 * LOOK_S
"""How long another is left to give way by itself: whoever hears a tick in its first look does."""


class ClockClashError(RuntimeError):
    """Another simulation makes the graph's clock. The message says which, and what to do."""


class ClockGuard:
    """Looks for other publishers of /clock while the node is young.

    It listens to /clock only before the node makes its own: with a reader and a writer of one topic in one process,
    each in a thread of its own, Fast DDS can hang.
    """

    def __init__(self, node: Node, *, is_ours: bool) -> None:
        """Start to look, if the clock is to be ours; its publisher must be there already.

        Args:
            node: The sim node.
            is_ours: Whether the node makes the clock.

        """
        self._node = node
        self._is_ours = is_ours
        self._born_s = time.monotonic()
        self._seen_s: float | None = None
        self._clash = ""
        self._own = _participant(node)
        if is_ours:
            steady = Clock(clock_type=ClockType.STEADY_TIME)
            self._timer = node.create_timer(_PERIOD_S, self._look, clock=steady)

    def look_first(self, executor: Executor) -> None:
        """Look for a while before any time has passed: a tick is another's, and one that ticks came first.

        Raises:
            ClockClashError: as `check`.

        """
        if not self._is_ours:
            return
        ticks: list[ClockMessage] = []
        listening = self._node.create_subscription(ClockMessage, CLOCK.name, ticks.append, subscriber_qos(CLOCK))
        end_s = time.monotonic() + LOOK_S
        while (left_s := end_s - time.monotonic()) > 0:
            executor.spin_once(timeout_sec=left_s)
        self._node.destroy_subscription(listening)
        self._judge(is_older=bool(ticks))
        self.check()

    def check(self) -> None:
        """Refuse to go on beside another clock.

        Raises:
            ClockClashError: another simulation makes it, and this one came later.

        """
        if self._clash:
            raise ClockClashError(self._clash)

    def _look(self) -> None:
        now_s = time.monotonic()
        if not self._others():
            self._seen_s = None
        elif self._seen_s is None:
            self._seen_s = now_s
        elif now_s - self._seen_s > _PATIENCE_S:
            self._judge(is_older=False)
        if self._seen_s is None and now_s - self._born_s > _YOUNG_S:
            self._timer.cancel()

    def _judge(self, *, is_older: bool) -> None:
        """Give way to another that is older, as is known, or as its process tells."""
        for other in self._others():
            if is_older or _age_key(_identity(other)) < _age_key(self._own):
                name = resolved(other.node_namespace, other.node_name)
                self._clash = (
                    f"{CLOCK.name} is made by another simulation, {name}: stop that one, choose another "
                    "ROS_DOMAIN_ID, or give this one publish_clock:=false to live in its time"
                )

    def _others(self) -> list[TopicEndpointInfo]:
        ends = self._node.get_publishers_info_by_topic(CLOCK.name)
        return [end for end in ends if _identity(end) != self._own]


def _participant(node: Node) -> bytes:
    """Return what the identities of all endpoints of a node's process begin with; rclpy tells it of no publisher."""
    publisher = node.create_publisher(ClockMessage, f"~/of_{uuid.uuid4().hex}", 1)
    [end] = node.get_publishers_info_by_topic(publisher.topic_name)
    node.destroy_publisher(publisher)
    return _identity(end)


def _identity(end: TopicEndpointInfo) -> bytes:
    return bytes(end.endpoint_gid)[_PARTICIPANT]


def _age_key(identity: bytes) -> tuple[bytes, int, bytes]:
    """Return what orders identities, on one machine by the number of the process: the older has the smaller, as a rule.

    Fast DDS begins them with its vendor and the machine, two bytes each, and two of the process, the lower first.
    """
    return identity[:4], int.from_bytes(identity[4:6], "little"), identity[6:]
