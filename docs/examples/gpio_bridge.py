"""Let a ros2_control stack jam: speaks as gpio_controllers' command controller does, and passes it on to the driver.

python gpio_bridge.py --ros-args -r __ns:=/lf_ankle

Commands: `gpio_controller/commands`, a group per channel with the interface `vacuum` (Pa below ambient; 0 unjams).
States: `gpio_controller/gpio_states`, per channel `vacuum` (measured, Pa) and `state` (jammkle_msgs/ChannelJamState).
Needs control_msgs. Do not run the project's own controller beside it: both would wish.
"""

import sys

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile

from jammkle_graph.runner import run
from jammkle_msgs.msg import ChannelJamCommand, JamCommand, JamState

VACUUM, STATE = "vacuum", "state"
PERIOD_S = 0.05
"""Well below the driver's command_timeout_s: a command of ros2_control stands until the next, ours go stale."""


def wishes(message):
    """Return the vacuum wanted, Pa, by channel, from a DynamicInterfaceGroupValues; ValueError if it is torn."""
    return {
        channel: dict(zip(values.interface_names, values.values, strict=True))[VACUUM]
        for channel, values in zip(message.interface_groups, message.interface_values, strict=True)
        if VACUUM in values.interface_names
    }


def states(report):
    """Return vacuum, Pa, and state by channel, from a JamState."""
    return {each.channel: (each.measured_vacuum_pa, float(each.state)) for each in report.channels}


def command(wanted, stamp):
    """Return the JamCommand for the vacuum wanted by channel."""
    message = JamCommand(channels=[ChannelJamCommand(channel=name, vacuum_pa=pa) for name, pa in wanted.items()])
    message.header.stamp = stamp
    return message


class GpioBridge(Node):
    """Repeats the latest commands as long as somebody is there to take them back."""

    def __init__(self):
        """Join both sides."""
        from control_msgs.msg import DynamicInterfaceGroupValues, InterfaceValue  # noqa: PLC0415 - there may be none

        super().__init__("gpio_bridge")
        self.group_values, self.interface_value = DynamicInterfaceGroupValues, InterfaceValue
        self.wanted = {}
        self.jam_command = self.create_publisher(JamCommand, "jam_command", QoSProfile(depth=1))
        self.gpio_states = self.create_publisher(DynamicInterfaceGroupValues, "gpio_controller/gpio_states", 10)
        self.commands = self.create_subscription(DynamicInterfaceGroupValues, "gpio_controller/commands", self.take, 10)
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.create_subscription(JamState, "jam_state", self.tell, latched)
        self.create_timer(PERIOD_S, self.repeat)

    def take(self, message):
        """Keep what is wanted."""
        try:
            self.wanted.update(wishes(message))
        except ValueError as error:
            self.get_logger().error(f"commands are not complete: {error}")

    def repeat(self):
        """Pass it on; where no commander is left, the driver lets go by itself."""
        if self.wanted and self.count_publishers(self.commands.topic_name):
            self.jam_command.publish(command(self.wanted, self.get_clock().now().to_msg()))

    def tell(self, report):
        """Tell the states as a GPIO controller does."""
        found = states(report)
        message = self.group_values(interface_groups=list(found))
        message.header.stamp = report.header.stamp
        message.interface_values = [
            self.interface_value(interface_names=[VACUUM, STATE], values=list(values)) for values in found.values()
        ]
        self.gpio_states.publish(message)


if __name__ == "__main__":
    sys.exit(run(GpioBridge))
