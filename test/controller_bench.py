"""A controller as a real process on real DDS: the bench plays the IMU and listens."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import Imu
from std_srvs.srv import SetBool

from jammkle_common.names import (
    CONTACT_EVENTS,
    DIAGNOSTICS,
    IMU,
    JAM_COMMAND,
    JAM_STATE,
    SET_AUTO,
)
from jammkle_common.qos import publisher_qos, subscriber_qos
from jammkle_controller.core.leg import Leg
from jammkle_msgs.msg import ContactEvent, JamCommand, JamState

if TYPE_CHECKING:
    import signal
    from collections.abc import Callable
    from pathlib import Path

TIMEOUT_S = 30.0
INTERVAL_S = 0.004
FALL_S, LANDED_AT_S = 0.1, 0.5
GRAVITY_M_S2 = 9.80665
LEG = Leg(
    thigh_m=0.15,
    shank_m=0.15,
    thigh_kg=0.35,
    shank_kg=0.502,
    shank_centre_m=0.107,
    lean_rad=0.5223,
    toe_m=0.06,
    heel_m=0.045,
    half_width_m=0.03,
    sole_m=0.02,
)
"""As of the simulated legs."""
LEG_URDF = """<robot name="leg">
  <link name="base_link"/>
  <joint name="hip" type="revolute"><parent link="base_link"/><child link="thigh"/><axis xyz="0 1 0"/></joint>
  <link name="thigh"><inertial><origin xyz="0 0 -0.075"/><mass value="0.35"/></inertial></link>
  <joint name="knee" type="revolute"><origin xyz="0 0 -0.15"/><parent link="thigh"/><child link="shank"/>
    <axis xyz="0 1 0"/></joint>
  <link name="shank"><inertial><origin xyz="0 0 -0.107"/><mass value="0.502"/></inertial></link>
  <joint name="mount" type="fixed"><origin xyz="0 0 -0.15" rpy="0 0.5223 0"/><parent link="shank"/>
    <child link="imu"/></joint>
  <link name="imu"/>
  <joint name="ankle_pitch" type="revolute"><parent link="imu"/><child link="foot"/><axis xyz="0 1 0"/></joint>
  <link name="foot"><collision><origin xyz="0.0075 0 -0.01"/><geometry><box size="0.105 0.06 0.02"/></geometry>
  </collision></link>
</robot>"""
"""Of the same leg."""


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
        self._felt_s = 0.0
        self.encode: Callable[[Imu], Imu | bytes] = lambda message: message
        self.imu = self.node.create_publisher(Imu, IMU.name, publisher_qos(IMU))
        for kind, topic, take in (
            (ContactEvent, CONTACT_EVENTS, self.events.append),
            (JamCommand, JAM_COMMAND, self.commands.append),
            (DiagnosticArray, DIAGNOSTICS, self._on_health),
        ):
            self.node.create_subscription(kind, topic.name, take, subscriber_qos(topic))

    def _on_health(self, message: DiagnosticArray) -> None:
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
                pytest.fail(f"gave up waiting until {what}; last received: {said}")
            self.executor.spin_once(timeout_sec=0.05)

    def wait_until_up(self) -> None:
        self.spin_until(lambda: bool(self.commands) and bool(self.health), "the controller is received")
        self.spin_until(lambda: self.imu.get_subscription_count() > 0, "the controller receives the IMU")

    def feel(self, force_m_s2: float, time_s: float) -> None:
        """Publish one IMU sample with a specific force along z, and the noise of a living sensor."""
        self._felt_s = time_s
        message = Imu()
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(round(time_s * 1e9), 1_000_000_000)
        message.header.frame_id = "imu"
        force, rate = message.linear_acceleration, message.angular_velocity
        force.x, force.y, force.z = self.noise.normal((0.0, 0.0, force_m_s2), 0.02).tolist()
        rate.x, rate.y, rate.z = self.noise.normal(0.0, 0.002, 3).tolist()
        message.orientation_covariance[0] = -1.0
        self.imu.publish(self.encode(message))
        self.executor.spin_once(timeout_sec=0.001)

    def stand_until(self, holds: Callable[[], bool], what: str) -> None:
        """Go on standing from the last sample until something holds: an IMU that falls silent is believed no more."""

        def stands() -> bool:
            self.feel(GRAVITY_M_S2, self._felt_s + INTERVAL_S)
            return holds()

        self.spin_until(stands, what)

    def stand(self, from_s: float, until_s: float) -> None:
        for index in range(round((until_s - from_s) / INTERVAL_S)):
            self.feel(GRAVITY_M_S2, from_s + index * INTERVAL_S)

    def land(self) -> None:
        """Stand, fall for 0.1 s, and hit the ground at `LANDED_AT_S`; that sample is the last."""
        self.stand(0.1, LANDED_AT_S - FALL_S)
        for index in range(round(FALL_S / INTERVAL_S)):
            self.feel(0.0, LANDED_AT_S - FALL_S + index * INTERVAL_S)
        self.feel(40.0, LANDED_AT_S)
        self.spin_until(lambda: self.kinds()[-1:] == [ContactEvent.IMPACT], "the impact is reported")

    def kinds(self) -> list[int]:
        return [event.type for event in self.events]

    def set_points_pa(self) -> dict[str, float]:
        return {channel.channel: channel.vacuum_pa for channel in self.commands[-1].channels}

    def wait_more(self, count: int = 4) -> None:
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
        self.spin_until(lambda: publisher.get_subscription_count() > 0, "the controller receives the driver")
        publisher.publish(state)

    def policy_says(self, word: str) -> bool:
        return "policy" in self.health and word in self.health["policy"].message

    def set_auto(self, *, on: bool) -> SetBool.Response:
        return self.call(SetBool, SET_AUTO.path, SetBool.Request(data=on))

    def stop(self, number: signal.Signals) -> int:
        self.process.send_signal(number)
        return self.process.wait(timeout=TIMEOUT_S)
