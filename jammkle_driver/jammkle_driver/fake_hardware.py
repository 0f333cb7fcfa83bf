"""A fake ankle in process as hardware: a small plant, with faults by script; publishes what a board would."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from rclpy.clock import Clock
from rclpy.clock_type import ClockType

from jammkle_driver.conversions import seconds
from jammkle_driver.core.hardware import ActuatorCommand, LinkState, LinkStatus, SafeCause, released
from jammkle_driver.fake.board import WATCHDOG_S
from jammkle_driver.fake.plant import FakePlant
from jammkle_driver.fake.script import ScriptError, read_script
from jammkle_driver.measured import Measured
from jammkle_graph.constants import STANDARD_ATMOSPHERE_PA
from jammkle_graph.names import CHANNELS
from jammkle_graph.parameters import ParameterError

if TYPE_CHECKING:
    from jammkle_driver.hardware_choice import HardwareContext

_PERIOD_S = 0.01
"""Time between two readings, s, as of the simulation."""


class FakeHardware:
    """An ankle of plain numbers. Implements `core.hardware.Hardware`."""

    def __init__(self, context: HardwareContext) -> None:
        """Start the plant, vented.

        Raises:
            ParameterError: the script of faults cannot be read.

        """
        self._context = context
        given = context.parameters.fake_faults
        try:
            text = Path(given).read_text(encoding="utf-8") if given and Path(given).is_file() else given
            self._script = list(read_script(text))
        except (OSError, ScriptError) as error:
            msg = f"parameter 'fake_faults': {error}"
            raise ParameterError(msg) from error
        self._plant = FakePlant(CHANNELS, context.parameters.air(), STANDARD_ATMOSPHERE_PA)
        self._command = released(CHANNELS)
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._heard_s = seconds(self._steady.now())
        self._silent = False
        self._last_s = self._heard_s
        self._measured = Measured(context, self._plant.places)
        self._timer = context.node.create_timer(_PERIOD_S, self._advance, clock=self._steady)

    @property
    def plant(self) -> FakePlant:
        """The plant, for tests that let something fail."""
        return self._plant

    @property
    def link(self) -> LinkStatus:
        """Always connected; it lets go as a board does when the driver stood still."""
        latched = frozenset({SafeCause.HOST_SILENT}) if self._silent else frozenset()
        return LinkStatus(LinkState.CONNECTED, "fake ankle in process", latched=latched)

    def apply(self, command: ActuatorCommand) -> None:
        """Take a command, unless the fake board has let go."""
        now_s = seconds(self._steady.now())
        if now_s - self._heard_s > WATCHDOG_S and any(self._command.solenoids.values()):
            self._silent = True
            self._command = released(CHANNELS)
            self._plant.command(self._command.solenoids, 0.0)
        self._heard_s = now_s
        if not self._silent and command != self._command:
            self._command = command
            self._plant.command(command.solenoids, command.pump_duty)

    def acknowledge(self) -> None:
        """Take jams again."""
        self._silent = False

    def close(self) -> None:
        """Stop the plant."""
        self._context.node.destroy_timer(self._timer)
        self._measured.close()

    def _advance(self) -> None:
        now_s = seconds(self._steady.now())
        # What was not a whole step is left for the next time; a process that stood still stops the plant, too.
        self._last_s = max(self._last_s, now_s - WATCHDOG_S)
        before_s = self._plant.time_s
        self._plant.advance(now_s - self._last_s)
        self._last_s += self._plant.time_s - before_s
        while self._script and self._script[0].time_s <= self._plant.time_s:
            entry = self._script.pop(0)
            if entry.fault is None:
                self._plant.heal()
            else:
                self._plant.inject(entry.fault, entry.place, entry.size)
        self._measured.publish(self._plant.readings_pa(), self._command)
