"""Publishes what is due of one ankle: sensors and states of one tick; and the graph's clock."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

from geometry_msgs.msg import WrenchStamped
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import FluidPressure, Imu, JointState
from std_msgs.msg import Bool, Float32

from jammkle_common import names
from jammkle_common.constants import NANOSECONDS_PER_SECOND
from jammkle_common.names import MANIFOLD_FRAME, resolved
from jammkle_common.qos import publisher_qos
from jammkle_msgs.msg import TendonStates, TrueContact
from jammkle_sim.conversions import OutgoingMessages
from jammkle_sim.core.schedule import STATES, Output

if TYPE_CHECKING:
    from collections.abc import Callable, Collection

    from rclpy.node import Node
    from rclpy.publisher import Publisher

    from jammkle_sim.core.engine import Tick
    from jammkle_sim.rigs.readout import ImuSample, TendonSample
    from jammkle_sim.robots.foot_truth import FootTruth
    from jammkle_sim.robots.gait import FootPlan


_NEED_NOT_BE_HEARD = (*STATES, Output.TRUE_CONTACT)


class AnkleSensors(Protocol):
    """What is published of one simulated ankle."""

    def imu(self) -> ImuSample:
        """Latest output of the IMU."""

    def channel_pressures_pa(self) -> dict[str, float]:
        """Absolute pressure per channel, Pa."""

    def manifold_pressure_pa(self) -> float:
        """Absolute pressure in the manifold, Pa."""

    def joint_positions(self) -> dict[str, float]:
        """Angles, rad, and slides, m."""

    def joint_velocities(self) -> dict[str, float]:
        """Rates of the same."""

    def tendons(self) -> tuple[TendonSample, ...]:
        """Every tendon."""


class WithLoadCell(AnkleSensors, Protocol):
    """An ankle on a rig."""

    def load_cell_force_n(self) -> tuple[float, float, float]:
        """Force between rig and leg, N."""


@runtime_checkable
class WithEfforts(Protocol):
    """An ankle of a robot, whose joints have servos."""

    def joint_efforts(self) -> dict[str, float]:
        """Efforts of the joints, N m and N."""


class RobotAnkle(AnkleSensors, Protocol):
    """An ankle of a robot."""

    def foot(self) -> FootTruth:
        """What the foot truly does on the ground."""

    def plan(self) -> FootPlan | None:
        """What the gait plans of the foot; None: there is no gait."""


class Outputs:
    """Publishers of one ankle's outputs, sampled at the moment of publishing."""

    def __init__(self, node: Node, ankle: AnkleSensors, outputs: Collection[Output], within: str = "") -> None:
        """Make the publishers on `node`.

        Args:
            node: The sim node.
            ankle: What is sampled; `WithLoadCell` or `RobotAnkle` where such an output is among them.
            outputs: What it can publish.
            within: Namespace of the ankle below the node's own; empty: that.

        """
        self._namespace = resolved(node.get_namespace(), within).rstrip("/") or "/"
        self._ankle: Any
        self.show(ankle)
        publisher = partial(_publisher, node, within)
        self._pressures = {
            channel: publisher(FluidPressure, topic)
            for channel, topic in {MANIFOLD_FRAME: names.MANIFOLD_PRESSURE, **names.PRESSURES}.items()
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
                publishing = _publishing_if_heard if output in _NEED_NOT_BE_HEARD else _publishing
                self._publish[output] = publishing(publisher(message_type, topic), make)
        if Output.GAIT in outputs:
            self._phase = publisher(Float32, names.GAIT_PHASE)
            self._planned_contact = publisher(Bool, names.PLANNED_CONTACT)
            self._publish[Output.GAIT] = self._publish_gait

    @property
    def broken_tendons(self) -> tuple[str, ...]:
        """Names of the tendons that were broken when last looked at."""
        return self._broken_tendons

    def show(self, ankle: AnkleSensors) -> None:
        """Sample this ankle from now on."""
        self._ankle = ankle
        self._has_efforts = isinstance(ankle, WithEfforts)  # which takes 20 us to find out
        tendons = ankle.tendons()
        self._messages = OutgoingMessages([tendon.name for tendon in tendons], self._namespace)
        self._broken_tendons = tuple(tendon.name for tendon in tendons if tendon.broken)

    def publish(self, tick: Tick) -> None:
        """Publish a tick's outputs.

        Raises:
            NotFiniteError: the simulation gave NaN or infinity; it was not published.

        """
        if Output.TENDON_STATES in tick.outputs:
            self._broken_tendons = tuple(tendon.name for tendon in self._ankle.tendons() if tendon.broken)
        for output in tick.outputs:
            if output is not Output.WHOLE:
                self._publish[output](tick.time_ns)

    def _imu(self, time_ns: int) -> bytes:
        return self._messages.imu_bytes(time_ns, self._ankle.imu())

    def _publish_pressures(self, time_ns: int) -> None:
        pressures_pa = {MANIFOLD_FRAME: self._ankle.manifold_pressure_pa(), **self._ankle.channel_pressures_pa()}
        for place, pressure_pa in pressures_pa.items():
            self._pressures[place].publish(self._messages.pressure_bytes(time_ns, pressure_pa, place))

    def _publish_gait(self, _time_ns: int) -> None:
        """Say what is planned of the foot, where a gait plans anything; both messages are of now, without a stamp."""
        plan: FootPlan | None = self._ankle.plan()
        if plan is None:
            return
        self._planned_contact.publish(Bool(data=plan.bears))
        if plan.phase is not None:
            self._phase.publish(Float32(data=plan.phase))

    def _joint_states(self, time_ns: int) -> JointState:
        positions, velocities = self._ankle.joint_positions(), self._ankle.joint_velocities()
        efforts = self._ankle.joint_efforts() if self._has_efforts else None
        return self._messages.joint_states(time_ns, positions, velocities, efforts)

    def _tendon_states(self, time_ns: int) -> TendonStates:
        return self._messages.tendon_states(time_ns, self._ankle.tendons())

    def _load_cell(self, time_ns: int) -> WrenchStamped:
        return self._messages.wrench(time_ns, self._ankle.load_cell_force_n())

    def _true_contact(self, time_ns: int) -> TrueContact:
        return self._messages.true_contact(time_ns, self._ankle.foot())


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


def _publishing(publisher: Publisher, make: Callable[[int], Any]) -> Callable[[int], None]:
    return lambda time_ns: publisher.publish(make(time_ns))


def _publishing_if_heard(publisher: Publisher, make: Callable[[int], Any]) -> Callable[[int], None]:
    """As `_publishing`, for what nobody need look at: a message that nobody hears costs as much as a step."""

    def publish(time_ns: int) -> None:
        if publisher.get_subscription_count() > 0:
            publisher.publish(make(time_ns))

    return publish


def _publisher(node: Node, within: str, message_type: type, topic: names.Topic) -> Publisher:
    return node.create_publisher(message_type, names.below(within, topic), publisher_qos(topic))
