"""The pose of an odometry as a transform, for whoever draws a robot where it is. Does not import rclpy."""

from __future__ import annotations

import functools
from typing import Any

from jammkle_common.messages import message_class
from jammkle_common.names import TF


def transform_of(odometry: Any) -> Any:
    """Return a `nav_msgs/Odometry` as the `tf2_msgs/TFMessage` that puts its child frame into its frame (REP-105).

    Where `tf2_msgs` is not installed, a plain message with the same fields.
    """
    kind, stamped_kind = _kinds()
    stamped = stamped_kind(header=odometry.header, child_frame_id=odometry.child_frame_id)
    place, moved = odometry.pose.pose.position, stamped.transform.translation
    moved.x, moved.y, moved.z = place.x, place.y, place.z
    stamped.transform.rotation = odometry.pose.pose.orientation
    return kind(transforms=[stamped])


@functools.cache
def _kinds() -> tuple[Any, Any]:
    return message_class(TF.message_type), message_class("geometry_msgs/msg/TransformStamped")
