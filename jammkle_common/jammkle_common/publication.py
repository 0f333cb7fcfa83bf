"""Subscriptions that miss no publisher, and what the middleware says of a message."""

from __future__ import annotations

import inspect
import time
from typing import TYPE_CHECKING, Any, NamedTuple

from rclpy.event_handler import SubscriptionEventCallbacks

from jammkle_common.delivery import subscribed
from jammkle_common.qos import live_qos, newest_qos, subscriber_qos

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from rclpy.node import Node
    from rclpy.subscription import Subscription

    from jammkle_common.names import Topic

_DEPTH = 10
"""Messages that wait, so that a stop which is taken back at once is still seen."""


class MessageInfo(NamedTuple):
    """What the middleware says of a message.

    Attributes:
        number: Which of its publisher's messages it is, from 1; 0 where the middleware does not count.
        sent_ns: When it was published, ns since 1970; where that is not known, when it was received.

    """

    number: int
    sent_ns: int


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
    profiles = [subscriber_qos(topic), newest_qos(_DEPTH)]
    if subscribed(topic).latched:
        profiles.insert(1, live_qos())
    silent = SubscriptionEventCallbacks(use_default_callbacks=False)
    return tuple(
        node.create_subscription(message_type, topic.name, with_info(callback), profile, event_callbacks=silent)
        for profile in profiles
    )


def _read(info: Mapping[str, int | None]) -> MessageInfo:
    sent_ns = info["source_timestamp"] or info["received_timestamp"] or time.time_ns()
    return MessageInfo(info["publication_sequence_number"] or 0, sent_ns)
