"""A leg or a quadruped: one simulation, and driver and controller of each ankle, as `jammkle up --robot` starts them.

ros2 launch jammkle_bringup robot.launch.py robot:=quadruped behaviour:=walk params:=robot.yaml
"""

from pathlib import Path

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, EmitEvent, OpaqueFunction
from launch.events import Shutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from jammkle_bringup.core.node_table import (
    SIM_HARDWARE,
    Robot,
    check_hardware,
    nodes_for,
    robot_names_for,
    simulated_time,
)
from jammkle_common.names import DRIVER_NODE, SIM_NODE, normalised, resolved

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
    robot, hardware = Robot(given["robot"]), given["hardware"]
    namespace = normalised(resolved(context.launch_configurations.get("ros_namespace", ""), given["namespace"]))
    check_hardware(hardware)
    actions = []
    files = [given["params"]] if given["params"] else []
    named = robot_names_for(robot, [Path(file) for file in files], namespace)
    for entry in (*named, *nodes_for(hardware, robot)):
        values = {"use_sim_time": True} if simulated_time(entry, hardware) else {}
        if entry.name == SIM_NODE:
            values["robot"] = robot.value
            values.update({"behaviour": given["behaviour"]} if given["behaviour"] else {})
            values["speed"] = float(given["speed"])
            values["publish_clock"] = given["publish_clock"].lower() == "true"
        if entry.name == DRIVER_NODE:
            values["hardware"] = hardware
        actions.append(
            Node(
                package=entry.package,
                executable=entry.executable or entry.name,
                name=entry.name,
                namespace=resolved(namespace, entry.within) if entry.within else namespace,
                parameters=[*files, values],
                output="screen",
                # as in ankle.launch.py: a graph without one of its nodes is worse than none
                on_exit=EmitEvent(event=Shutdown(reason=f"{entry.path} ended")),
            )
        )
    return actions
