"""The driver node on real DDS, with a fake ankle that answers to solenoids and duty."""

from __future__ import annotations

import contextlib
import math
import os
import signal
import subprocess
import sys
import time
from typing import TYPE_CHECKING

import pytest
import rclpy
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from fake_ankle import graph_of_its_own
from lifecycle_msgs.msg import Transition
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock as ClockMessage
from std_msgs.msg import Bool
from std_srvs.srv import SetBool, Trigger

from driver_graph import FakeAnkle, Graph
from jammkle_common import names
from jammkle_common.messages import Level
from jammkle_common.parameters import ParameterError
from jammkle_common.qos import publisher_qos, subscriber_qos
from jammkle_driver.fake import FakeFault
from jammkle_driver.hardware import FakeHardware
from jammkle_driver.node import DriverNode
from jammkle_msgs.msg import ChannelJamCommand, ChannelJamState, Fault, JamCommand, JamState
from jammkle_msgs.srv import Jam, Unjam

if TYPE_CHECKING:
    from collections.abc import Iterator


@pytest.fixture
def graph() -> Iterator[Graph]:
    with graph_of_its_own(FakeAnkle) as graph:
        yield graph


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


def test_a_late_joiner_gets_the_latest_states(graph: Graph) -> None:
    """Who subscribes after the jam receives jam_state, solenoids and duty as they are now."""
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
    graph.ankle.received.clear()
    states = len(graph.ankle.states)
    graph.spin_until(lambda: all(graph.ankle.received.count(channel) > 10 for channel in names.CHANNELS))
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


def test_a_driver_that_is_finalized_says_so(graph: Graph, capfd: pytest.CaptureFixture[str]) -> None:
    """Its process lives on without topics, and `jammkle up` shows what it logs alone."""
    graph.driver()
    assert graph.transition(Transition.TRANSITION_ACTIVE_SHUTDOWN)
    assert "drives nothing any more; start the process anew" in capfd.readouterr().err


def test_a_reading_that_is_due_as_the_driver_closes_ends_nothing(graph: Graph) -> None:
    """Rclpy calls a timer that was due once more after it is destroyed: the driver died with a traceback."""
    driver = graph.driver(hardware="fake")
    hardware = driver._hardware
    assert isinstance(hardware, FakeHardware)
    assert graph.transition(Transition.TRANSITION_ACTIVE_SHUTDOWN)
    hardware._exchange()


def test_a_transition_that_is_not_allowed_is_refused(graph: Graph) -> None:
    """Activating twice answers false and leaves the driver alive and jammed."""
    graph.jammable_driver()
    graph.call(Trigger, names.JAM_ALL.path)
    assert not graph.transition(Transition.TRANSITION_ACTIVATE)
    graph.spin_until(lambda: graph.ankle.all_in(ChannelJamState.JAMMED))


BEST_EFFORT = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)


@pytest.mark.parametrize(
    "qos",
    [publisher_qos(names.EMERGENCY_STOP), QoSProfile(depth=10), BEST_EFFORT],
    ids=["latched", "plain", "best effort"],
)
def test_emergency_stop_from_any_publisher(graph: Graph, qos: QoSProfile) -> None:
    """Whatever a publisher offers, it stops; only clear_fault after a false frees again, not one of somebody else."""
    graph.jammable_driver()
    graph.call(Trigger, names.JAM_ALL.path)
    graph.spin_until(lambda: graph.ankle.all_in(ChannelJamState.JAMMED))
    publisher = graph.node.create_publisher(Bool, names.EMERGENCY_STOP.name, qos)
    graph.spin_until(lambda: publisher.get_subscription_count() > 0)
    publisher.publish(Bool(data=True))
    graph.spin_until(lambda: graph.ankle.states[-1].emergency_stopped and graph.ankle.released())
    assert not graph.call(Trigger, names.JAM_ALL.path).success
    assert not graph.call(Trigger, names.CLEAR_FAULT.path).success
    other = graph.node.create_publisher(Bool, names.EMERGENCY_STOP.name, QoSProfile(depth=10))
    graph.spin_until(lambda: other.get_subscription_count() > 1)
    other.publish(Bool(data=False))
    refused = []

    def names_both() -> bool:
        refused.append(graph.call(Trigger, names.CLEAR_FAULT.path))
        return "1 of 2 publishers" in refused[-1].message

    graph.spin_until(names_both)
    assert not any(answer.success for answer in refused)
    for each in (publisher, other):
        each.publish(Bool(data=False))
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
    set_point = JamCommand(channels=[ChannelJamCommand(channel="achilles", vacuum_pa=40e3)])
    stream = graph.node.create_timer(0.05, lambda: publisher.publish(set_point), clock=steady)
    graph.spin_until(lambda: graph.ankle.state_of("achilles").state == ChannelJamState.JAMMED)
    stream.cancel()
    graph.spin_until(lambda: graph.ankle.state_of("achilles").state == ChannelJamState.UNJAMMED)
    assert "command_timeout_s" in graph.ankle.state_of("achilles").reason
    # Nor does it blind the diagnosis, whose readings are of the steady clock, too.
    driver._hardware.board.plant.inject(FakeFault.SENSOR_OUT_OF_RANGE, "achilles", 130e3)
    graph.spin_until(lambda: graph.ankle.state_of("achilles").fault == Fault.SENSOR_OUT_OF_RANGE)


def test_a_refusal_stays_until_a_command_is_taken(graph: Graph) -> None:
    """Of a reliable publisher, whose messages both subscriptions of the driver receive: the copy takes nothing back."""
    graph.jammable_driver()
    publisher = graph.node.create_publisher(JamCommand, names.JAM_COMMAND.name, publisher_qos(names.JAM_COMMAND))
    graph.spin_until(lambda: publisher.get_subscription_count() == 2)
    publisher.publish(JamCommand(channels=[ChannelJamCommand(channel="soleus", vacuum_pa=40e3)]))
    graph.spin_until(lambda: "unknown channel 'soleus'" in graph.ankle.states[-1].refused_command)
    since = len(graph.ankle.states)
    graph.spin_until(lambda: len(graph.ankle.states) > since + 5)
    assert all("soleus" in state.refused_command for state in graph.ankle.states[since:])
    publisher.publish(JamCommand(channels=[ChannelJamCommand(channel="achilles", vacuum_pa=40e3)]))
    graph.spin_until(lambda: not graph.ankle.states[-1].refused_command)


def test_a_configuration_that_fails_leaves_nothing_behind(graph: Graph) -> None:
    """Each time that hardware cannot be made, the topics of the try before are gone."""
    driver = graph.driver(hardware="fake", autostart=False)
    make = driver._make_hardware

    def fail(_context: object) -> None:
        msg = "the board file is gone"
        raise ValueError(msg)

    driver._make_hardware = fail
    for _ in range(3):
        driver.trigger_configure()
    driver._make_hardware = make
    driver.trigger_configure()
    graph.spin_until(lambda: driver.count_publishers(names.PUMP_DUTY.name) == 1)


@contextlib.contextmanager
def process_of_its_own(graph: Graph, *arguments: str) -> Iterator[subprocess.Popen[str]]:
    """Start a driver as its own process, which can be held up, and wait until it is soft."""
    environment = {**os.environ, "ROS_DOMAIN_ID": str(graph.domain_id), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    with subprocess.Popen(
        [sys.executable, "-m", "jammkle_driver", *arguments], env=environment, stderr=subprocess.PIPE, text=True
    ) as process:
        try:
            graph.spin_until(lambda: graph.ankle.all_in(ChannelJamState.UNJAMMED))
            yield process
        finally:
            process.kill()


def test_what_is_sent_once_counts_with_a_driver_that_was_held_up(graph: Graph) -> None:
    """The way back after a service is said once, a stop is pressed and let go: both count, whatever follows them."""
    points = [ChannelJamCommand(channel=channel, vacuum_pa=40e3) for channel in names.CHANNELS]
    command = graph.node.create_publisher(JamCommand, names.JAM_COMMAND.name, publisher_qos(names.JAM_COMMAND))
    stop = graph.node.create_publisher(Bool, names.EMERGENCY_STOP.name, publisher_qos(names.EMERGENCY_STOP))
    with process_of_its_own(graph) as process:
        graph.spin_until(lambda: command.get_subscription_count() == 2 and stop.get_subscription_count() == 3)
        command.publish(JamCommand(channels=points))
        graph.spin_until(lambda: graph.ankle.all_in(ChannelJamState.JAMMED))
        assert graph.call(Unjam, names.UNJAM.path, channels=[]).success
        graph.spin_until(lambda: graph.ankle.all_in(ChannelJamState.UNJAMMED))
        process.send_signal(signal.SIGSTOP)
        for number in range(25):
            command.publish(JamCommand(channels=points, anew=number == 3))
        process.send_signal(signal.SIGCONT)
        graph.spin_until(lambda: graph.ankle.all_in(ChannelJamState.JAMMED))
        process.send_signal(signal.SIGSTOP)
        for number in range(25):
            stop.publish(Bool(data=number < 5))
        process.send_signal(signal.SIGCONT)
        graph.spin_until(lambda: graph.ankle.states[-1].emergency_stopped and graph.ankle.released())


def test_a_fake_ankle_waits_for_a_driver_that_was_held_up(graph: Graph) -> None:
    """On a busy machine its process may get no core for longer than a board's watchdog: what a service jammed holds."""
    with process_of_its_own(graph, "--ros-args", "-p", "hardware:=fake") as process:
        assert graph.call(Jam, names.JAM.path, channels=[]).success
        graph.spin_until(lambda: graph.ankle.all_in(ChannelJamState.JAMMED))
        begun = len(graph.ankle.states)
        for held_up_s in (0.22, 0.3, 1.0):
            process.send_signal(signal.SIGSTOP)
            time.sleep(held_up_s)
            process.send_signal(signal.SIGCONT)
            after = len(graph.ankle.states)
            graph.spin_until(lambda after=after: len(graph.ankle.states) > after + 1)
        states = {channel.state for state in graph.ankle.states[begun:] for channel in state.channels}
        assert states == {ChannelJamState.JAMMED}


def test_a_stop_by_another_name_is_not_taken_back_by_others(graph: Graph) -> None:
    """With `emergency_stop` remapped, as for one stop of four ankles, a true counts while its publisher lives."""
    hand, other = (graph.node.create_publisher(Bool, "/robot/e_stop", 10) for _ in range(2))
    with process_of_its_own(graph, "--ros-args", "-r", "emergency_stop:=/robot/e_stop"):
        graph.spin_until(lambda: {hand.get_subscription_count(), other.get_subscription_count()} == {2})
        hand.publish(Bool(data=True))
        graph.spin_until(lambda: graph.ankle.states[-1].emergency_stopped)
        begun = len(graph.ankle.states)
        graph.spin_until(lambda: len(graph.ankle.states) > begun + 4)  # 2 s: those who left would count as gone
        other.publish(Bool(data=False))
        begun = len(graph.ankle.states)
        graph.spin_until(lambda: len(graph.ankle.states) > begun + 1)
        assert "still true" in graph.call(Trigger, names.CLEAR_FAULT.path).message


def test_two_that_command_at_once_are_reported(graph: Graph) -> None:
    """They contradict one another, one by best effort: the channel stays as the latest change has it."""
    driver = graph.jammable_driver()
    first = graph.node.create_publisher(JamCommand, names.JAM_COMMAND.name, publisher_qos(names.JAM_COMMAND))
    second = graph.node.create_publisher(JamCommand, names.JAM_COMMAND.name, BEST_EFFORT)
    graph.spin_until(lambda: second.get_subscription_count() > 0)

    def publish() -> None:
        for publisher, vacuum_pa in ((first, 0.0), (second, 40e3)):
            publisher.publish(JamCommand(channels=[ChannelJamCommand(channel="achilles", vacuum_pa=vacuum_pa)]))

    graph.node.create_timer(0.05, publish)
    graph.spin_until(lambda: graph.ankle.state_of("achilles").state == ChannelJamState.JAMMED)
    since = len(graph.ankle.states)
    graph.spin_until(lambda: len(graph.ankle.states) > since)
    assert graph.ankle.state_of("achilles").commanded_vacuum_pa == 40e3
    line = next(line for line in driver._health() if line.about == "jam_command")
    assert line.level is Level.WARN
    assert "2 publishers at once" in line.message


def test_an_unknown_parameter_is_refused(graph: Graph) -> None:
    """A typing error in a parameter's name ends the start with one line that lists what there is."""
    with pytest.raises(ParameterError, match=r"jam_timeot_s.*jam_timeout_s"):
        DriverNode(context=graph.context, parameter_overrides=[Parameter("jam_timeot_s", value=1.0)])


REFUSED = (
    ("hardware", "fake", "'hardware' is 'sim'; it stays so while the node runs"),
    ("port", "/dev/null", "'port' is ''; it stays so while the node runs"),
    ("board_file", "other.yaml", "stop the node and start it with -p board_file:=VALUE"),
    ("use_sim_time", True, "'use_sim_time' is False; it stays so while the node runs"),
    ("max_vacuum_pa", 60e3, "'max_vacuum_pa' is 70000; it stays so while the node runs"),
    ("default_vacuum_pa", 90e3, "'default_vacuum_pa' is 90000; it must be from min_vacuum_pa to max_vacuum_pa"),
    ("default_vacuum_pa", math.nan, "'default_vacuum_pa' is nan; it must be a finite number"),
    ("ambient_pressure_pa", "high", "'ambient_pressure_pa' is 'high'; it must be a number"),
)
"""A change of a parameter that is not taken, and words of the answer."""


def test_what_may_not_change_is_refused_with_the_reason(graph: Graph) -> None:
    """As `ros2 param set` asks: pins and limits keep their values with why and the way out, the jam goes on."""
    driver = graph.jammable_driver()
    assert graph.call(Trigger, names.JAM_ALL.path).success
    graph.spin_until(lambda: graph.ankle.all_in(ChannelJamState.JAMMED))
    for name, value, words in REFUSED:
        before = driver.get_parameter(name).value
        parameters = [Parameter(name, value=value).to_parameter_msg()]
        (result,) = graph.call(SetParameters, "driver/set_parameters", parameters=parameters).results
        at_once = graph.call(SetParametersAtomically, "driver/set_parameters_atomically", parameters=parameters).result
        assert (result.successful, at_once.successful) == (False, False)
        assert words in result.reason
        assert at_once.reason == result.reason
        assert driver.get_parameter(name).value == before
    assert {channel.commanded_vacuum_pa for channel in graph.ankle.states[-1].channels} == {50e3}
    graph.spin_until(lambda: graph.ankle.all_in(ChannelJamState.JAMMED))


def test_the_set_point_of_the_next_jam_may_change_while_jammed(graph: Graph) -> None:
    """What is dynamic is taken, and counts from the next request on."""
    graph.jammable_driver()
    assert graph.call(Trigger, names.JAM_ALL.path).success
    parameter = Parameter("default_vacuum_pa", value=30e3).to_parameter_msg()
    assert graph.call(SetParameters, "driver/set_parameters", parameters=[parameter]).results[0].successful
    assert graph.ankle.state_of("achilles").commanded_vacuum_pa == 50e3
    assert graph.call(Trigger, names.JAM_ALL.path).success
    graph.spin_until(lambda: graph.ankle.state_of("achilles").commanded_vacuum_pa == 30e3)


def test_a_bad_script_of_faults_ends_the_start(graph: Graph) -> None:
    """What cannot be read is refused before anything is driven, in one line."""
    with pytest.raises(ParameterError, match=r"parameter 'fake_faults': line 1 of the script .* 'explode'"):
        graph.driver(hardware="fake", fake_faults="1 explode")


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
