"""The one table of nodes: what is started for which robot and hardware, and parameter files that fit it.

Used by `jammkle up` and the launch files. A typing error in a parameter file would otherwise show only when its node
refuses to start, or not at all where the name of the node is misspelt.
"""

from __future__ import annotations

import difflib
import enum
import importlib
import re
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

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
    normalised,
    resolved,
)
from jammkle_common.parameters import ParameterError, from_mapping, of_table
from jammkle_common.yaml_text import read_file, read_yaml

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

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
    """One node: where its code is, its name on the graph, its parameter table, and when it is started."""

    package: str
    name: str
    """Name on the graph, inside the namespace."""
    parameter_table: str
    """`module:Class` of the node's parameters."""
    follows_simulated_time: bool = False
    """True if the node runs on /clock while the hardware is simulated."""
    simulates: bool = False
    """True if the node is the simulated hardware, and so only started with it."""
    looks_on: bool = False
    """True if the ankle is the same without the node, so that its death stops nothing."""
    module: str = ""
    """What `python -m` starts; empty: the Python package of the same name as the ROS package."""
    executable: str = ""
    """Name for `ros2 run` and launch files; empty: that on the graph."""
    within: str = ""
    """Namespace below the graph's own: that of the node's ankle, where there are several."""

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
    NodeEntry("jammkle_sim", SIM_NODE, "jammkle_sim.parameters:SimParameters", simulates=True),
    NodeEntry(
        "jammkle_controller",
        CONTROLLER_NODE,
        "jammkle_controller.parameters:ControllerParameters",
        follows_simulated_time=True,
    ),
    NodeEntry("jammkle_driver", DRIVER_NODE, "jammkle_driver.parameters:DriverParameters", follows_simulated_time=True),
)
"""In the order in which they start; they stop in the reverse order, so that the simulation sees the release."""

ROBOT_SIM = NodeEntry(
    "jammkle_sim",
    SIM_NODE,
    "jammkle_sim.parameters:RobotParameters",
    simulates=True,
    module="jammkle_sim.robot",
    executable="robot",
)
"""The simulation of a leg or a quadruped: one for all of its ankles."""

ROBOT_NODES = (ROBOT_SIM, *(entry for entry in NODES if not entry.simulates))
"""Each kind of node of a leg or a quadruped once."""

AS_BUILT = (
    (CONTROLLER_NODE, "imu_mount", "imu"),
    (CONTROLLER_NODE, "hang_pitch_deg", "hang_pitch_deg"),
    (DRIVER_NODE, "reservoir_volume_m3", "reservoir_volume_m3"),
)
"""What nodes must know of how a robot is built: node, its parameter, and the option of the robot that says it."""

GAP_MONITOR = NodeEntry(
    "jammkle_gap",
    GAP_MONITOR_NODE,
    "jammkle_gap.monitor.parameters:GapMonitorParameters",
    follows_simulated_time=True,
    looks_on=True,
    module="jammkle_gap.monitor",
)
"""Looks on, and is started where it is asked for."""

VIEWER = NodeEntry("jammkle_view", VIEWER_NODE, "jammkle_view.parameters:ViewerParameters", looks_on=True)
"""The page in the browser; looks on as well, and hands on what is clicked."""

FOXGLOVE = NodeEntry(
    "jammkle_view",
    FOXGLOVE_NODE,
    "jammkle_view.parameters:FoxgloveParameters",
    follows_simulated_time=True,
    looks_on=True,
    module="jammkle_view.foxglove",
)
"""The live connection for the Foxglove app; looks on."""

ROBOT_NAMES = NodeEntry(
    "jammkle_bringup",
    ROBOT_NAMES_NODE,
    "jammkle_bringup.robot_names:RobotNamesParameters",
    module="jammkle_bringup.robot_names",
)
"""Joints by the robot's names, one for each ankle, where its `joints` are given."""

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


def robot_names_for(
    robot: Robot,
    paths: Sequence[Path],
    namespace: str,
    values: Mapping[str, Mapping[str, object]] | None = None,
) -> tuple[NodeEntry, ...]:
    """Return the nodes that know the robot's own names: one for each ankle whose joints are named in files or values.

    Raises:
        InputError: a file cannot be read.

    """
    each = (replace(ROBOT_NAMES, within=ankle) for ankle in robot.ankles)
    return tuple(entry for entry in each if merged_values(paths, namespace, entry, values).get("joints"))


def simulated_time(entry: NodeEntry, hardware: str) -> bool:
    """Return True if the node runs on /clock with this hardware."""
    return entry.follows_simulated_time and hardware == SIM_HARDWARE


def to_launch(
    robot: Robot,
    given: Mapping[str, str],
    pushed: str,
    values: Mapping[str, Mapping[str, object]],
    looking_on: Sequence[NodeEntry] = (),
) -> Iterator[tuple[str, dict[str, object]]]:
    """Yield the path of each node that a launch file starts, and what launch_ros makes it of.

    Args:
        robot: What is brought up.
        given: The launch file's arguments: hardware, namespace, speed, publish_clock, params.
        pushed: Namespace of an including launch file.
        values: Further parameters of the simulation and of drivers, by name of the node.
        looking_on: Further nodes.

    Raises:
        InputError: the hardware is unknown, or a file cannot be read.

    """
    hardware, files = given["hardware"], [given["params"]] if given["params"] else []
    check_hardware(hardware)
    namespace = normalised(resolved(pushed, given["namespace"]))
    shared: dict[str, dict[str, object]] = {
        SIM_NODE: {"speed": float(given["speed"]), "publish_clock": given["publish_clock"].lower() == "true"},
        DRIVER_NODE: {"hardware": hardware},
    }
    named = robot_names_for(robot, [Path(file) for file in files], namespace)
    for entry in (*nodes_for(hardware, robot), *named, *looking_on):
        timed = {"use_sim_time": True} if simulated_time(entry, hardware) else {}
        yield (
            entry.path,
            {
                "package": entry.package,
                "executable": entry.executable or entry.name,
                "name": entry.name,
                "namespace": resolved(namespace, entry.within) if entry.within else namespace,
                "parameters": [*files, {**timed, **shared.get(entry.name, {}), **values.get(entry.name, {})}],
                "output": "screen",
            },
        )


def command_of(
    entry: NodeEntry,
    namespace: str,
    values: dict[str, ParameterValue],
    parameter_files: tuple[str, ...] = (),
) -> tuple[str, ...]:
    """Return the command that starts a node in a normalised namespace; values win over files, the last over all."""
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


Value = TypeVar("Value")

_PARAMETERS_KEY = "ros__parameters"
_WILDCARDS = ("*", "**")
_MISTYPED = 0.8
"""Likeness (difflib) from which on a name is a mistyped one. Chosen: two or three letters of it may be wrong."""


def check_parameter_files(
    paths: Sequence[Path],
    namespace: str,
    nodes: Sequence[NodeEntry],
    values: Mapping[str, Mapping[str, object]] | None = None,
) -> None:
    """Check ROS parameter files, the last of which wins, against the nodes that will run in a normalised namespace.

    Values, by node name or path as in `values_of`, win over the files.

    Raises:
        InputError: a file cannot be read or names a node that is not there, or a node's parameters hold an unknown
            or bad one, or do not go together.

    """
    for path in paths:
        _check_sections(path, namespace, nodes)
    for entry in nodes:
        merged = merged_values(paths, namespace, entry, values)
        try:
            from_mapping(entry.parameters(), of_table(merged))
        except ParameterError as error:
            full_name = resolved(namespace, entry.path)
            sources = [
                str(path) for path in paths if any(_matches(each, full_name) for each, _ in _read_sections(path))
            ]
            msg = f"{', '.join(sources) or 'given'}: {entry.path}: {error}"
            raise InputError(msg) from error


def values_of(values: Mapping[str, Mapping[str, Value]], entry: NodeEntry) -> dict[str, Value]:
    """Return what is given for a node: by its name (`driver`: of every ankle), then by its path (`lf_ankle/driver`)."""
    return {**values.get(entry.name, {}), **values.get(entry.path, {})}


def assignment(text: str) -> tuple[str, str, ParameterValue]:
    """Return node, parameter and value of `NODE:NAME:=VALUE`, the value read as in a parameter file.

    Raises:
        InputError: it has another form, or the value is not a single one.

    """
    found = re.fullmatch(r"([^:\s]+):([^:\s]+:=.*)", text, re.DOTALL)
    if found is None:
        msg = f"-p {text}: give NODE:NAME:=VALUE, for example driver:max_vacuum_pa:=50000"
        raise InputError(msg)
    return found.group(1), *option_value(found.group(2), text)


def option_value(text: str, typed: str) -> tuple[str, ParameterValue]:
    """Return name and value of `NAME:=VALUE`, read as in a parameter file; `typed` is all that was typed behind -p.

    Raises:
        InputError: it has another form, or the value is not a single one.

    """
    name, given, value_text = text.partition(":=")
    if not name or not given:
        msg = f"-p {typed}: give NAME:=VALUE, for example vacuum_pa:=35000"
        raise InputError(msg)
    try:
        value = read_yaml(value_text, typed)
    except InputError:
        value = None
    if not isinstance(value, (bool, int, float, str)):
        msg = f"-p {typed}: the value must be a number, true, false or text (text with a colon in quotes)"
        raise InputError(msg)
    return name, value


def merged_values(
    paths: Sequence[Path],
    namespace: str,
    entry: NodeEntry,
    values: Mapping[str, Mapping[str, object]] | None = None,
) -> dict[str, object]:
    """Return what is said of a node, by parameter: by files, of which the last section that fits wins, then by values.

    Raises:
        InputError: a file cannot be read.

    """
    full_name = resolved(namespace, entry.path)
    merged: dict[str, object] = {}
    for path in paths:
        for pattern, found in _read_sections(path):
            if _matches(pattern, full_name):
                merged.update(found)
    return {**merged, **values_of(values or {}, entry)}


def _read_sections(path: Path) -> list[tuple[str, dict[str, object]]]:
    document = read_file(path, str(path))
    if not isinstance(document, dict):
        msg = f"{path}: must hold sections such as '/**/driver: {{{_PARAMETERS_KEY}: {{...}}}}'"
        raise InputError(msg)
    return list(_sections(document, path))


def _sections(document: Mapping[str, object], path: Path, prefix: str = "") -> Iterator[tuple[str, dict[str, object]]]:
    """Yield `(pattern of node names, parameters)` of a file; namespaces may be nested."""
    for key, value in document.items():
        pattern = f"{prefix}/{str(key).strip('/')}"
        if not isinstance(value, dict):
            msg = f"{path}: section '{prefix or key}' holds no '{_PARAMETERS_KEY}'"
            raise InputError(msg)
        mistyped = difflib.get_close_matches(_PARAMETERS_KEY, map(str, value), 1, _MISTYPED)
        if mistyped and _PARAMETERS_KEY not in value:
            msg = f"{path}: section '{pattern}' holds '{mistyped[0]}', which must be '{_PARAMETERS_KEY}'"
            raise InputError(msg)
        if _PARAMETERS_KEY in value:
            values = value[_PARAMETERS_KEY]
            if values is None:  # which rcl refuses
                msg = f"{path}: '{_PARAMETERS_KEY}' of '{key}' holds nothing; give names with values, or leave it out"
                raise InputError(msg)
            if not isinstance(values, dict):
                msg = f"{path}: '{_PARAMETERS_KEY}' of '{key}' is {values!r}, and must be names with values"
                raise InputError(msg)
            yield pattern, dict(_flat(values))
        else:
            yield from _sections(value, path, pattern)


def _flat(values: Mapping[str, object], prefix: str = "") -> Iterator[tuple[str, object]]:
    for key, value in values.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def _matches(pattern: str, full_name: str) -> bool:
    """Return True if a pattern of a parameter file fits a node's full name; `*` is one level, `**` any number."""
    parts = ""
    for token in pattern.strip("/").split("/"):
        parts += {"*": "/[^/]+", "**": "(?:/[^/]+)*"}.get(token, "/" + re.escape(token))
    return re.fullmatch(parts, full_name) is not None


def _check_sections(path: Path, namespace: str, nodes: Sequence[NodeEntry]) -> None:
    patterns = [pattern for pattern, _ in _read_sections(path)]
    names = {entry.name for entry in nodes}
    for pattern in patterns:
        node = pattern.rpartition("/")[2]
        if node not in names and node not in _WILDCARDS:
            msg = f"{path}: no node '{node}' in this graph (section '{pattern}'); known are: {', '.join(sorted(names))}"
            raise InputError(msg)
    paths = [resolved(namespace, entry.path) for entry in nodes]
    fitting = [pattern for pattern in patterns if any(_matches(pattern, each) for each in paths)]
    # In the root one ankle alone has sections of other robots beside it, as files that several share do.
    is_whole = namespace != "/" or any("/" in entry.path for entry in nodes)
    for pattern in patterns if is_whole else ():
        is_within = pattern.startswith(f"{namespace.rstrip('/')}/")
        if is_within and pattern not in fitting and not set(_WILDCARDS).intersection(pattern.split("/")):
            msg = f"{path}: section '{pattern}' fits no node of this graph; its nodes are: {', '.join(sorted(paths))}"
            raise InputError(msg)
    if patterns and not fitting:
        msg = (
            f"{path}: no section fits namespace {namespace} (sections: {', '.join(patterns)}); "
            "'/**/driver' fits the driver of every namespace"
        )
        raise InputError(msg)
