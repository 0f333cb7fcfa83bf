"""The IMU of a robot that is played by a test: rest, fall, impact, as samples with the noise of a sensor."""

from __future__ import annotations

import random
from typing import TYPE_CHECKING

from sensor_msgs.msg import Imu

from jammkle_common.names import IMU, IMU_FRAME
from jammkle_common.qos import publisher_qos

if TYPE_CHECKING:
    from rclpy.node import Node

IMPACT_M_S2 = 40.0
_NOISE_M_S2 = 0.02
"""One whose readings never change counts as frozen."""


class PlayedImu:
    """Publishes what an IMU would measure along z."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._random = random.Random(1)  # noqa: S311 - noise of a sensor
        self.publisher = node.create_publisher(Imu, IMU.name, publisher_qos(IMU))

    def sample(self, specific_force_m_s2: float, frame: str = IMU_FRAME) -> Imu:
        """Return a sample of now, to be published."""
        message = Imu()
        message.header.stamp = self._node.get_clock().now().to_msg()
        message.header.frame_id = frame
        message.orientation_covariance[0] = -1.0
        message.linear_acceleration.z = specific_force_m_s2 + self._random.gauss(0.0, _NOISE_M_S2)
        return message
