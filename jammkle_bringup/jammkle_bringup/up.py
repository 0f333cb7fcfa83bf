"""`jammkle up`: check everything first, then start the graph, watch it and stop it in order."""

from __future__ import annotations

import sys
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from jammkle_bringup.core.bag_log import check_free
from jammkle_bringup.core.errors import InputError
from jammkle_bringup.core.namespace import resolved
from jammkle_bringup.core.namespace_lock import NamespaceLock, already_up, default_folder, ros_domain
from jammkle_bringup.core.node_table import NODES, Hardware, Robot, check_built, command_of, nodes_for, simulated_time
from jammkle_bringup.core.parameter_file import check_parameter_file
from jammkle_bringup.core.supervisor import ChildSpec, Supervisor
from jammkle_bringup.graph_client import GraphClient
from jammkle_graph.names import CLOCK, SIM_NODE
from jammkle_graph.parameters import ParameterError, rows

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from jammkle_bringup.core.node_table import NodeEntry, ParameterValue
    from jammkle_bringup.core.supervisor import Death

RECORDER = "recorder"
_DISCOVERY_S = 0.8
_RECORDER_STOP_TIMEOUT_S = 30.0  # a killed recorder leaves a bag without its end


@dataclass(frozen=True)
class GraphOptions:
    """Which graph to start. `values` are parameters by node name; they win over the files."""

    namespace: str
    robot: Robot = Robot.ANKLE
    hardware: Hardware = Hardware.SIM
    parameter_files: tuple[Path, ...] = ()
    bag: Path | None = None
    values: dict[str, dict[str, ParameterValue]] = field(default_factory=dict)

    @property
    def nodes(self) -> tuple[NodeEntry, ...]:
        """Nodes to start."""
        return nodes_for(self.robot, self.hardware)


def check(options: GraphOptions) -> None:
    """Refuse what cannot work before anything is started.

    Raises:
        InputError: one line on the first thing that is wrong.

    """
    check_built(options.robot, options.hardware)
    for file in options.parameter_files:
        check_parameter_file(file, options.namespace, options.nodes)
    if options.bag is not None:
        check_free(options.bag)


def check_speed(speed: float, hardware: Hardware) -> float:
    """Return the speed of a simulation.

    Raises:
        InputError: there is no simulation, or the speed is out of the simulation's range.

    """
    if hardware is not Hardware.SIM:
        msg = f"--speed {speed:g} needs --hardware sim: real hardware runs at its own"
        raise InputError(msg)
    table = next(entry for entry in NODES if entry.name == SIM_NODE).parameters()
    row = next(row for row in rows(table) if row.name == "speed")
    try:
        return float(row.check(speed))
    except ParameterError as error:
        msg = f"--speed: {error}"
        raise InputError(msg) from error


def beside_others(options: GraphOptions, asked_to_stop: Callable[[], bool]) -> GraphOptions:
    """Look at the ROS graph, since a lock file does not know of other users and machines.

    Returns:
        The options, without a /clock of its own where simulated time already comes from another ankle.

    Raises:
        InputError: a node of the same name is there.

    """
    names = {resolved(options.namespace, entry.name) for entry in options.nodes}
    with GraphClient(options.namespace, asked_to_stop) as client:
        client.wait_until(lambda: bool(names & client.nodes()), _DISCOVERY_S)
        there = sorted(names & client.nodes())
        clocks = client.node.get_publishers_info_by_topic(CLOCK.name)
    if there:
        msg = already_up(
            options.namespace, ros_domain(), f"node {', '.join(there)}; one that was killed is seen for 20 s more"
        )
        raise InputError(msg)
    if not clocks or options.hardware is not Hardware.SIM:
        return options
    owner = resolved(clocks[0].node_namespace, clocks[0].node_name)
    say(f"{CLOCK.name} comes from {owner} already, so this simulation publishes none")
    of_sim = {**options.values.get(SIM_NODE, {}), "publish_clock": False}
    return replace(options, values={**options.values, SIM_NODE: of_sim})


def child_specs(options: GraphOptions) -> tuple[ChildSpec, ...]:
    """Return the processes of a graph in the order in which they start: the recorder first, the driver last."""
    specs = []
    if options.bag is not None:
        source = "sim" if options.hardware is Hardware.SIM else "system"
        command = (sys.executable, "-m", "jammkle_bringup", "record", "-o", str(options.bag))
        command = (*command, "--namespace", options.namespace, "--clock", source)
        specs.append(ChildSpec(RECORDER, command, _RECORDER_STOP_TIMEOUT_S))
    files = tuple(str(file.absolute()) for file in options.parameter_files)
    for entry in options.nodes:
        values = dict(options.values.get(entry.name, {}))
        if simulated_time(entry, options.hardware):
            values["use_sim_time"] = True
        specs.append(ChildSpec(entry.name, command_of(entry, options.namespace, values, files)))
    return tuple(specs)


def up(options: GraphOptions, asked_to_stop: Callable[[], bool]) -> int:
    """Run a graph until asked to stop or until a node dies.

    Returns:
        The exit code: 0 when asked to stop and all ended well, 1 when a process died or had to be killed.

    Raises:
        InputError: something was wrong before the start; nothing was started.

    """
    check(options)
    with NamespaceLock(options.namespace, ros_domain(), default_folder()):
        options = beside_others(options, asked_to_stop)
        specs = child_specs(options)
        names = ", ".join(spec.name for spec in specs)
        say(f"starting {names} in namespace {options.namespace}, ROS domain {ros_domain()}; Ctrl-C stops")
        with Supervisor(specs, pass_on) as supervisor:
            death = supervisor.watch(asked_to_stop)
            if death is not None:
                say_death(death)
            bad = supervisor.stop()
    return say_how_it_ended(death, bad)


def say_how_it_ended(death: Death | None, bad: Sequence[Death]) -> int:
    """Say which processes did not end well and return the exit code."""
    others = [each for each in bad if death is None or each.name != death.name]
    for each in others:
        say_death(each)
    if death is None and not others:
        say("stopped")
        return 0
    return 1


def say(text: str) -> None:
    """Write one line for people; results alone go to the standard output."""
    sys.stderr.write(f"jammkle: {text}\n")
    sys.stderr.flush()


def say_death(death: Death) -> None:
    """Say who died and how."""
    say(death.text())


def pass_on(name: str, line: str) -> None:
    """Pass on what a node says."""
    sys.stderr.write(f"[{name}] {line}\n")
