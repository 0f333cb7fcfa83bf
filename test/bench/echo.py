"""A bare subscriber: for every IMU sample that says so, one Bool back. What a node costs that decides nothing."""

from __future__ import annotations

from rclpy.node import Node
from sensor_msgs.msg import Imu
from std_msgs.msg import Bool

from jammkle_graph.names import IMU
from jammkle_graph.qos import publisher_qos, subscriber_qos
from jammkle_graph.runner import run

ECHO_NODE = "echo"
ECHO_TOPIC = "echo"
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


if __name__ == "__main__":
    run(Echo)
