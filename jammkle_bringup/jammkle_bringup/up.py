"""`jammkle up`: check everything first, then start the graph, watch it and stop it in order."""

from __future__ import annotations

import sys
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from jammkle_bringup.core.namespace_lock import NamespaceLock, already_up, default_folder, ros_domain
from jammkle_bringup.core.node_table import (
    GAP_MONITOR,
    NODES,
    SIM_HARDWARE,
    VIEWER,
    Robot,
    check_hardware,
    command_of,
    nodes_for,
    simulated_time,
)
from jammkle_bringup.core.parameter_file import check_parameter_files, merged_values
from jammkle_bringup.core.supervisor import ChildSpec, Supervisor
from jammkle_bringup.graph_client import DISCOVERY_S, GraphClient
from jammkle_bringup.readiness import RECORDER, Startup
from jammkle_graph.bags.writing import check_free
from jammkle_graph.command.errors import GraphError, InputError
from jammkle_graph.command.signals import Interrupted
from jammkle_graph.names import CLOCK, DRIVER_NODE, SIM_NODE, VIEWER_NODE
from jammkle_graph.namespace import resolved
from jammkle_graph.parameters import ParameterError, rows

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from jammkle_bringup.core.node_table import NodeEntry, ParameterValue
    from jammkle_bringup.core.supervisor import Death

_RECORDER_STOP_TIMEOUT_S = 30.0  # a killed recorder leaves a bag without its end


@dataclass(frozen=True)
class GraphOptions:
    """Which graph to start. `values` are parameters by node name; they win over the files."""

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

    @property
    def nodes(self) -> tuple[NodeEntry, ...]:
        """Nodes to start; those that look on are the first to start and the last to stop."""
        watchers = (*((GAP_MONITOR,) if self.monitor else ()), *((VIEWER,) if self.view else ()))
        return (*watchers, *nodes_for(self.hardware, self.robot))


def check(options: GraphOptions) -> None:
    """Refuse what cannot work before anything is started.

    Raises:
        InputError: one line on the first thing that is wrong.

    """
    check_hardware(options.hardware)
    check_robot(options)
    check_parameter_files(options.parameter_files, options.namespace, options.nodes, options.values)
    named = given_value(options, DRIVER_NODE, "hardware")
    if named not in (None, options.hardware):
        msg = f"a parameter file says hardware: {named} of the driver: start with --hardware {named}"
        raise InputError(msg)
    if options.bag is not None:
        check_free(options.bag)


def check_robot(options: GraphOptions) -> None:
    """Refuse what a robot does not have.

    Raises:
        InputError: there is no twin of it, or its ankles would share one board.

    """
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


def robot_values(robot: Robot, behaviour: str | None, hardware: str) -> dict[str, dict[str, ParameterValue]]:
    """Return what the options of the command say of a simulated robot, by node.

    Raises:
        InputError: a behaviour of what has none.

    """
    if behaviour is not None and (robot is Robot.ANKLE or hardware != SIM_HARDWARE):
        msg = f"--behaviour {behaviour} needs a simulated --robot leg or quadruped: nothing else moves by itself"
        raise InputError(msg)
    if robot is Robot.ANKLE or hardware != SIM_HARDWARE:
        return {}
    chosen: dict[str, ParameterValue] = {"robot": robot.value}
    if behaviour is not None:
        chosen["behaviour"] = behaviour
    return {SIM_NODE: chosen}


def given_values(hardware: str, speed: float | None, port: str | None) -> dict[str, dict[str, ParameterValue]]:
    """Return what the options of the command say of parameters, by node.

    Raises:
        InputError: the hardware has no speed or no port, or the speed is out of the simulation's range.

    """
    values: dict[str, dict[str, ParameterValue]] = {}
    if hardware != SIM_HARDWARE:
        values[DRIVER_NODE] = {"hardware": hardware}
    if speed is not None:
        values[SIM_NODE] = {"speed": check_speed(speed, hardware)}
    if port is not None:
        if hardware == SIM_HARDWARE:
            msg = f"--port {port} needs --hardware modbus: a simulation has none"
            raise InputError(msg)
        values[DRIVER_NODE]["port"] = port
    return values


def viewer_values(
    robot: Robot, host: str | None, port: int | None, *, view: bool
) -> dict[str, dict[str, ParameterValue]]:
    """Return what the options of the command say of the page in the browser.

    Raises:
        InputError: there is no page.

    """
    values: dict[str, ParameterValue] = {"ankles": ",".join(robot.ankles)} if view and any(robot.ankles) else {}
    for name, value in (("host", host), ("port", port)):
        if value is not None and not view:
            msg = f"--view-{name} {value} needs --view: there is no page without"
            raise InputError(msg)
        if value is not None:
            values[name] = value
    return {VIEWER_NODE: values} if values else {}


def check_speed(speed: float, hardware: str) -> float:
    """Return the speed of a simulation.

    Raises:
        InputError: there is no simulation, or the speed is out of the simulation's range.

    """
    if hardware != SIM_HARDWARE:
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
    names = {resolved(options.namespace, entry.path) for entry in options.nodes}
    with GraphClient(options.namespace, asked_to_stop) as client:
        client.wait_until(lambda: bool(names & client.nodes()), DISCOVERY_S)
        there = sorted(names & client.nodes())
        clocks = client.node.get_publishers_info_by_topic(CLOCK.name)
    if there:
        msg = already_up(
            options.namespace, ros_domain(), f"node {', '.join(there)}; one that was killed is seen for 20 s more"
        )
        raise InputError(msg)
    if not clocks or options.hardware != SIM_HARDWARE:
        return options
    owner = resolved(clocks[0].node_namespace, clocks[0].node_name)
    say(f"{CLOCK.name} comes from {owner} already, so this simulation publishes none")
    return with_value(options, SIM_NODE, "publish_clock", value=False)


def child_specs(options: GraphOptions) -> tuple[ChildSpec, ...]:
    """Return the processes of a graph in the order in which they start: the recorder first, the driver last."""
    specs = []
    if options.bag is not None:
        source = "sim" if options.hardware == SIM_HARDWARE else "system"
        command = (sys.executable, "-m", "jammkle_bringup", "record", "-o", str(options.bag))
        command = (*command, "--namespace", options.namespace, "--clock", source)
        specs.append(ChildSpec(RECORDER, command, _RECORDER_STOP_TIMEOUT_S))
    files = tuple(str(file.absolute()) for file in options.parameter_files)
    for entry in options.nodes:
        values = dict(options.values.get(entry.name, {}))
        if simulated_time(entry, options.hardware):
            values["use_sim_time"] = True
        specs.append(ChildSpec(entry.path, command_of(entry, options.namespace, values, files)))
    return tuple(specs)


def up(options: GraphOptions, asked_to_stop: Callable[[], bool]) -> int:
    """Run a graph until asked to stop or until a node dies.

    A simulation starts paused and is let go once all nodes are connected, unless a file asks for `start_paused`.

    Returns:
        The exit code: 0 when asked to stop and all ended well, 1 when a process died or had to be killed, or when
        the graph was not ready in time.

    Raises:
        InputError: something was wrong before the start; nothing was started.

    """
    check(options)
    with NamespaceLock(options.namespace, ros_domain(), default_folder()):
        options = beside_others(options, asked_to_stop)
        stay_paused = bool(given_value(options, SIM_NODE, "start_paused"))
        specs = child_specs(with_value(options, SIM_NODE, "start_paused", value=True))
        names = ", ".join(spec.name for spec in specs)
        say(f"starting {names} in namespace {options.namespace}, ROS domain {ros_domain()}; Ctrl-C stops")
        with Supervisor(specs, pass_on) as supervisor:
            death = None
            failed = False
            try:
                begin(options, supervisor, asked_to_stop, stay_paused=stay_paused)
                death = supervisor.watch(asked_to_stop)
            except GraphError as error:
                say(str(error))
                failed, death = True, supervisor.first_death()
            except Interrupted:  # before it was up; it stops as it does later
                pass
            if death is not None and not failed:
                say_death(death)
            bad = supervisor.stop()
    return say_how_it_ended(death, bad) or int(failed)


def begin(
    options: GraphOptions, supervisor: Supervisor, asked_to_stop: Callable[[], bool], *, stay_paused: bool
) -> None:
    """Wait until the nodes are connected and the driver is active, then let simulated time run.

    Raises:
        GraphError: a process died, the time is up, or the simulation refuses.
        Interrupted: the command was asked to stop.

    """
    members = set(supervisor.process_ids())
    by_itself = given_value(options, DRIVER_NODE, "autostart") is not False
    with GraphClient(options.namespace, asked_to_stop) as client:
        startup = Startup(client, supervisor)
        # a driver that waits to be configured has no topics yet
        drivers = [entry.path for entry in options.nodes if entry.name == DRIVER_NODE]
        startup.wait_until_connected(members if by_itself else members - set(drivers), options.robot.ankles)
        if by_itself:
            for driver in drivers:
                startup.wait_until_active(driver)
        supervisor.loaded()
        others_clock = given_value(options, SIM_NODE, "publish_clock") is False
        if others_clock and given_value(options, SIM_NODE, "start_time_s") is None:
            startup.join_clock()
        if stay_paused:
            say("up; paused, as start_paused says: the service sim/set_paused lets it go")
            return
        if SIM_NODE in members:
            startup.let_go()
        say("up")


def given_value(options: GraphOptions, node: str, name: str) -> object:
    """Return what was given for a parameter of a node, or None; what `values` holds wins over the files."""
    found: object = None
    for entry in options.nodes:
        if entry.name == node:
            found = merged_values(options.parameter_files, options.namespace, entry).get(name)
    return options.values.get(node, {}).get(name, found)


def with_value(options: GraphOptions, node: str, name: str, *, value: ParameterValue) -> GraphOptions:
    """Return the options with a parameter that wins over the files."""
    of_node = {**options.values.get(node, {}), name: value}
    return replace(options, values={**options.values, node: of_node})


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
