"""What those who take every topic of a graph have in common, a recorder and a viewer: which topics, and how."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from jammkle_common.names import CLOCK, DIAGNOSTICS
from jammkle_common.namespace import relative

if TYPE_CHECKING:
    from collections.abc import Sequence

_OUTSIDE = (CLOCK.name, DIAGNOSTICS.name, "/tf", "/tf_static")
_LEFT_OUT = ("/rosout", "/parameter_events")


def belongs(namespace: str, name: str) -> bool:
    """Return whether a topic is one of a namespace's, or said of it outside.

    Args:
        namespace: Normalised.
        name: Full name of the topic.

    """
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
    """Return the strongest request that all of these publishers can meet.

    Args:
        offered: By each publisher.
        depth: Messages that may wait.

    """
    reliable = all(offer.reliability is ReliabilityPolicy.RELIABLE for offer in offered)
    latched = all(offer.durability is DurabilityPolicy.TRANSIENT_LOCAL for offer in offered)
    return QoSProfile(
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )
