"""How each kind of topic is delivered, at both ends: the one place where that is chosen. Does not import rclpy."""

from __future__ import annotations

from dataclasses import dataclass

from jammkle_common.names import Topic, TopicKind

_SENSOR_DEPTH = 100
SENSOR_HISTORY_DEPTH = 1000
"""Two seconds of 500 Hz, one of 1 kHz: longer than a process on a busy machine waits for its turn. Assumed.

A reliable publisher can send again only what it still has, so its depth is how long a recorder may be held up.
"""
_EVENT_DEPTH = 100
"""Five seconds of what is repeated at 20 Hz, so that a recorder which is held up for 2 s misses none."""


@dataclass(frozen=True)
class Delivery:
    """What is asked of the middleware for one end of a topic."""

    depth: int
    """Messages that wait for a receiver that is busy."""
    reliable: bool
    """Whether a lost message is sent again."""
    latched: bool = False
    """Whether one who joins late gets the last messages (transient local)."""


_LATCHED = Delivery(1, reliable=True, latched=True)
_PUBLISHED = {
    TopicKind.SENSOR: Delivery(SENSOR_HISTORY_DEPTH, reliable=True),
    TopicKind.COMMAND: Delivery(_EVENT_DEPTH, reliable=True),
    TopicKind.STATE: _LATCHED,
    TopicKind.ACTUATOR: Delivery(_EVENT_DEPTH, reliable=True, latched=True),
    TopicKind.EVENT: Delivery(_EVENT_DEPTH, reliable=True),
    TopicKind.CLOCK: Delivery(SENSOR_HISTORY_DEPTH, reliable=True),
}
_SUBSCRIBED = {
    **_PUBLISHED,
    TopicKind.SENSOR: Delivery(_SENSOR_DEPTH, reliable=False),
    TopicKind.COMMAND: Delivery(1, reliable=True),
    TopicKind.CLOCK: Delivery(1, reliable=False),
}


def published(topic: Topic) -> Delivery:
    """Return how this project publishes `topic`."""
    return _PUBLISHED[topic.kind]


def subscribed(topic: Topic) -> Delivery:
    """Return how this project subscribes to `topic`; it matches any publisher of the ecosystem for sensors."""
    return _SUBSCRIBED[topic.kind]
