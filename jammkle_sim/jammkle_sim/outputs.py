"""Publishes what is due: sensors and states of one tick, and after them its /clock."""

from __future__ import annotations

from typing import TYPE_CHECKING

from geometry_msgs.msg import WrenchStamped
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import FluidPressure, Imu, JointState

from jammkle_graph import names
from jammkle_graph.qos import publisher_qos
from jammkle_msgs.msg import TendonStates
from jammkle_sim.conversions import OutgoingMessages
from jammkle_sim.core.schedule import Output

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.node import Node
    from rclpy.publisher import Publisher

    from jammkle_sim.core.engine import Tick
    from jammkle_sim.rigs.simulation import Simulation


class Outputs:
    """Publishers of one simulation's outputs, sampled at the moment of publishing."""

    def __init__(self, node: Node, simulation: Simulation, *, publish_clock: bool) -> None:
        """Make the publishers on `node`; without `publish_clock` somebody else keeps the graph's time."""
        self.show(simulation)
        self._imu = _publisher(node, Imu, names.IMU)
        self._joint_states = _publisher(node, JointState, names.JOINT_STATES)
        self._tendon_states = _publisher(node, TendonStates, names.TENDON_STATES)
        self._load_cell = _publisher(node, WrenchStamped, names.LOAD_CELL)
        self._manifold = _publisher(node, FluidPressure, names.MANIFOLD_PRESSURE)
        self._pressures = {
            channel: _publisher(node, FluidPressure, topic) for channel, topic in names.PRESSURES.items()
        }
        self._clock = _publisher(node, Clock, names.CLOCK) if publish_clock else None
        self._publish: dict[Output, Callable[[int], None]] = {
            Output.IMU: self._publish_imu,
            Output.PRESSURES: self._publish_pressures,
            Output.JOINT_STATES: self._publish_joint_states,
            Output.TENDON_STATES: self._publish_tendon_states,
            Output.LOAD_CELL: self._publish_load_cell,
        }

    @property
    def broken_tendons(self) -> tuple[str, ...]:
        """Names of the tendons that were broken when last looked at."""
        return self._broken_tendons

    def show(self, simulation: Simulation) -> None:
        """Sample this simulation from now on."""
        self._simulation = simulation
        tendons = simulation.tendons()
        self._messages = OutgoingMessages([tendon.name for tendon in tendons])
        self._broken_tendons = tuple(tendon.name for tendon in tendons if tendon.broken)

    def publish(self, tick: Tick) -> None:
        """Publish a tick's outputs, then its /clock.

        Raises:
            NotFiniteError: the simulation gave NaN or infinity; neither it nor the tick's /clock was published.

        """
        for output in tick.outputs:
            self._publish[output](tick.time_ns)
        self.publish_clock(tick.time_ns)

    def publish_clock(self, time_ns: int) -> None:
        """Publish /clock alone."""
        if self._clock is not None:
            self._clock.publish(self._messages.clock(time_ns))

    def _publish_imu(self, time_ns: int) -> None:
        self._imu.publish(self._messages.imu(time_ns, self._simulation.imu()))

    def _publish_pressures(self, time_ns: int) -> None:
        for channel, pressure_pa in self._simulation.channel_pressures_pa().items():
            self._pressures[channel].publish(self._messages.pressure(time_ns, pressure_pa))
        self._manifold.publish(self._messages.pressure(time_ns, self._simulation.manifold_pressure_pa()))

    def _publish_joint_states(self, time_ns: int) -> None:
        positions, velocities = self._simulation.joint_positions(), self._simulation.joint_velocities()
        self._joint_states.publish(self._messages.joint_states(time_ns, positions, velocities))

    def _publish_tendon_states(self, time_ns: int) -> None:
        tendons = self._simulation.tendons()
        self._tendon_states.publish(self._messages.tendon_states(time_ns, tendons))
        self._broken_tendons = tuple(tendon.name for tendon in tendons if tendon.broken)

    def _publish_load_cell(self, time_ns: int) -> None:
        self._load_cell.publish(self._messages.wrench(time_ns, self._simulation.load_cell_force_n()))


def _publisher(node: Node, message_type: type, topic: names.Topic) -> Publisher:
    return node.create_publisher(message_type, topic.name, publisher_qos(topic))
