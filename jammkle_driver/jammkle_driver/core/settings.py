"""Everything that can be set about the driver."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from jammkle_driver.core.ankle import AnkleSettings
    from jammkle_driver.core.requests import VacuumLimits


@dataclass(frozen=True)
class DriverSettings:
    """What a driver goes by.

    Attributes:
        limits: Vacuum that may be asked for.
        ankle: What channels, pump and diagnosis go by.
        command_timeout_s: Silence after which what a stream of wishes jammed is let go, s.
        pressure_timeout_s: Silence after which a pressure counts as not measured, s.
        emergency_stop_timeout_s: Silence of the emergency stop that counts as a stop, s; 0 = never.
        tick_period_s: Time between two calls of `Driver.tick`, s.

    """

    limits: VacuumLimits
    ankle: AnkleSettings
    command_timeout_s: float
    pressure_timeout_s: float
    emergency_stop_timeout_s: float
    tick_period_s: float
