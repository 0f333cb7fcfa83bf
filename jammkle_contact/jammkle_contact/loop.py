"""Controller and driver of one ankle around a simulated one, in one process and without ROS.

The cores are those of the nodes, called in the order in which the graph calls them: pressures, IMU, wish, actuators. It
is deterministic, and as fast as the simulation lets it be.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from jammkle_contact.replay import new_controller
from jammkle_controller.core.imu import ImuSample
from jammkle_driver.core.driver import Driver
from jammkle_driver.core.hardware import MANIFOLD, PressureSample
from jammkle_driver.core.requests import Wish
from jammkle_driver.core.watchdog import Instant
from jammkle_driver.parameters import TICK_PERIOD_S, DriverParameters
from jammkle_graph.constants import NANOSECONDS_PER_SECOND
from jammkle_graph.names import CHANNELS, JAM_COMMAND

if TYPE_CHECKING:
    from collections.abc import Mapping

    from jammkle_controller.core.events import ContactEvent
    from jammkle_controller.parameters import ControllerParameters

PRESSURE_PERIOD_S = 0.01
"""Time between two readings of the pressures, s, as on the graph."""


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

    def set_pump_duty(self, duty: float) -> None:
        """Set the pump's duty, 0 to 1."""

    def set_solenoid(self, channel: str, energised: bool) -> None:  # noqa: FBT001 - the state of a coil, as Bool is
        """Energise or release a channel's solenoid."""


class AnkleLoop:
    """Controller and driver of one simulated ankle."""

    def __init__(
        self, ankle: SimulatedAnkle, controller: ControllerParameters, driver: DriverParameters | None = None
    ) -> None:
        """Start both, at time 0.

        Args:
            ankle: What is felt and driven.
            controller: Parameters of the controller.
            driver: Parameters of the driver; none: its defaults.

        """
        self.ankle = ankle
        self.controller = new_controller(controller)
        self.driver = Driver(CHANNELS, (driver or DriverParameters()).settings())
        self.driver.activate(_instant(0.0))
        self.events: list[ContactEvent] = []
        self._command_period_s = 1.0 / controller.command_rate_hz
        self._next_pressure_s = self._next_tick_s = self._next_command_s = 0.0

    def sample(self, time_s: float) -> ImuSample:
        """Return the IMU's reading as a sample of this time, s."""
        reading = self.ankle.imu()
        time_ns = round(time_s * NANOSECONDS_PER_SECOND)
        return ImuSample(time_ns, *reading.specific_force_m_s2, *reading.angular_velocity_rad_s)

    def step(self, time_s: float) -> ImuSample:
        """Feel and drive at a time, s, which must rise; return what the IMU read."""
        now = _instant(time_s)
        if time_s >= self._next_pressure_s:
            self._next_pressure_s = time_s + PRESSURE_PERIOD_S
            pressures = {**self.ankle.channel_pressures_pa(), MANIFOLD: self.ankle.manifold_pressure_pa()}
            for place, pressure_pa in pressures.items():
                self.driver.measure(PressureSample(place, pressure_pa, time_s), now)
        sample = self.sample(time_s)
        reaction = self.controller.update(sample)
        self.events += reaction.events
        if reaction.wish_changed or time_s >= self._next_command_s:
            self._next_command_s = time_s + self._command_period_s
            wishes = [Wish(channel, vacuum_pa) for channel, vacuum_pa in self.controller.wish.items()]
            self.driver.follow(wishes, now, JAM_COMMAND.name)
        if time_s >= self._next_tick_s:
            self._next_tick_s = time_s + TICK_PERIOD_S
            self.driver.tick(now)
        command = self.driver.command
        self.ankle.set_pump_duty(command.pump_duty)
        for channel, energised in command.solenoids.items():
            self.ankle.set_solenoid(channel, energised)
        return sample


def _instant(time_s: float) -> Instant:
    return Instant(time_s, time_s, clock_runs=True)
