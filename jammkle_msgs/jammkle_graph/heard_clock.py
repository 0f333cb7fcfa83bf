"""A node that hears /clock at little cost, and knows when it last did."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

from rclpy.node import Node
from rclpy.serialization import deserialize_message
from rosgraph_msgs.msg import Clock

from jammkle_graph import wire
from jammkle_graph.names import CLOCK

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.qos import QoSProfile
    from rclpy.subscription import Subscription


class ClockHearer(Node):
    """To be named before another kind of node among the bases of one that may live in simulated time.

    With `use_sim_time` rclpy subscribes to /clock by itself. At 250 ticks a second of simulated time its making of two
    objects for each was a twelfth of a driver's work, and a second subscription that notes when it ticked another.
    """

    clock_heard_s: float = 0.0
    """When /clock was last heard, s of time.monotonic, also where it stands; 0: never, or nobody asks for it."""

    def create_subscription(
        self,
        msg_type: type,
        topic: str,
        callback: Callable[[Any], Any],
        qos_profile: QoSProfile | int,
        **options: Any,
    ) -> Subscription:
        """Subscribe as rclpy does; to /clock by its bytes, of which `callback` gets a message that is used again."""
        if topic != CLOCK.name or options.get("raw"):
            return super().create_subscription(msg_type, topic, callback, qos_profile, **options)
        message = Clock()

        def hear(serialized: bytes) -> None:
            self.clock_heard_s = time.monotonic()
            stamp = wire.read_clock(serialized)
            if stamp is None:
                callback(deserialize_message(serialized, Clock))
                return
            message.clock.sec, message.clock.nanosec = stamp
            callback(message)

        return super().create_subscription(msg_type, topic, hear, qos_profile, **options, raw=True)
