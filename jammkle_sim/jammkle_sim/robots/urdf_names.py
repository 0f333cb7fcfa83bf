"""What a robot's parts are called outside of its model: links as frames on the graph, joints as joint_states has them.

A robot on one ankle has the ankle's topics in its own namespace, and calls its parts as that does: `foot`, `hip`,
`ankle_pitch`. Of several ankles each is a namespace: its links are `lf_ankle/foot`, and as a joint's name must be the
only one of its kind in a robot and may hold no slash, its joints are `lf_ankle_pitch`, `lf_hip`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from jammkle_common.names import ANKLE_JOINTS, frame

if TYPE_CHECKING:
    from collections.abc import Iterator

    from jammkle_sim.robots.attach import AttachedAnkle
    from jammkle_sim.robots.robot import Robot

_JOINT_PREFIX = "ankle_"
"""What the names of an ankle's own joints begin with, whatever the ankle is called."""


@dataclass(frozen=True)
class Told:
    """One joint that joint_states tells of."""

    ankle: str
    """Name of the ankle that tells it."""
    name: str
    """Name in the joint_states of that ankle."""
    joint: str
    """Name in the model."""
    unique: str
    """Name in the whole robot: in its URDF, and in the joint_states of all of it."""


class UrdfNames:
    """Names of one robot's parts."""

    def __init__(self, robot: Robot, namespace: str = "/") -> None:
        """Take the robot's ankles.

        Args:
            robot: The robot.
            namespace: Normalised ROS namespace of the robot, which its frames begin with.

        """
        self._namespace = namespace
        self._ankles = robot.ankles
        self.told: tuple[Told, ...] = tuple(_told(robot))
        """Every joint that joint_states tells of."""
        self._joints = {told.joint: told.unique for told in self.told}

    def within(self, ankle: AttachedAnkle) -> str:
        """Return the namespace of an ankle below the robot's; a single one is in that."""
        return ankle.name if len(self._ankles) > 1 else ""

    def link(self, body: str) -> str:
        """Return the frame of a body, by its name in the model."""
        ankle, _, part = body.rpartition("/")
        single = len(self._ankles) == 1 and ankle == self._ankles[0].name
        return self.frame(part if single else body)

    def frame(self, name: str, ankle: AttachedAnkle | None = None) -> str:
        """Return a frame of the robot, or of one of its ankles."""
        return frame(self._namespace, frame(self.within(ankle), name) if ankle is not None else name)

    def joint(self, joint: str) -> str:
        """Return the name of a joint by its name in the model; one that nobody tells of keeps that."""
        return self._joints.get(joint, joint)


def _told(robot: Robot) -> Iterator[Told]:
    several = len(robot.ankles) > 1
    for ankle in robot.ankles:
        for joint in ANKLE_JOINTS:
            alone = f"{ankle.name}_{joint.removeprefix(_JOINT_PREFIX)}"
            yield Told(ankle.name, joint, ankle.named(joint), alone if several else joint)
        for name, joint in ankle.joints.items():
            yield Told(ankle.name, name, joint, joint if several else name)
