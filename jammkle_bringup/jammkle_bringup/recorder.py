"""The recorder node: everything in a namespace, and what is said of it outside, into one bag."""

from __future__ import annotations

import bisect
import contextlib
import enum
import errno
import functools
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from rclpy.time import Time as RosTime
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from std_msgs.msg import Header, String

from jammkle_common import wire
from jammkle_common.bags.definitions import MessageDefinitions, share_folders
from jammkle_common.bags.writing import FLUSH_PERIOD_S, BagCounts, BagLog, check_free
from jammkle_common.command.errors import InputError
from jammkle_common.command.results import say
from jammkle_common.constants import NANOSECONDS_PER_SECOND
from jammkle_common.diagnostics import DiagnosticsPublisher, Liveness
from jammkle_common.messages import Health, Level, installed_class
from jammkle_common.names import CLOCK, DIAGNOSTICS, LOCKSTEP, RECORDER_NODE, SIM_PARAMETERS, TOPICS, resolved
from jammkle_common.qos import MessageInfo, answer_qos, belongs, misses, node_at, publisher_qos, strongest, with_info
from jammkle_common.runner import run

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    from builtin_interfaces.msg import Time
    from rclpy.duration import Duration
    from rclpy.executors import Executor
    from rclpy.subscription import Subscription

    from jammkle_common.bags.writing import BagCounts
    from jammkle_common.runner import StopFlag

QUEUE_DEPTH = 2000
"""Messages per topic that may wait while the recorder is busy: 2 s of a 1 kHz IMU. Assumed."""

_DISCOVERY_PERIOD_S = 0.2
_UNDECIDED_NS = NANOSECONDS_PER_SECOND
"""How long messages without any stamp wait for a /clock to be discovered, ns; it takes 0.2 s as a rule."""
_SWITCH_WITHIN_S = 10.0
"""Time, s, for which a /clock that appears after the system's time was chosen still puts all messages onto its own."""
_SPIN_TIMEOUT_S = 0.1
_LONGEST_DRAIN_S = 10.0
"""Time, s, after which what is on its way is given up: a publisher whose clock is behind publishes before the end for
as long as it is behind."""


class Recorder(Node):
    """Subscribes to topics as they appear and writes their messages as they came over the wire."""

    def __init__(self, path: Path, namespace: str, source: TimeSource) -> None:
        """Create the bag, record a normalised namespace into it, with log times by this clock.

        Raises:
            InputError: the bag's path exists or cannot be made.

        """
        self.path = path
        self._failed = False
        self._definitions = MessageDefinitions(share_folders())
        self._log = BagLog(path, self._definitions)
        self._times = LogTimes(source, self._write, self._is_of_clock_maker)
        self._begun_ns = time.time_ns()
        self._may_switch = source is TimeSource.UNDECIDED
        self._kept: list[Received] = []
        self._end_ns: int | None = None
        self._received = 0  # published before the end
        super().__init__(RECORDER_NODE, namespace=namespace, start_parameter_services=False)
        self._namespace = namespace
        self._sim_parameters = resolved(namespace, SIM_PARAMETERS.name)
        self._recorded: dict[str, Subscription] = {}
        self._requested: dict[str, QoSProfile] = {}
        self._types: dict[str, tuple[str, Callable[[], Sequence[Qos]]]] = {}
        self._of_clock_maker: dict[str, bool] = {}
        self._of_one_publisher: set[str] = set()
        self.losses = Losses()
        self._done = self.create_publisher(Header, LOCKSTEP.name, answer_qos())
        self._answer = wire.Writer(self.get_fully_qualified_name(), 0)
        self._refused: dict[str, str] = {}
        self._tick_ns: int | None = None
        # What the project itself publishes is subscribed to before its publishers are there, so that nothing is
        # lost between a publisher's first message and the next look at the graph.
        for topic in TOPICS:
            self._subscribe(resolved(namespace, topic.name), topic.message_type, publisher_qos(topic))
        # last, so that whose reports come in knows of all subscriptions before
        self._liveness = Liveness(self, ankles=None)
        self._diagnostics = DiagnosticsPublisher(self, "bag", self._health, self._now)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(_DISCOVERY_PERIOD_S, self._discover, clock=steady)
        self.create_timer(FLUSH_PERIOD_S, self._flush, clock=steady)
        self._discover()

    def counts(self) -> BagCounts:
        """Return how many messages are in the bag so far."""
        return self._log.counts()

    def can_go_on(self) -> bool:
        """Return False if a message could not be written, or the bag's folder is gone, which writing does not show."""
        if not self._failed and not self.path.is_dir():
            self._failed = True
            self._log.fail(FileNotFoundError(errno.ENOENT, "its folder is gone", str(self.path)))
        return not self._failed

    def drive(self, executor: Executor, stop: StopFlag) -> None:
        """Record until asked to stop, then take what is still on its way and complete the bag.

        Raises:
            GraphError: the bag cannot be written any more; what could be saved of it was.

        """
        while not stop and self.can_go_on():
            executor.spin_once(timeout_sec=_SPIN_TIMEOUT_S)
        self.drain(executor)
        self.close()

    def drain(self, executor: Executor) -> None:
        """Take what was published until now and is still on its way, while the graph may go on."""
        self._end_ns = time.time_ns()
        for timer in self.timers:
            timer.cancel()
        end_s = time.monotonic() + _LONGEST_DRAIN_S
        others = 0
        # an executor takes what has come in order, or of each topic in turn
        while self.can_go_on() and others <= len(self._recorded) and time.monotonic() < end_s:
            before, begun_s = self._received, time.monotonic()
            executor.spin_once(timeout_sec=_SPIN_TIMEOUT_S)
            if self._received > before:
                others = 0
            elif time.monotonic() - begun_s < _SPIN_TIMEOUT_S:
                others += 1
            else:
                break

    def close(self) -> BagCounts:
        """Complete the bag.

        Raises:
            GraphError: it could not be written to its end.

        """
        with self._keeping_failure():
            self._times.end()
        return self._log.close()

    def _discover(self) -> None:
        """Subscribe to topics that have appeared, and anew where a publisher offers less than was asked for."""
        since_ns = self._times.waiting_since_ns
        if since_ns is not None and time.time_ns() - since_ns > _UNDECIDED_NS and not self.count_publishers(CLOCK.name):
            with self._keeping_failure():
                self._times.decide(TimeSource.SYSTEM)
        self._diagnostics.check()
        for name, types in self.get_topic_names_and_types():
            if name in self._refused or name.endswith(f"/{LOCKSTEP.name}") or not belongs(self._namespace, name):
                continue
            publishers = self.get_publishers_info_by_topic(name)
            if len(publishers) == 1:
                self._of_one_publisher.add(name)
            else:
                self._of_one_publisher.discard(name)
            if not publishers:
                continue
            if len(types) > 1:
                self._refuse(name, f"it has several types: {', '.join(types)}")
                continue
            offered = [publisher.qos_profile for publisher in publishers]
            asked = self._requested.get(name)
            if asked is None or any(misses(asked, offer) for offer in offered):
                self._subscribe(name, types[0], strongest(offered, QUEUE_DEPTH))

    def _subscribe(self, name: str, message_type: str, offered: QoSProfile) -> None:
        try:
            kind = installed_class(message_type)
            self._types[name] = (message_type, functools.partial(self._offered, name, offered))
            self._log.add_topic(name, *self._types[name])
        except InputError as error:
            self._refuse(name, str(error))
            return
        profile = QoSProfile(depth=QUEUE_DEPTH, reliability=offered.reliability, durability=offered.durability)
        old = self._recorded.pop(name, None)
        if old is not None:
            self.destroy_subscription(old)
        take = functools.partial(self._take_clock if name == CLOCK.name else self._take, name, _begins_with_time(kind))
        self._requested[name] = profile
        self._recorded[name] = self.create_subscription(kind, name, with_info(take), profile, raw=True)

    def _refuse(self, name: str, why: str) -> None:
        self._refused[name] = why
        self.get_logger().warning(f"{name} is not recorded: {why}")

    def _health(self) -> Sequence[Health]:
        """Say what is recorded, and whose reports come in: a bag lacks what a node said before it was discovered."""
        counts = self._log.counts()
        values = {"messages": str(counts.messages), "topics": str(len(counts.by_topic))}
        text = f"recording into {self.path}"
        if self._refused:
            text += "; not recorded: " + "; ".join(f"{name}: {why}" for name, why in self._refused.items())
        if self.losses.by_topic:
            text += f"; {self.losses}"
        level = Level.WARN if self._refused or self.losses.by_topic else Level.OK
        return [Health("recording", level, text, values), self._liveness.health()]

    def _now(self) -> Time | None:
        if self._times.source is TimeSource.SYSTEM:
            return self.get_clock().now().to_msg()
        return None if self._tick_ns is None else RosTime(nanoseconds=self._tick_ns).to_msg()

    def shut_down(self) -> None:
        """Say that this node ends in order."""
        self._diagnostics.farewell()

    def _offered(self, name: str, assumed: QoSProfile) -> Sequence[Qos]:
        publishers = self.get_publishers_info_by_topic(name)
        return [_bag_qos(publisher.qos_profile) for publisher in publishers] or [_bag_qos(assumed)]

    @contextlib.contextmanager
    def _keeping_failure(self) -> Iterator[None]:
        """Keep an error for the loop: the executor would print it in its own words, and go on."""
        try:
            yield
        except OSError:  # the bag knows which
            self._failed = True

    def _take(self, name: str, is_stamped: bool, data: bytes, info: MessageInfo) -> None:  # noqa: FBT001 - bound
        # a latched message from before belongs to the start: nobody was there when it was published
        is_from_before = info.sent_ns < self._begun_ns
        source_ns = max(info.sent_ns, self._begun_ns)
        # of health, since that comes from nodes that live in neither time
        stamp_ns = _stamp_ns(data) if is_stamped and name != DIAGNOSTICS.name else 0
        message = Received(name, data, source_ns, stamp_ns, is_from_before)
        self._count(info)
        self.losses.take(name, info.number, of_one_publisher=name in self._of_one_publisher)
        with self._keeping_failure():
            self._keep(message)
            self._log_one(message)

    def _count(self, info: MessageInfo) -> None:
        if self._end_ns is None or info.sent_ns <= self._end_ns:
            self._received += 1

    def _log_one(self, message: Received) -> None:
        self._times.take(message)
        if message.topic == self._sim_parameters:
            self._log.set_custom_data(SIM_PARAMETERS.name, deserialize_message(message.data, String).data)

    def _write(self, message: Received, log_ns: int) -> None:
        self._log.write(message.topic, message.data, log_ns)

    def _is_of_clock_maker(self, name: str) -> bool:
        """Return whether all publishers of a topic belong to the node that makes /clock, once that is known."""
        known = self._of_clock_maker.get(name)
        if known is None:
            makers, publishers = self._nodes(CLOCK.name), self._nodes(name)
            if not makers or not publishers:
                return False
            known = self._of_clock_maker[name] = publishers <= makers
        return known

    def _nodes(self, topic: str) -> set[str]:
        """Return the nodes that publish a topic; none while one of them is not known."""
        found = {node_at(end) for end in self.get_publishers_info_by_topic(topic)}
        return set() if "" in found else found

    def _keep(self, message: Received) -> None:
        """Keep the first messages: should a /clock appear, they get its time after all."""
        if not self._may_switch:
            return
        if self._kept and message.source_ns - self._kept[0].source_ns > _SWITCH_WITHIN_S * NANOSECONDS_PER_SECOND:
            self._may_switch = False
            self._kept.clear()
        else:
            self._kept.append(message)

    def _switch(self) -> None:
        """Write the bag anew on simulated time, with the first messages that were kept."""
        self._log.discard()
        self._log = BagLog(self.path, self._definitions)
        for name, of_topic in self._types.items():
            self._log.add_topic(name, *of_topic)
        self._times = LogTimes(TimeSource.SIMULATED, self._write, self._is_of_clock_maker)
        kept, self._kept = self._kept, []
        for message in kept:
            self._log_one(message)

    def _flush(self) -> None:
        with self._keeping_failure():
            self._log.flush()

    def _take_clock(self, name: str, _is_stamped: bool, data: bytes, info: MessageInfo) -> None:  # noqa: FBT001
        tick_ns = self._tick_ns = _stamp_ns(data)
        self._count(info)
        with self._keeping_failure():
            if self._may_switch:
                if self._times.source is TimeSource.SYSTEM:
                    self._switch()
                    self.get_logger().info(f"{name} has appeared: log times are simulated time after all")
                else:
                    self.get_logger().info(f"log times are simulated time, by {name}")
                self._may_switch = False
                self._kept.clear()
            self._times.tick(Received(name, data, info.sent_ns, tick_ns))
        self._diagnostics.at(tick_ns / NANOSECONDS_PER_SECOND)
        if self._done.get_subscription_count() > 0:
            self._done.publish(self._answer.write(tick_ns))


def _bag_qos(profile: QoSProfile) -> Qos:
    def named(kind: Any, policy: Any) -> Any:
        return kind.__members__.get(policy.name, kind.UNKNOWN)

    def time_of(duration: Duration) -> QosTime:
        return QosTime(*divmod(duration.nanoseconds, NANOSECONDS_PER_SECOND))

    return Qos(
        named(QosHistory, profile.history),
        profile.depth,
        named(QosReliability, profile.reliability),
        named(QosDurability, profile.durability),
        time_of(profile.deadline),
        time_of(profile.lifespan),
        named(QosLiveliness, profile.liveliness),
        time_of(profile.liveliness_lease_duration),
        profile.avoid_ros_namespace_conventions,
    )


def _begins_with_time(kind: Any) -> bool:
    """Return whether messages begin with a header, or with a time as /clock does."""
    first = next(iter(kind.get_fields_and_field_types().values()), "")
    return first in ("std_msgs/Header", "builtin_interfaces/Time")


def _stamp_ns(data: bytes) -> int:
    stamp = wire.read_clock(data)
    return 0 if stamp is None else stamp[0] * NANOSECONDS_PER_SECOND + stamp[1]


OTHER_EPOCH_NS = 60 * NANOSECONDS_PER_SECOND
"""Difference of stamp and source timestamp from which on they are of two clocks: no stamp is older than a minute."""

_MOST_TICKS = 100_000
"""Ticks that are remembered: more than a recorder's queues hold messages between."""


class TimeSource(enum.Enum):
    """Which clock gives the log times of a bag."""

    UNDECIDED = "undecided"
    """It is not known yet whether there is a /clock: messages wait."""
    SIMULATED = "simulated"
    """/clock. Messages from before its first tick get their own stamp, or the time of that tick if they have none
    or were published before the recording."""
    SYSTEM = "system"
    """The clock of the machines that publish."""


@dataclass(frozen=True)
class Received:
    """A message as it was received."""

    topic: str
    """Full name."""
    data: bytes
    """Serialised (CDR)."""
    source_ns: int
    """When it was published, ns of its publisher's system clock."""
    stamp_ns: int = 0
    """Stamp of its header, ns; 0 where it has none."""
    is_from_before: bool = False
    """Whether it was published before the recording began, as latched messages may be."""


_MOST_COUNTS = 4
"""Counts of one topic that are kept. Chosen: of two publishers, each started anew once."""


class Losses:
    """Messages that did not come in, as where the machine is too busy to take them before the queue is full.

    They are gaps in the numbers that a publisher gives its messages. Which of several publishers a message comes from
    is not known, so that only topics with one are counted. Messages of a second one may come before it is seen: each
    number goes on from the nearest below, and a gap that a later number falls into was none.
    """

    def __init__(self) -> None:
        """Nothing is lost yet."""
        self.by_topic: dict[str, int] = {}
        self._latest: dict[str, list[int]] = {}
        self._gaps: dict[str, list[tuple[int, int]]] = {}
        """By topic, numbers before and after what is counted."""

    def take(self, topic: str, number: int, *, of_one_publisher: bool) -> None:
        """Take a message's number, from 1; 0: the middleware does not count."""
        if not of_one_publisher or number == 0:
            self._latest.pop(topic, None)
            self._gaps.pop(topic, None)
            return
        latest, gaps = self._latest.setdefault(topic, []), self._gaps.setdefault(topic, [])
        for gap in [(before, after) for before, after in gaps if before < number < after]:
            gaps.remove(gap)
            latest.append(gap[0])
            self._count(topic, gap[0] + 1 - gap[1])
        before = max((each for each in latest if each < number), default=0)
        if before:
            latest.remove(before)
            if number > before + 1:
                gaps.append((before, number))
                self._count(topic, number - before - 1)
        latest.append(number)
        del latest[:-_MOST_COUNTS], gaps[:-_MOST_COUNTS]

    def _count(self, topic: str, lost: int) -> None:
        self.by_topic[topic] = self.by_topic.get(topic, 0) + lost
        if not self.by_topic[topic]:
            del self.by_topic[topic]

    def __str__(self) -> str:
        """Return what was lost of which topics, and why."""
        lost = ", ".join(f"{count} of {topic}" for topic, count in sorted(self.by_topic.items()))
        return f"machine or network were too busy to take every message; lost: {lost}; give the recorder more of both"


class LogTimes:
    """Gives messages their log times, which are when they were published, and holds them until those are known.

    On hardware that is the middleware's source timestamp. In simulation it is simulated time: a message of the node
    that makes /clock belongs to the tick that follows it, or to its own stamp; one of any other node to the last tick
    before it. Which tick that was is known by source timestamps, which the publishers of one machine take from one
    clock. In lockstep this is exact, since a node publishes between a tick and its answer to it.
    """

    def __init__(
        self, source: TimeSource, write: Callable[[Received, int], None], is_of_clock_maker: Callable[[str], bool]
    ) -> None:
        """Start.

        Args:
            source: Which clock to use; UNDECIDED goes by the first stamp, or the first tick.
            write: Takes each message with its log time, ns.
            is_of_clock_maker: Whether a topic is published by the node that makes /clock; asked when a message is
                written, as the graph may not know a publisher's node yet when the first message arrives.

        """
        self.source = source
        self._write = write
        self._is_of_clock_maker = is_of_clock_maker
        self._held: list[Received] = []
        self._tick_sources_ns: list[int] = []
        self._tick_stamps_ns: list[int] = []
        self._start_ns: int | None = None

    @property
    def waiting_since_ns(self) -> int | None:
        """When the first message that waits was published, ns; None: none waits."""
        return self._held[0].source_ns if self._held else None

    def take(self, message: Received) -> None:
        """Take a message that is no tick."""
        if self.source is TimeSource.UNDECIDED and message.stamp_ns:
            other = abs(message.stamp_ns - message.source_ns) > OTHER_EPOCH_NS
            self.decide(TimeSource.SIMULATED if other else TimeSource.SYSTEM)
        if self.source is TimeSource.SYSTEM:
            self._write(message, message.source_ns)
        else:
            self._held.append(message)

    def tick(self, message: Received) -> None:
        """Take a tick of /clock, with its time as stamp."""
        if self.source is TimeSource.UNDECIDED:
            self.decide(TimeSource.SIMULATED)
        if self.source is TimeSource.SYSTEM:
            self._write(message, message.source_ns)
            return
        if self._start_ns is None:
            self._start_ns = message.stamp_ns
        if not self._tick_stamps_ns or self._tick_stamps_ns[-1] != message.stamp_ns:
            self._tick_sources_ns.append(message.source_ns)
            self._tick_stamps_ns.append(message.stamp_ns)
            if len(self._tick_stamps_ns) > 2 * _MOST_TICKS:
                del self._tick_sources_ns[:_MOST_TICKS], self._tick_stamps_ns[:_MOST_TICKS]
        self._release(message.source_ns)
        self._write(message, message.stamp_ns)

    def end(self) -> None:
        """Give away what still waits: without any tick all of it has time zero, as time never began."""
        if self.source is TimeSource.UNDECIDED:
            self.decide(TimeSource.SYSTEM)
        self._release(None)

    def decide(self, source: TimeSource) -> None:
        """Say which clock gives the log times, if that is not decided yet."""
        if self.source is not TimeSource.UNDECIDED:
            return
        self.source = source
        if source is TimeSource.SYSTEM:
            held, self._held = self._held, []
            for each in held:
                self._write(each, each.source_ns)

    def _release(self, before_ns: int | None) -> None:
        """Write what was published before a tick, by log time; what was later waits for the next one."""
        held, self._held = self._held, []
        due = held if before_ns is None else [each for each in held if each.source_ns < before_ns]
        if before_ns is not None and len(due) < len(held):
            self._held = [each for each in held if each.source_ns >= before_ns]
        for log_ns, each in sorted(((self._log_ns(each), each) for each in due), key=lambda pair: pair[0]):
            self._write(each, log_ns)

    def _log_ns(self, message: Received) -> int:
        log_ns = self._published_ns(message)
        # rosbag2 logs when it receives; a player would begin with as much silence as lies between
        return max(log_ns, self._start_ns or 0) if message.is_from_before else log_ns

    def _published_ns(self, message: Received) -> int:
        of_clock_maker = self._is_of_clock_maker(message.topic)
        if of_clock_maker and message.stamp_ns:
            return message.stamp_ns
        if not self._tick_stamps_ns:
            return 0
        following = bisect.bisect_right(self._tick_sources_ns, message.source_ns)
        if following == 0 and message.stamp_ns:
            return min(message.stamp_ns, self._tick_stamps_ns[0])
        at = following if of_clock_maker else following - 1
        return self._tick_stamps_ns[min(max(at, 0), len(self._tick_stamps_ns) - 1)]


_SOURCES = {"auto": TimeSource.UNDECIDED, "sim": TimeSource.SIMULATED, "system": TimeSource.SYSTEM}


def record(path: Path, namespace: str, clock: str) -> BagCounts:
    """Record until SIGINT or SIGTERM and return what is in the bag, which is complete then.

    Raises:
        InputError: the path exists or cannot be made, or the clock is unknown.

    """
    if clock not in _SOURCES:
        msg = f"--clock '{clock}' must be one of {', '.join(_SOURCES)}"
        raise InputError(msg)
    check_free(path)
    nodes: list[Recorder] = []

    def make_node() -> Recorder:
        node = Recorder(path, namespace, _SOURCES[clock])
        nodes.append(node)
        say(f"recording namespace {namespace} into {path}; Ctrl-C ends")
        return node

    run(make_node, arguments=[])
    counts = nodes[0].counts()
    say(f"{counts.messages} messages of {len(counts.by_topic)} topics are in {path}")
    if nodes[0].losses.by_topic:
        say(str(nodes[0].losses))
    return counts
