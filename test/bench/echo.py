"""Bare relays: one Bool for each IMU sample that asks for it, and that Bool once more. What a node costs by itself."""

from __future__ import annotations

import sys

from rclpy.node import Node
from sensor_msgs.msg import Imu
from std_msgs.msg import Bool

from jammkle_common.names import IMU
from jammkle_common.qos import publisher_qos, subscriber_qos
from jammkle_common.runner import run

ECHO = (__file__,)
"""Arguments for Python that run the first relay; with `SECOND_ECHO_NODE` beside, the second."""
ECHO_NODE = "echo"
ECHO_TOPIC = "echo"
SECOND_ECHO_NODE = "second_echo"
SECOND_ECHO_TOPIC = "second_echo"
MARK = "echo"
"""frame_id of the samples to answer."""


class Echo(Node):
    """Counts every sample and answers the marked ones."""

    def __init__(self) -> None:
        super().__init__(ECHO_NODE)
        self.count = 0
        self._answer = self.create_publisher(Bool, ECHO_TOPIC, publisher_qos(IMU))
        self.create_subscription(Imu, IMU.name, self._on_imu, subscriber_qos(IMU))

    def _on_imu(self, sample: Imu) -> None:
        self.count += 1
        if sample.header.frame_id == MARK:
            self._answer.publish(Bool(data=True))


class SecondEcho(Node):
    """Answers the answers: with the first one, a chain of two processes, as controller and driver are."""

    def __init__(self) -> None:
        super().__init__(SECOND_ECHO_NODE)
        self._answer = self.create_publisher(Bool, SECOND_ECHO_TOPIC, publisher_qos(IMU))
        self.create_subscription(Bool, ECHO_TOPIC, self._answer.publish, subscriber_qos(IMU))


if __name__ == "__main__":
    run(SecondEcho if SECOND_ECHO_NODE in sys.argv else Echo)
