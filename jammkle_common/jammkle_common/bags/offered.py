"""QoS profiles as the metadata of a bag holds them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rclpy.qos import DurabilityPolicy, HistoryPolicy, LivelinessPolicy, ReliabilityPolicy
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime

from jammkle_common.constants import NANOSECONDS_PER_SECOND

if TYPE_CHECKING:
    from rclpy.duration import Duration
    from rclpy.qos import QoSProfile

_RELIABILITY = {
    ReliabilityPolicy.RELIABLE: QosReliability.RELIABLE,
    ReliabilityPolicy.BEST_EFFORT: QosReliability.BEST_EFFORT,
    ReliabilityPolicy.SYSTEM_DEFAULT: QosReliability.SYSTEM_DEFAULT,
}
_DURABILITY = {
    DurabilityPolicy.TRANSIENT_LOCAL: QosDurability.TRANSIENT_LOCAL,
    DurabilityPolicy.VOLATILE: QosDurability.VOLATILE,
    DurabilityPolicy.SYSTEM_DEFAULT: QosDurability.SYSTEM_DEFAULT,
}
_HISTORY = {
    HistoryPolicy.KEEP_LAST: QosHistory.KEEP_LAST,
    HistoryPolicy.KEEP_ALL: QosHistory.KEEP_ALL,
    HistoryPolicy.SYSTEM_DEFAULT: QosHistory.SYSTEM_DEFAULT,
}
_LIVELINESS = {
    LivelinessPolicy.AUTOMATIC: QosLiveliness.AUTOMATIC,
    LivelinessPolicy.MANUAL_BY_TOPIC: QosLiveliness.MANUAL_BY_TOPIC,
    LivelinessPolicy.SYSTEM_DEFAULT: QosLiveliness.SYSTEM_DEFAULT,
}


def bag_qos(profile: QoSProfile) -> Qos:
    """Return a profile as a bag's metadata holds it."""
    return Qos(
        _HISTORY.get(profile.history, QosHistory.UNKNOWN),
        profile.depth,
        _RELIABILITY.get(profile.reliability, QosReliability.UNKNOWN),
        _DURABILITY.get(profile.durability, QosDurability.UNKNOWN),
        _bag_time(profile.deadline),
        _bag_time(profile.lifespan),
        _LIVELINESS.get(profile.liveliness, QosLiveliness.UNKNOWN),
        _bag_time(profile.liveliness_lease_duration),
        profile.avoid_ros_namespace_conventions,
    )


def _bag_time(duration: Duration) -> QosTime:
    seconds, nanoseconds = divmod(duration.nanoseconds, NANOSECONDS_PER_SECOND)
    return QosTime(seconds, nanoseconds)
