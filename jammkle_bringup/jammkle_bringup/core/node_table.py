"""The one table of nodes: what is started for which robot and hardware. Used by `jammkle up` and the launch files."""

from __future__ import annotations

import enum
import importlib
import sys
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from jammkle_common.command import HARDWARE, entries
from jammkle_common.command.errors import InputError
from jammkle_common.names import (
    CONTROLLER_NODE,
    DRIVER_NODE,
    FOXGLOVE_NODE,
    GAP_MONITOR_NODE,
    QUADRUPED_ANKLES,
    ROBOT_NAMES_NODE,
    SIM_HARDWARE,
    SIM_NODE,
    VIEWER_NODE,
    resolved,
)
from jammkle_sim.robots.options import RobotOptions

if TYPE_CHECKING:
    from jammkle_common.parameters import ParameterClass


class Robot(enum.Enum):
    """What is simulated or driven."""

    ANKLE = "ankle"
    """One ankle on its rig, dropped onto a slope."""
    LEG = "leg"
    QUADRUPED = "quadruped"

    @property
    def ankles(self) -> tuple[str, ...]:
        """Namespaces of its ankles below the graph's own; a single one is in that."""
        return QUADRUPED_ANKLES if self is Robot.QUADRUPED else ("",)


@dataclass(frozen=True)
class NodeEntry:
    """One node: where its code is, its name on the graph, its parameter table, and when it is started.

    Attributes:
        package: The ROS package.
        executable: Name for `ros2 run` and launch files.
        name: Name on the graph, inside the namespace.
        parameter_table: `module:Class` of the node's parameters.
        simulates: True if the node is the simulated hardware, and so only started with it.
        follows_simulated_time: True if the node runs on /clock while the hardware is simulated.
        module: What `python -m` starts; empty: the Python package of the same name as the ROS package.
        within: Namespace below the graph's own: that of the node's ankle, where there are several.
        looks_on: True if the ankle is the same without the node, so that its death stops nothing.

    """

    package: str
    executable: str
    name: str
    parameter_table: str
    follows_simulated_time: bool
    simulates: bool = False
    module: str = ""
    within: str = ""
    looks_on: bool = False

    @property
    def path(self) -> str:
        """Name relative to the graph's namespace: `driver`, `lf_ankle/driver`."""
        return f"{self.within}/{self.name}" if self.within else self.name

    def parameters(self) -> type[ParameterClass]:
        """Return the node's parameter table. Imported only when asked for, to keep the command quick."""
        module, _, name = self.parameter_table.partition(":")
        table: type[ParameterClass] = getattr(importlib.import_module(module), name)
        return table


NODES: tuple[NodeEntry, ...] = (
    NodeEntry(
        package="jammkle_sim",
        executable="sim",
        name=SIM_NODE,
        parameter_table="jammkle_sim.parameters:SimParameters",
        follows_simulated_time=False,
        simulates=True,
    ),
    NodeEntry(
        package="jammkle_controller",
        executable="controller",
        name=CONTROLLER_NODE,
        parameter_table="jammkle_controller.parameters:ControllerParameters",
        follows_simulated_time=True,
    ),
    NodeEntry(
        package="jammkle_driver",
        executable="driver",
        name=DRIVER_NODE,
        parameter_table="jammkle_driver.parameters:DriverParameters",
        follows_simulated_time=True,
    ),
)
"""In the order in which they start; they stop in the reverse order, so that the simulation sees the release."""

ROBOT_SIM = NodeEntry(
    package="jammkle_sim",
    executable="robot",
    name=SIM_NODE,
    parameter_table="jammkle_sim.parameters:RobotParameters",
    follows_simulated_time=False,
    simulates=True,
    module="jammkle_sim.robot",
)
"""The simulation of a leg or a quadruped: one for all of its ankles."""

ROBOT_NODES = (ROBOT_SIM, *(entry for entry in NODES if not entry.simulates))
"""Each kind of node of a leg or a quadruped once."""

ROBOT_VALUES = {CONTROLLER_NODE: {"imu_mount": RobotOptions().imu}}
"""What fits our robots better than the default of a node: where their IMUs are."""

GAP_MONITOR = NodeEntry(
    package="jammkle_gap",
    executable="gap_monitor",
    name=GAP_MONITOR_NODE,
    parameter_table="jammkle_gap.monitor.parameters:GapMonitorParameters",
    follows_simulated_time=True,
    module="jammkle_gap.monitor",
    looks_on=True,
)
"""Looks on, and is started where it is asked for."""

VIEWER = NodeEntry(
    package="jammkle_view",
    executable="viewer",
    name=VIEWER_NODE,
    parameter_table="jammkle_view.parameters:ViewerParameters",
    follows_simulated_time=False,
    looks_on=True,
)
"""The page in the browser; looks on as well, and hands on what is clicked."""

FOXGLOVE = NodeEntry(
    package="jammkle_view",
    executable="foxglove",
    name=FOXGLOVE_NODE,
    parameter_table="jammkle_view.foxglove.parameters:FoxgloveParameters",
    follows_simulated_time=True,
    module="jammkle_view.foxglove",
    looks_on=True,
)
"""The live connection for the Foxglove app; looks on."""

ROBOT_NAMES = NodeEntry(
    package="jammkle_bringup",
    executable="robot_names",
    name=ROBOT_NAMES_NODE,
    parameter_table="jammkle_bringup.robot_names.parameters:RobotNamesParameters",
    follows_simulated_time=False,
    module="jammkle_bringup.robot_names",
)
"""Joints and channels by the robot's names, one for each ankle. A robot commands through it, so its death stops all."""

ParameterValue = bool | int | float | str


def check_hardware(hardware: str) -> None:
    """Refuse hardware that no installed package brings along.

    Raises:
        InputError: the name is unknown.

    """
    known = entries(HARDWARE)
    if hardware not in known:
        msg = f"--hardware {hardware} is not known: use one of {', '.join(known)}"
        raise InputError(msg)


def nodes_for(hardware: str, robot: Robot = Robot.ANKLE) -> tuple[NodeEntry, ...]:
    """Return the nodes of a graph, in the order in which they start: one simulation, and a set for each ankle."""
    kinds = NODES if robot is Robot.ANKLE else ROBOT_NODES
    simulated = [entry for entry in kinds if entry.simulates and hardware == SIM_HARDWARE]
    of_ankles = [replace(entry, within=ankle) for entry in kinds if not entry.simulates for ankle in robot.ankles]
    return (*simulated, *of_ankles)


def robot_names_for(robot: Robot) -> tuple[NodeEntry, ...]:
    """Return the nodes that know the robot's own names: one for each ankle."""
    return tuple(replace(ROBOT_NAMES, within=ankle) for ankle in robot.ankles)


def simulated_time(entry: NodeEntry, hardware: str) -> bool:
    """Return True if the node runs on /clock with this hardware."""
    return entry.follows_simulated_time and hardware == SIM_HARDWARE


def command_of(
    entry: NodeEntry,
    namespace: str,
    values: dict[str, ParameterValue],
    parameter_files: tuple[str, ...] = (),
) -> tuple[str, ...]:
    """Return the command that starts a node in a normalised namespace.

    Args:
        entry: The node.
        namespace: Normalised namespace of the graph.
        values: Parameters that win over the files.
        parameter_files: YAML files, the last one wins.

    """
    full = resolved(namespace, entry.within) if entry.within else namespace
    arguments = ["-r", f"__ns:={full}"]
    for file in parameter_files:
        arguments += ["--params-file", file]
    for name, value in values.items():
        arguments += ["-p", f"{name}:={_yaml_text(value)}"]
    return (sys.executable, "-m", entry.module or entry.package, "--ros-args", *arguments)


def _yaml_text(value: ParameterValue) -> str:
    """Return a value so that ROS reads it back in the same type."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        doubled = value.replace("'", "''")
        return f"'{doubled}'"
    return repr(value)
