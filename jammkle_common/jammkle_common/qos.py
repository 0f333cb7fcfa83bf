"""QoS profiles of both ends of every topic, and subscriptions that fit any publisher.

How each kind of topic is delivered is chosen in `jammkle_common.names`.
"""

from __future__ import annotations

import dataclasses
import inspect
import time
from typing import TYPE_CHECKING, Any, NamedTuple

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from jammkle_common.constants import NANOSECONDS_PER_SECOND
from jammkle_common.names import (
    CLOCK,
    DIAGNOSTICS,
    SENSOR_HISTORY_DEPTH,
    Delivery,
    published,
    relative,
    resolved,
    subscribed,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from rclpy.node import Node
    from rclpy.subscription import Subscription
    from rclpy.topic_endpoint_info import TopicEndpointInfo

    from jammkle_common.names import Topic


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


def patient_qos(topic: Topic) -> QoSProfile:
    """Profile of `subscriber_qos` with a queue so long that a subscriber may be busy for seconds and miss nothing."""
    return _profile(dataclasses.replace(subscribed(topic), depth=SENSOR_HISTORY_DEPTH))


def newest_qos(depth: int) -> QoSProfile:
    """Profile for those who look at a stream of measurements now and then, and want the newest `depth` alone.

    It matches any publisher, and what was not looked at costs no more than its way into the queue.
    """
    return QoSProfile(depth=depth, reliability=ReliabilityPolicy.BEST_EFFORT)


def answer_qos() -> QoSProfile:
    """Profile of answers to ticks of a simulation. It asks again where one is lost, so that none need be kept."""
    return QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)


_DEPTH = 100
"""Messages that wait, so that a stop which is taken back, or what is said once, is still seen by one who was held up:
2 s of 50 Hz."""


class MessageInfo(NamedTuple):
    """What the middleware says of a message."""

    number: int
    """Which of its publisher's messages it is, from 1; 0 where the middleware does not count."""
    sent_ns: int
    """When it was published, ns since 1970; where that is not known, when it was received."""


def with_info(callback: Callable[[Any, MessageInfo], None]) -> Callable[..., None]:
    """Return a callback for `create_subscription` that passes on what the middleware says of a message.

    rclpy sees by a callback's signature that it takes two arguments. Its EventsExecutor (7.1.6) passes both as one.
    """

    def take(*received: Any) -> None:
        message, info = received if len(received) > 1 else received[0]
        callback(message, _read(info))

    both = [inspect.Parameter(name, inspect.Parameter.POSITIONAL_ONLY) for name in ("message", "info")]
    take.__signature__ = inspect.Signature(both)  # type: ignore[attr-defined]
    return take


def subscribe_to_any(
    node: Node, message_type: type, topic: Topic, callback: Callable[[Any, MessageInfo], None]
) -> tuple[Subscription, ...]:
    """Subscribe to publishers of any quality of service: latched, reliable or best effort.

    A subscription asks for one quality, and publishers that offer less do not match it: so there are two or three, and
    a message comes up to three times, with the same info. That less was offered to one of them is no warning.
    """
    # All are as deep: a shorter one would hand over newer messages first, and what the others kept would count as late.
    profiles = [_profile(dataclasses.replace(subscribed(topic), depth=_DEPTH)), newest_qos(_DEPTH)]
    if subscribed(topic).latched:
        # of those that do not latch, as `ros2 topic pub` by default does not, a latched subscription sees nothing
        profiles.insert(1, _profile(Delivery(_DEPTH, reliable=True)))
    silent = SubscriptionEventCallbacks(use_default_callbacks=False)
    return tuple(
        node.create_subscription(message_type, topic.name, with_info(callback), profile, event_callbacks=silent)
        for profile in profiles
    )


def subscribe_to_changes(node: Node, message_type: type, topic: Topic, callback: Callable[[Any], None]) -> None:
    """Subscribe to measurements that may be published on change only, and then latched, by whoever does so.

    Beside those that come, what a latched publisher has said last before is received once.
    """
    latest_ns = 0

    def take(message: Any, info: MessageInfo) -> None:
        nonlocal latest_ns
        # what the other subscription had first; further back it is another publisher's clock
        if not 0 <= latest_ns - info.sent_ns < NANOSECONDS_PER_SECOND:
            latest_ns = info.sent_ns
            callback(message)

    def take_latched(message: Any, info: MessageInfo) -> None:
        if info.sent_ns > latest_ns:
            take(message, info)

    subscribed_to_latched = False

    def on_match(matched: Any) -> None:
        # Only once somebody latches: other publishers would log that no messages will be sent to this subscription.
        nonlocal subscribed_to_latched
        offered = [end.qos_profile.durability for end in node.get_publishers_info_by_topic(topic.name)]
        is_latched = DurabilityPolicy.TRANSIENT_LOCAL in offered or len(offered) < matched.current_count
        if is_latched and not subscribed_to_latched:
            subscribed_to_latched = True
            latched = _profile(Delivery(1, reliable=True, latched=True))
            silent = SubscriptionEventCallbacks(use_default_callbacks=False)
            node.create_subscription(message_type, topic.name, with_info(take_latched), latched, event_callbacks=silent)

    events = SubscriptionEventCallbacks(matched=on_match)
    node.create_subscription(message_type, topic.name, with_info(take), subscriber_qos(topic), event_callbacks=events)


def _read(info: Mapping[str, int | None]) -> MessageInfo:
    sent_ns = info["source_timestamp"] or info["received_timestamp"] or time.time_ns()
    return MessageInfo(info["publication_sequence_number"] or 0, sent_ns)


_OUTSIDE = (CLOCK.name, DIAGNOSTICS.name, "/tf", "/tf_static")
_LEFT_OUT = ("/rosout", "/parameter_events")


def node_at(end: TopicEndpointInfo) -> str:
    """Return the full name of the node at an end of a topic; empty while it is not known: it comes after the end."""
    return "" if end.node_name == _UNKNOWN_NODE else resolved(end.node_namespace, end.node_name)


_UNKNOWN_NODE = "_NODE_NAME_UNKNOWN_"
"""What rmw_dds_common (`GraphCache`) has for a node that is not known yet."""


def belongs(namespace: str, name: str) -> bool:
    """Return whether a topic, by its full name, is one of a normalised namespace's, or said of it outside."""
    if name in _OUTSIDE:
        return True
    inside = relative(namespace, name)
    hidden = any(part.startswith("_") for part in name.split("/"))  # of actions; ros2 bag leaves them out as well
    return inside is not None and name not in _LEFT_OUT and not hidden


def misses(asked: QoSProfile, offered: QoSProfile) -> bool:
    """Return True if a subscription that asks for `asked` never sees a publisher that offers `offered`."""
    return (
        asked.reliability is ReliabilityPolicy.RELIABLE and offered.reliability is not ReliabilityPolicy.RELIABLE
    ) or (
        asked.durability is DurabilityPolicy.TRANSIENT_LOCAL
        and offered.durability is not DurabilityPolicy.TRANSIENT_LOCAL
    )


def strongest(offered: Sequence[QoSProfile], depth: int) -> QoSProfile:
    """Return the strongest request that all of these publishers meet, of none the weakest; `depth` may wait."""
    reliable = bool(offered) and all(offer.reliability is ReliabilityPolicy.RELIABLE for offer in offered)
    latched = bool(offered) and all(offer.durability is DurabilityPolicy.TRANSIENT_LOCAL for offer in offered)
    return _profile(Delivery(depth, reliable=reliable, latched=latched))
