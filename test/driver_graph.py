"""A driver's node in the test's own process, on real DDS, with a node that subscribes to it, and a fake ankle."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.experimental import EventsExecutor
from rclpy.parameter import Parameter
from sensor_msgs.msg import FluidPressure
from std_msgs.msg import Bool, Float32

from jammkle_common import names
from jammkle_common.qos import publisher_qos, subscriber_qos
from jammkle_driver.node import DriverNode
from jammkle_msgs.msg import ChannelJamState, JamState

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.node import Node

AMBIENT_PA = 101325.0
PERIOD_S = 0.01
DEADLINE_S = 15.0


class Onlooker:
    """What a driver says: its outputs, jam_state, and its lines on /diagnostics."""

    def __init__(self, node: Node) -> None:
        self.node = node
        self.solenoids = dict.fromkeys(names.CHANNELS, False)
        self.duty = 0.0
        self.received: list[str] = []
        self.states: list[JamState] = []
        self.lines: dict[str, DiagnosticStatus] = {}
        for channel, topic in names.SOLENOIDS.items():
            node.create_subscription(Bool, topic.name, self._on_solenoid(channel), subscriber_qos(topic))
        node.create_subscription(Float32, names.PUMP_DUTY.name, self._on_duty, subscriber_qos(names.PUMP_DUTY))

    def watch_states(self) -> None:
        """Receive jam_state and /diagnostics from now on."""
        qos = subscriber_qos(names.JAM_STATE)
        self.node.create_subscription(JamState, names.JAM_STATE.name, self.states.append, qos)
        topic = names.DIAGNOSTICS
        self.node.create_subscription(DiagnosticArray, topic.name, self._on_diagnostics, subscriber_qos(topic))

    def _on_solenoid(self, channel: str) -> Callable[[Bool], None]:
        def take(message: Bool) -> None:
            self.solenoids[channel] = message.data
            self.received.append(channel)

        return take

    def _on_duty(self, message: Float32) -> None:
        self.duty = message.data

    def _on_diagnostics(self, array: DiagnosticArray) -> None:
        self.lines.update({status.name.partition(": ")[2]: status for status in array.status})

    def released(self) -> bool:
        return not any(self.solenoids.values()) and self.duty == 0.0

    def state_of(self, channel: str) -> ChannelJamState:
        return next(c for c in self.states[-1].channels if c.channel == channel) if self.states else ChannelJamState()

    def all_in(self, state: int) -> bool:
        return bool(self.states) and all(c.state == state for c in self.states[-1].channels)

    def values_of(self, line: str) -> dict[str, str]:
        """Values of a line on /diagnostics."""
        return {value.key: value.value for value in self.lines[line].values} if line in self.lines else {}


class FakeAnkle(Onlooker):
    """Pressures that follow the solenoids and the pump within tens of milliseconds, as the topics of a simulation."""

    def __init__(self, node: Node) -> None:
        super().__init__(node)
        self.silent: set[str] = set()
        self._manifold_pa = 0.0
        self._vacuum_pa = dict.fromkeys(names.CHANNELS, 0.0)
        self._pressures = {
            place: node.create_publisher(FluidPressure, topic.name, publisher_qos(topic))
            for place, topic in {**names.PRESSURES, "manifold": names.MANIFOLD_PRESSURE}.items()
        }
        node.create_timer(PERIOD_S, self._advance, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _advance(self) -> None:
        self._manifold_pa = min(self._manifold_pa + 3e3 * self.duty, 80e3)
        for channel, vacuum_pa in self._vacuum_pa.items():
            connected = self.solenoids[channel]
            step_pa = 0.4 * ((self._manifold_pa if connected else 0.0) - vacuum_pa)
            self._vacuum_pa[channel] += step_pa
            if connected:  # the air of a tendon lowers the manifold
                self._manifold_pa -= 0.1 * step_pa
        for place, vacuum_pa in {**self._vacuum_pa, "manifold": self._manifold_pa}.items():
            if place not in self.silent:
                message = FluidPressure(fluid_pressure=AMBIENT_PA - vacuum_pa)
                message.header.stamp = self.node.get_clock().now().to_msg()
                self._pressures[place].publish(message)


class Graph:
    """A context of its own, on a domain of its own, with an executor, a test node and who looks on from it."""

    def __init__(self, domain_id: int, onlooker: type[Onlooker] = FakeAnkle) -> None:
        self.domain_id = domain_id
        self.context = rclpy.Context()
        self.context.init(domain_id=domain_id)
        self.executor = EventsExecutor(context=self.context)
        self.node = self.add(rclpy.create_node("test", context=self.context))
        self.ankle = onlooker(self.node)
        self.ankle.watch_states()

    def add(self, node: Any) -> Any:
        self.executor.add_node(node)
        return node

    def driver(self, **parameters: Any) -> DriverNode:
        """Start a driver of an ankle that keeps to no law of the air."""
        return self.lawful_driver(**{"diagnose": False, "fault_policy": "channel", **parameters})

    def lawful_driver(self, **parameters: Any) -> DriverNode:
        """Start a driver with its own defaults but for these parameters."""
        overrides = [Parameter(name, value=value) for name, value in parameters.items()]
        driver = self.add(DriverNode(context=self.context, parameter_overrides=overrides))
        driver.start()
        return driver

    def jammable_driver(self, **parameters: Any) -> DriverNode:
        driver = self.driver(**parameters)
        self.spin_until(lambda: self.ankle.all_in(ChannelJamState.UNJAMMED))
        return driver

    def spin_until(self, holds: Callable[[], bool], timeout_s: float = DEADLINE_S) -> None:
        deadline = time.monotonic() + timeout_s
        while not holds():
            assert time.monotonic() < deadline, f"never held; last jam_state: {self.ankle.states[-1:]}"
            self.executor.spin_once(timeout_sec=0.02)

    def call(self, kind: Any, name: str, **fields: Any) -> Any:
        client = self.node.create_client(kind, name)
        self.spin_until(client.service_is_ready)
        future = client.call_async(kind.Request(**fields))
        self.spin_until(future.done)
        self.node.destroy_client(client)
        return future.result()

    def transition(self, identifier: int) -> bool:
        return bool(self.call(ChangeState, "driver/change_state", transition=Transition(id=identifier)).success)

    def close(self) -> None:
        nodes = list(self.executor.get_nodes())
        self.executor.shutdown()  # first, so that nothing that arrives calls into nodes that are gone
        for node in nodes:
            node.destroy_node()
        self.context.try_shutdown()
        # The garbage collector does not see through an events executor, and with it the whole participant stays alive.
        del self.executor
