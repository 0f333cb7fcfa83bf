"""Lockstep on the graph: who answers the ticks of this simulation, and its answers to another that makes /clock.

A simulation that makes /clock waits for its participants. One that lives in the /clock of another simulation goes as
far as that has ticked, and answers it when it is there and its own participants are done: it is a participant itself.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from rclpy.serialization import deserialize_message
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Header

from jammkle_common import wire
from jammkle_common.constants import NANOSECONDS_PER_SECOND
from jammkle_common.names import CLOCK, LOCKSTEP, below, resolved
from jammkle_common.qos import answer_qos, node_at, subscriber_qos
from jammkle_sim.core.lockstep import Lockstep

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from rclpy.node import Node
    from rclpy.publisher import Publisher

    from jammkle_common.messages import Health
    from jammkle_sim.parameters import RunParameters

_STOPPED_AFTER_S = 10.0
"""Real time without an answer, s, after which who is gone from the graph has not left in order: a process that a
debugger or SIGSTOP stops is forgotten there once its lease ends (20 s in Fast DDS). It is to be waited for."""
_LEFT_AFTER_S = 0.3
"""Real time, s, for which an answer is missing before it is looked whether its sender has left the graph."""


class Participants:
    """The simulation's end of the topic `lockstep`."""

    def __init__(
        self, node: Node, ankles: Iterable[str], parameters: RunParameters, on_change: Callable[[], None]
    ) -> None:
        """Listen on `node`.

        Args:
            node: The sim node.
            ankles: Namespaces of its ankles below its own; those in them take part, as those in its own do.
            parameters: Whether it waits for others, for how long, and whether /clock is its own.
            on_change: Called when somebody falls out of step, or is back.

        """
        self._node = node
        self._on_change = on_change
        self._account = Lockstep(parameters.lockstep_timeout_s, time.monotonic)
        self._topics = [resolved(node.get_namespace(), below(within, LOCKSTEP)) for within in {"", *ankles}]
        self._looked_s = 0.0
        self._reported = 0
        self._other: Publisher | None = None
        self._other_tick_ns: int | None = None
        self._answered_ns: int | None = None
        self._waits = parameters.lockstep
        self._writer = wire.HeaderWriter(node.get_fully_qualified_name())
        if not parameters.lockstep:
            return
        for topic in self._topics:
            node.create_subscription(Header, topic, self._take_answer, subscriber_qos(LOCKSTEP), raw=True)
        if not parameters.publish_clock:
            node.create_subscription(Clock, CLOCK.name, self._take_tick, subscriber_qos(CLOCK))

    @property
    def any(self) -> bool:
        """Whether anybody is waited for."""
        return self._waits and bool(self._account.participants)

    @property
    def limit_ns(self) -> int | None:
        """How far another simulation's clock has ticked, ns; None: no other one's has."""
        return self._other_tick_ns

    def set_timeout(self, timeout_s: float) -> None:
        """Wait for silent participants so long from now on, s of real time; 0: for ever."""
        self._account.timeout_s = timeout_s

    def sent(self, tick_ns: int) -> None:
        """Note that a tick of this simulation's own clock was published, with its stamp, ns."""
        if self._waits:
            self._account.sent(tick_ns)

    def ready(self) -> bool:
        """Return whether the next step may be taken."""
        if not self._waits:
            return True
        ready = self._account.ready()
        if not ready:
            self._look_who_left()
        if self._account.changes != self._reported:
            self._reported = self._account.changes
            self._on_change()
        return ready

    def to_repeat(self) -> bool:
        """Return whether the latest tick is to be published again, as an answer is missing."""
        return self._waits and self._account.to_repeat()

    def arrived(self, next_output_ns: float) -> None:
        """Answer the simulation that makes /clock, once this one is as far as it may go and all of its own are done.

        Args:
            next_output_ns: Simulated time of its next output, ns; infinite where it stands still and waits for nobody.

        """
        tick_ns = self._other_tick_ns
        if tick_ns is None or tick_ns == self._answered_ns or next_output_ns <= tick_ns or not self.ready():
            return
        if self._other is None:
            makers = [node_at(end) for end in self._node.get_publishers_info_by_topic(CLOCK.name)]
            if not makers or not makers[0]:
                return
            topic = resolved(makers[0].rpartition("/")[0], LOCKSTEP.name)
            self._other = self._node.create_publisher(Header, topic, answer_qos())
        self._other.publish(self._writer.write(tick_ns))
        self._answered_ns = tick_ns

    def health(self) -> Health:
        """Return one line on who is in step."""
        return self._account.health()

    def _take_answer(self, serialized: bytes) -> None:
        answer = wire.read_header(serialized)
        if answer is None:
            header = deserialize_message(serialized, Header)
            answer = header.stamp.sec * NANOSECONDS_PER_SECOND + header.stamp.nanosec, header.frame_id
        stamp_ns, name = answer
        if name:
            self._account.answered(name, stamp_ns)

    def _take_tick(self, message: Clock) -> None:
        tick_ns = message.clock.sec * NANOSECONDS_PER_SECOND + message.clock.nanosec
        if tick_ns == self._other_tick_ns:
            self._answered_ns = None  # it asks again
        self._other_tick_ns = tick_ns
        self._account.sent(tick_ns)

    def _look_who_left(self) -> None:
        """Forget those that have left the graph in order; one that was killed is seen on it for a while."""
        now_s = time.monotonic()
        if self._account.waited_s < _LEFT_AFTER_S or now_s - self._looked_s < _LEFT_AFTER_S:
            return
        if self._account.timeout_s == 0.0 and self._account.waited_s > _STOPPED_AFTER_S:
            return
        self._looked_s = now_s
        there = {node_at(end) for topic in self._topics for end in self._node.get_publishers_info_by_topic(topic)}
        for name in self._account.missing:
            if name not in there and "" not in there:
                self._account.forget(name)
