"""Controller and driver of one ankle around a simulated one, in one process and without ROS.

The cores are those of the nodes, called in the order of the graph: joints, gait, pressures, IMU, set points,
actuators. It is deterministic, and as fast as the simulation lets it be.
"""

from __future__ import annotations

import math
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
from jammkle_driver.core.hardware import MANIFOLD, PressureSample
from jammkle_driver.core.requests import SetPoint
from jammkle_driver.core.watchdog import Instant
from jammkle_driver.parameters import TICK_PERIOD_S, DriverParameters

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from jammkle_controller.core.events import ContactEvent
    from jammkle_controller.core.leg import Leg
    from jammkle_controller.parameters import ControllerParameters

STATE_PERIOD_S = 0.01
"""Time between two readings of pressures, joints and the gait's plan, s, as on the graph of a robot."""


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


class _Every:
    """Tells when something periodic is due: on a grid, however the times of the steps are rounded."""

    _ROUNDING_S = 1e-9

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self._next_s = 0.0

    def due(self, time_s: float) -> bool:
        """Whether it is due at a time, s; if it is, the next is a period later."""
        if time_s < self._next_s - self._ROUNDING_S:
            return False
        self._next_s = max(self._next_s, time_s - self._period_s) + self._period_s
        return True


class AnkleLoop:
    """Controller and driver of one simulated ankle. The controller receives what it would on the graph."""

    def __init__(
        self,
        ankle: SimulatedAnkle,
        controller: ControllerParameters,
        driver: DriverParameters | None = None,
        body: Callable[[], BodyMotion] | None = None,
        leg: Leg | None = None,
    ) -> None:
        """Start both, at time 0.

        Args:
            ankle: What is felt and driven.
            controller: Parameters of the controller.
            driver: Parameters of the driver; none: its defaults.
            body: Tells how the robot's body moves, for a controller that receives odometry: one without error.
            leg: The leg above the ankle, for efforts and odometry.

        """
        self.ankle = ankle
        self.controller = AnkleController(controller, leg=leg)
        self._leg = (controller.hip_joint, controller.knee_joint) if controller.use_efforts else None
        self._above = (leg.abduction if leg else "", controller.hip_joint, controller.knee_joint)
        self._body = body if controller.use_odometry else None
        self.driver = Driver(CHANNELS, (driver or DriverParameters()).settings())
        self.driver.activate(_instant(0.0))
        self.events: list[ContactEvent] = []
        self._standing: tuple[object, ...] = ()
        self._reported_s = -math.inf
        self._states = _Every(STATE_PERIOD_S)
        self._ticks = _Every(TICK_PERIOD_S)
        self._commands = _Every(1.0 / controller.command_rate_hz)

    def sample(self, time_s: float) -> ImuSample:
        """Return the IMU's reading as a sample of this time, s."""
        reading = self.ankle.imu()
        time_ns = round(time_s * NANOSECONDS_PER_SECOND)
        return ImuSample(time_ns, *reading.specific_force_m_s2, *reading.angular_velocity_rad_s)

    def step(self, time_s: float) -> ImuSample:
        """Feel and drive at a time, s, which must rise; return what the IMU read."""
        now = _instant(time_s)
        before_pa = self.controller.set_points_pa
        if self._states.due(time_s):
            for received in self._reported(time_s):
                self.events += feed(self.controller, received).events
            pressures = {**self.ankle.channel_pressures_pa(), MANIFOLD: self.ankle.manifold_pressure_pa()}
            for place, pressure_pa in pressures.items():
                self.driver.measure(PressureSample(place, pressure_pa, time_s), now)
                self._report_driver(time_s)
        sample = self.sample(time_s)
        self.events += self.controller.update(sample).events
        # The repeats go on at their own times beside what is said on change, as the node's timer does.
        if self._commands.due(time_s) or self.controller.set_points_pa != before_pa:
            set_points = [SetPoint(channel, vacuum_pa) for channel, vacuum_pa in self.controller.set_points_pa.items()]
            self.driver.follow(set_points, now, JAM_COMMAND.name)
        if self._ticks.due(time_s):
            self.driver.tick(now)
        self._report_driver(time_s)
        command = self.driver.command
        self.ankle.set_pump_duty(command.pump_duty)
        for channel, energised in command.solenoids.items():
            self.ankle.set_solenoid(channel, energised)
        return sample

    def _report_driver(self, time_s: float) -> None:
        """Let the controller receive what the driver says on a change, and again each second, of its air."""
        standing = self.driver.standing
        if standing == self._standing and time_s - self._reported_s < 1.0:
            return
        self._standing, self._reported_s = standing, time_s
        status = self.driver.status
        self.controller.on_driver(Stored(max(status.manifold_vacuum_pa or 0.0, 0.0), status.reservoir_volume_m3))

    def _reported(self, time_s: float) -> list[Received]:
        """Return what joints and gait report, in the order of the graph."""
        time_ns = round(time_s * NANOSECONDS_PER_SECOND)
        roll_rad = self.ankle.joint_positions().get(ANKLE_JOINTS[0])
        if roll_rad is not None:
            self.controller.inputs.on_pitch(self.ankle.joint_positions()[ANKLE_JOINTS[1]])
        reported = [] if roll_rad is None else [Received(time_ns, Input.JOINTS, roll_rad)]
        if isinstance(self.ankle, WithEfforts) and set(self._above[1:]) <= self.ankle.joint_positions().keys():
            roll, pitch, _ = ANKLE_JOINTS
            angles, rates = self.ankle.joint_positions(), self.ankle.joint_velocities()
            shank_rad_s = sum(rates[joint] for joint in self._above[1:])
            reading = AnkleReading(angles[pitch], angles[roll], rates[pitch], rates[roll], shank_rad_s)
            reported.append(Received(time_ns, reading))
        if self._leg is not None and isinstance(self.ankle, WithEfforts):
            columns = (self.ankle.joint_positions(), self.ankle.joint_velocities(), self.ankle.joint_efforts())
            if set(self._leg) <= columns[0].keys():
                reported.append(
                    Received(time_ns, LegReading(*(column[joint] for column in columns for joint in self._leg)))
                )
        if self._body is not None and isinstance(self.ankle, WithEfforts):
            moves = self._body()
            reported.append(Received(time_ns, self._pose(self.ankle)))
            reported.append(Received(time_ns, BodyTwist(time_ns, moves.linear_m_s, moves.angular_rad_s)))
        planned = self.ankle.plan() if isinstance(self.ankle, WithPlan) else None
        if planned is not None:
            reported.append(Received(time_ns, Input.PLANNED_CONTACT, float(planned.bears)))
            if planned.phase is not None:
                reported.append(Received(time_ns, Input.GAIT_PHASE, planned.phase))
        return reported

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


def _instant(time_s: float) -> Instant:
    return Instant(time_s, time_s)
