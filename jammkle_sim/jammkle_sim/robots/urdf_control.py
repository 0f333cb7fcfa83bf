"""Tags of ros2_control: joints that are told on a topic, and the channels of every ankle as GPIO.

Both are for a stack to read, see docs/integration.md. The plugins are those of
ros-controls/topic_based_hardware_interfaces: one reads joint_states, the other has its states from messages of
pal_statistics and keeps the commands. docs/examples/gpio_bridge.py passes both on between it and the driver.
"""

from __future__ import annotations

from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

from jammkle_common.names import CHANNELS, JOINT_STATES, resolved

if TYPE_CHECKING:
    from jammkle_sim.robots.robot import Robot
    from jammkle_sim.robots.urdf_names import UrdfNames

VACUUM, STATE = "vacuum", "state"
"""Interfaces of a channel: Pa below ambient, and jammkle_msgs/ChannelJamState as a number."""
_JOINT_PLUGIN = "joint_state_topic_hardware_interface/JointStateTopicSystem"
_GPIO_PLUGIN = "cm_topic_hardware_component/CMTopicSystem"
LARGEST_VACUUM_PA = 70e3
"""Most that the driver takes, unless its parameter `max_vacuum_pa` says otherwise."""
_UNUSED = "unused_joint_commands"
"""Topic of commands that the joints' plugin asks for; nobody commands them."""


def control_tags(robot: Robot, names: UrdfNames, namespace: str) -> tuple[ET.Element, ET.Element]:
    """Return the tags of the joints and of the channels.

    Args:
        robot: The robot.
        names: Of its parts.
        namespace: Normalised ROS namespace of the robot.

    """
    owner = namespace.strip("/").replace("/", "_") or robot.name
    joints = _system(f"{owner}_joints", _JOINT_PLUGIN)
    hardware = joints[0]
    for parameter, topic in (("joint_states_topic", JOINT_STATES.name), ("joint_commands_topic", _UNUSED)):
        ET.SubElement(hardware, "param", name=parameter).text = resolved(namespace, topic)
    for told in names.told:
        joint = ET.SubElement(joints, "joint", name=told.unique)
        for interface in ("position", "velocity"):
            ET.SubElement(joint, "state_interface", name=interface)
    air = _system(f"{owner}_air", _GPIO_PLUGIN)
    for ankle in robot.ankles:
        for channel in CHANNELS:
            gpio = ET.SubElement(air, "gpio", name="_".join(part for part in (names.within(ankle), channel) if part))
            wish = ET.SubElement(gpio, "command_interface", name=VACUUM)
            for bound, value_pa in (("min", 0.0), ("max", LARGEST_VACUUM_PA)):
                ET.SubElement(wish, "param", name=bound).text = f"{value_pa:g}"
            for interface in (VACUUM, STATE):
                ET.SubElement(gpio, "state_interface", name=interface)
    return joints, air


def _system(name: str, plugin: str) -> ET.Element:
    system = ET.Element("ros2_control", name=name, type="system")
    ET.SubElement(ET.SubElement(system, "hardware"), "plugin").text = plugin
    return system
