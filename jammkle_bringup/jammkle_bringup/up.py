"""`jammkle up`: check everything first, then start the graph, watch it and stop it in order."""

from __future__ import annotations

import sys
import time
from typing import TYPE_CHECKING

from jammkle_bringup.core.namespace_lock import ClockLock, NamespaceLock, default_folder, ros_domain
from jammkle_bringup.core.node_table import SIM_HARDWARE, command_of, simulated_time
from jammkle_bringup.core.parameter_file import values_of
from jammkle_bringup.core.supervisor import ChildSpec, Supervisor
from jammkle_bringup.graph_client import DISCOVERY_S, GraphClient
from jammkle_bringup.graph_options import (
    GraphOptions,
    check,
    given_value,
    makes_clock,
    node_names,
    with_imu_mount,
    with_legs,
    with_value,
)
from jammkle_bringup.neighbours import LOOK_S, LOOKERS, refuse_if_doubled, refuse_if_there
from jammkle_bringup.readiness import RECORDER, Startup
from jammkle_common.command.errors import GraphError, Interrupted
from jammkle_common.names import CLOCK, CONTROLLER_NODE, DRIVER_NODE, SIM_NODE

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Sequence

    from jammkle_bringup.core.supervisor import Death

_LOOK_PERIOD_S = 0.1
_RECORDER_STOP_TIMEOUT_S = 30.0  # a killed recorder leaves a bag without its end


def beside_others(
    options: GraphOptions, asked_to_stop: Callable[[], bool], client: GraphClient | None = None
) -> GraphOptions:
    """Look at the ROS graph, since a lock file does not know of other users and machines.

    Before a simulation it is looked for a second only: who starts it looks on afterwards, see `refuse_if_doubled`.
    Nodes of real hardware are not started before discovery has had all its time. Without a client, one is made.

    Returns:
        The options, without a /clock of its own where simulated time already comes from another ankle.

    Raises:
        InputError: a node of the same name is there.

    """
    if client is None:
        with GraphClient(options.namespace, asked_to_stop, LOOKERS) as alone:
            return beside_others(options, asked_to_stop, alone)
    look_s = LOOK_S if options.hardware == SIM_HARDWARE else DISCOVERY_S
    owner = refuse_if_there(client, node_names(options), look_s)
    if not owner or options.hardware != SIM_HARDWARE:
        return options
    say(f"{CLOCK.name} comes from {owner} already, so this simulation publishes none")
    return with_value(options, SIM_NODE, "publish_clock", value=False)


def with_one_clock(options: GraphOptions, clock: ClockLock) -> GraphOptions:
    """Return the options without a /clock of its own where another simulation that starts just now makes it.

    Raises:
        InputError: the lock's file cannot be made.

    """
    if not makes_clock(options) or clock.take():
        return options
    say(f"{CLOCK.name} is made by another simulation in ROS domain {ros_domain()}, so this one publishes none")
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
        values = values_of(options.values, entry)
        if simulated_time(entry, options.hardware):
            values["use_sim_time"] = True
        command = command_of(entry, options.namespace, values, files)
        specs.append(ChildSpec(entry.path, command, looks_on=entry.looks_on, kind=entry.name))
    return tuple(specs)


def up(options: GraphOptions, asked_to_stop: Callable[[], bool]) -> int:
    """Run a graph until asked to stop or until a node dies.

    A simulation starts paused and is let go once all nodes are connected, unless a file asks for `start_paused`.

    Returns:
        The exit code: 0 when asked to stop and all ended well, 1 when a process died or had to be killed, or when
        the graph was not ready in time.

    Raises:
        InputError: something was wrong before the start, and nothing was started; or another graph was started together
            with this one, and this one was stopped.

    """
    check(options)
    options = with_legs(with_imu_mount(options))
    with (
        NamespaceLock(options.namespace, ros_domain(), default_folder()),
        ClockLock(ros_domain(), default_folder()) as clock,
        Supervisor(
            paused_specs(options), pass_on, held=True, on_loss=say_loss
        ) as supervisor,  # they load while it is looked
    ):
        death = None
        failed = False
        try:
            begin_alone(options, supervisor, clock, asked_to_stop)
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


def begin_alone(
    options: GraphOptions, supervisor: Supervisor, clock: ClockLock, asked_to_stop: Callable[[], bool]
) -> None:
    """Begin where no other graph is, and look on for one until discovery has had all its time.

    Raises:
        InputError: there is one.
        GraphError: a process died, the time is up, or the simulation refuses.
        Interrupted: the command was asked to stop before it was up.

    """
    with GraphClient(options.namespace, asked_to_stop, LOOKERS) as client:
        joined = with_one_clock(beside_others(options, asked_to_stop, client), clock)
        if joined != options:
            supervisor.begin_anew(paused_specs(joined))
        names = ", ".join(supervisor.process_ids())
        say(f"starting {names} in namespace {options.namespace}, ROS domain {ros_domain()}; Ctrl-C stops")
        supervisor.release()
        end_s = time.monotonic() + DISCOVERY_S
        begin(joined, supervisor, client)
        while time.monotonic() < end_s and not asked_to_stop() and supervisor.first_death() is None:
            refuse_if_doubled(client, node_names(joined), makes_clock=makes_clock(joined))
            time.sleep(_LOOK_PERIOD_S)


def steering(options: GraphOptions, members: Collection[str]) -> set[str]:
    """Return those of a graph's processes that its simulation waits for; none where nothing is simulated in step."""
    if SIM_NODE not in members or given_value(options, SIM_NODE, "lockstep") is False:
        return set()
    return {member for member in members if member.rpartition("/")[2] in (DRIVER_NODE, CONTROLLER_NODE, RECORDER)}


def paused_specs(options: GraphOptions) -> tuple[ChildSpec, ...]:
    """Return the processes of a graph whose simulation starts paused."""
    return child_specs(with_value(options, SIM_NODE, "start_paused", value=True))


def begin(options: GraphOptions, supervisor: Supervisor, client: GraphClient) -> None:
    """Wait until the nodes are connected and the driver is active, then let simulated time run.

    Raises:
        InputError: another graph was started together with this one.
        GraphError: a process died, the time is up, or the simulation refuses.
        Interrupted: the command was asked to stop.

    """
    members = set(supervisor.process_ids())
    by_itself = given_value(options, DRIVER_NODE, "autostart") is not False
    startup = Startup(client, supervisor)
    # a driver that waits to be configured has no topics yet
    drivers = [entry.path for entry in options.nodes if entry.name == DRIVER_NODE]
    startup.wait_until_connected(members if by_itself else members - set(drivers), options.robot.ankles)
    refuse_if_doubled(client, node_names(options), makes_clock=makes_clock(options))
    if by_itself:
        for driver in drivers:
            startup.wait_until_active(driver)
    startup.wait_until_in_step(steering(options, members))
    supervisor.loaded()
    others_clock = given_value(options, SIM_NODE, "publish_clock") is False
    if others_clock and given_value(options, SIM_NODE, "start_time_s") is None:
        startup.join_clock()
    if given_value(options, SIM_NODE, "start_paused"):
        say("up; paused, as start_paused says: the service sim/set_paused lets it go")
        return
    if SIM_NODE in members:
        startup.let_go()
    say("up")


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


def say_loss(death: Death) -> None:
    """Say who died without taking the graph along."""
    say(f"{death.text()}; the graph goes on without it")


def pass_on(name: str, line: str) -> None:
    """Pass on what a node says."""
    sys.stderr.write(f"[{name}] {line}\n")
