"""The simulated ankle as hardware: pressures come in by subscription."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sensor_msgs.msg import FluidPressure

from jammkle_driver.core.hardware import MANIFOLD
from jammkle_graph.names import MANIFOLD_PRESSURE, PRESSURES
from jammkle_graph.qos import subscriber_qos

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.node import Node

    from jammkle_driver.core.hardware import ActuatorCommand


class SimulatedHardware:
    """Hands over the pressures that the simulation publishes. Implements `core.hardware.Hardware`."""

    def __init__(self, node: Node, take: Callable[[str, FluidPressure], None]) -> None:
        """Subscribe to every pressure; `take` gets the place (a channel or MANIFOLD) and the message."""
        self._node = node
        topics = {**PRESSURES, MANIFOLD: MANIFOLD_PRESSURE}
        self._subscriptions = [
            node.create_subscription(
                FluidPressure, topic.name, lambda message, place=place: take(place, message), subscriber_qos(topic)
            )
            for place, topic in topics.items()
        ]

    def apply(self, command: ActuatorCommand) -> None:
        """Do nothing: the driver publishes its commands whatever the hardware, and the simulation listens to them."""

    def close(self) -> None:
        """Unsubscribe."""
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)
        self._subscriptions.clear()
