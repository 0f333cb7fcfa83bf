"""The sim node: simulated hardware on the graph, the graph's clock, and services to pause, step and reset."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING

from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock as RosClock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.serialization import deserialize_message
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Header, String
from std_srvs.srv import SetBool, Trigger

from jammkle_common import names, wire
from jammkle_common.constants import NANOSECONDS_PER_SECOND
from jammkle_common.diagnostics import DiagnosticsPublisher, Liveness
from jammkle_common.messages import Health, Level
from jammkle_common.names import CLOCK, LOCKSTEP, below, resolved
from jammkle_common.parameters import ParameterError, declare, on_change
from jammkle_common.qos import answer_qos, node_at, publisher_qos, subscriber_qos
from jammkle_msgs.srv import Step
from jammkle_sim.conversions import NotFiniteError, parameters_message, time_message
from jammkle_sim.core.engine import (
    AS_FAST_AS_POSSIBLE,
    Engine,
    Output,
    Pacer,
    RefusedError,
    RunState,
    steps_per_output,
)
from jammkle_sim.core.lockstep import Lockstep
from jammkle_sim.parameters import GAIT_RATE_HZ, MACHINE_RATE_HZ, MAX_RATE_HZ, PRESSURE_RATE_HZ
from jammkle_sim.rigs.simulation import UnstableSimulationError
from jammkle_sim.robots.urdf import UrdfNames, robot_urdf
from jammkle_sim.topics import (
    AnkleOutputs,
    ClockOutput,
    JointRequests,
    MachineOutputs,
    SimulatedBoard,
    namespaces,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable

    from rclpy.executors import Executor
    from rclpy.publisher import Publisher
    from rclpy.service import Service

    from jammkle_common.runner import StopFlag
    from jammkle_sim.core.engine import Tick
    from jammkle_sim.kinds import SimKind
    from jammkle_sim.parameters import RunParameters
    from jammkle_sim.rigs.simulation import Simulation

_SLOW_BELOW = 0.9
"""Share of the wanted speed below which the simulation counts as too slow. Assumed: clear of measuring noise."""

_LONGEST_WORK_S = 0.001
"""Real time, s, for which outputs are worked off before callbacks are served again, should they be due back to back.
Serving costs 70 us even when there is nothing to serve, as much as a step; so not after every output."""

_MOST_CALLBACKS = 16
"""Most callbacks that are served after one another: all commands of four drivers' ticks, about a millisecond."""

_LONGEST_WAIT_S = 0.1
"""Real time, s, after which the loop looks at its stop flag."""

_STANDING_CLOCK_PERIOD_S = 0.5
"""Real time, s, after which /clock is repeated while it stands."""


class SimNode(Node):
    """Runs one simulation at its pace and puts it on the graph. `drive` drives it."""

    def __init__(self, kind: SimKind) -> None:
        """Make the node, what it simulates and all its topics and services.

        Raises:
            ParameterError: an unknown parameter, or one out of range.

        """
        # Who makes the clock must not listen to it, whatever a launch file sets for all nodes.
        own_time = Parameter("use_sim_time", value=False)
        super().__init__(
            names.SIM_NODE, parameter_overrides=[own_time], automatically_declare_parameters_from_overrides=True
        )
        parameters = declare(self, kind.parameters)
        self._kind = kind
        self._wanted = self._built = parameters
        self._simulation = kind.make(parameters)
        self._engine = _make_engine(self._simulation, parameters, kind.outputs)
        self._clock_output = ClockOutput(self, parameters.clock_rate_hz, is_ours=parameters.publish_clock)
        self._description = self.create_publisher(
            String, names.SIM_PARAMETERS.name, publisher_qos(names.SIM_PARAMETERS)
        )
        self._diagnostics = DiagnosticsPublisher(
            self, "jammkle_sim", self._health, lambda: time_message(self._engine.time_ns)
        )
        ankles = namespaces(self._simulation)
        self._participants = Participants(self, ankles.values(), parameters, self._diagnostics.check)
        self._liveness = Liveness(self, ankles.values(), self._time_s)
        self._outputs = [AnkleOutputs(self, self._simulation, name, kind.outputs) for name in ankles]
        self._boards = [
            SimulatedBoard(self, self._simulation, name, self._diagnostics.check, self._time_s) for name in ankles
        ]
        self._reported_broken: list[tuple[str, ...]] = []
        self._machine_outputs = self._make_machine_outputs()
        self._joint_requests = JointRequests(self, self._simulation, self._time_s)
        self._describe()
        self._requests = _Requests(self, self._engine, self._reset, self._diagnostics.check)
        steady = RosClock(clock_type=ClockType.STEADY_TIME)
        self._clock_repeater = self.create_timer(_STANDING_CLOCK_PERIOD_S, self._repeat_standing_clock, clock=steady)
        self.add_on_set_parameters_callback(self._refuse_late_start_time)
        on_change(self, kind.parameters, self._take_changes)

    @property
    def time_ns(self) -> int:
        """Simulated time, ns."""
        return self._engine.time_ns

    def cycle(self) -> float:
        """Advance and publish what is due, for about a millisecond at most.

        Returns:
            How long callbacks may be served until the next call, s; 0 when something is due already.

        """
        end_s = time.monotonic() + _LONGEST_WORK_S
        while True:
            if not self._participants.ready():
                if self._participants.account.to_repeat():
                    self._tick(self._engine.time_ns)
                return _LONGEST_WAIT_S
            self._requests.answer_finished_steps()
            wait_s = self._advance()
            if wait_s > 0 or time.monotonic() >= end_s:
                return min(wait_s, _LONGEST_WAIT_S)

    def _advance(self) -> float:
        """Advance to the next due outputs and publish them, if their time has come; return the time until the next."""
        limit_ns = self._participants.limit_ns
        if limit_ns is not None:
            self._engine.go_as_far_as(limit_ns)
        stands = self._engine.stands
        left_out = stands and not self._built.publish_clock  # of a time that somebody else makes
        begins = not self._engine.begun and self._engine.wait_s() <= 0.0
        for board in self._boards:
            board.set_paused(self._engine.time_ns, paused=left_out)
            if begins:
                board.begin()
            board.before_step(self._engine.time_ns)
        try:
            tick = self._engine.cycle()
            if tick is not None:
                self._publish(tick)
        except (UnstableSimulationError, NotFiniteError) as error:
            self._fail(str(error))
        self._report_breaks()
        self._participants.arrived(math.inf if stands else self._engine.next_output_ns())
        return self._engine.wait_s()

    def _publish(self, tick: Tick) -> None:
        if Output.PRESSURES in tick.outputs:
            for board in self._boards:
                board.repeat(tick.time_ns)
        for outputs in self._outputs:
            outputs.publish(tick)
        self._machine_outputs.publish(tick, self._simulation)
        if self._engine.state is not RunState.RUNNING:
            self._tick(tick.time_ns)
        elif self._clock_output.run(tick.time_ns):
            self._participants.account.sent(tick.time_ns)
        self._diagnostics.at(self._time_s())

    def _time_s(self) -> float:
        return self._engine.time_ns / NANOSECONDS_PER_SECOND

    def _tick(self, time_ns: int) -> None:
        """Publish /clock, where that is this node's to make, and wait for the answers."""
        if self._clock_output.publish(time_ns):
            self._participants.account.sent(time_ns)

    def drive(self, executor: Executor, stop: StopFlag) -> None:
        """Run until asked to stop: a cycle, then callbacks until the next one is due."""
        self._engine.restart_pace()  # making the node has taken time that nobody wants to catch up
        while not stop:
            executor.spin_once(timeout_sec=self.cycle())
            if not self._participants.account.participants:
                self._serve_drivers(executor)

    def _serve_drivers(self, executor: Executor) -> None:
        """Serve what the drivers have sent meanwhile.

        One callback a cycle is too few when time is short, and a driver whose commands wait is taken for dead.
        """
        received = -1
        for _ in range(_MOST_CALLBACKS):
            before, received = received, sum(board.received for board in self._boards)
            if received == before:
                return
            executor.spin_once(timeout_sec=0)

    def shut_down(self) -> None:
        """Answer whoever still waits for steps."""
        self._engine.fail("the sim node was stopped")
        self._requests.answer_finished_steps()
        self._diagnostics.farewell()

    def _refuse_late_start_time(self, changes: list[Parameter]) -> SetParametersResult:
        """Time must not jump once it has begun."""
        if self._engine.begun and any(change.name == "start_time_s" for change in changes):
            reason = "start_time_s cannot change once simulated time has begun: start with start_paused"
            return SetParametersResult(successful=False, reason=reason)
        return SetParametersResult(successful=True)

    def _take_changes(self, changed: RunParameters) -> None:
        self._wanted = changed
        self._engine.set_speed(changed.speed)
        self._participants.account.timeout_s = changed.lockstep_timeout_s
        if not self._engine.begun:
            self._engine.set_start_time(changed.start_time_s)

    def _repeat_standing_clock(self) -> None:
        """Publish the standing /clock again, so that a node which joins during a pause knows the time."""
        if self._engine.stands:
            self._tick(self._engine.time_ns)

    def _report_breaks(self) -> None:
        broken = [outputs.broken_tendons for outputs in self._outputs]
        if broken != self._reported_broken:
            self._reported_broken = broken
            self._diagnostics.check()

    def _fail(self, why: str) -> None:
        self._engine.fail(why)
        self.get_logger().error(f"{why}; paused until ~/reset")
        self._diagnostics.check()

    def _describe(self) -> None:
        if left_out := self._simulation.machine.left_out:
            constants = ", ".join(left_out)
            self.get_logger().info(f"effects_file: left out, as this simulation cannot show them: {constants}")
        self._description.publish(parameters_message(self._simulation.machine.description()))

    def _reset(self) -> None:
        anew = self._kind.options_of(self._wanted) != self._kind.options_of(self._built)
        made = self._kind.make(self._wanted) if anew else None  # first, as it may be refused
        self._engine.reset()
        if made is not None:
            self._simulation.exchange(made.machine)
            self._built = self._wanted
            for outputs in self._outputs:
                outputs.look_at_tendons()
            self._describe()
        for board in self._boards:
            board.apply()

    def _health(self) -> list[Health]:
        return [
            self._simulation_health(),
            self._participants.account.health(),
            *(each.health() for pair in zip(self._outputs, self._boards, strict=True) for each in pair),
            self._liveness.health(),
        ]

    def _simulation_health(self) -> Health:
        """Run state, simulated time and pace, and whether the clock is this simulation's alone."""
        engine, pacer, factor = self._engine, self._engine.pacer, self._engine.real_time_factor
        fastest = pacer.speed == AS_FAST_AS_POSSIBLE
        values = {
            "state": engine.state.value,
            "simulated time (s)": f"{self._time_s():.4f}",
            "target real-time factor": "as fast as possible" if fastest else f"{pacer.speed:g}",
            "achieved real-time factor": "not measured yet" if math.isnan(factor) else f"{factor:.3f}",
            "late cycles": str(pacer.late_cycles),
            "real time given up (s)": f"{pacer.given_up_s:.3f}",
        }
        clocks = self.count_publishers(names.CLOCK.name) if self._built.publish_clock else 0
        level, message = Level.OK, engine.state.value
        if engine.state is RunState.FAILED:
            level, message = Level.ERROR, f"{engine.failure}; paused until ~/reset"
        elif clocks > 1:
            level, message = Level.WARN, f"{names.CLOCK.name} is made by {clocks} simulations: stop the others, choose "
            message += "another ROS_DOMAIN_ID, or give all but one publish_clock:=false to live in its time"
        elif engine.state is RunState.RUNNING and factor < _SLOW_BELOW * pacer.speed:
            level, message = Level.WARN, "slower than wanted; lower the parameter speed"
        return Health("simulation", level, message, values)

    def _make_machine_outputs(self) -> MachineOutputs:
        """Make what is published of the whole; joints of several ankles together, as a single one reports its own."""
        robot = self._kind.robot_of(self._simulation.machine)
        joints = UrdfNames(robot).reported if len(robot.ankles) > 1 else ()
        return MachineOutputs(self, robot_urdf(robot, self.get_namespace()), joints)


def _make_engine(simulation: Simulation, parameters: RunParameters, outputs: Collection[Output]) -> Engine:
    """Make the engine; that rates and time step fit each other was checked with the parameters."""
    timestep_s = simulation.timestep_s
    state = steps_per_output(parameters.state_rate_hz, timestep_s, MAX_RATE_HZ)
    periods = {
        Output.IMU: steps_per_output(parameters.imu_rate_hz, timestep_s, MAX_RATE_HZ),
        Output.JOINT_STATES: state,
        Output.TENDON_STATES: state,
        Output.LOAD_CELL: state,
        Output.TRUE_CONTACT: state,
        Output.GAIT: steps_per_output(GAIT_RATE_HZ, timestep_s, MAX_RATE_HZ),
        Output.MACHINE: steps_per_output(MACHINE_RATE_HZ, timestep_s, MAX_RATE_HZ),
        Output.PRESSURES: steps_per_output(PRESSURE_RATE_HZ, timestep_s, MAX_RATE_HZ),
    }
    periods = {output: period for output, period in periods.items() if output in outputs}
    pacer = Pacer(parameters.speed)
    engine = Engine(simulation, periods, pacer, time.monotonic, start_paused=parameters.start_paused)
    engine.set_start_time(parameters.start_time_s)
    return engine


class _Requests:
    """~/set_paused, ~/reset and ~/step, and the answer that is still owed for steps being taken."""

    def __init__(
        self, node: Node, engine: Engine, reset: Callable[[], None], on_state_change: Callable[[], None]
    ) -> None:
        """Offer the services; resetting may raise RefusedError, and every granted request is passed on."""
        self._engine = engine
        self._reset_machine = reset
        self._on_state_change = on_state_change
        self._steps_asked = 0
        node.create_service(SetBool, names.SET_PAUSED.name, self._set_paused)
        node.create_service(Trigger, names.RESET.name, self._reset)
        self._step_answer = _LateAnswer(node.create_service(Step, names.STEP.name, self._step))

    def answer_finished_steps(self) -> None:
        """Answer ~/step if its steps are done, or if they never will be."""
        if self._steps_asked and self._engine.state is not RunState.STEPPING:
            self._step_answer.release(self._fill_step_answer)
            self._steps_asked = 0
            self._on_state_change()

    def _set_paused(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        try:
            if request.data:
                self._engine.pause()
            else:
                self._engine.resume()
        except RefusedError as error:
            response.message = str(error)
            return response
        response.success = True
        response.message = f"{self._engine.state.value} at {self._simulated_s():.4f} s"
        self._on_state_change()
        return response

    def _reset(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self.answer_finished_steps()
        try:
            self._reset_machine()
        except (RefusedError, ParameterError) as error:
            response.message = str(error)
            return response
        response.success = True
        response.message = (
            f"rig and noise as at the start; simulated time goes on from {self._simulated_s():.4f} s, "
            f"{self._engine.state.value}"
        )
        self._on_state_change()
        return response

    def _step(self, request: Step.Request, response: Step.Response) -> Step.Response:
        self.answer_finished_steps()  # there is room for one that waits
        try:
            self._engine.begin_steps(request.steps)
        except RefusedError as error:
            response.message = str(error)
            response.simulated_time_s = self._simulated_s()
            return response
        self._steps_asked = request.steps
        self._step_answer.hold_next()
        return response

    def _fill_step_answer(self, response: Step.Response) -> None:
        failure = self._engine.failure
        response.success = not failure
        response.message = failure or f"took {self._steps_asked} steps"
        response.simulated_time_s = self._simulated_s()

    def _simulated_s(self) -> float:
        return self._engine.time_ns / NANOSECONDS_PER_SECOND


class _LateAnswer:
    """Lets a service answer after its callback has returned, so that a long request does not block the node.

    The executor hands every answer, with the header that says whose it is, to `Service.send_response`; the events
    executor knows no other way (it does not await coroutines). This stands in between and holds the answer back.
    """

    def __init__(self, service: Service) -> None:
        """Stand in front of `service`."""
        self._send = service.send_response
        self._hold = False
        self._held: tuple[object, object] | None = None
        service.send_response = self._take

    def hold_next(self) -> None:
        """Hold back the answer that the callback now running returns."""
        self._hold = True

    def release(self, fill: Callable[[object], None]) -> None:
        """Send the answer held back, after `fill` has written it; does nothing if there is none."""
        if self._held is not None:
            response, header = self._held
            self._held = None
            fill(response)
            self._send(response, header)

    def _take(self, response: object, header: object) -> None:
        if self._hold:
            self._hold = False
            self._held = (response, header)
        else:
            self._send(response, header)


_STOPPED_AFTER_S = 10.0
"""Real time without an answer, s, after which who is gone from the graph has not left in order: a process that a
debugger or SIGSTOP stops is forgotten there once its lease ends (20 s in Fast DDS). It is to be waited for."""
_LEFT_AFTER_S = 0.3
"""Real time, s, for which an answer is missing before it is looked whether its sender has left the graph."""


class Participants:
    """The simulation's end of the topic `lockstep`: who answers its ticks, and its answers to another one's.

    A simulation that makes /clock waits for its participants. One that lives in the /clock of another simulation goes
    as far as that has ticked, and answers it when it is there and its own participants are done.
    """

    def __init__(
        self, node: Node, ankles: Iterable[str], parameters: RunParameters, on_change: Callable[[], None]
    ) -> None:
        """Listen on `node`.

        Args:
            node: The sim node.
            ankles: Namespaces of its ankles below its own; those in them take part, as those in its own do.
            parameters: Whether it waits for others, for how long, and whether /clock is its own.
            on_change: Called when somebody falls out of step, or is back.

        """
        self._node = node
        self._on_change = on_change
        self.account = Lockstep(parameters.lockstep_timeout_s, time.monotonic)
        """Of ticks and answers; nobody is known where it does not wait for others."""
        self._topics = [resolved(node.get_namespace(), below(within, LOCKSTEP)) for within in {"", *ankles}]
        self._looked_s = 0.0
        self._reported = 0
        self._other: Publisher | None = None
        self.limit_ns: int | None = None
        """How far another simulation's clock has ticked, ns; None: no other one's has."""
        self._answered_ns: int | None = None
        self._writer = wire.Writer(node.get_fully_qualified_name(), 0)
        if not parameters.lockstep:
            return
        for topic in self._topics:
            node.create_subscription(Header, topic, self._take_answer, subscriber_qos(LOCKSTEP), raw=True)
        if not parameters.publish_clock:
            node.create_subscription(Clock, CLOCK.name, self._take_tick, subscriber_qos(CLOCK))

    def ready(self) -> bool:
        """Return whether the next step may be taken."""
        ready = self.account.ready()
        if not ready:
            self._look_who_left()
        if self.account.changes != self._reported:
            self._reported = self.account.changes
            self._on_change()
        return ready

    def arrived(self, next_output_ns: float) -> None:
        """Answer the simulation that makes /clock, once this one is as far as it may go and all of its own are done.

        The next output is infinitely far, ns, where time stands still and nobody is waited for.
        """
        tick_ns = self.limit_ns
        if tick_ns is None or tick_ns == self._answered_ns or next_output_ns <= tick_ns or not self.ready():
            return
        if self._other is None:
            makers = [node_at(end) for end in self._node.get_publishers_info_by_topic(CLOCK.name)]
            if not makers or not makers[0]:
                return
            topic = resolved(makers[0].rpartition("/")[0], LOCKSTEP.name)
            self._other = self._node.create_publisher(Header, topic, answer_qos())
        self._other.publish(self._writer.write(tick_ns))
        self._answered_ns = tick_ns

    def _take_answer(self, serialized: bytes) -> None:
        answer = wire.read(serialized, 0)
        if answer is None:
            header = deserialize_message(serialized, Header)
            answer = wire.Measured(
                header.stamp.sec * NANOSECONDS_PER_SECOND + header.stamp.nanosec, header.frame_id, ()
            )
        if answer.frame_id:
            self.account.answered(answer.frame_id, answer.time_ns)

    def _take_tick(self, message: Clock) -> None:
        tick_ns = message.clock.sec * NANOSECONDS_PER_SECOND + message.clock.nanosec
        if tick_ns == self.limit_ns:
            self._answered_ns = None  # it asks again
        self.limit_ns = tick_ns
        self.account.sent(tick_ns)

    def _look_who_left(self) -> None:
        """Forget those that have left the graph in order; one that was killed is seen on it for a while."""
        now_s = time.monotonic()
        if self.account.waited_s < _LEFT_AFTER_S or now_s - self._looked_s < _LEFT_AFTER_S:
            return
        if self.account.timeout_s == 0.0 and self.account.waited_s > _STOPPED_AFTER_S:
            return
        self._looked_s = now_s
        there = {node_at(end) for topic in self._topics for end in self._node.get_publishers_info_by_topic(topic)}
        for name in self.account.missing:
            if name not in there and "" not in there:
                self.account.forget(name)
