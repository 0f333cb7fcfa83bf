"""A leg or a quadruped: one simulation, and driver and controller of each ankle, as `jammkle up --robot` starts them.

ros2 launch jammkle_bringup robot.launch.py robot:=quadruped behaviour:=walk params:=robot.yaml
"""

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, EmitEvent, OpaqueFunction
from launch.events import Shutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from jammkle_bringup.core.node_table import SIM_HARDWARE, Robot, to_launch
from jammkle_common.names import SIM_NODE

ARGUMENTS = {
    "robot": (Robot.QUADRUPED.value, "What to bring up: leg, quadruped."),
    "behaviour": ("", "What a simulated one does: stand, walk, drop, slip, hang; empty: what params say, or stand."),
    "hardware": (SIM_HARDWARE, "What stands behind the drivers: sim, modbus (a port each in params), or a package's."),
    "namespace": ("", "ROS namespace of the robot, as in ankle.launch.py; several ankles are below it, as lf_ankle."),
    "speed": ("1.0", "Simulated time per real time; 0: as fast as possible."),
    "publish_clock": ("true", "Whether this simulation makes /clock; false where another one does."),
    "params": ("", "ROS parameter file (YAML); config/robot.yaml is one to start from."),
}


def generate_launch_description() -> LaunchDescription:
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=description)
        for name, (default, description) in ARGUMENTS.items()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=nodes)])


def nodes(context: LaunchContext) -> list[Node]:
    given = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    simulated = {name: given[name] for name in ("robot", "behaviour") if given[name]}
    pushed = context.launch_configurations.get("ros_namespace", "")
    # as in ankle.launch.py: a graph without one of its nodes is worse than none
    return [
        Node(**node, on_exit=EmitEvent(event=Shutdown(reason=f"{path} ended")))
        for path, node in to_launch(Robot(given["robot"]), given, pushed, {SIM_NODE: simulated})
    ]
