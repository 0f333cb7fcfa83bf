"""The node robot_names: joint states by names and signs of ours, or by the robot's, beside what there is.

    python -m jammkle_bringup.robot_names        ros2 run jammkle_bringup robot_names

It subscribes to `robot/joint_states` and publishes `joint_states`; by ROS remaps it goes between any two topics, also
the other way round. Topics alone, such as a channel's pressure, are remapped at the node that has them.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from typing import Any

from rclpy.node import Node
from sensor_msgs.msg import JointState

from jammkle_bringup.core.renaming import JointRenaming
from jammkle_common import names
from jammkle_common.command.errors import InputError
from jammkle_common.parameters import ParameterError, declare, parameter
from jammkle_common.qos import publisher_qos, subscriber_qos
from jammkle_common.runner import run


@dataclass(frozen=True)
class RobotNamesParameters:
    """What can be set on robot_names."""

    joints: str = parameter(
        "",
        "Joints, as theirs=ours parted by commas: lf_foot_pitch=ankle_pitch, lf_foot_roll=-ankle_roll; with the minus "
        "theirs counts the other way round; the others are left out",
    )


class RobotNamesNode(Node):
    """Passes joint states on under other names: ours for the robot's, and the robot's for ours."""

    def __init__(self, **node_options: Any) -> None:
        """Make the node; options are those of rclpy.

        Raises:
            ParameterError: a parameter is unknown, or a name cannot be mapped as it says.

        """
        super().__init__(names.ROBOT_NAMES_NODE, automatically_declare_parameters_from_overrides=True, **node_options)
        values = declare(self, RobotNamesParameters)
        try:
            self._ours = JointRenaming.parsed(values.joints)
        except InputError as error:
            msg = f"{self.get_fully_qualified_name()}: {error}"
            raise ParameterError(msg) from error
        if not self._ours.new:
            msg = f"{self.get_fully_qualified_name()}: joints is empty: give theirs=ours"
            raise ParameterError(msg)
        self._theirs = self._ours.reverse
        source, target = names.ROBOTS_JOINT_STATES, names.JOINT_STATES
        self._publisher = self.create_publisher(JointState, target.name, publisher_qos(target))
        self.create_subscription(JointState, source.name, self._on_joints, subscriber_qos(source))

    def _on_joints(self, message: JointState) -> None:
        found = self._ours.renamed(message) or self._theirs.renamed(message)
        if found is not None:
            joints, values = found
            self._publisher.publish(JointState(header=message.header, name=joints, **values))


def main() -> int:
    """Run the node until SIGINT or SIGTERM and return the exit code."""
    return run(RobotNamesNode)


if __name__ == "__main__":
    sys.exit(main())
