"""The node robot_names: joints and channels under the robot's own names, beside ours."""

from __future__ import annotations

import copy
from functools import partial
from typing import TYPE_CHECKING, Any

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool

from jammkle_bringup.core.renaming import ChannelRenaming, JointRenaming, RenamingError
from jammkle_bringup.robot_names.parameters import OF_THE_ROBOT, RobotNamesParameters
from jammkle_common import names
from jammkle_common.parameters import ParameterError, declare
from jammkle_common.qos import publisher_qos, subscriber_qos
from jammkle_msgs.msg import JamCommand, JamState
from jammkle_msgs.srv import Jam, Unjam

if TYPE_CHECKING:
    from rclpy.client import Client
    from rclpy.task import Future

ANSWER_S = 2.0
"""The driver answers at once; after so long it is taken for dead. As long as ros2cli waits for a node."""


class RobotNamesNode(Node):
    """Passes on what is said of joints and channels, under other names. Nothing is decided here.

    If it ends, commands that came through it go stale, and the driver vents what they have jammed.
    """

    def __init__(self, **node_options: Any) -> None:
        """Make the node.

        Args:
            node_options: Passed on to rclpy (`parameter_overrides`, `namespace`, `context`).

        Raises:
            ParameterError: a parameter is unknown, or a name cannot be mapped as it says.

        """
        super().__init__(names.ROBOT_NAMES_NODE, automatically_declare_parameters_from_overrides=True, **node_options)
        values = declare(self, RobotNamesParameters)
        try:
            joints, self._channels = JointRenaming.parsed(values.joints), ChannelRenaming.parsed(values.channels)
        except RenamingError as error:
            msg = f"{self.get_fully_qualified_name()}: {error}"
            raise ParameterError(msg) from error
        if not joints.new and not values.channels:
            msg = f"{self.get_fully_qualified_name()}: joints and channels are empty: give one, as theirs=ours"
            raise ParameterError(msg)
        self._group = ReentrantCallbackGroup()  # what a request waits for, and others meanwhile
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        if joints.new and values.joints_of == OF_THE_ROBOT:
            self._pass_joints(names.ROBOTS_JOINT_STATES, names.JOINT_STATES, joints)
        elif joints.new:
            self._pass_joints(names.JOINT_STATES, names.ROBOTS_JOINT_STATES, joints.reverse)
        if values.channels:
            self._pass_channels()

    def _pass_joints(self, source: names.Topic, target: names.Topic, renaming: JointRenaming) -> None:
        publisher = self.create_publisher(JointState, target.name, publisher_qos(target))

        def take(message: JointState) -> None:
            found = renaming.renamed(message)
            if found is not None:
                publisher.publish(
                    JointState(
                        header=message.header,
                        name=list(found.name),
                        position=list(found.position),
                        velocity=list(found.velocity),
                        effort=list(found.effort),
                    )
                )

        self.create_subscription(JointState, source.name, take, subscriber_qos(source))

    def _pass_channels(self) -> None:
        heard, told = names.JAM_STATE, names.ROBOTS_JAM_STATE
        self._states = self.create_publisher(JamState, told.name, publisher_qos(told))
        self.create_subscription(JamState, heard.name, self._take_state, subscriber_qos(heard))
        heard, told = names.ROBOTS_JAM_COMMAND, names.JAM_COMMAND
        self._commands = self.create_publisher(JamCommand, told.name, publisher_qos(told))
        self.create_subscription(JamCommand, heard.name, self._take_command, subscriber_qos(heard))
        for kind, service in ((Jam, names.JAM), (Unjam, names.UNJAM)):
            client = self.create_client(kind, service.path, callback_group=self._group)
            name = names.robots_service(service.suffix)
            self.create_service(kind, name, partial(self._ask, client), callback_group=self._group)
        for theirs, ours in self._channels.theirs_to_ours.items():
            client = self.create_client(SetBool, names.CHANNEL_JAMS[ours].path, callback_group=self._group)
            name = names.robots_service(names.channel_jam_service(theirs).suffix)
            self.create_service(SetBool, name, partial(self._pass_on, client), callback_group=self._group)

    def _take_state(self, message: JamState) -> None:
        told = copy.deepcopy(message)
        for channel in told.channels:
            channel.channel = self._channels.theirs(channel.channel)
            channel.reason = self._channels.told(channel.reason)
        told.refused_command = self._channels.told(told.refused_command)
        self._states.publish(told)

    def _take_command(self, message: JamCommand) -> None:
        try:
            ours = self._channels.ours([each.channel for each in message.channels])
        except RenamingError as error:
            self.get_logger().warning(f"{names.ROBOTS_JAM_COMMAND.name} refused: {error}", throttle_duration_sec=1.0)
            return
        passed = copy.deepcopy(message)
        for channel, name in zip(passed.channels, ours, strict=True):
            channel.channel = name
        self._commands.publish(passed)

    async def _ask(self, client: Client, request: Any, response: Any) -> Any:
        try:
            request.channels = self._channels.ours(request.channels)
        except RenamingError as error:
            response.success, response.message = False, str(error)
            return response
        return await self._pass_on(client, request, response)

    async def _pass_on(self, client: Client, request: Any, response: Any) -> Any:
        answer = None
        if client.service_is_ready():
            future: Future = client.call_async(request)
            limit = self.create_timer(ANSWER_S, future.cancel, callback_group=self._group, clock=self._steady)
            answer = await future
            self.destroy_timer(limit)
        if answer is None:
            response.success, response.message = False, f"no answer from {client.srv_name}: is the driver there?"
            return response
        answer.message = self._channels.told(answer.message)
        return answer
