"""The recorder node: everything in a namespace, and what is said of it outside, into one bag."""

from __future__ import annotations

import contextlib
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
from rosgraph_msgs.msg import Clock as ClockMessage
from std_msgs.msg import String

from jammkle_bringup.conversions import clock_ns, message_class
from jammkle_graph.bags.offered import bag_qos
from jammkle_graph.bags.writing import FLUSH_PERIOD_S, BagLog, TimeSource
from jammkle_graph.command.errors import InputError
from jammkle_graph.names import CLOCK, SIM_PARAMETERS, TOPICS
from jammkle_graph.namespace import resolved
from jammkle_graph.overhearing import belongs, misses, strongest
from jammkle_graph.qos import publisher_qos

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from rclpy.executors import Executor
    from rclpy.subscription import Subscription
    from rosbags.interfaces import Qos

    from jammkle_graph.bags.definitions import MessageDefinitions
    from jammkle_graph.bags.writing import BagCounts
    from jammkle_graph.runner import StopFlag

QUEUE_DEPTH = 2000
"""Messages per topic that may wait while the recorder is busy: 2 s of a 1 kHz IMU. Assumed."""

_DISCOVERY_PERIOD_S = 0.2
_UNDECIDED_S = 1.0
_SPIN_TIMEOUT_S = 0.1
_DRAIN_S = 1.0  # a graph that goes on publishes without end


@dataclass(frozen=True)
class RecorderOptions:
    """What to record: the bag's folder, a normalised namespace, and which clock gives the log times."""

    path: Path
    namespace: str
    source: TimeSource


class Recorder(Node):
    """Subscribes to topics as they appear and writes their messages as they came over the wire."""

    def __init__(self, options: RecorderOptions, definitions: MessageDefinitions) -> None:
        """Create the bag and start to record.

        Raises:
            InputError: the bag's path exists or cannot be made.

        """
        self.path = options.path
        self._failed = False
        self._log = BagLog(options.path, definitions, options.source)
        super().__init__("recorder", namespace=options.namespace, start_parameter_services=False)
        self._namespace = options.namespace
        self._sim_parameters = resolved(options.namespace, SIM_PARAMETERS.name)
        self._recorded: dict[str, Subscription] = {}
        self._requested: dict[str, QoSProfile] = {}
        self._refused: set[str] = set()
        # What the project itself publishes is subscribed to before its publishers are there, so that nothing is
        # lost between a publisher's first message and the next look at the graph.
        for topic in TOPICS:
            self._subscribe(resolved(options.namespace, topic.name), topic.message_type, publisher_qos(topic))
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(_DISCOVERY_PERIOD_S, self._discover, clock=steady)
        self._decision = self.create_timer(_UNDECIDED_S, self._decide, clock=steady)
        self.create_timer(FLUSH_PERIOD_S, self._flush, clock=steady)
        self._discover()

    def counts(self) -> BagCounts:
        """Return how many messages came so far."""
        return self._log.counts()

    def can_go_on(self) -> bool:
        """Return False if a message could not be written, or the bag's folder is gone, which writing does not show."""
        if not self._failed and not self.path.is_dir():
            self._failed = True
            self._log.fail(FileNotFoundError(errno.ENOENT, "its folder is gone", str(self.path)))
        return not self._failed

    def close(self) -> BagCounts:
        """Complete the bag.

        Raises:
            GraphError: it could not be written to its end.

        """
        return self._log.close()

    def _discover(self) -> None:
        """Subscribe to topics that have appeared, and anew where a publisher offers less than was asked for."""
        for name, types in self.get_topic_names_and_types():
            if name in self._refused or not belongs(self._namespace, name):
                continue
            publishers = self.get_publishers_info_by_topic(name)
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
            kind = message_class(message_type)
            self._log.add_topic(name, message_type, functools.partial(self._offered, name, offered))
        except InputError as error:
            self._refuse(name, str(error))
            return
        profile = QoSProfile(depth=QUEUE_DEPTH, reliability=offered.reliability, durability=offered.durability)
        old = self._recorded.pop(name, None)
        if old is not None:
            self.destroy_subscription(old)
        take = self._take_clock if name == CLOCK.name else functools.partial(self._take, name)
        self._requested[name] = profile
        self._recorded[name] = self.create_subscription(kind, name, take, profile, raw=True)

    def _refuse(self, name: str, why: str) -> None:
        self._refused.add(name)
        self.get_logger().warning(f"{name} is not recorded: {why}")

    def _offered(self, name: str, assumed: QoSProfile) -> Sequence[Qos]:
        publishers = self.get_publishers_info_by_topic(name)
        return [bag_qos(publisher.qos_profile) for publisher in publishers] or [bag_qos(assumed)]

    @contextlib.contextmanager
    def _keeping_failure(self) -> Iterator[None]:
        """Keep an error for the loop: the executor would print it in its own words, and go on."""
        try:
            yield
        except OSError:  # the bag knows which
            self._failed = True

    def _take(self, name: str, data: bytes) -> None:
        with self._keeping_failure():
            self._log.write(name, data)
            if name == self._sim_parameters:
                self._log.set_custom_data(SIM_PARAMETERS.name, _text(data))

    def _flush(self) -> None:
        with self._keeping_failure():
            self._log.flush()

    def _take_clock(self, data: bytes) -> None:
        with self._keeping_failure():
            if self._log.source is TimeSource.UNDECIDED:
                self._log.decide(TimeSource.SIMULATED)
            self._log.tick(clock_ns(deserialize_message(data, ClockMessage)))
            self._log.write(CLOCK.name, data)

    def _decide(self) -> None:
        """Settle which clock is used: by now a simulation would have been discovered."""
        self._decision.cancel()
        simulated = self.count_publishers(CLOCK.name) > 0
        with self._keeping_failure():
            self._log.decide(TimeSource.SIMULATED if simulated else TimeSource.SYSTEM)


def spin_and_close(node: Recorder, executor: Executor, stop: StopFlag) -> None:
    """Record until asked to stop, then take what is still on its way and complete the bag.

    Raises:
        GraphError: the bag cannot be written any more; what could be saved of it was.

    """
    while not stop and node.can_go_on():
        executor.spin_once(timeout_sec=_SPIN_TIMEOUT_S)
    end_s = time.monotonic() + _DRAIN_S
    before = -1
    while node.can_go_on() and node.counts().messages > before and time.monotonic() < end_s:
        before = node.counts().messages
        executor.spin_once(timeout_sec=_SPIN_TIMEOUT_S)
        executor.spin_once(timeout_sec=0)
    node.close()


def _text(data: bytes) -> str:
    message: Any = deserialize_message(data, String)
    return str(message.data)
