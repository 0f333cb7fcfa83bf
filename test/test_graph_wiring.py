"""The wiring of the running graph: who publishes what, with which QoS, and what late joiners get."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING

import pytest
from rclpy.qos import QoSCompatibility, qos_check_compatible

from graph import Probe, Up, interface, shared_graph
from jammkle_common.names import (
    CHANNELS,
    CLOCK,
    CONTROLLER_NODE,
    DRIVER_NODE,
    EMERGENCY_STOP,
    FROM_OUTSIDE,
    IMU,
    JAM_STATE,
    LOCKSTEP,
    RESET,
    SERVICES,
    SIM_NODE,
    SIM_PARAMETERS,
    SOLENOIDS,
    TOPICS,
)
from jammkle_msgs.msg import ChannelJamState

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from builtin_interfaces.msg import Time

LATE_S = 2.0
NODES = (DRIVER_NODE, CONTROLLER_NODE, SIM_NODE)
ROS_OWN_SERVICES = ("rcl_interfaces/", "type_description_interfaces/", "lifecycle_msgs/")
"""Services that ROS gives every node or every lifecycle node."""


def test_a_stop_that_came_before_the_driver_is_heeded(
    start: Callable[..., Up], make_probe: Callable[..., Probe]
) -> None:
    """A latched emergency stop holds a driver that starts after it."""
    probe = make_probe()
    stop = probe.publisher(EMERGENCY_STOP)
    stop.publish(interface(EMERGENCY_STOP.message_type)(data=True))
    start("up")
    probe.listen(JAM_STATE)
    probe.spin_until(lambda: probe.last(JAM_STATE).emergency_stopped, "the driver is stopped")


def seconds(stamp: Time) -> float:
    """Time of a stamp, s."""
    return float(stamp.sec + stamp.nanosec * 1e-9)


def test_two_ankles_live_side_by_side(
    start: Callable[..., Up], make_probe: Callable[..., Probe], left_alone: tuple[str, str]
) -> None:
    """Two namespaces share a domain: the second takes the time of the first, and is soft while that is jammed."""
    left, right = make_probe("/lf_ankle"), make_probe("/rf_ankle")
    start("up", "--namespace", "lf_ankle", *left_alone)
    left.listen(CLOCK, JAM_STATE)
    left.spin_until(lambda: left.has(CLOCK) and seconds(left.last(CLOCK).clock) > LATE_S, "time goes on")
    right.listen(CLOCK, IMU, JAM_STATE)
    up = start("up", "--namespace", "rf_ankle", *left_alone)
    right.wait_until_up()
    right.spin_until(lambda: right.has(IMU), "the second ankle's IMU is received")
    right.spin_until(lambda: len(right.node.get_publishers_info_by_topic(CLOCK.name)) == 1, "there is one clock")
    assert "already, so this simulation publishes none" in up.text()
    right.spin_until(
        lambda: abs(seconds(right.last(IMU).header.stamp) - seconds(right.last(CLOCK).clock)) < LATE_S / 2,
        "the second ankle lives in the time of the first",
    )

    left.wait_until_up()
    start("jam", "--namespace", "/lf_ankle").wait()
    left.wait_until_jammed()
    assert set(right.channel_states()) == set(CHANNELS)
    assert not {ChannelJamState.JAMMING, ChannelJamState.JAMMED} & set(right.channel_states().values())


@pytest.fixture(scope="module")
def probe(tmp_path_factory: pytest.TempPathFactory, left_alone: tuple[str, str]) -> Iterator[Probe]:
    """Bring up one ankle for the tests that only look on, and wait until its driver knows every channel."""
    with shared_graph(tmp_path_factory.mktemp("wiring"), "up", "--monitor", *left_alone) as (_, looking_on):
        # What a node offers is announced one by one after the node itself, and on a busy machine that takes a while.
        known = looking_on.node.get_node_names
        looking_on.spin_until(lambda: set(NODES) <= set(known()), "every node is discovered")
        looking_on.spin_until(lambda: not _unannounced(looking_on), "every topic and service is announced")
        yield looking_on


def _unannounced(looking_on: Probe) -> list[str]:
    """Topics that nobody publishes yet, and services that nobody offers yet."""
    services = {name for name, _ in looking_on.node.get_service_names_and_types()}
    publishers = {topic.name: looking_on.node.count_publishers(topic.name) for topic in TOPICS}
    return [
        *(topic.name for topic in TOPICS if topic not in FROM_OUTSIDE and not publishers[topic.name]),
        *(f"/{each.path}" for each in SERVICES if f"/{each.path}" not in services),
    ]


def test_every_pair_of_publisher_and_subscriber_fits(probe: Probe) -> None:
    """On every topic of the graph, each publisher is compatible with each subscriber, in type and in QoS."""
    for topic in TOPICS:
        publishers = probe.node.get_publishers_info_by_topic(topic.name)
        subscribers = probe.node.get_subscriptions_info_by_topic(topic.name)
        if topic not in FROM_OUTSIDE:
            assert publishers, f"nobody publishes {topic.name}"
        assert {end.topic_type for end in publishers + subscribers} <= {topic.message_type}
        for publisher in publishers:
            for subscriber in subscribers:
                verdict, reason = qos_check_compatible(publisher.qos_profile, subscriber.qos_profile)
                assert verdict == QoSCompatibility.OK, (
                    f"{topic.name}: {publisher.node_name} -> {subscriber.node_name}: {reason}"
                )


def test_there_is_no_topic_that_is_not_in_the_table(probe: Probe) -> None:
    """Every topic that a node of ours publishes or takes is one of the documented ones, or ROS's own."""
    known = {topic.name if topic.name.startswith("/") else f"/{topic.name}" for topic in (*TOPICS, LOCKSTEP)}
    known |= {"/rosout", "/parameter_events"} | {f"/{node}/transition_event" for node in NODES}
    for node in NODES:
        pairs = probe.node.get_publisher_names_and_types_by_node(node, "/")
        pairs += probe.node.get_subscriber_names_and_types_by_node(node, "/")
        assert {name for name, _ in pairs} <= known


def test_the_services_are_those_in_the_table(probe: Probe) -> None:
    """Each node offers exactly the services of the table, with their types."""
    for node in NODES:
        wanted = {(f"/{each.path}", each.service_type) for each in SERVICES if each.node == node}

        def offered(node: str = node) -> set[tuple[str, str]]:
            found = probe.node.get_service_names_and_types_by_node(node, "/")
            return {(name, types[0]) for name, types in found if not types[0].startswith(ROS_OWN_SERVICES)}

        probe.spin_until(lambda offered=offered, wanted=wanted: offered() >= wanted, f"all of {node} are offered")
        assert offered() == wanted


def test_who_joins_late_gets_what_is_latched(probe: Probe) -> None:
    """jam_state, the solenoids and the simulation's parameters reach a subscriber that comes after them."""
    latched = (SIM_PARAMETERS, JAM_STATE, *SOLENOIDS.values())
    with contextlib.closing(Probe(probe.context.get_domain_id())) as late:
        late.listen(*latched)
        late.spin_until(lambda: all(late.received[topic.name] for topic in latched), "everything latched has come")
        assert "slope_deg" in late.last(SIM_PARAMETERS).data


def test_the_clock_never_runs_backwards(probe: Probe) -> None:
    """Ticks rise while the simulation runs, and do not fall in a reset; one that is missed comes twice."""
    probe.listen(CLOCK)
    probe.spin_until(lambda: len(probe.received[CLOCK.name]) > 200, "the clock ticked 200 times")
    assert probe.call(RESET).success
    probe.spin_until(lambda: len(probe.received[CLOCK.name]) > 400, "the clock ticks on")
    ticks_ns = [tick.clock.sec * 10**9 + tick.clock.nanosec for tick in probe.received[CLOCK.name]]
    assert ticks_ns == sorted(ticks_ns)
