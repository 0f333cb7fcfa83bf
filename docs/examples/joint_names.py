r"""Give the joints of a robot the names that the tools of this project know: joint_states in, joint_states out.

python joint_names.py --ros-args -r __ns:=/lf_ankle -r robot/joint_states:=/joint_states \
    -p names:="[lf_foot_pitch, ankle_pitch, lf_foot_roll, ankle_roll]" -p turned:="[lf_foot_roll]"

`names` is pairs, theirs then ours; `turned` are those of theirs that count the other way round (ours are right-handed
about x forward, y to the left, z up, so that ankle_pitch is positive toe-down). What is not named is left out.
"""

import sys

from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import JointState

from jammkle_graph.parameters import ParameterError
from jammkle_graph.runner import run


def pairs_of(names):
    """Return ours by theirs; ParameterError if the names do not come in pairs."""
    if len(names) % 2 or not names:
        raise ParameterError(f"names is {list(names)}; give pairs, theirs then ours: [their_pitch, ankle_pitch]")
    return dict(zip(names[::2], names[1::2], strict=True))


def renamed(message, ours, turned):
    """Return the message with the joints of `ours` alone, by our names; None if it has none of them."""
    kept = [place for place, name in enumerate(message.name) if name in ours]
    if not kept:
        return None
    signs = [-1.0 if message.name[place] in turned else 1.0 for place in kept]
    values = {
        field: [sign * found[place] for sign, place in zip(signs, kept, strict=True)] if found else []
        for field, found in (
            ("position", message.position),
            ("velocity", message.velocity),
            ("effort", message.effort),
        )
    }
    return JointState(header=message.header, name=[ours[message.name[place]] for place in kept], **values)


class JointNames(Node):
    """Passes joint states on under other names."""

    def __init__(self):
        """Hear the robot's and publish the ankle's; ParameterError if the names do not come in pairs."""
        super().__init__("joint_names")
        self.ours = pairs_of(self.declare_parameter("names", [""]).value)
        self.turned = set(self.declare_parameter("turned", [""]).value)
        self.joint_states = self.create_publisher(JointState, "joint_states", 10)
        self.create_subscription(JointState, "robot/joint_states", self.take, qos_profile_sensor_data)

    def take(self, message):
        """Pass one on."""
        found = renamed(message, self.ours, self.turned)
        if found is not None:
            self.joint_states.publish(found)


if __name__ == "__main__":
    sys.exit(run(JointNames))
