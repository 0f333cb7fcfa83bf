"""Controller and driver of one ankle around a simulated one, in one process and without ROS.

The cores are those of the nodes, called when and in the order in which they are on a graph in lockstep: what the
simulation publishes is dealt with at the next tick of /clock, what controller and driver send each other at the tick
after that. It is deterministic, and as fast as the simulation lets it be.
"""

from __future__ import annotations

import math
import struct
from functools import partial
from typing import TYPE_CHECKING, Protocol, runtime_checkable

from jammkle_common.constants import NANOSECONDS_PER_SECOND
from jammkle_common.names import ANKLE_JOINTS, CHANNELS, JAM_COMMAND
from jammkle_controller.core.ankle_contact import AnkleReading
from jammkle_controller.core.controller import AnkleController
from jammkle_controller.core.imu import ImuSample
from jammkle_controller.core.inputs import Input
from jammkle_controller.core.landing import Stored
from jammkle_controller.core.leg import BodyTwist, LegPose, LegReading
from jammkle_controller.recordings import Received, feed
from jammkle_driver.core.driver import Driver
from jammkle_driver.core.hardware import MANIFOLD, ActuatorCommand, LinkState, LinkStatus, PressureSample
from jammkle_driver.core.requests import SetPoint
from jammkle_driver.core.watch import Instant
from jammkle_driver.parameters import TICK_PERIOD_S, DriverParameters
from jammkle_sim.parameters import RobotParameters

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from jammkle_controller.core.controller import Reaction
    from jammkle_controller.core.events import ContactEvent
    from jammkle_controller.core.leg import Leg
    from jammkle_controller.parameters import ControllerParameters

STATE_PERIOD_S = 0.01
"""Time between two readings of pressures, joints and the gait's plan, s, as on the graph of a robot."""
DRIVER_STATE_PERIOD_S = 1.0
"""How often jam_state is repeated, s."""
ROBOT_TICK_RATE_HZ = RobotParameters().clock_rate_hz
"""Ticks of /clock per second in the graph of a robot; in that of a rig there is one for each sample."""


class ImuReading(Protocol):
    """What an IMU of the simulation gives."""

    @property
    def specific_force_m_s2(self) -> tuple[float, float, float]:
        """Specific force, m/s^2."""

    @property
    def angular_velocity_rad_s(self) -> tuple[float, float, float]:
        """Angular velocity, rad/s."""


class SimulatedAnkle(Protocol):
    """An ankle of a simulation: a rig's, or one of a robot's."""

    def imu(self) -> ImuReading:
        """Return the latest reading."""

    def channel_pressures_pa(self) -> Mapping[str, float]:
        """Return the absolute pressure per channel, Pa."""

    def manifold_pressure_pa(self) -> float:
        """Return the absolute pressure in the manifold, Pa."""

    def joint_positions(self) -> Mapping[str, float]:
        """Return angles, rad, and slides, m."""

    def set_pump_duty(self, duty: float) -> None:
        """Set the pump's duty, 0 to 1."""

    def set_solenoid(self, channel: str, energised: bool) -> None:  # noqa: FBT001 - the state of a coil, as Bool is
        """Energise or release a channel's solenoid."""


class BodyMotion(Protocol):
    """How the body of a robot moves."""

    @property
    def linear_m_s(self) -> tuple[float, float, float]:
        """Velocity of its origin, m/s, in its own frame."""

    @property
    def angular_rad_s(self) -> tuple[float, float, float]:
        """Angular velocity, rad/s, in its own frame."""


class PlannedStep(Protocol):
    """What a gait plans of one foot now."""

    @property
    def bears(self) -> bool:
        """Whether it has the foot on the ground."""

    @property
    def phase(self) -> float | None:
        """From 0 at touch-down to 1 at the next; None: it has not begun to step."""


@runtime_checkable
class WithEfforts(Protocol):
    """An ankle of a robot, whose leg has servos."""

    def joint_velocities(self) -> Mapping[str, float]:
        """Return rates, rad/s and m/s."""

    def joint_efforts(self) -> Mapping[str, float]:
        """Return efforts of the servos, N m and N."""


@runtime_checkable
class WithPlan(Protocol):
    """An ankle of a robot, which may walk."""

    def plan(self) -> PlannedStep | None:
        """Return what the gait plans of the foot; None: there is no gait."""


_CONNECTED = LinkStatus(LinkState.CONNECTED, "a simulation in this process")


class _Regular:
    """Tells whether a multiple of a period has been passed, as a node in lockstep does."""

    def __init__(self, period_s: float) -> None:
        self._period_ns = round(period_s * NANOSECONDS_PER_SECOND)
        self._last_ns = 0

    def due(self, time_ns: int) -> bool:
        """Whether it is due at a time, ns, later than that of the call before."""
        last_ns, self._last_ns = self._last_ns, time_ns
        return time_ns // self._period_ns > last_ns // self._period_ns


class AnkleLoop:
    """Controller and driver of one simulated ankle. They receive what they would on the graph, at the same times."""

    def __init__(
        self,
        ankle: SimulatedAnkle,
        controller: ControllerParameters,
        driver: DriverParameters | None = None,
        body: Callable[[], BodyMotion] | None = None,
        leg: Leg | None = None,
        tick_rate_hz: int = ROBOT_TICK_RATE_HZ,
    ) -> None:
        """Start both, at time 0.

        Args:
            ankle: What is felt and driven.
            controller: Parameters of the controller.
            driver: Parameters of the driver; none: its defaults.
            body: Tells how the robot's body moves, for a controller that receives odometry: one without error.
            leg: The leg above the ankle, for efforts and odometry.
            tick_rate_hz: Of /clock: nodes in lockstep work at its ticks, and a sample between two waits for the next.

        """
        self.ankle = ankle
        self.controller = AnkleController(controller, leg=leg)
        self._leg = (controller.hip_joint, controller.knee_joint) if controller.use_efforts else None
        self._above = (leg.abduction if leg else "", controller.hip_joint, controller.knee_joint)
        self._body = body if controller.use_odometry else None
        self.driver = Driver(CHANNELS, driver or DriverParameters())
        self.events: list[ContactEvent] = []
        self.commands: list[tuple[int, dict[str, float]]] = []
        """Every jam_command: its stamp, ns, and the vacuum by channel, Pa."""
        self.driven: list[tuple[int, ActuatorCommand]] = []
        """What pump and solenoids were set to, on every change, and when, ns."""
        self._sensed: list[Callable[[], Reaction | None]] = []
        self._measured: list[tuple[int, dict[str, float]]] = []
        self._asked: list[dict[str, float]] = []
        self._said: Stored | None = None
        self._standing: tuple[object, ...] = ()
        self._obeyed = self.driver.command
        self._acknowledged: list[tuple[int, ActuatorCommand]] = [(0, self._obeyed)]
        self._acknowledged_lately = True
        self._states, self._ticks = _Regular(STATE_PERIOD_S), _Regular(1.0 / tick_rate_hz)
        self._commands, self._driver_ticks, self._driver_states = (
            _Regular(period_s) for period_s in (1.0 / controller.command_rate_hz, TICK_PERIOD_S, DRIVER_STATE_PERIOD_S)
        )
        now = _instant(0)
        self.driver.activate(now)
        self._settle(now, 0)

    def sample(self, time_s: float) -> ImuSample:
        """Return the IMU's reading as a sample of this time, s."""
        reading = self.ankle.imu()
        time_ns = round(time_s * NANOSECONDS_PER_SECOND)
        return ImuSample(time_ns, *reading.specific_force_m_s2, *reading.angular_velocity_rad_s)

    def step(self, time_s: float) -> ImuSample:
        """Feel at a time, s, which must rise, and drive if /clock ticks then; return what the IMU read."""
        time_ns = round(time_s * NANOSECONDS_PER_SECOND)
        states = self._states.due(time_ns)
        if states:
            self._sensed += self._reported(time_ns)
            if not self._acknowledged_lately:
                self._acknowledge(time_ns)
            self._acknowledged_lately = False
            pressures = {MANIFOLD: self.ankle.manifold_pressure_pa(), **self.ankle.channel_pressures_pa()}
            self._measured.append((time_ns, pressures))
        sample = self.sample(time_s)
        self._sensed.append(partial(self.controller.update, sample))
        if states and self._body is not None and isinstance(self.ankle, WithEfforts):
            moves = self._body()
            twist = BodyTwist(time_ns, moves.linear_m_s, moves.angular_rad_s)
            self._sensed.append(partial(self.controller.on_odometry, twist, time_ns))
        if self._ticks.due(time_ns):
            said, self._said = self._said, None
            asked, self._asked = self._asked, []
            self._control(time_ns, said)
            self._drive(time_ns, asked)
        return sample

    def _control(self, time_ns: int, said: Stored | None) -> None:
        """Let the controller deal with what the driver said at an earlier tick, and with what was felt since."""
        if said is not None:
            self.controller.on_driver(said)
        for take in self._sensed:
            reaction = take()
            if reaction is not None:
                self.events += reaction.events
                if reaction.changed:
                    self._command(time_ns)
        self._sensed.clear()
        if self._commands.due(time_ns):
            self._command(time_ns)

    def _command(self, time_ns: int) -> None:
        set_points_pa = dict(self.controller.set_points_pa)
        self.commands.append((time_ns, set_points_pa))
        self._asked.append(set_points_pa)

    def _drive(self, time_ns: int, asked: list[dict[str, float]]) -> None:
        """Let the driver deal with what was asked at an earlier tick, and with what was measured since."""
        now = _instant(time_ns)
        for set_points_pa in asked:
            set_points = [SetPoint(channel, vacuum_pa) for channel, vacuum_pa in set_points_pa.items()]
            self.driver.follow(set_points, now, JAM_COMMAND.name)
            self._settle(now, time_ns)
        for at_ns, command in self._acknowledged:
            self.driver.take_driven(command, at_ns / NANOSECONDS_PER_SECOND)
        self._acknowledged.clear()
        for at_ns, pressures in self._measured:
            for place, pressure_pa in pressures.items():
                self.driver.look_at_link(_CONNECTED, now)
                self.driver.measure(PressureSample(place, pressure_pa, at_ns / NANOSECONDS_PER_SECOND), now)
                self._settle(now, time_ns)
        self._measured.clear()
        if self._driver_ticks.due(time_ns):
            self.driver.tick(now, 0)
            self.driver.look_at_link(_CONNECTED, now)
            self._settle(now, time_ns)
        if self._driver_states.due(time_ns):
            self._say()
        if self.driven and self.driven[-1][0] == time_ns:
            self._acknowledge(time_ns)

    def _settle(self, now: Instant, time_ns: int) -> None:
        """Do what the driver wants, and let it say what has changed."""
        self.driver.ankle.note_command(now)
        wanted = self.driver.command
        command = ActuatorCommand(wanted.solenoids, _as_float32(wanted.pump_duty))
        if command != self._obeyed:
            self._obeyed = command
            self.driven.append((time_ns, command))
            self.ankle.set_pump_duty(command.pump_duty)
            for channel, energised in command.solenoids.items():
                self.ankle.set_solenoid(channel, energised)
        if self.driver.standing != self._standing:
            self._standing = self.driver.standing
            self._say()

    def _say(self) -> None:
        stored_pa = self.driver.ankle.manifold_vacuum_pa
        self._said = Stored(max(stored_pa or 0.0, 0.0), self.driver.parameters.reservoir_volume_m3)

    def _acknowledge(self, time_ns: int) -> None:
        """Let the simulated board say what it does."""
        self._acknowledged.append((time_ns, self._obeyed))
        self._acknowledged_lately = True

    def _reported(self, time_ns: int) -> list[Callable[[], Reaction | None]]:
        """Return what takes the reports of joints and gait, in the order of the graph."""
        positions = self.ankle.joint_positions()
        received: list[Received] = []
        taken: list[Callable[[], Reaction | None]] = []
        roll, pitch, _ = ANKLE_JOINTS
        if roll in positions:
            received.append(Received(time_ns, Input.JOINTS, positions[roll]))
            taken.append(partial(self.controller.inputs.on_pitch, positions[pitch]))
        if isinstance(self.ankle, WithEfforts) and set(self._above[1:]) <= positions.keys():
            rates = self.ankle.joint_velocities()
            shank_rad_s = rates[self._above[1]] + rates[self._above[2]]
            reading = AnkleReading(positions[pitch], positions[roll], rates[pitch], rates[roll], shank_rad_s)
            received.append(Received(time_ns, reading))
        if self._leg is not None and isinstance(self.ankle, WithEfforts) and set(self._leg) <= positions.keys():
            columns = (positions, self.ankle.joint_velocities(), self.ankle.joint_efforts())
            received.append(
                Received(time_ns, LegReading(*(column[joint] for column in columns for joint in self._leg)))
            )
        if self._body is not None and isinstance(self.ankle, WithEfforts):
            received.append(Received(time_ns, self._pose(self.ankle)))
        planned = self.ankle.plan() if isinstance(self.ankle, WithPlan) else None
        if planned is not None:
            received.append(Received(time_ns, Input.PLANNED_CONTACT, float(planned.bears)))
            if planned.phase is not None:
                received.append(Received(time_ns, Input.GAIT_PHASE, _as_float32(planned.phase)))
        return [*taken, *(partial(feed, self.controller, each) for each in received)]

    def _pose(self, ankle: WithEfforts) -> LegPose:
        """Return angles and rates from the body down; a leg without abduction has none."""
        roll, pitch, yaw = ANKLE_JOINTS
        missing = {self._above[0]: 0.0}
        columns = (self.ankle.joint_positions(), ankle.joint_velocities())
        return LegPose(
            *(
                column.get(joint, missing.get(joint, math.nan))
                for column in columns
                for joint in (*self._above, pitch, roll, yaw)
            )
        )


def _instant(time_ns: int) -> Instant:
    return Instant(time_ns / NANOSECONDS_PER_SECOND, time_ns / NANOSECONDS_PER_SECOND)


def _as_float32(value: float) -> float:
    """Return what is left of a number in a std_msgs/Float32."""
    rounded: float = struct.unpack("f", struct.pack("f", value))[0]
    return rounded
