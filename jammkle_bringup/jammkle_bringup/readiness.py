"""Wait until the nodes of a graph that was just started have found each other, then let simulated time run.

Discovery over DDS takes up to some seconds, and a simulated ankle falls after one: a simulation that runs at once
lands before its controller hears the IMU. So it starts paused, and goes on when everything is connected.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.msg import State
from lifecycle_msgs.srv import GetState
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from rosgraph_msgs.msg import Clock
from std_srvs.srv import SetBool

from jammkle_bringup.conversions import clock_ns
from jammkle_common.command.errors import GraphError
from jammkle_common.constants import NANOSECONDS_PER_SECOND
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
    SET_PAUSED,
    SIM_NODE,
    SOLENOIDS,
    STEP,
    relative,
    resolved,
)
from jammkle_common.qos import subscriber_qos
from jammkle_msgs.srv import Step
from jammkle_sim.parameters import SimParameters

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Sequence

    from rclpy.topic_endpoint_info import TopicEndpointInfo

    from jammkle_bringup.core.supervisor import Death, Supervisor
    from jammkle_bringup.graph_client import GraphClient

RECORDER = "recorder"

READY_TIMEOUT_S = 30.0
"""Until all nodes are there. Assumed; a first start compiles the simulation's laws, which takes some seconds."""

_STATE_TIMEOUT_S = 2.0

STUCK_S = 60.0
"""Real time, s, for steps that take a fraction of a second; only a simulation that hangs takes so long."""

_JOINED_WITHIN_S = 0.2
"""How far /clock may have gone on while a simulation was told to start at it, s: it stays behind by as much."""
_JOIN_TRIES = 5
"""On a busy machine an answer takes a second or more; the last try counts, however late it is."""

_CONNECTIONS = (
    (IMU.name, SIM_NODE, (CONTROLLER_NODE, RECORDER)),
    (CONTACT_EVENTS.name, CONTROLLER_NODE, (RECORDER,)),
    (JAM_COMMAND.name, CONTROLLER_NODE, (DRIVER_NODE, RECORDER)),
    (PUMP_DUTY.name, DRIVER_NODE, (SIM_NODE, RECORDER)),
    (ACTUATOR_STATES.name, SIM_NODE, (DRIVER_NODE, RECORDER)),
    *((SOLENOIDS[channel].name, DRIVER_NODE, (SIM_NODE, RECORDER)) for channel in CHANNELS),
    *((PRESSURES[channel].name, SIM_NODE, (DRIVER_NODE, RECORDER)) for channel in CHANNELS),
)
"""What a landing needs: topic, who publishes it, who listens to it."""


@dataclass(frozen=True)
class Startup:
    """A graph that is starting or running, seen from a client's node, with the processes behind it.

    Attributes:
        client: Node in the graph's namespace.
        supervisor: The processes.
        hint: Where to read on when something fails, to end a line with; may be empty.

    """

    client: GraphClient
    supervisor: Supervisor
    hint: str = ""

    def wait(self, predicate: Callable[[], bool], timeout_s: float) -> bool:
        """Wait for something on the graph; True once it holds, False when the time is up.

        Raises:
            GraphError: a process died meanwhile.
            Interrupted: the command was asked to stop.

        """
        deaths: list[Death] = []

        def done() -> bool:
            death = self.supervisor.first_death()
            if death is not None:
                deaths.append(death)
            return bool(deaths) or predicate()

        held = self.client.wait_until(done, timeout_s)
        if deaths:
            msg = f"{deaths[0].text()}{self.hint}"
            raise GraphError(msg)
        return held

    def wait_until_connected(self, members: Collection[str], ankles: Sequence[str] = ("",)) -> None:
        """Wait until these nodes are connected to each other.

        Args:
            members: Names relative to the graph's namespace: `sim`, `driver`, `lf_ankle/driver`.
            ankles: Namespaces of the ankles, below that one.

        Raises:
            GraphError: a process died, or the time is up.
            Interrupted: the command was asked to stop.

        """
        timeout_s = READY_TIMEOUT_S * len(ankles)
        if not self.wait(lambda: not _missing(self.client, members, ankles), timeout_s):
            missing = ", ".join(_missing(self.client, members, ankles))
            msg = f"not ready after {timeout_s:g} s, missing: {missing}{self.hint}"
            raise GraphError(msg)

    def wait_until_in_step(self, members: Collection[str]) -> None:
        """Wait until the simulation knows these nodes as those that it waits for, so that all see its first step.

        Args:
            members: Names relative to the graph's namespace.

        Raises:
            GraphError: a process died, or the time is up.
            Interrupted: the command was asked to stop.

        """
        in_step: set[str] = set()
        line = f"{resolved(self.client.namespace, SIM_NODE)}{LOCKSTEP_LINE}"

        def take(array: DiagnosticArray) -> None:
            for status in array.status:
                if status.name == line:
                    in_step.update(value.key for value in status.values)

        self.client.subscribe(DiagnosticArray, DIAGNOSTICS, take, subscriber_qos(DIAGNOSTICS))
        wanted = {resolved(self.client.namespace, member) for member in members}
        if not self.wait(lambda: wanted <= in_step, READY_TIMEOUT_S * len(members)):
            msg = f"not in step with the simulation: {', '.join(sorted(wanted - in_step))}{self.hint}"
            raise GraphError(msg)

    def wait_until_active(self, driver: str = DRIVER_NODE) -> None:
        """Wait until a driver, by its name relative to the graph's namespace, is active.

        Raises:
            GraphError: a process died, or the time is up.
            Interrupted: the command was asked to stop.

        """
        state = State.PRIMARY_STATE_UNKNOWN

        def active() -> bool:
            nonlocal state
            try:
                answer = self.client.call_path(f"{driver}/get_state", GetState, GetState.Request(), _STATE_TIMEOUT_S)
            except GraphError:  # not yet; a driver that died is noticed by `wait`
                return False
            state = answer.current_state.id
            return bool(state == State.PRIMARY_STATE_ACTIVE)

        if not self.wait(active, READY_TIMEOUT_S):
            msg = f"{driver} is not active after {READY_TIMEOUT_S:g} s (lifecycle state {state}){self.hint}"
            raise GraphError(msg)

    def join_clock(self) -> None:
        """Let the paused simulation start at the /clock that another one makes, if that one's time has begun.

        Raises:
            GraphError: the simulation does not answer, or refuses.
            Interrupted: the command was asked to stop.

        """
        ticks: list[Clock] = []
        self.client.subscribe(Clock, CLOCK, ticks.append, subscriber_qos(CLOCK))
        setter = f"{SIM_NODE}/set_parameters"
        # who makes it may be starting just now; a clock that stands is repeated every 0.5 s
        if not self.wait(lambda: bool(ticks), READY_TIMEOUT_S):
            return
        for _ in range(_JOIN_TRIES):
            start_s = clock_ns(ticks[-1]) / NANOSECONDS_PER_SECOND
            value = ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=start_s)
            request = SetParameters.Request(parameters=[Parameter(name="start_time_s", value=value)])
            (result,) = self.client.call_path(setter, SetParameters, request).results
            if not result.successful:
                msg = f"the simulation did not take the time of {CLOCK.name}: {result.reason}{self.hint}"
                raise GraphError(msg)
            if clock_ns(ticks[-1]) / NANOSECONDS_PER_SECOND - start_s < _JOINED_WITHIN_S:
                return

    def step(self, steps: int) -> float:
        """Let a paused simulation take steps, as fast as all that are in step with it can; return its time then, s.

        What its nodes have published up to then has been received.

        Raises:
            GraphError: a process died, or the simulation refuses or does not answer.
            Interrupted: the command was asked to stop.

        """
        caller = self.client.node.create_client(Step, resolved(self.client.namespace, STEP.path))
        try:
            future = caller.call_async(Step.Request(steps=steps))
            if not self.wait(future.done, STUCK_S):
                msg = f"{STEP.path} did not answer within {STUCK_S:g} s{self.hint}"
                raise GraphError(msg)
        finally:
            self.client.node.destroy_client(caller)
        answer = future.result()
        if not answer.success:
            msg = f"the simulation did not go on: {answer.message}{self.hint}"
            raise GraphError(msg)
        self.client.take_what_came()
        return float(answer.simulated_time_s)

    def wait_steps(self, steps: int) -> None:
        """Wait until a simulation that runs in the time of another /clock has taken that many steps.

        Raises:
            GraphError: a process died, or /clock stands still.
            Interrupted: the command was asked to stop.

        """
        self.let_go()
        ticks_ns: list[int] = []
        self.client.subscribe(Clock, CLOCK, lambda tick: ticks_ns.append(clock_ns(tick)), subscriber_qos(CLOCK))
        passed_ns = round(steps * SimParameters().timestep_s * NANOSECONDS_PER_SECOND)
        if not self.wait(lambda: bool(ticks_ns) and ticks_ns[-1] - ticks_ns[0] >= passed_ns, STUCK_S):
            msg = f"{CLOCK.name} stands still for {STUCK_S:g} s{self.hint}"
            raise GraphError(msg)

    def let_go(self) -> None:
        """Let the simulated time run.

        Raises:
            GraphError: the simulation does not answer, or refuses.
            Interrupted: the command was asked to stop.

        """
        answer = self.client.call(SET_PAUSED, SetBool, SetBool.Request(data=False))
        if not answer.success:
            msg = f"the simulation did not start: {answer.message}{self.hint}"
            raise GraphError(msg)


def _missing(client: GraphClient, members: Collection[str], ankles: Sequence[str]) -> list[str]:
    """Return which ends of a topic between these nodes are not there yet."""
    missing = []
    for ankle in ankles:
        for topic, publisher, subscribers in _CONNECTIONS:
            # the recorder and a simulation of several ankles are not in the namespace of one of them
            source, *listeners = (
                name if name in (SIM_NODE, RECORDER) or not ankle else f"{ankle}/{name}"
                for name in (publisher, *subscribers)
            )
            if source not in members:
                continue
            path = f"{ankle}/{topic}" if ankle else topic
            full = resolved(client.namespace, path)
            publishing = _names(client, client.publishers(full))
            listening = _names(client, client.subscriptions(full))
            if source not in publishing:
                missing.append(f"{source} ({path})")
            missing += [f"{name} ({path})" for name in listeners if name in members and name not in listening]
    return missing


def _names(client: GraphClient, ends: Sequence[TopicEndpointInfo]) -> set[str | None]:
    """Return the nodes at these ends, relative to the graph's namespace."""
    return {relative(client.namespace, resolved(end.node_namespace, end.node_name)) for end in ends}
