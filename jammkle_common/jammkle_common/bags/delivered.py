"""How a topic is delivered, as the metadata of a bag holds it. Does not import rclpy."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime

if TYPE_CHECKING:
    from jammkle_common.delivery import Delivery

_NO_TIME = QosTime(0, 0)
"""Of a deadline, lifespan or lease that nobody asks for."""


def bag_delivery(delivery: Delivery) -> Qos:
    """Return what a publisher with this delivery would be recorded with."""
    return Qos(
        QosHistory.KEEP_LAST,
        delivery.depth,
        QosReliability.RELIABLE if delivery.reliable else QosReliability.BEST_EFFORT,
        QosDurability.TRANSIENT_LOCAL if delivery.latched else QosDurability.VOLATILE,
        _NO_TIME,
        _NO_TIME,
        QosLiveliness.SYSTEM_DEFAULT,
        _NO_TIME,
        avoid_ros_namespace_conventions=False,
    )
