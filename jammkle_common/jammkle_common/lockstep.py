"""The time that a node lives in, and how it keeps in step with a simulation that makes that time.

On hardware a node lives on the machine's steady clock. With `use_sim_time` it lives in simulated time: every time-out,
watchdog and regular piece of work of it counts /clock, so that nothing depends on how fast or how busy the machine is.

A simulation that waits for its nodes (lockstep, as PX4 and ArduPilot have it in software in the loop) publishes the
state of a step, then /clock, and takes its next step once every node that it knows has answered with that stamp on
`lockstep`. A node of ours deals with what came for a stamp when its tick comes, in a fixed order: first what other
nodes sent in an earlier step, then what the simulation sent, then regular work that is due; then it answers. What it
publishes meanwhile has arrived before the next step begins. So the same inputs lead to the same outputs at the same
stamps on any machine, at any speed.
"""

from __future__ import annotations

import inspect
import time
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

from rclpy.clock import Clock as RosClock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Header

from jammkle_common import wire
from jammkle_common.constants import NANOSECONDS_PER_SECOND
from jammkle_common.names import CLOCK, DIAGNOSTICS, EMERGENCY_STOP, LOCKSTEP, TOPICS, TopicKind
from jammkle_common.qos import answer_qos

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.publisher import Publisher
    from rclpy.qos import QoSProfile
    from rclpy.subscription import Subscription

_FROM_NODES = frozenset(topic.name for topic in TOPICS if topic.kind is not TopicKind.SENSOR) - {DIAGNOSTICS.name}
"""Topics on which nodes tell each other something; sensors are the simulation's. Reports of health decide nothing."""
_AT_ONCE = frozenset((DIAGNOSTICS.name, EMERGENCY_STOP.name))
"""Topics that wait for no tick."""


class _Waiting(NamedTuple):
    topic: str
    stamp_ns: int
    deliver: Callable[[], Any]


class _Regular:
    """Work that is due at every multiple of a period, so that its phase does not depend on when a node was started."""

    def __init__(self, period_s: float, callback: Callable[[], object]) -> None:
        self._period_ns = round(period_s * NANOSECONDS_PER_SECOND)
        self._callback = callback
        self._last_ns: int | None = None

    def run(self, time_ns: int) -> None:
        """Do the work if a multiple of the period has been passed since the last call; a jump back begins anew."""
        last_ns, self._last_ns = self._last_ns, time_ns
        if last_ns is not None and time_ns // self._period_ns > last_ns // self._period_ns:
            self._callback()


class LockstepNode(Node):
    """To be named before another kind of node among the bases of one that may live in simulated time."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        """Make the node; arguments and options are those of rclpy's own, and parameters that are given are declared."""
        options.setdefault("automatically_declare_parameters_from_overrides", True)
        self._tick_ns: int | None = None
        self._tick_received_s = time.monotonic()
        self._in_step = False
        self._waiting: list[_Waiting] = []
        self._stayed, self._delivered_ns = 0, -1
        self._regular: list[_Regular] = []
        self._at_first_tick: list[Callable[[], object]] = []
        self._done: Publisher | None = None
        super().__init__(*arguments, **options)
        self._simulated = bool(self.get_clock().ros_time_is_active)
        self._steady = RosClock(clock_type=ClockType.STEADY_TIME)
        if self._simulated:
            self._done = self.create_publisher(Header, LOCKSTEP.name, answer_qos())
            self._answer = wire.Writer(self.get_fully_qualified_name(), 0)

    def live_on_steady_clock(self) -> None:
        """Let the machine's steady clock count from now on: real hardware goes on while somebody pauses /clock.

        To be called before `every`.
        """
        self._simulated = self._in_step = False
        if self._done is not None:
            self.destroy_publisher(self._done)
            self._done = None

    @property
    def lives_in_simulated_time(self) -> bool:
        """Whether /clock counts here, and not the machine's steady clock."""
        return self._simulated

    @property
    def in_step(self) -> bool:
        """Whether a simulation waits for this node."""
        return self._in_step

    @property
    def clock_silent_s(self) -> float:
        """How long /clock has not been received, s of the machine's steady clock; 0 for a node that needs none."""
        return time.monotonic() - self._tick_received_s if self._simulated else 0.0

    @property
    def knows_time(self) -> bool:
        """Whether the node's clock tells the time: with `use_sim_time` only from the first tick of /clock on."""
        return self._tick_ns is not None or not self.get_clock().ros_time_is_active

    def now_s(self) -> float:
        """Time that this node lives in, s: simulated, or of the machine's steady clock. For differences alone."""
        clock = self.get_clock() if self._simulated else self._steady
        return float(clock.now().nanoseconds) / NANOSECONDS_PER_SECOND

    def every(self, period_s: float, callback: Callable[[], object]) -> Callable[[], None]:
        """Call `callback` every period, s, > 0, by the time that this node lives in; return what ends that."""
        if not self._simulated:
            timer = self.create_timer(period_s, callback, clock=self._steady)
            return lambda: self.destroy_timer(timer)
        regular = _Regular(period_s, callback)
        self._regular.append(regular)
        return lambda: self._regular.remove(regular)

    def at_first_tick(self, callback: Callable[[], object]) -> None:
        """Call `callback` once, as soon as simulated time is known."""
        self._at_first_tick.append(callback)

    def create_subscription(
        self,
        msg_type: type,
        topic: str,
        callback: Callable[[Any], Any],
        qos_profile: QoSProfile | int,
        **options: Any,
    ) -> Subscription:
        """Subscribe as rclpy does; in step with a simulation a message waits for the tick of its step.

        /clock is read by its bytes, and its message used again: rclpy's making of two objects for each of 250 ticks a
        second was a twelfth of a driver's work.
        """
        raw = bool(options.pop("raw", False))
        if topic == CLOCK.name and not raw:
            take = self._on_clock(callback)
            return super().create_subscription(msg_type, topic, take, qos_profile, **options, raw=True)
        if topic not in _AT_ONCE:
            callback = self._at_the_tick(topic, callback)
        return super().create_subscription(msg_type, topic, callback, qos_profile, **options, raw=raw)

    def _on_clock(self, callback: Callable[[Any], Any]) -> Callable[[bytes], None]:
        message = Clock()

        def take(serialized: bytes) -> None:
            stamp = wire.read_clock(serialized)
            if stamp is None:
                ticked = deserialize_message(serialized, Clock).clock
                stamp = (ticked.sec, ticked.nanosec)
            message.clock.sec, message.clock.nanosec = stamp
            callback(message)
            self._take_tick(stamp[0] * NANOSECONDS_PER_SECOND + stamp[1])

        return take

    def _at_the_tick(self, topic: str, callback: Callable[..., Any]) -> Callable[..., None]:
        from_nodes = topic in _FROM_NODES

        def take(*received: Any) -> None:
            if self._in_step:
                # the EventsExecutor of rclpy 7.1.6 passes a message and what is said of it as one
                message = received[0][0] if isinstance(received[0], tuple) else received[0]
                stamp_ns = _stamp_ns(message) if from_nodes else -1
                self._waiting.append(_Waiting(topic if from_nodes else "", stamp_ns, partial(callback, *received)))
            else:
                callback(*received)

        take.__signature__ = inspect.signature(callback)  # type: ignore[attr-defined] - rclpy counts the arguments
        return take

    def _take_tick(self, time_ns: int) -> None:
        self._tick_ns = time_ns
        self._tick_received_s = time.monotonic()
        first, self._at_first_tick = self._at_first_tick, []
        for callback in first:
            callback()
        self._deliver(time_ns)
        for regular in tuple(self._regular):
            regular.run(time_ns)
        if self._done is None:  # rclpy is not through with making this node
            return
        self._in_step = self._done.get_subscription_count() > 0
        if self._in_step:
            self._done.publish(self._answer.write(time_ns))

    def _deliver(self, time_ns: int) -> None:
        """Deal with what waits, apart from what another node has sent in this very step: it may come, or not yet."""
        stayed, self._stayed = (self._stayed if time_ns == self._delivered_ns else 0), 0
        self._delivered_ns = time_ns
        if not self._waiting:
            return
        waiting, self._waiting = self._waiting, []
        # A tick that is repeated is no step: what has waited for it since the one before has come.
        early = [each for k, each in enumerate(waiting) if each.topic and (each.stamp_ns != time_ns or k < stayed)]
        early.sort(key=lambda each: (each.stamp_ns, each.topic))
        for each in (*early, *(each for each in waiting if not each.topic)):
            each.deliver()
        kept = [each for k, each in enumerate(waiting) if each.topic and each.stamp_ns == time_ns and k >= stayed]
        self._waiting[:0] = kept
        self._stayed = len(kept)


def _stamp_ns(message: Any) -> int:
    """Return the stamp of a message's header, ns; -1 of one that has none."""
    header = getattr(message, "header", None)
    if header is None:
        return -1
    return int(header.stamp.sec) * NANOSECONDS_PER_SECOND + int(header.stamp.nanosec)
