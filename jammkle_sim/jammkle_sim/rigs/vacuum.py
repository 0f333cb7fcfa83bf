"""How a rig keeps its own vacuum: a schedule of set points, and a small regulator from pressure to commands."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from jammkle_common.names import CHANNELS

if TYPE_CHECKING:
    from collections.abc import Mapping

GAIN_PER_PA = 2.5e-4
"""Pump duty per Pa of missing vacuum. Assumed, as in the driver."""
INTEGRAL_TIME_S = 0.5
"""Time in which the integral repeats the proportional part. Assumed, as in the driver."""
MANIFOLD_LEAD_PA = 2e3
"""How much deeper than the set point the manifold may be while tendons follow. Assumed, as in the driver."""


@dataclass(frozen=True)
class VacuumStep:
    """From a time on, hold these channels at a vacuum; 0 vents them."""

    time_s: float
    """Since the start of the rig."""
    channels: tuple[str, ...]
    vacuum_pa: float


@dataclass(frozen=True)
class Commands:
    """What pump and solenoids are commanded."""

    pump_duty: float
    """0 to 1."""
    energised: tuple[bool, ...]
    """In the order of CHANNELS."""


def all_channels(time_s: float, vacuum_pa: float) -> VacuumStep:
    """Return a step that sets every channel."""
    return VacuumStep(time_s, CHANNELS, vacuum_pa)


class VacuumRegulator:
    """Makes set points of vacuum into commands: one at a time may differ from 0, as a 3/2 solenoid draws or vents."""

    def __init__(self, ambient_pa: float) -> None:
        """Start with everything vented.

        Args:
            ambient_pa: Pressure of the atmosphere, Pa.

        """
        self._ambient_pa = ambient_pa
        self._integral = 0.0

    def commands(
        self, wanted_pa: Mapping[str, float], channel_pa: Mapping[str, float], manifold_pa: float, elapsed_s: float
    ) -> Commands:
        """Return what to command now.

        Args:
            wanted_pa: Vacuum by channel, every one of them, Pa; 0 vents.
            channel_pa: Measured absolute pressure by channel, Pa.
            manifold_pa: Measured absolute pressure of the manifold, Pa.
            elapsed_s: Since the call before.

        """
        energised = tuple(wanted_pa[channel] > 0.0 for channel in CHANNELS)
        if not any(energised):
            self._integral = 0.0
            return Commands(0.0, energised)
        missing_pa = max(
            wanted_pa[channel] - (self._ambient_pa - channel_pa[channel]) for channel in CHANNELS if wanted_pa[channel]
        )
        lead_pa = max(wanted_pa.values()) + MANIFOLD_LEAD_PA - (self._ambient_pa - manifold_pa)
        proportional = GAIN_PER_PA * min(missing_pa, lead_pa)
        if 0.0 < proportional + self._integral < 1.0:  # at a bound the integral stands still
            self._integral = max(self._integral + proportional * elapsed_s / INTEGRAL_TIME_S, 0.0)
        return Commands(min(max(proportional + self._integral, 0.0), 1.0), energised)


class VacuumKeeper:
    """Follows a schedule of set points."""

    def __init__(self, schedule: tuple[VacuumStep, ...], ambient_pa: float) -> None:
        """Start with everything vented.

        Args:
            schedule: Steps by rising time.
            ambient_pa: Pressure of the atmosphere, Pa.

        """
        self._schedule = schedule
        self._regulator = VacuumRegulator(ambient_pa)

    def commands(
        self, time_s: float, channel_pa: Mapping[str, float], manifold_pa: float, elapsed_s: float
    ) -> Commands:
        """Return what to command now.

        Args:
            time_s: Since the start of the rig.
            channel_pa: Measured absolute pressure by channel, Pa.
            manifold_pa: Measured absolute pressure of the manifold, Pa.
            elapsed_s: Since the call before.

        """
        wanted_pa = dict.fromkeys(CHANNELS, 0.0)
        for step in self._schedule:
            if step.time_s <= time_s:
                wanted_pa.update(dict.fromkeys(step.channels, step.vacuum_pa))
        return self._regulator.commands(wanted_pa, channel_pa, manifold_pa, elapsed_s)
