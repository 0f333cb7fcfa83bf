"""Hears the topics of one ankle: what is seldom by callbacks, what is fast by looking at the newest once per frame.

A callback per sample would cost more than the page itself: four ankles send some 5,000 measurements per second, of
which a page that moves 30 times per second can show a tenth. What is only plotted, pressures and IMU, is subscribed to
for the ankle that is plotted alone.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from jammkle_common import names
from jammkle_common.qos import newest_qos, subscriber_qos
from jammkle_view.conversions import TAKERS

if TYPE_CHECKING:
    from rclpy.node import Node
    from rclpy.subscription import Subscription

    from jammkle_common.names import Topic
    from jammkle_view.core.ankle import Ankle

_SELDOM = (names.JAM_STATE, names.CONTACT_EVENTS, names.SIM_PARAMETERS)
_OF_THE_WHOLE = names.SIM_PARAMETERS
_SHOWN = (names.JOINT_STATES, names.TENDON_STATES)
_PLOTTED = (*names.PRESSURES.values(), names.MANIFOLD_PRESSURE)
_IMU_DEPTH = 100
"""A tenth of a second at 1 kHz: three frames, of which every sample is plotted, as an impact lasts a few alone."""


class AnkleEars:
    """Subscriptions to one ankle's topics, and whom they tell."""

    def __init__(self, node: Node, watcher: Node, namespace: str, ankle: Ankle, *, with_base: bool) -> None:
        """Subscribe.

        Args:
            node: Whose executor serves what is seldom.
            watcher: A node without executor: nobody is called for what it hears.
            namespace: Of the ankle, relative to both nodes'; empty: their own.
            ankle: Who takes what is heard.
            with_base: Whether to hear where the whole is, too; one of several ankles will do.

        """
        self._ankle = ankle
        prefix = f"{namespace}/" if namespace else ""
        for topic in _SELDOM:
            take = TAKERS[topic.name]
            node.create_subscription(
                _kind(topic),
                f"{prefix}{topic.name}",
                lambda message, take=take: ankle.take(take(message)),
                subscriber_qos(topic),
            )
        if namespace:  # one simulation of several ankles speaks above them
            take = TAKERS[_OF_THE_WHOLE.name]
            node.create_subscription(
                _kind(_OF_THE_WHOLE),
                _OF_THE_WHOLE.name,
                lambda message: ankle.take(take(message)),
                subscriber_qos(_OF_THE_WHOLE),
            )
        self._watcher, self._prefix = watcher, prefix
        self._shown = [(topic.name, _watch(watcher, prefix, topic, 1)) for topic in _SHOWN]
        if with_base:
            self._shown.append((names.ODOMETRY.name, _watch(watcher, "", names.ODOMETRY, 1)))
        self._plotted: list[tuple[str, Subscription]] = []
        self._imu: Subscription | None = None

    def look(self) -> None:
        """Take the newest of every measurement; of an IMU that is plotted all since the last look."""
        for topic, subscription in (*self._shown, *self._plotted):
            self._take(topic, subscription)
        if self._imu is not None:
            for _ in range(_IMU_DEPTH):
                if not self._take(names.IMU.name, self._imu):
                    break

    def plot(self, *, wanted: bool) -> None:
        """Begin or cease to hear what is only plotted."""
        if wanted and self._imu is None:
            self._imu = _watch(self._watcher, self._prefix, names.IMU, _IMU_DEPTH)
            self._plotted = [(topic.name, _watch(self._watcher, self._prefix, topic, 1)) for topic in _PLOTTED]
        elif not wanted and self._imu is not None:
            for subscription in (self._imu, *(subscription for _, subscription in self._plotted)):
                self._watcher.destroy_subscription(subscription)
            self._plotted, self._imu = [], None

    def _take(self, topic: str, subscription: Subscription) -> bool:
        with subscription.handle:
            taken = subscription.handle.take_message(subscription.msg_type, subscription.raw)
        if taken is None:
            return False
        self._ankle.take(TAKERS[topic](taken[0]))
        return True


def _kind(topic: Topic) -> Any:
    package, folder, name = topic.message_type.split("/")
    return getattr(import_module(f"{package}.{folder}"), name)


def _watch(watcher: Node, prefix: str, topic: Topic, depth: int) -> Subscription:
    return watcher.create_subscription(_kind(topic), f"{prefix}{topic.name}", _nobody, newest_qos(depth))


def _nobody(_message: object) -> None:
    """Stand where rclpy wants a callback; never called."""
