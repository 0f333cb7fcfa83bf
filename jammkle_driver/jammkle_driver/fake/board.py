"""The board between a driver and a plant: it follows commands, and lets go by itself where the firmware would."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from jammkle_common.names import CHANNELS
from jammkle_driver.core.hardware import LinkState, LinkStatus, ResetCause, SafeCause, released
from jammkle_driver.core.registers import default_watchdog_s
from jammkle_driver.fake.faults import LinkFault

if TYPE_CHECKING:
    from jammkle_driver.core.hardware import ActuatorCommand
    from jammkle_driver.fake.plant import Plant

WATCHDOG_S = default_watchdog_s()
"""Silence of the host after which the board lets go, s."""

STEP_S = 0.01
"""Time by which a board and its plant go on at once, s."""

_SUPPLY_V, _SAGGED_V = 12.0, 8.0


class FakeBoard:
    """Outputs, host watchdog, latches and the link to them.

    Attributes:
        plant: What is behind the pins.
        link: What the driver knows of the board.
        driven: What the outputs do.
        noise_share: Share of telegrams whose check sum is wrong, 0 to 1, for who exchanges them.

    """

    def __init__(self, plant: Plant) -> None:
        """Make one that is connected and drives nothing."""
        self.plant = plant
        self.link = LinkStatus(LinkState.CONNECTED, supply_v=_SUPPLY_V, starts=1, connects=1)
        self.noise_share = 0.0
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
        for _ in range(round(duration_s / STEP_S)):
            self.plant.advance(STEP_S)
            self._silent_s += STEP_S
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

    def inject(self, fault: LinkFault, size: float = 0.0) -> None:
        """Let something fail; what `size` means stands at the fault."""
        if fault is LinkFault.UNPLUGGED:
            self.unplug()
        elif fault is LinkFault.REBOOTED:
            self.reboot()
        elif fault is LinkFault.BROWN_OUT:
            self.sag()
        else:
            self.noise_share = size

    def heal(self) -> None:
        """Repair everything; what is latched stays until it is acknowledged."""
        self.plant.heal()
        self.noise_share = 0.0
        self.plug()

    def unplug(self) -> None:
        """Pull the cable."""
        self.link = replace(self.link, state=LinkState.LOST, detail="no such device")

    def plug(self) -> None:
        """Put the cable in again, with a supply that is well."""
        back = int(self.link.state is not LinkState.CONNECTED)
        connects = self.link.connects + back
        self.link = replace(self.link, state=LinkState.CONNECTED, detail="", supply_v=_SUPPLY_V, connects=connects)

    def reboot(self, cause: ResetCause = ResetCause.EXTERNAL) -> None:
        """Start anew."""
        self._latch(SafeCause.RESET)
        self.link = replace(self.link, reset_cause=cause, starts=self.link.starts + 1)

    def sag(self) -> None:
        """Let the supply fall below what the board works with."""
        self._latch(SafeCause.SUPPLY_LOW)
        self.link = replace(self.link, supply_v=_SAGGED_V)

    def _latch(self, cause: SafeCause) -> None:
        self._drive(released(CHANNELS), 0.0)
        self.link = replace(self.link, latched=self.link.latched | {cause})

    def _drive(self, command: ActuatorCommand, late_s: float) -> None:
        self.driven = command
        self.plant.command(command.solenoids, command.pump_duty, late_s)
