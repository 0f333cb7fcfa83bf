"""QoS profiles for both ends of every kind of topic. The one place where they are chosen."""

from __future__ import annotations

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from jammkle_graph.names import Topic, TopicKind

_SENSOR_DEPTH = 100
_EVENT_DEPTH = 100
_PATIENT_DEPTH = 1000
"""Two seconds of 500 Hz: longer than a process on a busy machine waits for its turn. Assumed."""
_LIVE_DEPTH = 10
"""So that a stop which is taken back at once is still seen."""

_LATCHED = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
_COMMAND = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)
_EVENT = QoSProfile(depth=_EVENT_DEPTH, reliability=ReliabilityPolicy.RELIABLE)
_CLOCK = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)

_PUBLISHER = {
    TopicKind.SENSOR: QoSProfile(depth=_SENSOR_DEPTH, reliability=ReliabilityPolicy.RELIABLE),
    TopicKind.COMMAND: _COMMAND,
    TopicKind.STATE: _LATCHED,
    TopicKind.EVENT: _EVENT,
    TopicKind.CLOCK: _CLOCK,
}
_SUBSCRIBER = {
    **_PUBLISHER,
    TopicKind.SENSOR: QoSProfile(depth=_SENSOR_DEPTH, reliability=ReliabilityPolicy.BEST_EFFORT),
}


def publisher_qos(topic: Topic) -> QoSProfile:
    """Profile with which this project publishes `topic`."""
    return _PUBLISHER[topic.kind]


def subscriber_qos(topic: Topic) -> QoSProfile:
    """Profile with which this project subscribes to `topic`; it matches any publisher of the ecosystem for sensors."""
    return _SUBSCRIBER[topic.kind]


def every_change_qos() -> QoSProfile:
    """Latched profile for those who must miss no change of a state, such as a pump's duty, while they are busy."""
    return QoSProfile(
        depth=_SENSOR_DEPTH, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
    )


def patient_qos(topic: Topic) -> QoSProfile:
    """Profile of `subscriber_qos` with a queue so long that a subscriber may be busy for seconds and miss nothing."""
    given = _SUBSCRIBER[topic.kind]
    return QoSProfile(depth=_PATIENT_DEPTH, reliability=given.reliability, durability=given.durability)


def live_qos() -> QoSProfile:
    """Volatile profile that also matches publishers that do not latch (`ros2 topic pub` by default does not).

    A latched subscription never sees such a publisher. Where missing one is dangerous (the emergency stop),
    subscribe twice: with `subscriber_qos` for late joining, and with this.
    """
    return QoSProfile(depth=_LIVE_DEPTH, reliability=ReliabilityPolicy.RELIABLE)
