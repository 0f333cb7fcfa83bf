"""The controller as a real process on real DDS; the test plays the IMU and listens."""

from __future__ import annotations

import math
import os
import signal
import struct
import subprocess
import sys
import time
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from nav_msgs.msg import Odometry
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from rclpy.executors import SingleThreadedExecutor
from rclpy.serialization import serialize_message
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import Imu, JointState
from std_msgs.msg import Bool
from std_srvs.srv import SetBool

from jammkle_graph.names import (
    CHANNELS,
    CONTACT_EVENTS,
    DIAGNOSTICS,
    FOOT_CONTACT,
    IMU,
    JAM_COMMAND,
    JAM_STATE,
    JOINT_STATES,
    ODOMETRY,
    SET_AUTO,
    UNJAM,
)
from jammkle_graph.qos import publisher_qos, subscriber_qos
from jammkle_graph.testing import own_domain
from jammkle_msgs.msg import ChannelJamState, ContactEvent, Fault, JamCommand, JamState

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

TIMEOUT_S = 30.0
INTERVAL_S = 0.004
FALL_S, LANDED_AT_S = 0.1, 0.5
GRAVITY_M_S2 = 9.80665


class Bench:
    """A controller process, and a node that publishes IMU samples and keeps what the controller says."""

    def __init__(self, domain_id: int, folder: Path, *arguments: str) -> None:
        self.errors = folder / "stderr.txt"
        environment = {**os.environ, "ROS_DOMAIN_ID": str(domain_id), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
        command = [sys.executable, "-m", "jammkle_controller", *arguments]
        with self.errors.open("w") as errors:
            self.process = subprocess.Popen(command, env=environment, stdout=errors, stderr=errors)
        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=domain_id, signal_handler_options=SignalHandlerOptions.NO)
        self.node = rclpy.create_node("bench", context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.noise = np.random.default_rng(1)
        self.events: list[ContactEvent] = []
        self.commands: list[JamCommand] = []
        self.health: dict[str, DiagnosticStatus] = {}
        self.reports = 0
        self.encode: Callable[[Imu], Imu | bytes] = lambda message: message
        self.imu = self.node.create_publisher(Imu, IMU.name, publisher_qos(IMU))
        for kind, topic, take in (
            (ContactEvent, CONTACT_EVENTS, self.events.append),
            (JamCommand, JAM_COMMAND, self.commands.append),
            (DiagnosticArray, DIAGNOSTICS, self._hear),
        ):
            self.node.create_subscription(kind, topic.name, take, subscriber_qos(topic))

    def _hear(self, message: DiagnosticArray) -> None:
        self.reports += 1
        self.health.update({status.name.split(": ")[1]: status for status in message.status})

    def close(self) -> None:
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)

    def spin_until(self, holds: Callable[[], bool], what: str) -> None:
        deadline_s = time.monotonic() + TIMEOUT_S
        while not holds():
            if time.monotonic() > deadline_s:
                said = self.events[-1:], self.commands[-1:], self.health, self.errors.read_text()
                pytest.fail(f"gave up waiting until {what}; last heard: {said}")
            self.executor.spin_once(timeout_sec=0.05)

    def wait_until_up(self) -> None:
        self.spin_until(lambda: bool(self.commands) and bool(self.health), "the controller is heard")
        self.spin_until(lambda: self.imu.get_subscription_count() > 0, "the controller hears the IMU")

    def feel(self, force_m_s2: float, time_s: float) -> None:
        """Publish one IMU sample with a specific force along z, and the noise of a living sensor."""
        message = Imu()
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(round(time_s * 1e9), 1_000_000_000)
        message.header.frame_id = "imu"
        force, rate = message.linear_acceleration, message.angular_velocity
        force.x, force.y, force.z = self.noise.normal((0.0, 0.0, force_m_s2), 0.02).tolist()
        rate.x, rate.y, rate.z = self.noise.normal(0.0, 0.002, 3).tolist()
        message.orientation_covariance[0] = -1.0
        self.imu.publish(self.encode(message))
        self.executor.spin_once(timeout_sec=0.001)

    def stand(self, from_s: float, until_s: float) -> None:
        for index in range(round((until_s - from_s) / INTERVAL_S)):
            self.feel(GRAVITY_M_S2, from_s + index * INTERVAL_S)

    def land(self) -> None:
        """Stand, fall for 0.1 s, and hit the ground at `LANDED_AT_S`; that sample is the last."""
        self.stand(0.1, LANDED_AT_S - FALL_S)
        for index in range(round(FALL_S / INTERVAL_S)):
            self.feel(0.0, LANDED_AT_S - FALL_S + index * INTERVAL_S)
        self.feel(40.0, LANDED_AT_S)
        self.spin_until(lambda: self.kinds()[-1:] == [ContactEvent.IMPACT], "the impact is told")

    def kinds(self) -> list[int]:
        return [event.type for event in self.events]

    def wishes(self) -> dict[str, float]:
        return {channel.channel: channel.vacuum_pa for channel in self.commands[-1].channels}

    def hear_more(self, count: int = 4) -> None:
        """Wait for some more commands of the steady stream."""
        seen = len(self.commands)
        self.spin_until(lambda: len(self.commands) >= seen + count, "commands go on")

    def call(self, kind: Any, name: str, request: Any) -> Any:
        client = self.node.create_client(kind, name)
        self.spin_until(client.service_is_ready, f"{name} is offered")
        future = client.call_async(request)
        self.spin_until(future.done, f"{name} answers")
        return future.result()

    def set_parameter(self, name: str, value: float) -> Any:
        given = ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=value)
        request = SetParameters.Request(parameters=[Parameter(name=name, value=given)])
        return self.call(SetParameters, "controller/set_parameters", request).results[0]

    def driver_says(self, state: JamState) -> None:
        """Play the driver, latched as it is."""
        publisher = self.node.create_publisher(JamState, JAM_STATE.name, publisher_qos(JAM_STATE))
        self.spin_until(lambda: publisher.get_subscription_count() > 0, "the controller hears the driver")
        publisher.publish(state)

    def policy_says(self, word: str) -> bool:
        return "policy" in self.health and word in self.health["policy"].message

    def set_auto(self, *, on: bool) -> SetBool.Response:
        return self.call(SetBool, SET_AUTO.path, SetBool.Request(data=on))

    def stop(self, number: signal.Signals) -> int:
        self.process.send_signal(number)
        return self.process.wait(timeout=TIMEOUT_S)


@pytest.fixture
def make_bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Bench]]:
    """Make a bench in a ROS domain of its own."""
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    benches: list[Bench] = []
    with own_domain() as number:

        def make(*arguments: str) -> Bench:
            benches.append(Bench(number, tmp_path, *arguments))
            return benches[-1]

        yield make
        for bench in benches:
            bench.close()


def big_endian(message: Imu) -> bytes:
    """Return a message as a machine of the other byte order sends it."""
    serialized = serialize_message(message)
    words = struct.unpack_from("<iII", serialized, 4)
    numbers = struct.unpack("<37d", serialized[-37 * 8 :])
    return (
        b"\0\0"
        + serialized[2:4]
        + struct.pack(">iII", *words)
        + serialized[16 : -37 * 8]
        + struct.pack(">37d", *numbers)
    )


def test_an_imu_of_the_other_byte_order_is_felt_as_well(make_bench: Callable[..., Bench]) -> None:
    bench = make_bench()
    bench.wait_until_up()
    bench.encode = big_endian
    bench.land()
    assert bench.events[-1].header.frame_id == "imu"


def test_landing_is_told_and_jams_after_the_delay(make_bench: Callable[..., Bench]) -> None:
    """A landing gives events stamped with their samples, and vacuum once the samples' time has passed the delay.

    The delay is the samples' time, not the wall's: while no sample comes, as in a paused simulation, nothing jams.
    """
    bench = make_bench()
    bench.wait_until_up()
    assert bench.wishes() == dict.fromkeys(CHANNELS, 0.0)
    bench.land()
    liftoff, impact = bench.events
    assert liftoff.type == ContactEvent.LIFTOFF
    stamp = impact.header.stamp
    assert stamp.sec + stamp.nanosec * 1e-9 == pytest.approx(LANDED_AT_S, abs=1e-9)
    assert impact.header.frame_id == "imu"
    assert impact.unit == "m/s^2"
    assert impact.magnitude == pytest.approx(40.0, abs=0.2)
    assert impact.probability > 0.9
    assert impact.source == "imu"
    bench.hear_more()
    assert bench.wishes() == dict.fromkeys(CHANNELS, 0.0)
    bench.feel(30.0, LANDED_AT_S + 0.019)
    bench.hear_more()
    assert bench.wishes() == dict.fromkeys(CHANNELS, 0.0)
    bench.feel(20.0, LANDED_AT_S + 0.02)
    bench.spin_until(lambda: bench.wishes() == dict.fromkeys(CHANNELS, 40e3), "the channels are to be jammed")
    bench.stand(LANDED_AT_S + 0.024, LANDED_AT_S + 0.4)
    bench.spin_until(lambda: bench.kinds()[-1] == ContactEvent.SETTLED, "the landing settles")
    assert bench.wishes() == dict.fromkeys(CHANNELS, 40e3)


def test_delay_of_zero_can_be_set_while_running(make_bench: Callable[..., Bench]) -> None:
    """jam_delay_s is dynamic: with zero the impact's own sample jams; out of range is refused by name and limit."""
    bench = make_bench()
    bench.wait_until_up()
    refused = bench.set_parameter("jam_delay_s", 3.0)
    assert not refused.successful
    assert "jam_delay_s" in refused.reason
    assert "1" in refused.reason
    assert bench.set_parameter("jam_delay_s", 0.0).successful
    bench.land()
    bench.spin_until(lambda: bench.wishes() == dict.fromkeys(CHANNELS, 40e3), "the impact jams")


def test_auto_off_ends_the_stream_and_on_resumes_it(make_bench: Callable[..., Bench]) -> None:
    """With auto off no jam_command is sent, while events are still told; with auto on the wish is sent at once."""
    bench = make_bench()
    bench.wait_until_up()
    answer = bench.set_auto(on=False)
    assert answer.success
    assert "command_timeout_s" in answer.message
    sent = bench.reports
    bench.spin_until(lambda: bench.reports >= sent + 2, "what was under way has come")
    bench.commands.clear()
    bench.land()
    bench.stand(LANDED_AT_S + INTERVAL_S, LANDED_AT_S + 0.1)
    sent = bench.reports
    bench.spin_until(lambda: bench.reports >= sent + 2, "two more reports have come")
    assert bench.commands == []
    assert bench.set_auto(on=True).success
    bench.spin_until(lambda: bool(bench.commands), "the stream goes on")
    assert bench.wishes() == dict.fromkeys(CHANNELS, 40e3)


def test_auto_can_be_off_from_the_start(make_bench: Callable[..., Bench]) -> None:
    """With auto_at_start false nothing is commanded before ~/set_auto."""
    bench = make_bench("--ros-args", "-p", "auto_at_start:=false")
    bench.spin_until(lambda: bench.reports >= 2, "the controller is heard")
    assert bench.commands == []
    bench.set_auto(on=True)
    bench.spin_until(lambda: bool(bench.commands), "the stream begins")


def test_health_of_the_imu_is_told(make_bench: Callable[..., Bench]) -> None:
    """A missing IMU is an error that says for how long, NaN samples are a warning with their count, and it passes."""
    bench = make_bench()
    bench.wait_until_up()
    error, warning = DiagnosticStatus.ERROR, DiagnosticStatus.WARN
    bench.spin_until(lambda: bench.health["imu"].level == error, "the missing IMU is an error")
    assert "no usable sample on /imu/data for" in bench.health["imu"].message
    bench.stand(0.1, 0.3)
    bench.feel(math.nan, 0.3)

    def warned() -> bool:
        bench.feel(GRAVITY_M_S2, 0.3 + bench.reports * 1.0)
        return bench.health["imu"].level == warning

    bench.spin_until(warned, "the NaN is a warning")
    assert "1 not finite" in bench.health["imu"].message
    bench.spin_until(lambda: bench.health["imu"].level == error, "the IMU is missed again")


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_ends_cleanly_on_signals(make_bench: Callable[..., Bench], number: signal.Signals) -> None:
    """SIGTERM and SIGINT end the process with 0 and without a word."""
    bench = make_bench()
    bench.wait_until_up()
    bench.stand(0.1, 0.3)
    assert bench.stop(number) == 0
    assert bench.errors.read_text() == ""


@pytest.mark.parametrize(("given", "named"), [("jam_dely_s:=0.1", "jam_dely_s"), ("jam_delay_s:=-1.0", "0 to 1 s")])
def test_bad_parameters_get_one_line(make_bench: Callable[..., Bench], given: str, named: str) -> None:
    """An unknown parameter or a value out of range ends the process with 2 and one line that names it."""
    bench = make_bench("--ros-args", "-p", given)
    assert bench.process.wait(timeout=TIMEOUT_S) == 2
    lines = bench.errors.read_text().splitlines()
    assert len(lines) == 1
    assert named in lines[0]


def test_set_points_that_the_driver_would_refuse_are_refused(make_bench: Callable[..., Bench]) -> None:
    """Once the driver's limits are heard, a set point beyond them is refused with both numbers; one within is taken."""
    bench = make_bench()
    bench.wait_until_up()
    bench.driver_says(JamState(min_vacuum_pa=5e3, max_vacuum_pa=45e3))
    bench.spin_until(lambda: bench.policy_says("45000"), "the set points of the start are objected to")
    assert bench.health["policy"].level == DiagnosticStatus.ERROR
    refused = bench.set_parameter("hold_vacuum_pa", 46e3)
    assert not refused.successful
    assert "45000" in refused.reason
    assert bench.set_parameter("hold_vacuum_pa", 38e3).successful
    assert bench.set_parameter("full_vacuum_pa", 45e3).successful
    bench.spin_until(lambda: bench.health["policy"].level == DiagnosticStatus.OK, "all is well")


def test_a_stance_that_was_held_before_is_taken_up(make_bench: Callable[..., Bench]) -> None:
    """Channels that were let go since jam_command fell silent are jammed again once the body is seen at rest.

    And a driver that does not follow then is told where it hurts, in its own words; somebody who vents is no fault.
    """
    bench = make_bench()
    bench.wait_until_up()
    stale = ChannelJamState(channel=CHANNELS[0], fault=Fault.COMMANDS_STALE)
    bench.driver_says(JamState(channels=[stale], refused_command="refused: an example"))
    bench.hear_more()
    assert bench.wishes() == dict.fromkeys(CHANNELS, 0.0)
    bench.stand(0.1, 0.6)
    bench.spin_until(lambda: bench.wishes() == dict.fromkeys(CHANNELS, 40e3), "the stance is held")
    bench.spin_until(lambda: bench.policy_says("an example"), "the refusal is told")
    assert bench.health["policy"].level == DiagnosticStatus.ERROR
    by_hand = [ChannelJamState(channel=channel, reason=f"asked by {UNJAM.name}") for channel in CHANNELS]
    bench.driver_says(JamState(channels=by_hand))
    bench.spin_until(lambda: bench.policy_says("vented by a service"), "what somebody has asked for is told")
    assert bench.health["policy"].level == DiagnosticStatus.OK
    bench.driver_says(JamState(channels=[*by_hand[:2], ChannelJamState(channel=CHANNELS[2], reason="let go")]))
    bench.spin_until(lambda: bench.policy_says(f"{CHANNELS[2]}: let go"), "what nobody has asked for is told")
    assert bench.health["policy"].level == DiagnosticStatus.ERROR


def test_a_robot_that_nobody_held_is_left_soft(make_bench: Callable[..., Bench]) -> None:
    """A controller that finds channels vented for no reason of its own waits for a landing."""
    bench = make_bench()
    bench.wait_until_up()
    bench.driver_says(JamState(channels=[ChannelJamState(channel=CHANNELS[0])]))
    bench.stand(0.1, 0.6)
    bench.hear_more()
    assert bench.wishes() == dict.fromkeys(CHANNELS, 0.0)


def test_an_imu_in_g_is_told_and_moves_nothing(make_bench: Callable[..., Bench]) -> None:
    """Readings in g are an error on /diagnostics that names unit and safe mode, and give no event and no wish."""
    bench = make_bench()
    bench.wait_until_up()
    for index in range(100):
        bench.feel(1.0, 0.1 + index * INTERVAL_S)
    bench.spin_until(lambda: "unit" in bench.health["imu"].message, "the unit is told")
    assert bench.health["imu"].level == DiagnosticStatus.ERROR
    assert "unavailable" in bench.health["imu"].message
    assert "kept" in bench.health["imu"].message
    assert bench.events == []
    bench.hear_more()
    assert bench.wishes() == dict.fromkeys(CHANNELS, 0.0)


def test_other_inputs_are_named_and_vent(make_bench: Callable[..., Bench]) -> None:
    """A foot switch is named on /diagnostics once heard; it opens and vents a stance, and the event says so."""
    bench = make_bench()
    bench.wait_until_up()
    bench.land()
    bench.stand(LANDED_AT_S + INTERVAL_S, LANDED_AT_S + 0.3)
    bench.spin_until(lambda: bench.wishes() == dict.fromkeys(CHANNELS, 40e3), "the stance is held")
    assert "none" in bench.health["inputs"].message
    assert "a step is not felt on the body" in bench.health["inputs"].message
    assert "not felt on the body: lift-off of a step" in {each.key for each in bench.health["imu"].values}
    switch = bench.node.create_publisher(Bool, FOOT_CONTACT.name, publisher_qos(FOOT_CONTACT))
    bench.spin_until(lambda: switch.get_subscription_count() > 0, "the controller hears the switch")

    def closed_and_named() -> bool:
        switch.publish(Bool(data=True))  # again and again: that it is matched here does not say that it is there
        return "contact switch" in bench.health["inputs"].message

    bench.spin_until(closed_and_named, "the switch is named")
    assert "not felt" not in bench.health["inputs"].message
    switch.publish(Bool(data=False))
    bench.spin_until(lambda: bench.wishes() == dict.fromkeys(CHANNELS, 0.0), "the ankle is vented")
    bench.spin_until(lambda: bench.events[-1].source == "contact switch", "the lift-off is told")
    assert bench.events[-1].type == ContactEvent.LIFTOFF


def test_odometry_is_named_tells_a_slip_and_is_missed(make_bench: Callable[..., Bench]) -> None:
    """With use_odometry a steady slide is told, in the body's frame; once it is silent the IMU's slips are all."""
    shared = "/shared/odom"
    bench = make_bench("--ros-args", "-p", "use_odometry:=true", "-p", f"odometry_topic:={shared}")
    bench.wait_until_up()
    joints = bench.node.create_publisher(JointState, JOINT_STATES.name, publisher_qos(JOINT_STATES))
    odometry = bench.node.create_publisher(Odometry, shared, publisher_qos(ODOMETRY))
    switch = bench.node.create_publisher(Bool, FOOT_CONTACT.name, publisher_qos(FOOT_CONTACT))
    missing = f"no odometry on {shared} that tells the speed of the sole"
    bench.spin_until(lambda: missing in bench.health["inputs"].message, "that there is none is told")
    assert bench.health["inputs"].level == DiagnosticStatus.WARN
    for publisher in (joints, odometry, switch):
        bench.spin_until(lambda heard=publisher: heard.get_subscription_count() > 0, "the controller hears it")

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

    def told() -> bool:
        go(0.3)
        return any(event.type == ContactEvent.SLIP for event in bench.events)

    bench.spin_until(named, "the odometry is named")
    assert bench.health["inputs"].level == DiagnosticStatus.OK
    assert not bench.events
    bench.spin_until(told, "the slip is told")
    slip = next(event for event in bench.events if event.type == ContactEvent.SLIP)
    assert (slip.source, slip.unit, slip.header.frame_id) == ("odometry", "m/s", "base_link")
    assert slip.magnitude == pytest.approx(0.3, abs=0.05)
    assert slip.direction.x > 0.95
    bench.spin_until(lambda: missing in bench.health["inputs"].message, "that it is silent is told")


def test_efforts_are_named_and_vent_a_foot_that_bears_nothing(make_bench: Callable[..., Bench]) -> None:
    """With use_efforts the leg in joint_states is named once heard; it lets go, the lift-off is told with its load."""
    bench = make_bench("--ros-args", "-p", "use_efforts:=true")
    bench.wait_until_up()
    joints = bench.node.create_publisher(JointState, JOINT_STATES.name, publisher_qos(JOINT_STATES))
    bench.spin_until(lambda: joints.get_subscription_count() > 0, "the controller hears the joints")

    def stand_with(knee_n_m: float) -> None:
        for _ in range(5):
            time_s = time.time()  # the node's own clock: what is heard lately is named
            leg = JointState(name=["knee", "hip"], position=[-1.05, 0.52], velocity=[0.0, 0.0], effort=[knee_n_m, 0.25])
            leg.header.stamp.nanosec = round(time_s % 1.0 * 1e9)
            leg.header.stamp.sec = int(time_s)
            joints.publish(leg)
            bench.feel(GRAVITY_M_S2, time_s)

    def named() -> bool:
        stand_with(1.3)
        return "joint efforts" in bench.health["inputs"].message

    def told() -> bool:
        stand_with(-0.25)
        return bool(bench.events)

    bench.spin_until(named, "the efforts are named")
    bench.spin_until(told, "the lift-off is told")
    assert (bench.events[0].type, bench.events[0].source) == (ContactEvent.LIFTOFF, "joint efforts")
    assert (bench.events[0].unit, abs(bench.events[0].magnitude) < 4.0) == ("N", True)
