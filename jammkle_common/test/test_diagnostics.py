"""When a node reports its health: not before it knows the time, unless that does not come."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING, Any

import pytest
import rclpy
from builtin_interfaces.msg import Time
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Header

from domains import own_domain, wait_until
from jammkle_common import diagnostics
from jammkle_common.diagnostics import DiagnosticsPublisher
from jammkle_common.lockstep import LockstepNode
from jammkle_common.messages import Health, Level
from jammkle_common.names import CLOCK, LOCKSTEP
from jammkle_common.qos import answer_qos, publisher_qos
from jammkle_msgs.msg import ChannelJamCommand, JamCommand

if TYPE_CHECKING:
    from collections.abc import Iterator

HEALTH = [Health("toy", Level.OK, "well", {})]


class Sent:
    """A publisher that keeps what is published."""

    def __init__(self) -> None:
        self.stamps: list[Time] = []

    def publish(self, array: Any) -> None:
        self.stamps.append(array.header.stamp)


@pytest.fixture
def node(monkeypatch: pytest.MonkeyPatch) -> Iterator[LockstepNode]:
    """Make a node that lives in simulated time, in a domain of its own."""
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    with own_domain() as domain, contextlib.ExitStack() as stack:
        context = rclpy.Context()
        rclpy.init(context=context, domain_id=domain, signal_handler_options=SignalHandlerOptions.NO)
        stack.callback(rclpy.shutdown, context=context)
        simulated = Parameter("use_sim_time", value=True)
        made = LockstepNode("toy", context=context, parameter_overrides=[simulated])
        stack.callback(made.destroy_node)
        yield made


def reporting(node: LockstepNode, monkeypatch: pytest.MonkeyPatch) -> tuple[DiagnosticsPublisher, Sent]:
    """Return what reports for a node, and what it sends."""
    sent = Sent()
    with monkeypatch.context() as patch:
        patch.setattr(node, "create_publisher", lambda *_: sent)
        return DiagnosticsPublisher(node, "toy", lambda: HEALTH), sent


def test_a_node_that_knows_no_time_yet_reports_with_the_first_tick(
    node: LockstepNode, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A stamp of zero is right where the clock stands at zero alone; the report comes as soon as the tick does."""
    publisher, sent = reporting(node, monkeypatch)
    monkeypatch.setattr(diagnostics, "_FIRST_TICK_WITHIN_S", 1e9)
    publisher.check()
    publisher.publish()
    assert not sent.stamps
    clock = node.create_publisher(Clock, CLOCK.name, publisher_qos(CLOCK))
    executor = SingleThreadedExecutor(context=node.context)
    executor.add_node(node)

    def has_reported() -> bool:
        clock.publish(Clock(clock=Time(sec=90)))
        executor.spin_once(timeout_sec=0.1)
        return bool(sent.stamps)

    wait_until(has_reported, "it reports")
    executor.shutdown()
    assert set(map(str, sent.stamps)) == {str(Time(sec=90))}


def test_a_node_whose_clock_does_not_come_reports_all_the_same(
    node: LockstepNode, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Somebody must say that there is no /clock."""
    publisher, sent = reporting(node, monkeypatch)
    monkeypatch.setattr(diagnostics, "_FIRST_TICK_WITHIN_S", 0.0)
    publisher.check()
    assert sent.stamps == [Time()]


def test_what_waits_for_a_step_is_dealt_with_while_a_simulation_is_paused(node: LockstepNode) -> None:
    """Messages of a tick that is repeated come with the next repetition, in order, and pile up nowhere."""
    taken: list[int] = []
    listener = rclpy.create_node("sim", context=node.context)
    listener.create_subscription(Header, LOCKSTEP.name, lambda _: None, answer_qos())
    wait_until(lambda: node.count_subscribers(LOCKSTEP.name) > 0, "somebody waits for this node")
    take = node._at_the_tick("jam_command", lambda message: taken.append(message.channels))
    node._take_tick(5 * 10**9)
    for number in range(200):
        take(JamCommand(header=Header(stamp=Time(sec=5)), channels=[ChannelJamCommand(channel=str(number))]))
        if number % 10 == 9:
            node._take_tick(5 * 10**9)
    assert [channels[0].channel for channels in taken] == [str(number) for number in range(190)]
    node._take_tick(5 * 10**9)
    assert len(taken) == 200
    listener.destroy_node()
