"""The board between a driver and a plant: it follows commands, and lets go by itself where the firmware would."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from jammkle_driver.core.hardware import LinkState, LinkStatus, ResetCause, SafeCause, released
from jammkle_driver.core.registers import default_watchdog_s
from jammkle_graph.names import CHANNELS

if TYPE_CHECKING:
    from jammkle_driver.core.hardware import ActuatorCommand
    from jammkle_driver.fake.plant import Plant

WATCHDOG_S = default_watchdog_s()
"""Silence of the host after which the board lets go, s."""

_STEP_S = 0.01


class FakeBoard:
    """Outputs, host watchdog, latches and the link to them.

    Attributes:
        plant: What is behind the pins.
        link: What the driver knows of the board.
        driven: What the outputs do.

    """

    def __init__(self, plant: Plant) -> None:
        """Make one that is connected and drives nothing."""
        self.plant = plant
        self.link = LinkStatus(LinkState.CONNECTED)
        self.driven: ActuatorCommand = released(CHANNELS)
        self._silent_s = 0.0

    def hear(self, command: ActuatorCommand, late_s: float = 0.0) -> None:
        """Take a command, which is a sign of life; latched, the board takes none that jams.

        Args:
            command: What the outputs shall do.
            late_s: How much later they do it, s.

        """
        self._silent_s = 0.0
        if command != self.driven and not (self.link.latched and any(command.solenoids.values())):
            self._drive(command, late_s)

    def advance(self, duration_s: float) -> None:
        """Let time pass, and let go once nothing was heard for `WATCHDOG_S`."""
        for _ in range(round(duration_s / _STEP_S)):
            self.plant.advance(_STEP_S)
            self._silent_s += _STEP_S
            if self._silent_s >= WATCHDOG_S and self.driven != released(CHANNELS):
                self._latch(SafeCause.HOST_SILENT)

    def count(self, exchanges: int, crc_errors: int) -> None:
        """Count telegrams that were answered, and those with a wrong check sum."""
        self.link = replace(
            self.link, exchanges=self.link.exchanges + exchanges, crc_errors=self.link.crc_errors + crc_errors
        )

    def acknowledge(self) -> None:
        """Take jams again."""
        self.link = replace(self.link, latched=frozenset())

    def unplug(self) -> None:
        """Pull the cable."""
        self.link = replace(self.link, state=LinkState.LOST, detail="no such device")

    def plug(self) -> None:
        """Put the cable in again."""
        self.link = replace(self.link, state=LinkState.CONNECTED, detail="")

    def reboot(self, cause: ResetCause = ResetCause.EXTERNAL) -> None:
        """Start anew."""
        self._latch(SafeCause.RESET)
        self.link = replace(self.link, reset_cause=cause, starts=self.link.starts + 1)

    def sag(self) -> None:
        """Let the supply fall below what the board works with."""
        self._latch(SafeCause.SUPPLY_LOW)
        self.link = replace(self.link, supply_v=3.9)

    def _latch(self, cause: SafeCause) -> None:
        self._drive(released(CHANNELS), 0.0)
        self.link = replace(self.link, latched=self.link.latched | {cause})

    def _drive(self, command: ActuatorCommand, late_s: float) -> None:
        self.driven = command
        self.plant.command(command.solenoids, command.pump_duty, late_s)
