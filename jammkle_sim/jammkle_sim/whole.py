"""What is said of the whole that is simulated, not of one ankle: its URDF, where its base is, all of its joints."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from nav_msgs.msg import Odometry
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from jammkle_common import names
from jammkle_common.messages import transform_of
from jammkle_common.qos import publisher_qos
from jammkle_sim.conversions import OutgoingMessages
from jammkle_sim.core.schedule import Output

try:  # what tf listens to comes with the distribution, and is not among the wheels
    from tf2_msgs.msg import TFMessage
except ModuleNotFoundError:
    TFMessage = None

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from rclpy.node import Node
    from rclpy.publisher import Publisher

    from jammkle_sim.core.engine import Tick
    from jammkle_sim.outputs import AnkleSensors
    from jammkle_sim.rigs.base import BaseSample
    from jammkle_sim.robots.urdf_names import Told


class Based(Protocol):
    """Anything simulated that has a base."""

    def base(self) -> BaseSample:
        """Where it is, and how it moves."""


class Whole:
    """Publishers of one simulation, in the node's own namespace."""

    def __init__(self, node: Node, urdf: str, told: Sequence[Told]) -> None:
        """Publish the URDF, which stays as it is.

        Args:
            node: The sim node.
            urdf: Of what is simulated.
            told: Joints of several ankles, to be told together under names of their own; none of a single one, which
                tells them in this very namespace.

        """
        self._messages = OutgoingMessages((), node.get_namespace())
        self._told = told
        topic = names.ROBOT_DESCRIPTION
        self._description = node.create_publisher(String, topic.name, publisher_qos(topic))
        self._description.publish(String(data=urdf))
        self._odometry = node.create_publisher(Odometry, names.ODOMETRY.name, publisher_qos(names.ODOMETRY))
        self._transforms = None
        if TFMessage is not None:
            self._transforms = node.create_publisher(TFMessage, names.TF.name, publisher_qos(names.TF))
        self._joints = None
        if told:
            self._joints = node.create_publisher(JointState, names.JOINT_STATES.name, publisher_qos(names.JOINT_STATES))

    def publish(self, tick: Tick, simulation: Based, ankles: Mapping[str, AnkleSensors]) -> None:
        """Publish what is due, if anybody hears it.

        Args:
            tick: What is due, and its time.
            simulation: Whose base it is.
            ankles: By name.

        Raises:
            NotFiniteError: the simulation gave NaN or infinity; it was not published.

        """
        if Output.WHOLE not in tick.outputs:
            return
        if _is_heard(self._odometry) or _is_heard(self._transforms):
            odometry = self._messages.odometry(tick.time_ns, simulation.base())
            self._odometry.publish(odometry)
            if self._transforms is not None:
                self._transforms.publish(transform_of(odometry))
        if self._joints is not None and _is_heard(self._joints):
            positions = {name: ankle.joint_positions() for name, ankle in ankles.items()}
            velocities = {name: ankle.joint_velocities() for name, ankle in ankles.items()}
            self._joints.publish(
                self._messages.joint_states(
                    tick.time_ns,
                    {told.unique: positions[told.ankle][told.name] for told in self._told},
                    {told.unique: velocities[told.ankle][told.name] for told in self._told},
                )
            )


def _is_heard(publisher: Publisher | None) -> bool:
    return publisher is not None and publisher.get_subscription_count() > 0
