"""The driver node on real DDS, with a fake ankle that answers to solenoids and duty."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
import time
from typing import TYPE_CHECKING, Any

import pytest
import rclpy
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.experimental import EventsExecutor
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock as ClockMessage
from sensor_msgs.msg import FluidPressure
from std_msgs.msg import Bool, Float32
from std_srvs.srv import SetBool, Trigger

from jammkle_driver.fake.faults import FakeFault
from jammkle_driver.node import DriverNode
from jammkle_graph import names
from jammkle_graph.parameters import ParameterError
from jammkle_graph.qos import publisher_qos, subscriber_qos
from jammkle_graph.testing import own_domain
from jammkle_msgs.msg import ChannelJamCommand, ChannelJamState, Fault, JamCommand, JamState
from jammkle_msgs.srv import Jam, Unjam

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from rclpy.node import Node

AMBIENT_PA = 101325.0
PERIOD_S = 0.01
DEADLINE_S = 15.0


class FakeAnkle:
    """Pressures that follow the solenoids and the pump within tens of milliseconds, and what the driver says."""

    def __init__(self, node: Node) -> None:
        self.node = node
        self.solenoids = dict.fromkeys(names.CHANNELS, False)
        self.duty = 0.0
        self.heard: list[str] = []
        self.states: list[JamState] = []
        self.silent: set[str] = set()
        self._manifold_pa = 0.0
        self._vacuum_pa = dict.fromkeys(names.CHANNELS, 0.0)
        for channel, topic in names.SOLENOIDS.items():
            node.create_subscription(Bool, topic.name, self._on_solenoid(channel), subscriber_qos(topic))
        node.create_subscription(Float32, names.PUMP_DUTY.name, self._on_duty, subscriber_qos(names.PUMP_DUTY))
        self._pressures = {
            place: node.create_publisher(FluidPressure, topic.name, publisher_qos(topic))
            for place, topic in {**names.PRESSURES, "manifold": names.MANIFOLD_PRESSURE}.items()
        }
        node.create_timer(PERIOD_S, self._advance, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def watch_states(self) -> None:
        qos = subscriber_qos(names.JAM_STATE)
        self.node.create_subscription(JamState, names.JAM_STATE.name, self.states.append, qos)

    def _on_solenoid(self, channel: str) -> Callable[[Bool], None]:
        def take(message: Bool) -> None:
            self.solenoids[channel] = message.data
            self.heard.append(channel)

        return take

    def _on_duty(self, message: Float32) -> None:
        self.duty = message.data

    def _advance(self) -> None:
        self._manifold_pa = min(self._manifold_pa + 3e3 * self.duty, 80e3)
        for channel, vacuum_pa in self._vacuum_pa.items():
            source_pa = self._manifold_pa if self.solenoids[channel] else 0.0
            self._vacuum_pa[channel] += 0.4 * (source_pa - vacuum_pa)
        for place, vacuum_pa in {**self._vacuum_pa, "manifold": self._manifold_pa}.items():
            if place not in self.silent:
                message = FluidPressure(fluid_pressure=AMBIENT_PA - vacuum_pa)
                message.header.stamp = self.node.get_clock().now().to_msg()
                self._pressures[place].publish(message)

    def released(self) -> bool:
        return not any(self.solenoids.values()) and self.duty == 0.0

    def state_of(self, channel: str) -> ChannelJamState:
        return next(c for c in self.states[-1].channels if c.channel == channel) if self.states else ChannelJamState()

    def all_in(self, state: int) -> bool:
        return bool(self.states) and all(c.state == state for c in self.states[-1].channels)


class Graph:
    """A context of its own, on a domain of its own, with an executor, a test node and a fake ankle."""

    def __init__(self, domain_id: int) -> None:
        self.domain_id = domain_id
        self.context = rclpy.Context()
        self.context.init(domain_id=domain_id)
        self.executor = EventsExecutor(context=self.context)
        self.node = self.add(rclpy.create_node("test", context=self.context))
        self.ankle = FakeAnkle(self.node)
        self.ankle.watch_states()

    def add(self, node: Any) -> Any:
        self.executor.add_node(node)
        return node

    def driver(self, **parameters: Any) -> DriverNode:
        # this ankle keeps to no law of the air
        given = {"diagnose": False, "fault_policy": "channel", **parameters}
        overrides = [Parameter(name, value=value) for name, value in given.items()]
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


@pytest.fixture
def graph(monkeypatch: pytest.MonkeyPatch) -> Iterator[Graph]:
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    with own_domain() as domain_id:
        graph = Graph(domain_id)
        yield graph
        graph.close()


def test_services_jam_and_unjam_to_measured_vacuum(graph: Graph) -> None:
    """Every service acts on the channels it names, and jam_state ends where the measured pressure says."""
    graph.jammable_driver()
    ankle = graph.ankle
    assert graph.call(Jam, names.JAM.path, channels=["achilles"], vacuum_pa=30e3).success
    graph.spin_until(lambda: ankle.state_of("achilles").state == ChannelJamState.JAMMED)
    assert ankle.state_of("achilles").commanded_vacuum_pa == 30e3
    assert ankle.state_of("achilles").measured_vacuum_pa == pytest.approx(30e3, abs=2.5e3)
    assert ankle.solenoids == {"peroneal_left": False, "peroneal_right": False, "achilles": True}
    assert graph.call(Unjam, names.UNJAM.path, channels=["achilles"]).success
    graph.spin_until(lambda: ankle.all_in(ChannelJamState.UNJAMMED) and ankle.released())
    assert graph.call(SetBool, names.CHANNEL_JAMS["peroneal_left"].path, data=True).success
    graph.spin_until(lambda: ankle.state_of("peroneal_left").state == ChannelJamState.JAMMED)
    assert graph.call(SetBool, names.CHANNEL_JAMS["peroneal_left"].path, data=False).success
    graph.spin_until(ankle.released)
    assert graph.call(Trigger, names.JAM_ALL.path).success
    graph.spin_until(lambda: ankle.all_in(ChannelJamState.JAMMED))
    assert graph.call(Trigger, names.UNJAM_ALL.path).success
    graph.spin_until(lambda: ankle.all_in(ChannelJamState.UNJAMMED) and ankle.released())


def test_bad_requests_are_answered_and_change_nothing(graph: Graph) -> None:
    """Unknown channel, vacuum out of range or NaN: success=false, one line with the value, nothing energised."""
    graph.jammable_driver()
    for channels, vacuum_pa, word in (
        (["achilles", "knee"], 0.0, "knee"),
        (["achilles"], 90e3, "90000"),
        (["achilles"], math.nan, "nan"),
    ):
        answer = graph.call(Jam, names.JAM.path, channels=channels, vacuum_pa=vacuum_pa)
        assert not answer.success
        assert word in answer.message
    assert graph.ankle.released()
    assert graph.ankle.all_in(ChannelJamState.UNJAMMED)


def test_a_late_joiner_gets_the_latest_states(graph: Graph) -> None:
    """Who subscribes after the jam hears jam_state, solenoids and duty as they are now."""
    graph.jammable_driver()
    graph.call(Trigger, names.JAM_ALL.path)
    graph.spin_until(lambda: graph.ankle.all_in(ChannelJamState.JAMMED))
    late = FakeAnkle(graph.add(rclpy.create_node("late", context=graph.context, namespace="late")))
    late.node.create_subscription(
        JamState, f"/{names.JAM_STATE.name}", late.states.append, subscriber_qos(names.JAM_STATE)
    )
    graph.spin_until(lambda: late.all_in(ChannelJamState.JAMMED))


def test_signs_of_life_go_on_while_nothing_changes(graph: Graph) -> None:
    """Commands, jam_state and diagnostics are repeated without any cause, for watchdogs and plain subscribers."""
    graph.jammable_driver()
    diagnostics: list[DiagnosticArray] = []
    topic = names.DIAGNOSTICS
    graph.node.create_subscription(DiagnosticArray, topic.name, diagnostics.append, subscriber_qos(topic))
    graph.ankle.heard.clear()
    states = len(graph.ankle.states)
    graph.spin_until(lambda: all(graph.ankle.heard.count(channel) > 10 for channel in names.CHANNELS))
    graph.spin_until(lambda: len(graph.ankle.states) > states + 1 and len(diagnostics) > 1)
    assert graph.ankle.all_in(ChannelJamState.UNJAMMED)


def test_lifecycle_rounds_release_and_answer(graph: Graph) -> None:
    """Three rounds: inactive refuses and releases, active jams, cleanup takes the services away."""
    driver = graph.driver(autostart=False)
    for _ in range(3):
        assert graph.transition(Transition.TRANSITION_CONFIGURE)
        refused = graph.call(Trigger, names.JAM_ALL.path)
        assert not refused.success
        assert "activate" in refused.message
        assert graph.transition(Transition.TRANSITION_ACTIVATE)
        graph.spin_until(lambda: graph.ankle.all_in(ChannelJamState.UNJAMMED))
        assert graph.call(Trigger, names.JAM_ALL.path).success
        graph.spin_until(lambda: graph.ankle.all_in(ChannelJamState.JAMMED))
        assert graph.transition(Transition.TRANSITION_DEACTIVATE)
        graph.spin_until(lambda: graph.ankle.released() and graph.ankle.all_in(ChannelJamState.UNKNOWN))
        assert graph.transition(Transition.TRANSITION_CLEANUP)
        graph.spin_until(lambda: not graph.node.get_publishers_info_by_topic(names.JAM_STATE.name))
        assert not [service for service in driver.services if service.service_name.endswith(names.JAM_ALL.suffix)]


def test_a_transition_that_is_not_allowed_is_refused(graph: Graph) -> None:
    """Activating twice answers false and leaves the driver alive and jammed."""
    graph.jammable_driver()
    graph.call(Trigger, names.JAM_ALL.path)
    assert not graph.transition(Transition.TRANSITION_ACTIVATE)
    graph.spin_until(lambda: graph.ankle.all_in(ChannelJamState.JAMMED))


@pytest.mark.parametrize("qos", [publisher_qos(names.EMERGENCY_STOP), QoSProfile(depth=10)], ids=["latched", "plain"])
def test_emergency_stop_from_any_publisher(graph: Graph, qos: QoSProfile) -> None:
    """A latched and a plain publisher both stop; only clear_fault after a false frees again."""
    graph.jammable_driver()
    graph.call(Trigger, names.JAM_ALL.path)
    graph.spin_until(lambda: graph.ankle.all_in(ChannelJamState.JAMMED))
    publisher = graph.node.create_publisher(Bool, names.EMERGENCY_STOP.name, qos)
    graph.spin_until(lambda: publisher.get_subscription_count() > 0)
    publisher.publish(Bool(data=True))
    graph.spin_until(lambda: graph.ankle.states[-1].emergency_stopped and graph.ankle.released())
    assert not graph.call(Trigger, names.JAM_ALL.path).success
    assert not graph.call(Trigger, names.CLEAR_FAULT.path).success
    publisher.publish(Bool(data=False))
    graph.spin_until(lambda: graph.call(Trigger, names.CLEAR_FAULT.path).success)
    assert graph.call(Trigger, names.JAM_ALL.path).success
    graph.spin_until(lambda: graph.ankle.all_in(ChannelJamState.JAMMED))


def test_an_emergency_stop_from_before_the_driver_holds(graph: Graph) -> None:
    """A driver that starts after a latched stop starts stopped."""
    publisher = graph.node.create_publisher(Bool, names.EMERGENCY_STOP.name, publisher_qos(names.EMERGENCY_STOP))
    publisher.publish(Bool(data=True))
    graph.driver()
    graph.spin_until(lambda: bool(graph.ankle.states) and graph.ankle.states[-1].emergency_stopped)


def test_a_clock_that_stands_keeps_no_real_ankle_jammed(graph: Graph) -> None:
    """With `use_sim_time` and a /clock that is paused, what is no simulation still goes stale by the steady clock."""
    clock = graph.node.create_publisher(ClockMessage, names.CLOCK.name, publisher_qos(names.CLOCK))
    steady = Clock(clock_type=ClockType.STEADY_TIME)
    graph.node.create_timer(0.1, lambda: clock.publish(ClockMessage(clock=Time(sec=5))), clock=steady)
    driver = graph.driver(hardware="fake", use_sim_time=True, diagnose=True)
    publisher = graph.node.create_publisher(JamCommand, names.JAM_COMMAND.name, publisher_qos(names.JAM_COMMAND))
    wish = JamCommand(channels=[ChannelJamCommand(channel="achilles", vacuum_pa=40e3)])
    stream = graph.node.create_timer(0.05, lambda: publisher.publish(wish), clock=steady)
    graph.spin_until(lambda: graph.ankle.state_of("achilles").state == ChannelJamState.JAMMED)
    stream.cancel()
    graph.spin_until(lambda: graph.ankle.state_of("achilles").state == ChannelJamState.UNJAMMED)
    assert "command_timeout_s" in graph.ankle.state_of("achilles").reason
    # Nor does it blind the diagnosis, whose readings are of the steady clock, too.
    driver._hardware.plant.inject(FakeFault.SENSOR_OUT_OF_RANGE, "achilles", 130e3)
    graph.spin_until(lambda: graph.ankle.state_of("achilles").fault == Fault.SENSOR_OUT_OF_RANGE)


def test_jam_commands_are_followed_until_they_go_stale(graph: Graph) -> None:
    """A streamed jam_command jams; when it stops coming, its channels are vented with the reason; others stay."""
    graph.jammable_driver()
    publisher = graph.node.create_publisher(JamCommand, names.JAM_COMMAND.name, publisher_qos(names.JAM_COMMAND))
    wish = JamCommand(channels=[ChannelJamCommand(channel="achilles", vacuum_pa=40e3)])
    timer = graph.node.create_timer(0.05, lambda: publisher.publish(wish))
    graph.call(Jam, names.JAM.path, channels=["peroneal_left"], vacuum_pa=40e3)
    graph.spin_until(lambda: graph.ankle.state_of("achilles").state == ChannelJamState.JAMMED)
    refused = graph.call(Jam, names.JAM.path, channels=["peroneal_left"], vacuum_pa=60e3)
    assert not refused.success
    assert "achilles holds 40000 Pa" in refused.message
    graph.node.destroy_timer(timer)
    graph.spin_until(lambda: graph.ankle.state_of("achilles").state == ChannelJamState.UNJAMMED)
    assert "command_timeout_s" in graph.ankle.state_of("achilles").reason
    # the other channel may be a little too deep just now, and be let up to its set point
    still = {"peroneal_left": True, "peroneal_right": False, "achilles": False}
    graph.spin_until(lambda: graph.ankle.solenoids == still)
    assert graph.ankle.state_of("peroneal_left").commanded_vacuum_pa == 40e3


def test_a_silent_pressure_is_a_fault_until_cleared(graph: Graph) -> None:
    """A channel whose sensor falls silent is released with a reason; clear_fault brings it back."""
    graph.jammable_driver()
    graph.call(Trigger, names.JAM_ALL.path)
    graph.spin_until(lambda: graph.ankle.all_in(ChannelJamState.JAMMED))
    graph.ankle.silent.add("achilles")
    graph.spin_until(lambda: graph.ankle.state_of("achilles").state == ChannelJamState.FAULT)
    assert "pressure_timeout_s" in graph.ankle.state_of("achilles").reason
    graph.spin_until(lambda: not graph.ankle.solenoids["achilles"])
    assert graph.ankle.solenoids["peroneal_left"]
    graph.ankle.silent.clear()
    assert graph.call(Trigger, names.CLEAR_FAULT.path).success
    graph.spin_until(lambda: graph.ankle.state_of("achilles").state == ChannelJamState.UNJAMMED)


def test_an_unknown_parameter_is_refused(graph: Graph) -> None:
    """A typing error in a parameter's name ends the start with one line that lists what there is."""
    with pytest.raises(ParameterError, match=r"jam_timeot_s.*jam_timeout_s"):
        DriverNode(context=graph.context, parameter_overrides=[Parameter("jam_timeot_s", value=1.0)])


def test_a_scripted_fault_of_the_fake_ankle_is_told_everywhere(graph: Graph) -> None:
    """A hole in the achilles line: FAULT with its reason on jam_state, numbers on /diagnostics, everything vented.

    The stop then says that nothing is wrong with venting, and clearing brings the ankle back once the hole is closed.
    """
    lines: dict[str, DiagnosticStatus] = {}
    topic = names.DIAGNOSTICS

    def take(array: DiagnosticArray) -> None:
        lines.update({status.name.partition(": ")[2]: status for status in array.status})

    graph.node.create_subscription(DiagnosticArray, topic.name, take, subscriber_qos(topic))
    script = "2.5 leak achilles 3e-10; 7 heal"
    driver = graph.jammable_driver(hardware="fake", fake_faults=script, diagnose=True, fault_policy="ankle")
    state = graph.ankle
    graph.spin_until(lambda: driver._driver.status.atmosphere.measured)
    assert graph.call(Trigger, names.JAM_ALL.path).success
    graph.spin_until(lambda: state.state_of("achilles").state == ChannelJamState.FAULT)
    assert state.state_of("achilles").fault == Fault.LEAK
    assert state.states[-1].fault.reason == Fault.LEAK
    assert "achilles" in state.states[-1].fault.text
    assert "vented" in state.states[-1].fault.action
    graph.spin_until(state.released)
    graph.spin_until(lambda: "fault" in lines and "LEAK" in lines["fault"].message)
    values = {value.key: value.value for value in lines["fault"].values}
    assert float(values["leak conductance (m^3/(s Pa))"]) == pytest.approx(3e-10, rel=0.5)
    assert not graph.call(Jam, names.JAM.path, channels=["peroneal_left"]).success
    assert graph.call(Trigger, names.UNJAM_ALL.path).success
    graph.spin_until(lambda: graph.call(Trigger, names.CLEAR_FAULT.path).success)
    graph.spin_until(lambda: state.all_in(ChannelJamState.UNJAMMED))


def test_a_bad_script_of_faults_ends_the_start(graph: Graph) -> None:
    """What cannot be read is refused before anything is driven, in one line."""
    driver = graph.driver(autostart=False, hardware="fake", fake_faults="1 explode")
    with pytest.raises(ParameterError, match="explode"):
        driver.on_configure(driver._state_machine.current_state)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_releases_everything(graph: Graph, number: signal.Signals) -> None:
    """A jammed driver process that gets SIGINT or SIGTERM releases everything, says nothing, and exits 0."""
    environment = {**os.environ, "ROS_DOMAIN_ID": str(graph.domain_id), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    with subprocess.Popen(
        [sys.executable, "-m", "jammkle_driver"], env=environment, stderr=subprocess.PIPE, text=True
    ) as process:
        try:
            graph.spin_until(lambda: graph.ankle.all_in(ChannelJamState.UNJAMMED))
            graph.call(Trigger, names.JAM_ALL.path)
            graph.spin_until(lambda: graph.ankle.all_in(ChannelJamState.JAMMED))
            process.send_signal(number)
            graph.spin_until(lambda: process.poll() is not None)
            graph.spin_until(graph.ankle.released)
            graph.spin_until(lambda: graph.ankle.all_in(ChannelJamState.UNKNOWN))
        finally:
            process.kill()
        _, said = process.communicate()
    assert process.returncode == 0, said
    assert "Traceback" not in said
