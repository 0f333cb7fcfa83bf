"""One ankle: driver, controller and simulation, as `jammkle up` starts them.

ros2 launch jammkle_bringup ankle.launch.py namespace:=lf_ankle speed:=0.5
"""

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, EmitEvent, OpaqueFunction
from launch.events import Shutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from jammkle_bringup.core.node_table import GAP_MONITOR, SIM_HARDWARE, Robot, to_launch
from jammkle_common.names import DRIVER_NODE, SIM_NODE

ARGUMENTS = {
    "hardware": (SIM_HARDWARE, "What stands behind the driver: sim, modbus, or what a package brings along."),
    "port": ("", "Where the board is: a serial device, or tcp://HOST[:PORT]."),
    "namespace": ("", "ROS namespace of the ankle, in that of an including launch file unless it begins with /."),
    "speed": ("1.0", "Simulated time per real time; 0: as fast as possible."),
    # Launch has nothing that waits until the nodes have found each other, as `jammkle up` does. Discovery may take 2 s,
    # and an ankle that falls before its controller receives the IMU lands unnoticed; so it hangs for longer.
    "release_time_s": ("5.0", "Simulated time after which the carriage is released; wins over params."),
    "publish_clock": ("true", "Whether this simulation makes /clock; false for all but one of several ankles."),
    "monitor": ("false", "Whether the gap monitor follows the ankle with a simulated twin."),
    "params": ("", "ROS parameter file (YAML); config/ankle.yaml is one to start from."),
}


def generate_launch_description() -> LaunchDescription:
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=description)
        for name, (default, description) in ARGUMENTS.items()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=nodes)])


def nodes(context: LaunchContext) -> list[Node]:
    given = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    values = {
        SIM_NODE: {"release_time_s": float(given["release_time_s"])},
        DRIVER_NODE: {"port": given["port"]},
    }
    looking_on = (GAP_MONITOR,) if given["monitor"].lower() == "true" else ()
    pushed = context.launch_configurations.get("ros_namespace", "")
    # a graph without one of its nodes is worse than none: the rest is stopped, solenoids released
    return [
        Node(**node, on_exit=EmitEvent(event=Shutdown(reason=f"{path} ended")))
        for path, node in to_launch(Robot.ANKLE, given, pushed, values, looking_on)
    ]
