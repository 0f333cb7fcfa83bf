"""Controller and driver of one ankle around a simulated one, in one process and without ROS.

The cores are those of the nodes, called when and in the order in which they are on a graph in lockstep: what the
simulation publishes is dealt with at the next tick of /clock, what controller and driver send each other at the tick
after that. It is deterministic, and as fast as the simulation lets it be.
"""

from __future__ import annotations

import struct
from functools import partial
from types import SimpleNamespace
from typing import TYPE_CHECKING

from jammkle_common.constants import NANOSECONDS_PER_SECOND
from jammkle_common.names import CHANNELS, JAM_COMMAND, JOINT_STATES
from jammkle_controller.core.controller import AnkleController
from jammkle_controller.core.imu import ImuSample
from jammkle_controller.core.inputs import Input
from jammkle_controller.core.landing import Stored
from jammkle_controller.core.reading import DriverReport, Received, received_in
from jammkle_controller.core.slip import BodyTwist
from jammkle_driver.core.driver import Driver
from jammkle_driver.core.hardware import MANIFOLD, ActuatorCommand, LinkState, LinkStatus, PressureSample
from jammkle_driver.core.requests import SetPoint
from jammkle_driver.core.watch import Instant
from jammkle_driver.parameters import TICK_PERIOD_S, DriverParameters
from jammkle_sim.parameters import RobotParameters

if TYPE_CHECKING:
    from collections.abc import Callable

    from jammkle_controller.core.controller import Reaction
    from jammkle_controller.core.events import ContactEvent
    from jammkle_controller.core.leg import Leg
    from jammkle_controller.parameters import ControllerParameters
    from jammkle_sim.rigs.simulation import Ankle, BaseSample

STATE_PERIOD_S = 0.01
"""Time between two readings of pressures, joints and the gait's plan, s, as on the graph of a robot."""
DRIVER_STATE_PERIOD_S = 1.0
"""How often jam_state is repeated, s."""
ROBOT_TICK_RATE_HZ = RobotParameters().clock_rate_hz
"""Ticks of /clock per second in the graph of a robot; in that of a rig there is one for each sample."""


_CONNECTED = LinkStatus(LinkState.CONNECTED, "a simulation in this process")


class AnkleLoop:
    """Controller and driver of one simulated ankle. They receive what they would on the graph, at the same times."""

    def __init__(
        self,
        ankle: Ankle,
        controller: ControllerParameters,
        driver: DriverParameters | None = None,
        body: Callable[[], BaseSample] | None = None,
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
        self._parameters, self._leg = controller, leg
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
        self._tick_period_s = 1.0 / tick_rate_hz
        self._stepped_ns = self._ticked_ns = 0
        """Time of the last step, and of the last tick before this one."""
        now = _instant(0)
        self.driver.activate(now)
        self._settle(now, 0)

    def step(self, time_s: float) -> ImuSample:
        """Feel at a time, s, which must rise, and drive if /clock ticks then; return what the IMU read."""
        time_ns = round(time_s * NANOSECONDS_PER_SECOND)
        states = _passed(STATE_PERIOD_S, self._stepped_ns, time_ns)
        if states:
            self._sensed += self._reported(time_ns)
            if not self._acknowledged_lately:
                self._acknowledge(time_ns)
            self._acknowledged_lately = False
            pressures = {MANIFOLD: self.ankle.manifold_pressure_pa(), **self.ankle.channel_pressures_pa()}
            self._measured.append((time_ns, pressures))
        reading = self.ankle.imu()
        sample = ImuSample(time_ns, *reading.specific_force_m_s2, *reading.angular_velocity_rad_s)
        self._sensed.append(partial(self.controller.update, sample))
        if states and self._body is not None:
            moves = self._body()
            twist = BodyTwist(time_ns, moves.linear_m_s, moves.angular_rad_s)
            self._sensed.append(partial(self.controller.take, Received(time_ns, twist)))
        if _passed(self._tick_period_s, self._stepped_ns, time_ns):
            said, self._said = self._said, None
            asked, self._asked = self._asked, []
            self._control(time_ns, said)
            self._drive(time_ns, asked)
            self._ticked_ns = time_ns
        self._stepped_ns = time_ns
        return sample

    def _control(self, time_ns: int, said: Stored | None) -> None:
        """Let the controller deal with what the driver said at an earlier tick, and with what was felt since."""
        if said is not None:
            self.controller.on_driver(DriverReport(said, by_stream=False))
        for take in self._sensed:
            reaction = take()
            if reaction is not None:
                self.events += reaction.events
                if reaction.changed:
                    self._command(time_ns)
        self._sensed.clear()
        if _passed(1.0 / self._parameters.command_rate_hz, self._ticked_ns, time_ns):
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
        if _passed(TICK_PERIOD_S, self._ticked_ns, time_ns):
            self.driver.tick(now, 0)
            self.driver.look_at_link(_CONNECTED, now)
            self._settle(now, time_ns)
        if _passed(DRIVER_STATE_PERIOD_S, self._ticked_ns, time_ns):
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
        received = received_in(self._joint_states(time_ns), JOINT_STATES, time_ns, self._parameters, self._leg)
        planned = self.ankle.plan()
        if planned is not None:
            received.append(Received(time_ns, Input.PLANNED_CONTACT, float(planned.bears)))
            if planned.phase is not None:
                received.append(Received(time_ns, Input.GAIT_PHASE, _as_float32(planned.phase)))
        return [partial(self.controller.take, each) for each in received]

    def _joint_states(self, time_ns: int) -> SimpleNamespace:
        """Return what the simulation publishes of the joints."""
        positions, rates = self.ankle.joint_positions(), self.ankle.joint_velocities()
        efforts = self.ankle.joint_efforts()
        seconds, nanoseconds = divmod(time_ns, NANOSECONDS_PER_SECOND)
        return SimpleNamespace(
            header=SimpleNamespace(stamp=SimpleNamespace(sec=seconds, nanosec=nanoseconds)),
            name=[*positions],
            position=[*positions.values()],
            velocity=[rates.get(joint, 0.0) for joint in positions],
            effort=[] if efforts is None else [efforts.get(joint, 0.0) for joint in positions],
        )


def _passed(period_s: float, since_ns: int, time_ns: int) -> bool:
    """Whether a multiple of a period lies after one time and up to another, as `LockstepNode` goes by."""
    period_ns = round(period_s * NANOSECONDS_PER_SECOND)
    return time_ns // period_ns > since_ns // period_ns


def _instant(time_ns: int) -> Instant:
    return Instant(time_ns / NANOSECONDS_PER_SECOND, time_ns / NANOSECONDS_PER_SECOND)


def _as_float32(value: float) -> float:
    """Return what is left of a number in a std_msgs/Float32."""
    rounded: float = struct.unpack("f", struct.pack("f", value))[0]
    return rounded
