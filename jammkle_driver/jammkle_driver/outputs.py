"""What the driver publishes about itself: actuator commands and jam_state, each when it changes and regularly."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.duration import Duration
from std_msgs.msg import Bool, Float32

from jammkle_common.names import JAM_STATE, PUMP_DUTY, SOLENOIDS
from jammkle_common.qos import publisher_qos
from jammkle_driver.conversions import duty_message, jam_state_message, solenoid_message
from jammkle_msgs.msg import JamState

if TYPE_CHECKING:
    from rclpy.node import Node

    from jammkle_driver.core.hardware import ActuatorCommand
    from jammkle_driver.core.status import DriverStatus

_DELIVERY_TIMEOUT_S = 0.5


class Outputs:
    """The driver's publishers.

    They are plain publishers, not lifecycle ones: the command that releases everything must get out while the node
    is already inactive.
    """

    def __init__(self, node: Node) -> None:
        """Create the publishers; nothing is published yet."""
        self._node = node
        self._duty = node.create_publisher(Float32, PUMP_DUTY.name, publisher_qos(PUMP_DUTY))
        self._solenoids = {
            channel: node.create_publisher(Bool, topic.name, publisher_qos(topic))
            for channel, topic in SOLENOIDS.items()
        }
        self._state = node.create_publisher(JamState, JAM_STATE.name, publisher_qos(JAM_STATE))
        self._command: ActuatorCommand | None = None

    def repeat_command(self, command: ActuatorCommand) -> None:
        """Publish the whole command."""
        self._command = None
        self.update_command(command)

    def update_command(self, command: ActuatorCommand) -> None:
        """Publish what differs from the last command; solenoids first, since they decide whether a tendon vents."""
        last = self._command
        if command is last:
            return
        self._command = command
        for channel, energised in command.solenoids.items():
            if last is None or last.solenoids[channel] != energised:
                self._solenoids[channel].publish(solenoid_message(energised=energised))
        if last is None or last.pump_duty != command.pump_duty:
            self._duty.publish(duty_message(command.pump_duty))

    def repeat_state(self, status: DriverStatus, refused_command: str) -> None:
        """Publish the state, and why the last jam_command was refused (empty: it was not)."""
        self._state.publish(jam_state_message(status, self._node.get_clock().now().to_msg(), refused_command))

    def deliver(self) -> None:
        """Wait until all subscribers have got what was published, at most half a second in all."""
        clock = Clock(clock_type=ClockType.STEADY_TIME)
        deadline = clock.now() + Duration(seconds=_DELIVERY_TIMEOUT_S)
        for publisher in (*self._solenoids.values(), self._duty, self._state):
            left = max(deadline - clock.now(), Duration(), key=lambda duration: duration.nanoseconds)
            publisher.wait_for_all_acked(left)

    def close(self) -> None:
        """Destroy the publishers."""
        for publisher in (*self._solenoids.values(), self._duty, self._state):
            self._node.destroy_publisher(publisher)
