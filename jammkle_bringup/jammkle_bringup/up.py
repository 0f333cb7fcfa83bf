"""`jammkle up`: check everything first, start the graph, wait until it is connected, watch it and stop it in order.

Discovery over DDS takes up to some seconds, and a simulated ankle falls after one: a simulation that runs at once lands
before its controller receives the IMU. So it starts paused, and goes on when everything is connected.
"""

from __future__ import annotations

import itertools
import sys
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, NoReturn

from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.msg import State
from lifecycle_msgs.srv import GetState
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from rosgraph_msgs.msg import Clock
from std_srvs.srv import SetBool

from jammkle_bringup.core.node_table import SIM_HARDWARE, command_of, simulated_time, values_of
from jammkle_bringup.core.supervisor import ChildSpec, Supervisor
from jammkle_bringup.graph_client import (
    DISCOVERY_S,
    LOOK_S,
    LOOKERS,
    GraphClient,
    below,
    refuse_if_doubled,
    refuse_if_there,
    ros_domain,
)
from jammkle_bringup.graph_options import (
    GraphOptions,
    check,
    given_value,
    makes_clock,
    node_names,
    with_legs,
    with_robot_as_built,
    with_value,
)
from jammkle_common.command.errors import GraphError, Interrupted
from jammkle_common.command.results import say
from jammkle_common.constants import NANOSECONDS_PER_SECOND
from jammkle_common.diagnostics import LIVENESS_LINE, reporting
from jammkle_common.messages import LOCKSTEP_LINE
from jammkle_common.names import (
    ACTUATOR_STATES,
    CHANNELS,
    CLOCK,
    CONTACT_EVENTS,
    CONTROLLER_NODE,
    DIAGNOSTICS,
    DRIVER_NODE,
    IMU,
    JAM_COMMAND,
    PRESSURES,
    PUMP_DUTY,
    RECORDER_NODE,
    SET_PAUSED,
    SIM_NODE,
    SOLENOIDS,
    STEP,
    relative,
    resolved,
)
from jammkle_common.qos import node_at, subscriber_qos
from jammkle_msgs.srv import Step
from jammkle_sim.parameters import SimParameters

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Sequence

    from rclpy.topic_endpoint_info import TopicEndpointInfo

    from jammkle_bringup.core.supervisor import Death

_LOOK_PERIOD_S = 0.1
_RECORDER_STOP_TIMEOUT_S = 30.0  # a killed recorder leaves a bag without its end


def beside_others(
    options: GraphOptions, asked_to_stop: Callable[[], bool], client: GraphClient | None = None
) -> GraphOptions:
    """Look at the ROS graph for another one.

    Before a simulation it is looked for a second only: who starts it looks on afterwards, see `refuse_if_doubled`.
    Discovery gets all its time before nodes of real hardware, and before an ankle with a namespace, which may have to
    take its time from another one. Without a client, one is made.

    Returns:
        The options, without a /clock of its own where simulated time already comes from another ankle.

    Raises:
        InputError: a node of the same name is there.

    """
    if client is None:
        with GraphClient(options.namespace, asked_to_stop, LOOKERS) as alone:
            return beside_others(options, asked_to_stop, alone)
    is_alone = options.hardware == SIM_HARDWARE and options.namespace == "/"
    look_s = LOOK_S if is_alone else DISCOVERY_S
    owner = refuse_if_there(client, node_names(options), look_s)
    if not owner or options.hardware != SIM_HARDWARE:
        return options
    say(f"{CLOCK.name} comes from {owner} already, so this simulation publishes none")
    return with_value(options, SIM_NODE, "publish_clock", value=False)


def child_specs(options: GraphOptions) -> tuple[ChildSpec, ...]:
    """Return the processes of a graph in the order in which they start: the recorder first, the driver last."""
    specs = []
    if options.bag is not None:
        source = "sim" if options.hardware == SIM_HARDWARE else "system"
        command = (sys.executable, "-m", "jammkle_common.command", "record", "-o", str(options.bag))
        command = (*command, "--namespace", options.namespace, "--clock", source)
        specs.append(ChildSpec(RECORDER_NODE, command, _RECORDER_STOP_TIMEOUT_S))
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
    options = with_legs(with_robot_as_built(options))
    # they load while it is looked
    with Supervisor(paused_specs(options), pass_on, held=True, on_loss=say_loss) as supervisor:
        death = None
        failed = False
        try:
            begin_alone(options, supervisor, asked_to_stop)
            death = supervisor.watch(asked_to_stop)
        except GraphError as error:
            say(str(error))
            failed, death = True, supervisor.first_death()
        except Interrupted:  # before it was up; it stops as it does later
            pass
        if death is not None and not failed:
            say(death.text())
        bad = supervisor.stop()
    return say_how_it_ended(death, bad) or int(failed)


def begin_alone(options: GraphOptions, supervisor: Supervisor, asked_to_stop: Callable[[], bool]) -> None:
    """Begin where no other graph is, and look on for one until discovery has had all its time.

    Raises:
        InputError: there is one.
        GraphError: a process died, the time is up, or the simulation refuses.
        Interrupted: the command was asked to stop before it was up.

    """
    with GraphClient(options.namespace, asked_to_stop, LOOKERS) as client:
        joined = beside_others(options, asked_to_stop, client)
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
    return {member for member in members if member.rpartition("/")[2] in (DRIVER_NODE, CONTROLLER_NODE, RECORDER_NODE)}


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
        say(each.text())
    if death is None and not others:
        say("stopped")
        return 0
    return 1


def say_loss(death: Death) -> None:
    """Say who died without taking the graph along."""
    say(f"{death.text()}; the graph goes on without it")


def pass_on(name: str, line: str) -> None:
    """Pass on what a node says."""
    sys.stderr.write(f"[{name}] {line}\n")


READY_TIMEOUT_S = 300.0
"""Until all nodes are there, s of real time: who dies is noticed at once, so only one that hangs takes so long. Chosen:
a start takes 3 s, but was seen to take over 30 s where eleven processes wanted two slow cores."""

_SAID_EVERY_S = 15.0
"""How long nothing is said of what a start waits for, s of real time."""

_STATE_TIMEOUT_S = 2.0

STUCK_S = 60.0
"""Real time, s, for steps that take a fraction of a second; only a simulation that hangs takes so long."""

_JOINED_WITHIN_S = 0.2
"""How far /clock may have gone on while a simulation was asked to start at it, s: it stays behind by as much."""
_JOIN_TRIES = 5
"""On a busy machine an answer takes a second or more; the last try counts, however late it is."""

_CONNECTIONS = (
    (IMU.name, SIM_NODE, (CONTROLLER_NODE, RECORDER_NODE)),
    (CONTACT_EVENTS.name, CONTROLLER_NODE, (RECORDER_NODE,)),
    (JAM_COMMAND.name, CONTROLLER_NODE, (DRIVER_NODE, RECORDER_NODE)),
    (PUMP_DUTY.name, DRIVER_NODE, (SIM_NODE, RECORDER_NODE)),
    (ACTUATOR_STATES.name, SIM_NODE, (DRIVER_NODE, RECORDER_NODE)),
    *((SOLENOIDS[channel].name, DRIVER_NODE, (SIM_NODE, RECORDER_NODE)) for channel in CHANNELS),
    *((PRESSURES[channel].name, SIM_NODE, (DRIVER_NODE, RECORDER_NODE)) for channel in CHANNELS),
)
"""What a landing needs: topic, who publishes it, who listens to it."""


@dataclass(frozen=True)
class Startup:
    """A graph that is starting or running, seen from a client's node, with the processes behind it.

    Everything that waits raises GraphError if a process dies meanwhile, if the time is up, or if a node refuses, and
    Interrupted if the command is asked to stop.
    """

    client: GraphClient
    supervisor: Supervisor
    hint: str = ""
    """Where to read on when something fails, to end a line with; may be empty."""

    def wait(self, predicate: Callable[[], bool], timeout_s: float) -> bool:
        """Wait for something on the graph; True once it holds, False when the time is up."""
        deaths: list[Death] = []

        def done() -> bool:
            death = self.supervisor.first_death()
            if death is not None:
                deaths.append(death)
            return bool(deaths) or predicate()

        held = self.client.wait_until(done, timeout_s)
        if deaths:
            self._fail(deaths[0].text())
        return held

    def _wait_for(self, missing: Callable[[], str]) -> bool:
        """Wait until nothing is missing, and say now and then what is; False when the time is up."""
        left_s = READY_TIMEOUT_S
        while not self.wait(lambda: not missing(), min(_SAID_EVERY_S, left_s)):
            left_s -= _SAID_EVERY_S
            if left_s <= 0.0:
                return False
            say(f"still waiting for {missing()}")
        return True

    def wait_until_connected(self, members: Collection[str], ankles: Sequence[str] = ("",)) -> None:
        """Wait until these nodes (`sim`, `lf_ankle/driver`) of these ankles are connected to each other."""

        def missing() -> str:
            return ", ".join(_missing(self.client, members, ankles))

        if not self._wait_for(missing):
            self._fail(f"not ready after {READY_TIMEOUT_S:g} s, missing: {missing()}")

    def wait_until_in_step(self, members: Collection[str]) -> None:
        """Wait until the simulation knows these nodes as those that it waits for, and those of each ankle one another.

        DDS finds nodes by pairs: of two whom the simulation has found, one may find the other 3 s later
        (`graph_client`), and misses what it publishes until then.
        """
        in_step: set[str] = set()
        acquainted: set[frozenset[str]] = set()
        namespace = self.client.namespace
        line = f"{resolved(namespace, SIM_NODE)}{LOCKSTEP_LINE}"

        def take(array: DiagnosticArray) -> None:
            for status in array.status:
                if status.name == line:
                    in_step.update(value.key for value in status.values)
                elif status.name.endswith(LIVENESS_LINE):
                    node = status.name.removesuffix(LIVENESS_LINE)
                    values = {value.key: value.value for value in status.values}
                    acquainted.update(frozenset((node, other)) for other in reporting(status.name, values))

        self.client.subscribe(DiagnosticArray, DIAGNOSTICS, take, subscriber_qos(DIAGNOSTICS))
        wanted = {resolved(namespace, member) for member in members}
        recorder = resolved(namespace, RECORDER_NODE)
        pairs = {
            frozenset((one, other))
            for one, other in itertools.combinations(sorted(wanted), 2)
            if recorder in (one, other) or one.rpartition("/")[0] == other.rpartition("/")[0]
        }

        def missing() -> str:
            apart = [" and ".join(sorted(pair)) for pair in pairs - acquainted]
            return ", ".join([*sorted(wanted - in_step), *(f"{each} to find each other" for each in sorted(apart))])

        if not self._wait_for(missing):
            self._fail(f"not in step with the simulation after {READY_TIMEOUT_S:g} s: {missing()}")

    def wait_until_active(self, driver: str = DRIVER_NODE) -> None:
        """Wait until a driver, by its name relative to the graph's namespace, is active.

        One that starts by itself answers only once it has been through that.
        """
        state: int | None = None

        def answers() -> bool:
            nonlocal state
            try:
                answer = self.client.call(f"{driver}/get_state", GetState, GetState.Request(), _STATE_TIMEOUT_S)
            except GraphError:  # not yet; a driver that died is noticed by `wait`
                return False
            state = int(answer.current_state.id)
            return True

        if not self.wait(answers, READY_TIMEOUT_S):
            self._fail(f"{driver} has not answered for {READY_TIMEOUT_S:g} s")
        if state != State.PRIMARY_STATE_ACTIVE:
            self._fail(
                f"{driver} is not active (lifecycle state {state}): it could not be configured, its lines say why"
            )

    def join_clock(self) -> None:
        """Let the paused simulation start at the /clock that another one makes, if that one's time has begun."""
        ticks: list[Clock] = []
        self.client.subscribe(Clock, CLOCK, ticks.append, subscriber_qos(CLOCK))
        setter = f"{SIM_NODE}/set_parameters"
        # who makes it may be starting just now; a clock that stands is repeated every 0.5 s
        if not self.wait(lambda: bool(ticks), STUCK_S):
            return
        for _ in range(_JOIN_TRIES):
            start_s = _clock_ns(ticks[-1]) / NANOSECONDS_PER_SECOND
            value = ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=start_s)
            request = SetParameters.Request(parameters=[Parameter(name="start_time_s", value=value)])
            (result,) = self.client.call(setter, SetParameters, request).results
            if not result.successful:
                self._fail(f"the simulation did not take the time of {CLOCK.name}: {result.reason}")
            if _clock_ns(ticks[-1]) / NANOSECONDS_PER_SECOND - start_s < _JOINED_WITHIN_S:
                return

    def step(self, steps: int) -> float:
        """Let a paused simulation take steps, as fast as all that are in step with it can; return its time then, s.

        What its nodes have published up to then has been received.
        """
        caller = self.client.node.create_client(Step, resolved(self.client.namespace, STEP.path))
        try:
            future = caller.call_async(Step.Request(steps=steps))
            if not self.wait(future.done, STUCK_S):
                self._fail(f"{STEP.path} did not answer within {STUCK_S:g} s")
        finally:
            self.client.node.destroy_client(caller)
        answer = future.result()
        if not answer.success:
            self._fail(f"the simulation did not go on: {answer.message}")
        self.client.take_what_came()
        return float(answer.simulated_time_s)

    def wait_steps(self, steps: int) -> None:
        """Wait until a simulation that runs in the time of another /clock has taken that many steps."""
        self.let_go()
        ticks_ns: list[int] = []
        self.client.subscribe(Clock, CLOCK, lambda tick: ticks_ns.append(_clock_ns(tick)), subscriber_qos(CLOCK))
        passed_ns = round(steps * SimParameters().timestep_s * NANOSECONDS_PER_SECOND)
        if not self.wait(lambda: bool(ticks_ns) and ticks_ns[-1] - ticks_ns[0] >= passed_ns, STUCK_S):
            self._fail(f"{CLOCK.name} stands still for {STUCK_S:g} s")

    def let_go(self) -> None:
        """Let the simulated time run."""
        answer = self.client.call(SET_PAUSED.path, SetBool, SetBool.Request(data=False))
        if not answer.success:
            self._fail(f"the simulation did not start: {answer.message}")

    def _fail(self, what: str) -> NoReturn:
        msg = f"{what}{self.hint}"
        raise GraphError(msg)


def _missing(client: GraphClient, members: Collection[str], ankles: Sequence[str]) -> list[str]:
    """Return which ends of a topic between these nodes are not there yet."""
    missing = []
    for ankle in ankles:
        for topic, publisher, subscribers in _CONNECTIONS:
            # the recorder and a simulation of several ankles are not in the namespace of one of them
            source, *listeners = (
                name if name in (SIM_NODE, RECORDER_NODE) else below(ankle, name) for name in (publisher, *subscribers)
            )
            if source not in members:
                continue
            path = below(ankle, topic)
            full = resolved(client.namespace, path)
            publishing = _names(client, client.publishers(full))
            listening = _names(client, client.subscriptions(full))
            if source not in publishing:
                missing.append(f"{source} ({path})")
            missing += [f"{name} ({path})" for name in listeners if name in members and name not in listening]
    return missing


def _names(client: GraphClient, ends: Sequence[TopicEndpointInfo]) -> set[str | None]:
    return {relative(client.namespace, node_at(end)) for end in ends}


def _clock_ns(tick: Clock) -> int:
    return int(tick.clock.sec) * NANOSECONDS_PER_SECOND + int(tick.clock.nanosec)
