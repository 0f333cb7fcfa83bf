"""What the controller receives beside the IMU, as a real process on real DDS: foot switch, odometry, joint efforts."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import pytest
from controller_bench import GRAVITY_M_S2, INTERVAL_S, LANDED_AT_S, LEG_URDF
from diagnostic_msgs.msg import DiagnosticStatus
from nav_msgs.msg import Odometry
from rclpy.event_handler import PublisherEventCallbacks
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, String

from jammkle_common.names import (
    CHANNELS,
    FOOT_CONTACT,
    JOINT_STATES,
    ODOMETRY,
    ROBOT_DESCRIPTION,
)
from jammkle_common.qos import publisher_qos
from jammkle_msgs.msg import ContactEvent

if TYPE_CHECKING:
    from collections.abc import Callable

    from controller_bench import Bench


def describe(bench: Bench, topic: str) -> None:
    """Publish what the leg is, as robot_state_publisher does, after nonsense, and wait until it is known."""
    publisher = bench.node.create_publisher(String, topic, publisher_qos(ROBOT_DESCRIPTION))
    publisher.publish(String(data="<robot>"))
    bench.spin_until(lambda: "is no XML" in bench.health["inputs"].message, "what is wrong with it is reported")
    publisher.publish(String(data=LEG_URDF))
    bench.spin_until(lambda: "leg is not known" not in bench.health["inputs"].message, "the leg is known")


def test_other_inputs_are_named_and_vent(make_bench: Callable[..., Bench]) -> None:
    """A foot switch is named on /diagnostics once received; it opens and vents a stance, and the event says so."""
    bench = make_bench()
    bench.land()
    bench.stand(LANDED_AT_S + INTERVAL_S, LANDED_AT_S + 0.3)
    bench.spin_until(lambda: bench.set_points_pa() == dict.fromkeys(CHANNELS, 40e3), "the stance is held")
    assert "none" in bench.health["inputs"].message
    assert "a step is not felt on the body" in bench.health["inputs"].message
    assert "not felt on the body: lift-off of a step" in {each.key for each in bench.health["imu"].values}
    incompatible: list[object] = []
    switch = bench.node.create_publisher(
        Bool,
        FOOT_CONTACT.name,
        publisher_qos(FOOT_CONTACT),
        event_callbacks=PublisherEventCallbacks(incompatible_qos=incompatible.append),
    )
    bench.spin_until(lambda: switch.get_subscription_count() > 0, "the controller receives the switch")

    def closed_and_named() -> bool:
        switch.publish(Bool(data=True))  # again and again: that it is matched here does not say that it is there
        return "contact switch" in bench.health["inputs"].message

    bench.spin_until(closed_and_named, "the switch is named")
    assert "not felt" not in bench.health["inputs"].message
    assert not incompatible, "else rclpy warns whoever publishes that no messages will be sent"
    switch.publish(Bool(data=False))
    bench.spin_until(lambda: bench.set_points_pa() == dict.fromkeys(CHANNELS, 0.0), "the ankle is vented")
    bench.spin_until(lambda: bench.events[-1].source == "contact switch", "the lift-off is reported")
    assert bench.events[-1].type == ContactEvent.LIFTOFF


def test_odometry_is_named_reports_a_slip_and_is_missed(make_bench: Callable[..., Bench]) -> None:
    """With use_odometry a steady slide is reported, in the body's frame; once it is silent the IMU's slips are all."""
    shared = "/shared/odom"
    bench = make_bench("--ros-args", "-p", "use_odometry:=true", "-p", "robot_namespace:=/shared")
    unknown = "the leg is not known: no robot_description on /shared/robot_description"
    bench.spin_until(lambda: unknown in bench.health["inputs"].message, "the missing description is reported")
    describe(bench, "/shared/robot_description")
    joints = bench.node.create_publisher(JointState, JOINT_STATES.name, publisher_qos(JOINT_STATES))
    odometry = bench.node.create_publisher(Odometry, shared, publisher_qos(ODOMETRY))
    switch = bench.node.create_publisher(Bool, FOOT_CONTACT.name, publisher_qos(FOOT_CONTACT))
    missing = f"no odometry on {shared} that gives the speed of the sole"
    bench.spin_until(lambda: missing in bench.health["inputs"].message, "that there is none is reported")
    assert bench.health["inputs"].level == DiagnosticStatus.WARN
    for publisher in (joints, odometry, switch):
        bench.spin_until(lambda received=publisher: received.get_subscription_count() > 0, "the controller receives it")

    def go(speed_m_s: float) -> None:
        time_s = time.time()
        leg = JointState(name=["knee", "hip"], position=[-1.05, 0.52], velocity=[0.0, 0.0])
        body = Odometry(child_frame_id="base_link")
        leg.header.stamp.sec = body.header.stamp.sec = int(time_s)
        leg.header.stamp.nanosec = body.header.stamp.nanosec = round(time_s % 1.0 * 1e9)
        body.twist.twist.linear.x = speed_m_s + bench.noise.normal(0.0, 0.003)
        body.twist.covariance[0] = 0.01**2
        switch.publish(Bool(data=True))
        joints.publish(leg)
        odometry.publish(body)
        bench.feel(GRAVITY_M_S2, time_s)

    def named() -> bool:
        go(0.0)
        return bench.health["inputs"].message == "beside the IMU: contact switch, odometry"

    def reported() -> bool:
        go(0.3)
        return any(event.type == ContactEvent.SLIP for event in bench.events)

    bench.spin_until(named, "the odometry is named")
    assert bench.health["inputs"].level == DiagnosticStatus.OK
    assert not bench.events
    bench.spin_until(reported, "the slip is reported")
    slip = next(event for event in bench.events if event.type == ContactEvent.SLIP)
    assert (slip.source, slip.unit, slip.header.frame_id) == ("odometry", "m/s", "base_link")
    assert slip.magnitude == pytest.approx(0.3, abs=0.05)
    assert slip.direction.x > 0.95
    bench.spin_until(lambda: missing in bench.health["inputs"].message, "that it is silent is reported")


def test_efforts_are_named_and_vent_a_foot_that_bears_nothing(make_bench: Callable[..., Bench]) -> None:
    """With use_efforts the leg in joint_states is named; it lets go, and the lift-off is reported with its load."""
    bench = make_bench("--ros-args", "-p", "use_efforts:=true")
    describe(bench, ROBOT_DESCRIPTION.name)
    joints = bench.node.create_publisher(JointState, JOINT_STATES.name, publisher_qos(JOINT_STATES))
    bench.spin_until(lambda: joints.get_subscription_count() > 0, "the controller receives the joints")

    def stand_with(knee_n_m: float) -> None:
        for _ in range(5):
            time_s = time.time()  # the node's own clock: what is received lately is named
            leg = JointState(name=["knee", "hip"], position=[-1.05, 0.52], velocity=[0.0, 0.0], effort=[knee_n_m, 0.25])
            leg.header.stamp.nanosec = round(time_s % 1.0 * 1e9)
            leg.header.stamp.sec = int(time_s)
            joints.publish(leg)
            bench.feel(GRAVITY_M_S2, time_s)

    def named() -> bool:
        stand_with(1.3)
        return "joint efforts" in bench.health["inputs"].message

    def reported() -> bool:
        stand_with(-0.25)
        return bool(bench.events)

    bench.spin_until(named, "the efforts are named")
    bench.spin_until(reported, "the lift-off is reported")
    assert (bench.events[0].type, bench.events[0].source) == (ContactEvent.LIFTOFF, "joint efforts")
    assert (bench.events[0].unit, abs(bench.events[0].magnitude) < 4.0) == ("N", True)
