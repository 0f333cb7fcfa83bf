"""Which graph to start: what `jammkle up` and its parameter files say, checked before anything starts."""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from jammkle_bringup.core.node_table import (
    AS_BUILT,
    FOXGLOVE,
    GAP_MONITOR,
    ROBOT_NAMES,
    SIM_HARDWARE,
    VIEWER,
    Robot,
    assignment,
    check_hardware,
    check_parameter_files,
    merged_values,
    nodes_for,
    robot_names_for,
)
from jammkle_common.bags.writing import check_free
from jammkle_common.command.errors import InputError
from jammkle_common.names import (
    CONTROLLER_NODE,
    DRIVER_NODE,
    SIM_NODE,
    VIEWER_NODE,
    relative,
    resolved,
)
from jammkle_common.parameters import ParameterError, rows
from jammkle_sim.parameters import SimParameters
from jammkle_sim.robots.options import RobotOptions
from jammkle_view.parameters import NO_FOXGLOVE, NO_PAGE

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from jammkle_bringup.core.node_table import NodeEntry, ParameterValue


@dataclass(frozen=True)
class GraphOptions:
    """Which graph to start. `values` are parameters by node name or path (see `values_of`); they win over the files."""

    namespace: str
    hardware: str = SIM_HARDWARE
    parameter_files: tuple[Path, ...] = ()
    bag: Path | None = None
    values: dict[str, dict[str, ParameterValue]] = field(default_factory=dict)
    robot: Robot = Robot.ANKLE
    monitor: bool = False
    """Whether a simulated twin follows the robot."""
    view: bool = False
    """Whether there is a page in the browser."""
    foxglove: bool = False
    """Whether the Foxglove app can look on."""

    @property
    def nodes(self) -> tuple[NodeEntry, ...]:
        """Nodes to start; those that look on are the first to start and the last to stop."""
        asked = ((GAP_MONITOR, self.monitor), (VIEWER, self.view), (FOXGLOVE, self.foxglove))
        watchers = [entry for entry, wanted in asked if wanted]
        named = robot_names_for(self.robot, self.parameter_files, self.namespace, self.values)
        return (*watchers, *named, *nodes_for(self.hardware, self.robot))


def check(options: GraphOptions) -> None:
    """Refuse what cannot work before anything is started.

    Raises:
        InputError: one line on the first thing that is wrong.

    """
    check_hardware(options.hardware)
    _check_robot(options)
    for wanted, module, way_out in ((options.view, "viser", NO_PAGE), (options.foxglove, "foxglove", NO_FOXGLOVE)):
        if wanted and importlib.util.find_spec(module) is None:
            raise InputError(way_out)
    check_parameter_files(options.parameter_files, options.namespace, options.nodes, options.values)
    named = given_value(options, DRIVER_NODE, "hardware")
    if named not in (None, options.hardware):
        msg = f"hardware: {named} is given for the driver by -p or --params: start with --hardware {named}"
        raise InputError(msg)
    if options.bag is not None:
        check_free(options.bag)


def _check_robot(options: GraphOptions) -> None:
    """Refuse a twin of what is no ankle, and one board for several."""
    name = options.robot.value
    if options.monitor and options.robot is not Robot.ANKLE:
        msg = f"--monitor needs --robot ankle: the twin of the gap monitor is one ankle on its rig, not a {name}"
        raise InputError(msg)
    if len(options.robot.ankles) > 1 and "port" in options.values.get(DRIVER_NODE, {}):
        section = f"/{options.robot.ankles[0]}/driver: {{ros__parameters: {{port: DEV}}}}"
        msg = (
            f"--port is one board, a {name} has {len(options.robot.ankles)}: give --params FILE with one {section} each"
        )
        raise InputError(msg)


_WITHOUT_PORT = (SIM_HARDWARE, "fake")
"""Hardware that is no board; a package's own may be one."""


def given_values(
    robot: Robot, hardware: str, speed: float | None, port: str | None
) -> dict[str, dict[str, ParameterValue]]:
    """Return what the options of the command say of parameters, by node.

    Raises:
        InputError: the hardware has no speed or no port, or the speed is out of the simulation's range.

    """
    of_sim: dict[str, ParameterValue] = {}
    of_driver: dict[str, ParameterValue] = {}
    if hardware != SIM_HARDWARE:
        of_driver["hardware"] = hardware
    elif robot is not Robot.ANKLE:
        of_sim["robot"] = robot.value
    if speed is not None:
        of_sim["speed"] = _checked_speed(speed, hardware)
    if port is not None:
        if hardware in _WITHOUT_PORT:
            msg = f"--port {port} needs --hardware modbus: {hardware} has none"
            raise InputError(msg)
        of_driver["port"] = port
    of_viewer: dict[str, ParameterValue] = {"ankles": ",".join(robot.ankles)} if any(robot.ankles) else {}
    found = {SIM_NODE: of_sim, DRIVER_NODE: of_driver, VIEWER_NODE: of_viewer}
    return {node: values for node, values in found.items() if values}


def _checked_speed(speed: float, hardware: str) -> float:
    if hardware != SIM_HARDWARE:
        msg = f"--speed {speed:g} needs --hardware sim: real hardware runs at its own"
        raise InputError(msg)
    row = next(row for row in rows(SimParameters) if row.name == "speed")
    try:
        return float(row.check(speed))
    except ParameterError as error:
        msg = f"--speed: {error}"
        raise InputError(msg) from error


def with_given(options: GraphOptions, texts: Sequence[str]) -> GraphOptions:
    """Return the options with parameters given as `NODE:NAME:=VALUE`; they win over all else.

    NODE is a node's name, `driver`, for that of every ankle, or its path in the graph's namespace, `lf_ankle/driver`,
    or its full name.

    Raises:
        InputError: one has another form, or names a node that is not started.

    """
    startable = (*options.nodes, *(replace(ROBOT_NAMES, within=ankle) for ankle in options.robot.ankles))
    known = {known for entry in startable for known in (entry.name, entry.path)}
    for text in texts:
        node, name, value = assignment(text)
        key = relative(options.namespace, node) or node
        if key not in known:
            msg = f"-p {text}: no node '{node}' in this graph; known are: {', '.join(sorted(known))}"
            raise InputError(msg)
        options = with_value(options, key, name, value=value)
    return options


def given_value(options: GraphOptions, node: str, name: str) -> object:
    """Return what was given for a parameter of a node, or None; what `values` holds wins over the files."""
    found: object = None
    for entry in options.nodes:
        if entry.name == node:
            found = given_values_of(options, entry).get(name, found)
    return found


def given_values_of(options: GraphOptions, entry: NodeEntry) -> dict[str, object]:
    """Return everything that was given for a node, by parameter."""
    return merged_values(options.parameter_files, options.namespace, entry, options.values)


def with_value(options: GraphOptions, node: str, name: str, *, value: ParameterValue) -> GraphOptions:
    """Return the options with a parameter that wins over the files, of a node by its name or path."""
    of_node = {**options.values.get(node, {}), name: value}
    return replace(options, values={**options.values, node: of_node})


def with_robot_as_built(options: GraphOptions) -> GraphOptions:
    """Return the options with nodes that know how a simulated robot is built, unless somebody says so."""
    if options.robot is Robot.ANKLE or options.hardware != SIM_HARDWARE:
        return options
    for node, name, of_robot in AS_BUILT:
        given = given_value(options, SIM_NODE, of_robot)
        value = getattr(RobotOptions(), of_robot) if given is None else given
        for entry in options.nodes:
            if entry.name == node and name not in given_values_of(options, entry):
                options = with_value(options, entry.path, name, value=value)
    return options


def with_legs(options: GraphOptions) -> GraphOptions:
    """Return the options in which controllers that need their simulated leg find it in robot_description."""
    if options.robot is Robot.ANKLE or options.hardware != SIM_HARDWARE:
        return options
    for entry in options.nodes:
        given = given_values_of(options, entry) if entry.name == CONTROLLER_NODE else {}
        if not (given.get("use_odometry") or given.get("use_efforts") or given.get("imu_link")):
            continue
        fits = {"robot_namespace": options.namespace, "joint_prefix": entry.within.removesuffix("ankle")}
        for name, value in fits.items():
            if name not in given:
                options = with_value(options, entry.path, name, value=value)
    return options


def node_names(options: GraphOptions) -> set[str]:
    """Return the full names of the nodes to start."""
    return {resolved(options.namespace, entry.path) for entry in options.nodes}


def makes_clock(options: GraphOptions) -> bool:
    """Return whether the graph has a simulation that publishes /clock."""
    return options.hardware == SIM_HARDWARE and given_value(options, SIM_NODE, "publish_clock") is not False
