"""Let a ros2_control stack jam: passes GPIO commands of a controller manager on to the driver, and states back.

python gpio_bridge.py --ros-args -r __ns:=/lf_ankle
python gpio_bridge.py --ros-args -p component:=quadruped_air -p ankles:="[lf_ankle, rf_ankle, lh_ankle, rh_ankle]"

Runs in the namespace of the controller manager. Commands: the interfaces `vacuum` (Pa below ambient; 0 unjams) that the
controller manager tells on `controller_manager/introspection_data`, whichever controller has set them. States: what
`cm_topic_hardware_component/CMTopicSystem` reads, per channel `vacuum` (measured, Pa) and `state`
(jammkle_msgs/ChannelJamState). Needs pal_statistics_msgs, which ros2_control brings along. Do not run the project's own
controller beside it: both would command.
"""

import math
import sys
import time

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data

from jammkle_common.runner import run
from jammkle_msgs.msg import ChannelJamCommand, ChannelJamState, JamCommand, JamState

VACUUM, STATE = "vacuum", "state"
COMMAND_INTERFACE, STATE_INTERFACE = "command_interface.", "state_interface."
PERIOD_S = 0.05
"""Well below the driver's command_timeout_s: a command of ros2_control stands until the next, ours go stale."""
SILENT_S = 2.5
"""Silence of jam_state, which is repeated every second, after which its ankle's states are not known any more."""
NAMES_VERSION = 1
"""Of the states' names, which are the same in every message; 0 means none to CMTopicSystem."""


def gpio(ankle, channel):
    """Return how the robot description calls a channel: of several ankles by ankle."""
    return f"{ankle}_{channel}" if ankle else channel


def set_points(names, values):
    """Return the vacuum wanted, Pa, by GPIO; what nobody has set yet is NaN, and no set point."""
    return {
        name.removeprefix(COMMAND_INTERFACE).removesuffix(f"/{VACUUM}"): value
        for name, value in zip(names, values, strict=True)
        if name.startswith(COMMAND_INTERFACE) and name.endswith(f"/{VACUUM}") and not math.isnan(value)
    }


def states(ankle, report):
    """Return the value of each state interface of an ankle by its full name, from a JamState."""
    states_now = {}
    for each in report.channels:
        name = STATE_INTERFACE + gpio(ankle, each.channel)
        states_now[f"{name}/{VACUUM}"], states_now[f"{name}/{STATE}"] = each.measured_vacuum_pa, float(each.state)
    return states_now


def command(ankle, channels, wanted, stamp):
    """Return the JamCommand of one ankle, of those of its channels that something is wanted of."""
    named = {channel: wanted.get(gpio(ankle, channel)) for channel in channels}
    message = JamCommand(
        channels=[ChannelJamCommand(channel=channel, vacuum_pa=pa) for channel, pa in named.items() if pa is not None]
    )
    message.header.stamp = stamp
    return message


class GpioBridge(Node):
    """Repeats the commands as long as the controller manager does; where it falls silent, the driver lets go."""

    def __init__(self):
        """Join both sides."""
        from pal_statistics_msgs.msg import StatisticsNames, StatisticsValues  # noqa: PLC0415 - there may be none

        super().__init__("gpio_bridge")
        self.messages = StatisticsNames, StatisticsValues
        alone = self.get_namespace().strip("/").replace("/", "_") or "ankle"
        component = self.declare_parameter("component", f"{alone}_air").value
        ankles = list(self.declare_parameter("ankles", [""]).value)
        self.prefixes = {ankle: ankle if len(ankles) > 1 else "" for ankle in ankles}
        self.channels, self.reported_s, self.refused, self.states_now = {}, {}, {}, {}
        self.names, self.passed_on_s = {}, -math.inf
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.jam_commands = {}
        for ankle in ankles:
            below = f"{ankle}/" if ankle else ""
            self.jam_commands[ankle] = self.create_publisher(JamCommand, f"{below}jam_command", QoSProfile(depth=1))
            self.create_subscription(JamState, f"{below}jam_state", lambda it, of=ankle: self.update(of, it), latched)
        self.state_names = self.create_publisher(StatisticsNames, f"{component}/names", 1)
        self.state_values = self.create_publisher(StatisticsValues, f"{component}/values", 1)
        introspection = "controller_manager/introspection_data"
        self.create_subscription(StatisticsNames, f"{introspection}/names", self.learn, latched)
        self.create_subscription(StatisticsValues, f"{introspection}/values", self.take, qos_profile_sensor_data)
        self.create_timer(1.0, self.doubt, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def learn(self, message):
        """Keep the latest names; values that have others are not understood until theirs have come."""
        self.names = {message.names_version: message.names}

    def take(self, message):
        """Pass the commands on, at most at our rate."""
        now_s = time.monotonic()
        names = self.names.get(message.names_version, ())
        if len(names) != len(message.values) or now_s < self.passed_on_s + PERIOD_S:
            return  # the manager is loading or unloading: the names that belong to it are on their way
        self.passed_on_s = now_s
        wanted = set_points(names, message.values)
        stamp = self.get_clock().now().to_msg()
        for ankle, channels in self.channels.items():
            request = command(self.prefixes[ankle], channels, wanted, stamp)
            if request.channels:
                self.jam_commands[ankle].publish(request)

    def update(self, ankle, report):
        """Keep the states of an ankle, and publish them."""
        self.channels[ankle], self.reported_s[ankle] = [each.channel for each in report.channels], time.monotonic()
        if report.refused_command and report.refused_command != self.refused.get(ankle):
            self.get_logger().error(f"{ankle or self.get_namespace()}: {report.refused_command}")
        self.refused[ankle] = report.refused_command
        self.states_now.update(states(self.prefixes[ankle], report))
        self.tell()

    def doubt(self):
        """Say of an ankle whose driver is silent that its states are not known."""
        for ankle, reported_s in self.reported_s.items():
            if time.monotonic() > reported_s + SILENT_S:
                unknown = [ChannelJamState(channel=name, measured_vacuum_pa=math.nan) for name in self.channels[ankle]]
                self.states_now.update(states(self.prefixes[ankle], JamState(channels=unknown)))
                self.tell()

    def tell(self):
        """Tell the states to the hardware component, with their names, which may have been lost before."""
        names, values = self.messages
        self.state_names.publish(names(names=list(self.states_now), names_version=NAMES_VERSION))
        self.state_values.publish(values(values=list(self.states_now.values()), names_version=NAMES_VERSION))


if __name__ == "__main__":
    sys.exit(run(GpioBridge))
