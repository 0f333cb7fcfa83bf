"""The sim node in a ROS domain of its own, driven by the test itself, with somebody who looks on."""

from __future__ import annotations

import dataclasses
import time
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import pytest
import rclpy
from rclpy.experimental import EventsExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_srvs.srv import SetBool, Trigger

from domains import own_domain
from jammkle_common import names
from jammkle_msgs.srv import Step
from jammkle_sim.kinds import RIG
from jammkle_sim.node import SimNode
from jammkle_sim.rigs.simulation import BaseSample, ImuSample, TendonSample, UnstableSimulationError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from jammkle_sim.parameters import SimParameters

TIMEOUT_S = 30.0
DEEP = 20_000


class FakeSimulation:
    """A rig whose values a test sets as it likes."""

    timestep_s = 0.0005
    machine = SimpleNamespace(
        parts={}, control=None, left_out=(), description=lambda: {"rig": "fake", "options": {"seed": 0}}
    )

    def __init__(self, _parameters: SimParameters | None = None) -> None:
        self.ankle = self
        self.ankles = {"ankle": self}
        self.steps = 0
        self.rig_steps = 0
        self.duty = 0.0
        self.energised = dict.fromkeys(names.CHANNELS, False)
        self.force_z = 9.81
        self.broken: set[str] = set()
        self.unstable_at: int | None = None

    @property
    def time_s(self) -> float:
        return self.steps * self.timestep_s

    def set_pump_duty(self, duty: float) -> None:
        self.duty = duty

    def set_solenoid(self, channel: str, energised: bool) -> None:  # noqa: FBT001 - as the simulation has it
        self.energised[channel] = energised

    def advance(self, steps: int) -> None:
        self.steps += steps
        self.rig_steps += steps
        if self.unstable_at is not None and self.rig_steps >= self.unstable_at:
            msg = "simulation of rig 'fake' became unstable"
            raise UnstableSimulationError(msg)

    def reset(self) -> None:
        self.rig_steps = 0
        self.duty = 0.0
        self.energised = dict.fromkeys(names.CHANNELS, False)
        self.broken = set()
        self.force_z = 9.81
        self.unstable_at = None

    def imu(self) -> ImuSample:
        return ImuSample((0.0, 0.0, self.force_z), (0.1, 0.2, 0.3))

    def channel_pressures_pa(self) -> dict[str, float]:
        return {channel: 101_325.0 - 1000.0 * index for index, channel in enumerate(names.CHANNELS)}

    def manifold_pressure_pa(self) -> float:
        return 51_325.0

    def joint_positions(self) -> dict[str, float]:
        return dict.fromkeys((*names.ANKLE_JOINTS, names.CARRIAGE_JOINT), 0.1)

    def joint_velocities(self) -> dict[str, float]:
        return dict.fromkeys((*names.ANKLE_JOINTS, names.CARRIAGE_JOINT), 0.2)

    def joint_efforts(self) -> None:
        return None

    def tendons(self) -> tuple[TendonSample, ...]:
        return tuple(TendonSample(name, 0.01, 0.02, 3.0, name in self.broken) for name in names.TENDONS)

    def base(self) -> BaseSample:
        return BaseSample((0.0, 0.0, 0.1), (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.2), (0.0, 0.0, 0.0))

    def load_cell_force_n(self) -> tuple[float, float, float]:
        return (0.0, 0.0, 17.7)


class Graph:
    """A sim node, and a node that records what it says and calls its services."""

    def __init__(self, make: Callable[[SimParameters], Any]) -> None:
        self.sim = SimNode(dataclasses.replace(RIG, make=make))
        self._executor = EventsExecutor()
        self._executor.add_node(self.sim)
        self.probe = rclpy.create_node("probe")
        self._probe_executor = EventsExecutor()
        self._probe_executor.add_node(self.probe)
        # Subscriptions stand on a node that no executor serves: everything that has arrived is taken after each cycle,
        # in this very thread. Fast DDS can hang where a reader is read in one thread and a writer of the same process
        # writes to it in another.
        self._listener = rclpy.create_node("listener")
        self._recordings: list[tuple[Any, str, list[Any]]] = []
        self.sent: list[tuple[int, str, Any]] = []
        """When it was sent, topic and message of everything recorded. Arrival is ordered within a topic only."""

    def close(self) -> None:
        # First, so that nothing that arrives calls into nodes that are gone.
        self._probe_executor.shutdown()
        self._executor.shutdown()
        self._recordings.clear()
        self._listener.destroy_node()
        self.probe.destroy_node()
        self.sim.destroy_node()
        # The garbage collector does not see through the executors, and with them whole participants would stay alive
        # and go on talking to the next test.
        del self._executor, self._probe_executor

    def record(self, message_type: type, topic: str, *, latched: bool = False) -> list[Any]:
        """Record a topic from now on, and wait until its publisher is there."""
        messages: list[Any] = []

        qos = QoSProfile(depth=DEEP, reliability=ReliabilityPolicy.BEST_EFFORT)
        if latched:
            qos.reliability = ReliabilityPolicy.RELIABLE
            qos.durability = DurabilityPolicy.TRANSIENT_LOCAL
        subscription = self._listener.create_subscription(message_type, topic, lambda _: None, qos)
        self._recordings.append((subscription, topic, messages))
        # Matched on both sides, or the first messages are lost.
        publishers = [publisher for publisher in self.sim.publishers if publisher.topic_name == subscription.topic_name]
        if publishers:
            self.spin_until(lambda: all(p.get_subscription_count() for p in publishers), f"publisher of {topic}")
        return messages

    def publisher(self, message_type: type, topic: names.Topic) -> Any:
        """Make a latched publisher that the sim node is subscribed to."""
        qos = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        publisher = self.probe.create_publisher(message_type, topic.name, qos)
        self.spin_until(lambda: publisher.get_subscription_count() > 0, f"subscriber of {topic.name}")
        return publisher

    def spin_until(self, predicate: Callable[[], bool], what: str) -> None:
        """Drive the sim node until something holds; fail with what was waited for."""
        end_s = time.monotonic() + TIMEOUT_S
        while not predicate():
            if time.monotonic() > end_s:
                pytest.fail(f"waited {TIMEOUT_S} s in vain for: {what}")
            self._executor.spin_once(timeout_sec=min(self.sim.cycle(), 0.005))
            self._probe_executor.spin_once(timeout_sec=0)
            self._take_all()

    def _take_all(self) -> None:
        for subscription, topic, messages in self._recordings:
            with subscription.handle:
                while (taken := subscription.handle.take_message(subscription.msg_type, False)) is not None:  # noqa: FBT003 - rclpy's own
                    message, info = taken
                    messages.append(message)
                    self.sent.append((info["source_timestamp"], topic, message))

    def client(self, service_type: type, service: names.Service) -> Any:
        """Make a client whose service is there."""
        client = self.probe.create_client(service_type, service.path)
        self.spin_until(client.service_is_ready, service.path)
        return client

    def call(self, service_type: type, service: names.Service, request: Any) -> Any:
        """Call a service and wait for its answer."""
        future = self.client(service_type, service).call_async(request)
        self.spin_until(future.done, f"answer of {service.path}")
        return future.result()

    def set_paused(self, paused: bool) -> Any:  # noqa: FBT001 - as the service has it
        return self.call(SetBool, names.SET_PAUSED, SetBool.Request(data=paused))

    def step(self, steps: int) -> Any:
        return self.call(Step, names.STEP, Step.Request(steps=steps))

    def reset(self) -> Any:
        return self.call(Trigger, names.RESET, Trigger.Request())

    @staticmethod
    def stamp_ns(stamp: Any) -> int:
        """Nanoseconds of a stamp."""
        return stamp.sec * 10**9 + stamp.nanosec

    @staticmethod
    def stamps_ns(messages: list[Any]) -> list[int]:
        """Nanoseconds of every message's header."""
        return [Graph.stamp_ns(message.header.stamp) for message in messages]

    @staticmethod
    def ticks_ns(clocks: list[Any]) -> list[int]:
        """Nanoseconds of every /clock."""
        return [Graph.stamp_ns(message.clock) for message in clocks]

    @staticmethod
    def latest_status(reports: list[Any], about: str) -> Any:
        """Return the newest status about something, or None."""
        found = [status for report in reports for status in report.status if status.name.endswith(f": {about}")]
        return found[-1] if found else None

    @staticmethod
    def values_of(status: Any) -> dict[str, str]:
        """Values of a status by key."""
        return {value.key: value.value for value in status.values}


@pytest.fixture
def sim_domain_id(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """Reserve a ROS domain on this machine for one test."""
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    with own_domain() as number:
        yield number


@pytest.fixture
def start_graph(sim_domain_id: int) -> Iterator[Callable[..., Graph]]:
    """Start one sim node with parameters (and `namespace`), on the landing rig or on another."""
    graphs: list[Graph] = []

    def start(make: Callable[[SimParameters], Any] = RIG.make, namespace: str = "", **parameters: object) -> Graph:
        arguments = [text for name, value in parameters.items() for text in ("-p", f"{name}:={value}")]
        if namespace:
            arguments += ["-r", f"__ns:=/{namespace}"]
        rclpy.init(args=["--ros-args", *arguments] if arguments else [], domain_id=sim_domain_id)
        graphs.append(Graph(make))
        return graphs[-1]

    yield start
    for graph in graphs:
        graph.close()
    rclpy.try_shutdown()


@pytest.fixture
def fake() -> FakeSimulation:
    """Return a rig whose values a test sets; pass `lambda _: fake` to start_graph."""
    return FakeSimulation()
