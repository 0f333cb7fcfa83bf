"""What the sim node publishes and subscribes to: sensors and commands of every ankle, the machine's base, the clock."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

from geometry_msgs.msg import WrenchStamped
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import FluidPressure, Imu, JointState
from std_msgs.msg import Bool, Float32, String
from trajectory_msgs.msg import JointTrajectory

from jammkle_common import names
from jammkle_common.constants import NANOSECONDS_PER_SECOND
from jammkle_common.messages import COMMANDS_LINE, Health, Level, transform_of
from jammkle_common.names import MANIFOLD_FRAME, below, resolved
from jammkle_common.parameters import ParameterError
from jammkle_common.qos import publisher_qos, subscriber_qos
from jammkle_msgs.msg import ActuatorStates, TendonStates, TrueContact
from jammkle_sim.conversions import BadCommandError, OutgoingMessages, actuator_states, duty_from, joint_course
from jammkle_sim.core.engine import STATES, Output
from jammkle_sim.robots.robot import FollowingControl

try:  # what tf listens to comes with the distribution, and is not among the wheels
    from tf2_msgs.msg import TFMessage
except ModuleNotFoundError:
    TFMessage = None

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping, Sequence

    from rclpy.node import Node
    from rclpy.publisher import Publisher

    from jammkle_sim.core.engine import Tick
    from jammkle_sim.rigs.simulation import Ankle, Simulation
    from jammkle_sim.robots.urdf import ReportedJoint

WATCHDOG_S = 0.2
"""Silence of the driver after which the simulated board lets go, s of simulated time: the firmware's default of
watchdog_ms."""
_ONLY_IF_SUBSCRIBED = (*STATES, Output.TRUE_CONTACT)
"""What nobody need look at: a message without a subscriber costs as much as a step."""


def namespaces(simulation: Simulation) -> dict[str, str]:
    """Return the namespace of each ankle below the node's own, by its name; a single one is in that."""
    return {name: name if len(simulation.ankles) > 1 else "" for name in simulation.ankles}


class AnkleOutputs:
    """Publishers of one ankle's outputs, sampled at the moment of publishing."""

    def __init__(self, node: Node, simulation: Simulation, name: str, outputs: Collection[Output]) -> None:
        """Make the publishers on the sim node of what an ankle, by its name, can publish."""
        self._within = within = namespaces(simulation)[name]
        self._simulation, self._name = simulation, name
        tendons = tuple(tendon.name for tendon in self._ankle.tendons())
        self._messages = OutgoingMessages(tendons, resolved(node.get_namespace(), within).rstrip("/") or "/")
        self.broken_tendons: tuple[str, ...] = ()
        """Names of the tendons that were broken when last looked at."""
        publisher = partial(_publisher, node, within)
        self._pressures = {
            place: publisher(FluidPressure, topic)
            for place, topic in {MANIFOLD_FRAME: names.MANIFOLD_PRESSURE, **names.PRESSURES}.items()
        }
        self._publish: dict[Output, Callable[[int], None]] = {Output.PRESSURES: self._publish_pressures}
        made: dict[Output, tuple[type, names.Topic, Callable[[int], Any]]] = {
            Output.IMU: (Imu, names.IMU, self._imu),
            Output.JOINT_STATES: (JointState, names.JOINT_STATES, self._joint_states),
            Output.TENDON_STATES: (TendonStates, names.TENDON_STATES, self._tendon_states),
            Output.LOAD_CELL: (WrenchStamped, names.LOAD_CELL, self._load_cell),
            Output.TRUE_CONTACT: (TrueContact, names.TRUE_CONTACT, self._true_contact),
        }
        for output, (message_type, topic, make) in made.items():
            if output in outputs:
                always = output not in _ONLY_IF_SUBSCRIBED
                self._publish[output] = _publishing(publisher(message_type, topic), make, always=always)
        if Output.GAIT in outputs:
            self._phase = publisher(Float32, names.GAIT_PHASE)
            self._planned_contact = publisher(Bool, names.PLANNED_CONTACT)
            self._publish[Output.GAIT] = self._publish_gait

    def look_at_tendons(self) -> None:
        """Note which are broken."""
        self.broken_tendons = tuple(tendon.name for tendon in self._ankle.tendons() if tendon.broken)

    def publish(self, tick: Tick) -> None:
        """Publish a tick's outputs.

        Raises:
            NotFiniteError: the simulation gave NaN or infinity; it was not published.

        """
        if Output.TENDON_STATES in tick.outputs:
            self.look_at_tendons()
        for output in tick.outputs:
            if output is not Output.MACHINE:
                self._publish[output](tick.time_ns)

    def health(self) -> Health:
        """Return one line on its tendons."""
        about, broken = f"{self._within} tendons".strip(), ", ".join(self.broken_tendons)
        values = {"broken tendons": broken or "none"}
        if broken:
            return Health(about, Level.ERROR, f"broken: {broken}; ~/reset makes them whole", values)
        return Health(about, Level.OK, "whole", values)

    @property
    def _ankle(self) -> Ankle:
        return self._simulation.ankles[self._name]

    def _imu(self, time_ns: int) -> bytes:
        return self._messages.imu(time_ns, self._ankle.imu())

    def _publish_pressures(self, time_ns: int) -> None:
        pressures_pa = {MANIFOLD_FRAME: self._ankle.manifold_pressure_pa(), **self._ankle.channel_pressures_pa()}
        for place, pressure_pa in pressures_pa.items():
            self._pressures[place].publish(self._messages.pressure(time_ns, pressure_pa, place))

    def _publish_gait(self, _time_ns: int) -> None:
        """Say what is planned of the foot, where a gait plans anything; both messages are of now, without a stamp."""
        plan = self._ankle.plan()
        if plan is None:
            return
        self._planned_contact.publish(Bool(data=plan.bears))
        if plan.phase is not None:
            self._phase.publish(Float32(data=plan.phase))

    def _joint_states(self, time_ns: int) -> JointState:
        ankle = self._ankle
        positions, velocities = ankle.joint_positions(), ankle.joint_velocities()
        return self._messages.joint_states(time_ns, positions, velocities, ankle.joint_efforts())

    def _tendon_states(self, time_ns: int) -> TendonStates:
        return self._messages.tendon_states(time_ns, self._ankle.tendons())

    def _load_cell(self, time_ns: int) -> bytes:
        return self._messages.wrench(time_ns, self._ankle.load_cell_force_n())

    def _true_contact(self, time_ns: int) -> TrueContact:
        return self._messages.true_contact(time_ns, self._ankle.foot())


class SimulatedBoard:
    """Subscriptions of one ankle's simulated board, and its acknowledgement.

    It says when it does what, and lets go when no commands come.
    """

    def __init__(
        self,
        node: Node,
        simulation: Simulation,
        name: str,
        on_change: Callable[[], None],
        time_s: Callable[[], float],
    ) -> None:
        """Subscribe on the sim node for an ankle, by its name; its board lives in simulated time, and tells changes."""
        self._within = within = namespaces(simulation)[name]
        self._simulation, self._name = simulation, name
        self.received = 0
        """How many messages of the driver have come."""
        self.refused = ""
        """Why the latest command was refused, in one line; empty when it was followed."""
        self.let_go = False
        """Whether the board has let go, as no command came; until everything is commanded to release."""
        self._time_s = time_s
        self._on_change = on_change
        self._duty, self._requested_duty = 0.0, 0.0
        self._energised, self._requested = (dict.fromkeys(names.CHANNELS, False) for _ in range(2))
        self._is_new = False
        self._restarts = 0
        self._paused = False
        self._acknowledged_lately = False
        self._received_s = time_s()
        qos = publisher_qos(names.ACTUATOR_STATES)
        self._acknowledgements = node.create_publisher(ActuatorStates, below(within, names.ACTUATOR_STATES), qos)
        duty = names.PUMP_DUTY
        node.create_subscription(Float32, below(within, duty), self._on_duty, subscriber_qos(duty))
        for channel, topic in names.SOLENOIDS.items():
            on_solenoid = partial(self._on_solenoid, channel)
            node.create_subscription(Bool, below(within, topic), on_solenoid, subscriber_qos(topic))

    def apply(self) -> None:
        """Command again what stands, and say that the plant began anew: it is still wired to the same driver."""
        self._restarts += 1
        self._is_new = True
        self._ankle.set_pump_duty(self._duty)
        for channel, energised in self._energised.items():
            self._ankle.set_solenoid(channel, energised)

    def set_paused(self, time_ns: int, *, paused: bool) -> None:
        """Say whether the ankle stands still although the clock may go on; the watchdog stands still, too."""
        if paused == self._paused:
            return
        self._paused = paused
        self._received_s = self._time_s()
        self._acknowledge(time_ns)

    def begin(self) -> None:
        """Acknowledge before the first step, when all subscribers are there."""
        self._is_new = True

    def before_step(self, time_ns: int) -> None:
        """Let go if the driver was silent for too long; acknowledge what has changed, at a simulated time, ns."""
        now_s = self._time_s()
        self._received_s = min(self._received_s, now_s)  # time may be set back
        is_on = self._duty > 0.0 or any(self._energised.values())
        if is_on and not self.let_go and now_s - self._received_s > WATCHDOG_S:
            self._set_let_go(let_go=True)
            self._obey(0.0, dict.fromkeys(names.CHANNELS, False))
        if self._is_new:
            self._acknowledge(time_ns)

    def repeat(self, time_ns: int) -> None:
        """Acknowledge once more if nothing was acknowledged since the last call, so that silence never lasts."""
        if not self._acknowledged_lately:
            self._acknowledge(time_ns)
        self._acknowledged_lately = False

    def health(self) -> Health:
        """Return one line on whether it is commanded, and does so."""
        about = f"{self._within}{COMMANDS_LINE}".strip()
        if self.let_go:
            message = f"no command for {WATCHDOG_S:g} s while something was on: everything released"
            return Health(about, Level.ERROR, f"{message}, until a release is commanded")
        if self.refused:
            return Health(about, Level.WARN, self.refused)
        return Health(about, Level.OK, "followed")

    @property
    def _ankle(self) -> Ankle:
        return self._simulation.ankles[self._name]

    def _acknowledge(self, time_ns: int) -> None:
        states = actuator_states(
            time_ns, self._duty, self._energised, self._restarts, host_silent=self.let_go, paused=self._paused
        )
        self._acknowledgements.publish(states)
        self._is_new = False
        self._acknowledged_lately = True

    def _on_duty(self, message: Float32) -> None:
        self._note_received()
        refused = ""
        try:
            self._requested_duty = duty_from(message)
        except BadCommandError as error:
            refused = str(error)
        if refused != self.refused:
            self.refused = refused
            self._on_change()
        if not refused:
            self._follow()

    def _on_solenoid(self, channel: str, message: Bool) -> None:
        self._note_received()
        self._requested[channel] = message.data
        self._follow()

    def _note_received(self) -> None:
        self.received += 1
        self._received_s = self._time_s()

    def _follow(self) -> None:
        """Do what is requested, unless the board has let go and was not yet commanded to release everything."""
        if self.let_go and (self._requested_duty > 0.0 or any(self._requested.values())):
            return
        self._set_let_go(let_go=False)
        self._obey(self._requested_duty, self._requested)

    def _obey(self, duty: float, energised: Mapping[str, bool]) -> None:
        if duty != self._duty:
            self._is_new = True
            self._duty = duty
            self._ankle.set_pump_duty(duty)
        for channel, on in energised.items():
            if on != self._energised[channel]:
                self._is_new = True
                self._energised[channel] = on
                self._ankle.set_solenoid(channel, on)

    def _set_let_go(self, *, let_go: bool) -> None:
        if let_go != self.let_go:
            self.let_go = let_go
            self._is_new = True
            self._on_change()


class JointRequests:
    """Lets the joints of a robot do what is asked of them."""

    def __init__(self, node: Node, simulation: Simulation, time_s: Callable[[], float]) -> None:
        """Subscribe on the sim node, if the simulation has joints that follow; time is that of /clock, s."""
        self._node, self._simulation, self._time_s = node, simulation, time_s
        if isinstance(simulation.machine.control, FollowingControl):
            topic = names.JOINT_TRAJECTORY
            node.create_subscription(JointTrajectory, topic.name, self._take, subscriber_qos(topic))

    def _take(self, message: JointTrajectory) -> None:
        control = self._simulation.machine.control
        run_began_s = self._time_s() - self._simulation.elapsed_s
        try:
            if isinstance(control, FollowingControl):
                control.follow(joint_course(message, run_began_s, self._simulation.elapsed_s))
        except (BadCommandError, ParameterError) as error:
            self._node.get_logger().warning(f"{error}; the joints do what they did before")


class MachineOutputs:
    """What is published of the machine and not of one ankle: its URDF, where its base is, all of its joints."""

    def __init__(self, node: Node, urdf: str, joints: Sequence[ReportedJoint]) -> None:
        """Publish the URDF, which stays as it is.

        Args:
            node: The sim node.
            urdf: Of what is simulated.
            joints: Those of several ankles, to be reported together under names of their own; none of a single one,
                which reports them in this very namespace.

        """
        self._messages = OutgoingMessages((), node.get_namespace())
        self._joints = joints
        publisher = partial(_publisher, node, "")
        self._description = publisher(String, names.ROBOT_DESCRIPTION)
        self._description.publish(String(data=urdf))
        self._odometry = publisher(Odometry, names.ODOMETRY)
        self._transforms = None if TFMessage is None else publisher(TFMessage, names.TF)
        self._joint_states = publisher(JointState, names.JOINT_STATES) if joints else None

    def publish(self, tick: Tick, simulation: Simulation) -> None:
        """Publish what is due, if anybody subscribes to it.

        Raises:
            NotFiniteError: the simulation gave NaN or infinity; it was not published.

        """
        if Output.MACHINE not in tick.outputs:
            return
        if _is_subscribed(self._odometry) or _is_subscribed(self._transforms):
            odometry = self._messages.odometry(tick.time_ns, simulation.base())
            self._odometry.publish(odometry)
            if self._transforms is not None:
                self._transforms.publish(transform_of(odometry))
        if self._joint_states is not None and _is_subscribed(self._joint_states):
            positions = {name: ankle.joint_positions() for name, ankle in simulation.ankles.items()}
            velocities = {name: ankle.joint_velocities() for name, ankle in simulation.ankles.items()}
            efforts = {name: ankle.joint_efforts() or {} for name, ankle in simulation.ankles.items()}
            self._joint_states.publish(
                self._messages.joint_states(
                    tick.time_ns,
                    {joint.unique: positions[joint.ankle][joint.name] for joint in self._joints},
                    {joint.unique: velocities[joint.ankle][joint.name] for joint in self._joints},
                    {joint.unique: efforts[joint.ankle].get(joint.name, 0.0) for joint in self._joints},
                )
            )


class ClockOutput:
    """The graph's clock, if it is this node's to make."""

    def __init__(self, node: Node, rate_hz: int, *, is_ours: bool) -> None:
        """Make the publisher on `node`, unless somebody else keeps the graph's time; `rate_hz` bounds `run`'s ticks."""
        self._publisher = _publisher(node, "", Clock, names.CLOCK) if is_ours else None
        self._period_ns = NANOSECONDS_PER_SECOND // rate_hz
        self._last_ns = 0
        self._messages = OutgoingMessages(())

    def run(self, time_ns: int) -> bool:
        """Publish a tick of time that runs on, if a multiple of the period has been passed; return whether it was."""
        if self._last_ns <= time_ns and time_ns // self._period_ns == self._last_ns // self._period_ns:
            return False
        return self.publish(time_ns)

    def publish(self, time_ns: int) -> bool:
        """Publish a tick; return whether that is this node's to do."""
        self._last_ns = time_ns
        if self._publisher is None:
            return False
        self._publisher.publish(self._messages.clock(time_ns))
        return True


def _publisher(node: Node, within: str, message_type: type, topic: names.Topic) -> Publisher:
    return node.create_publisher(message_type, below(within, topic), publisher_qos(topic))


def _publishing(publisher: Publisher, make: Callable[[int], Any], *, always: bool) -> Callable[[int], None]:
    def publish(time_ns: int) -> None:
        if always or _is_subscribed(publisher):
            publisher.publish(make(time_ns))

    return publish


def _is_subscribed(publisher: Publisher | None) -> bool:
    return publisher is not None and publisher.get_subscription_count() > 0
