"""How a board is wired: which coil or register is which pump, channel and sensor."""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from jammkle_driver.core.registers import register_list

if TYPE_CHECKING:
    from collections.abc import Mapping


class Firmware(enum.Enum):
    """Whose firmware the board has."""

    JAMMKLE = "jammkle"
    """The one of this project: watchdog, latched safe state, supply and counters are there."""
    OTHER = "other"
    """Any other Modbus server: coils and registers, and nothing that makes it safe."""


@dataclass(frozen=True)
class Solenoid:
    """One channel's solenoid: a coil. `inverted`: 0 energises."""

    coil: int
    inverted: bool = False

    def bit(self, *, energised: bool) -> bool:
        """Return what the coil must be."""
        return energised != self.inverted


@dataclass(frozen=True)
class Pump:
    """The pump: a holding register that takes a duty, or a coil that only switches.

    Attributes:
        register: Address of the holding register; None for a coil.
        coil: Address of the coil; None for a register.
        at_zero: Number in the register for duty 0.
        at_full: Number in the register for duty 1; below `at_zero` for a drive that runs faster with less.
        threshold: Duty above which a coil is on.
        inverted: For a coil: 0 runs the pump.

    """

    register: int | None = None
    coil: int | None = None
    at_zero: int = 0
    at_full: int = 1000
    threshold: float = 0.5
    inverted: bool = False

    def number(self, duty: float) -> int:
        """Return the register's number for a duty from 0 to 1."""
        return round(self.at_zero + (self.at_full - self.at_zero) * min(max(duty, 0.0), 1.0))

    def bit(self, duty: float) -> bool:
        """Return what the coil must be for a duty from 0 to 1."""
        return (duty > self.threshold) != self.inverted


@dataclass(frozen=True)
class Sensor:
    """One pressure sensor: a register, and the line from its number to Pa.

    Attributes:
        register: Address.
        table: `input` or `holding`.
        signed: Whether the number is a 16-bit two's complement.
        scale: Pa per step; negative for a sensor that counts down.
        offset_pa: Pa at number 0.
        vacuum: True if it measures vacuum below ambient, positive; False for absolute pressure.
        minimum: Number below which the sensor counts as broken.
        maximum: Number above which the sensor counts as broken.

    """

    register: int
    table: str = "input"
    signed: bool = False
    scale: float = 1.0
    offset_pa: float = 0.0
    vacuum: bool = False
    minimum: int = -0x8000
    maximum: int = 0xFFFF

    def pascals(self, number: int) -> float:
        """Return what the number stands for, Pa; NaN outside the limits, as a broken wire gives."""
        value = number - 0x10000 if self.signed and number >= 0x8000 else number  # noqa: PLR2004 - two's complement
        return self.offset_pa + self.scale * value if self.minimum <= value <= self.maximum else math.nan

    def absolute_pa(self, measured_pa: float, ambient_pa: float) -> float:
        """Return the pressure behind what was measured, Pa absolute; vacuum is counted from `ambient_pa`."""
        return ambient_pa - measured_pa if self.vacuum else measured_pa


@dataclass(frozen=True)
class Wiring:
    """Everything that a board file says.

    Attributes:
        firmware: Whose firmware it has.
        unit: Address of the board on the line, 1 to 247.
        baud_rate: Of a serial line.
        parity: `N`, `E` or `O`.
        stop_bits: 1 or 2.
        reply_timeout_s: Longest time until a reply is there, s.
        rate_hz: How often outputs are written and all sensors read, 1/s.
        watchdog_ms: For the project's firmware: silence after which it goes to its safe state, ms.
        pump: The pump.
        solenoids: By channel.
        sensors: By place: channels, and `manifold` if it has one.
        on_connect: Numbers that are written to holding registers whenever the link comes up, such as the time of a
            watchdog that the board has itself.

    """

    firmware: Firmware
    pump: Pump
    solenoids: Mapping[str, Solenoid]
    sensors: Mapping[str, Sensor]
    unit: int = 1
    baud_rate: int = 115200
    parity: str = "N"
    stop_bits: int = 1
    reply_timeout_s: float = 0.03
    rate_hz: float = 100.0
    watchdog_ms: int = field(default_factory=lambda: register_list().holding("watchdog_ms").default)
    on_connect: Mapping[int, int] = field(default_factory=dict)
