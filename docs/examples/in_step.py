"""A node that a simulated robot waits for: what it publishes for a stamp arrives before the next step is taken."""

import rclpy
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Header

rclpy.init()
node = rclpy.create_node("mission")
done = node.create_publisher(Header, "lockstep", 1)


def on_tick(tick):
    """Answer once everything is done that this node has to do with what came up to now."""
    done.publish(Header(stamp=tick.clock, frame_id=node.get_fully_qualified_name()))


# The last subscription: an executor of rclpy serves what has arrived in the order in which a node subscribed.
node.create_subscription(Clock, "/clock", on_tick, rclpy.qos.QoSProfile(depth=1, reliability=2))
rclpy.spin(node)
