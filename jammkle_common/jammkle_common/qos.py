"""QoS profiles of both ends of every topic, as `jammkle_common.delivery` chooses them."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from jammkle_common.delivery import SENSOR_HISTORY_DEPTH, Delivery, published, subscribed

if TYPE_CHECKING:
    from jammkle_common.names import Topic

_CHANGES_DEPTH = 100
_LIVE_DEPTH = 10
"""So that a stop which is taken back at once is still seen."""


def _profile(delivery: Delivery) -> QoSProfile:
    return QoSProfile(
        depth=delivery.depth,
        reliability=ReliabilityPolicy.RELIABLE if delivery.reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if delivery.latched else DurabilityPolicy.VOLATILE,
    )


def publisher_qos(topic: Topic) -> QoSProfile:
    """Profile with which this project publishes `topic`."""
    return _profile(published(topic))


def subscriber_qos(topic: Topic) -> QoSProfile:
    """Profile with which this project subscribes to `topic`; it matches any publisher of the ecosystem for sensors."""
    return _profile(subscribed(topic))


def every_change_qos() -> QoSProfile:
    """Latched profile for those who must miss no change of a state, such as a pump's duty, while they are busy."""
    return _profile(Delivery(_CHANGES_DEPTH, reliable=True, latched=True))


def patient_qos(topic: Topic) -> QoSProfile:
    """Profile of `subscriber_qos` with a queue so long that a subscriber may be busy for seconds and miss nothing."""
    return _profile(dataclasses.replace(subscribed(topic), depth=SENSOR_HISTORY_DEPTH))


def every_sample_qos(topic: Topic) -> QoSProfile:
    """Profile of `patient_qos` under which none is lost on the way; for what this project alone publishes."""
    return _profile(dataclasses.replace(published(topic), depth=SENSOR_HISTORY_DEPTH))


def newest_qos(depth: int) -> QoSProfile:
    """Profile for those who look at a stream of measurements now and then, and want the newest `depth` alone.

    It matches any publisher, and what was not looked at costs no more than its way into the queue.
    """
    return QoSProfile(depth=depth, reliability=ReliabilityPolicy.BEST_EFFORT)


def answer_qos() -> QoSProfile:
    """Profile of answers to ticks of a simulation. It asks again where one is lost, so that none need be kept."""
    return QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)


def live_qos() -> QoSProfile:
    """Volatile profile that also matches publishers that do not latch (`ros2 topic pub` by default does not).

    A latched subscription never sees such a publisher. Where missing one is dangerous (the emergency stop),
    subscribe twice: with `subscriber_qos` for late joining, and with this.
    """
    return _profile(Delivery(_LIVE_DEPTH, reliable=True))
