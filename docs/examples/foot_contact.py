"""Tell a stack that wants it whether a foot is on the ground: a latched Bool on `contact`, from the contact events.

python foot_contact.py --ros-args -r __ns:=/lf_ankle
"""

import sys

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import Bool

from jammkle_common.runner import run
from jammkle_msgs.msg import ContactEvent

CONTACT = {
    ContactEvent.IMPACT: True,
    ContactEvent.SLIP: True,
    ContactEvent.SETTLED: True,
    ContactEvent.LIFTOFF: False,
    ContactEvent.SWING: False,
}


class FootContact(Node):
    """Publishes what the latest event says of the foot; nothing before the first."""

    def __init__(self):
        """Follow events, and latch what they mean."""
        super().__init__("foot_contact")
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.contact = self.create_publisher(Bool, "contact", latched)
        self.create_subscription(ContactEvent, "contact_events", self.update, 100)

    def update(self, event):
        """Publish where an event says something of contact."""
        if event.type in CONTACT:
            self.contact.publish(Bool(data=CONTACT[event.type]))


if __name__ == "__main__":
    sys.exit(run(FootContact))
