"""The firmware that keeps the vacuum: set points over time, measured pressures in, duty and coils out."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING

from jammkle_common.names import CHANNELS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from studies.blind.reality.machine import Regulator

PERIOD_S = 0.010
"""Between two decisions: 100 Hz."""
_LEAST_DUTY = -0.2
"""Where the sum of the changes stops falling. Not at 0, else noise alone would add up to a vacuum too deep."""


@dataclass(frozen=True)
class SetPoint:
    """From a time on, a channel is to be at a vacuum; 0 vents it."""

    time_s: float
    channel: str
    vacuum_pa: float


def together(time_s: float, channels: Sequence[str], vacuum_pa: float) -> tuple[SetPoint, ...]:
    """Return set points of several channels at once."""
    return tuple(SetPoint(time_s, channel, vacuum_pa) for channel in channels)


def wanted_pa(schedule: Sequence[SetPoint], time_s: float) -> tuple[float, ...]:
    """Return the set point of each channel at a time, in the order of CHANNELS, Pa."""
    latest = dict.fromkeys(CHANNELS, 0.0)
    for point in sorted(schedule, key=lambda each: each.time_s):
        if point.time_s <= time_s + 1e-9:
            latest[point.channel] = point.vacuum_pa
    return tuple(latest[channel] for channel in CHANNELS)


@dataclass(frozen=True)
class Orders:
    """What pump and coils are told."""

    duty: float
    """0 to 1, in steps of the pulse width."""
    coils: tuple[bool, ...]
    """In the order of CHANNELS."""


@dataclass(frozen=True)
class Memory:
    """What the firmware keeps from one decision to the next."""

    duty: float = 0.0
    """Before rounding; below 0 it says how much too deep the vacuum is."""
    band_pa: float = 0.0
    """Error within the band in which the duty is not full."""
    running: bool = False


def decide(
    regulator: Regulator, memory: Memory, wanted: tuple[float, ...], vacuum_pa: Sequence[float], manifold_pa: float
) -> tuple[Orders, Memory]:
    """Return what to command now: a regulator in its velocity form, that adds changes to the duty.

    Args:
        regulator: Its constants.
        memory: From the decision before.
        wanted: Set points, Pa, in the order of CHANNELS.
        vacuum_pa: Measured vacuum of each channel, Pa.
        manifold_pa: Measured vacuum of the manifold, Pa.

    """
    coils = tuple(each > 0.0 for each in wanted)
    if not any(coils):
        return Orders(0.0, coils), Memory()
    missing_pa = max(goal - has for goal, has in zip(wanted, vacuum_pa, strict=True) if goal > 0.0)
    error_pa = min(missing_pa, max(wanted) + regulator.lead_pa - manifold_pa)
    # What lies beyond full duty does not count, else the duty would fall long before the set point.
    band_pa = min(max(error_pa, -1.0 / regulator.gain_per_pa), 1.0 / regulator.gain_per_pa)
    before_pa = memory.band_pa if memory.running else 0.0
    change = regulator.gain_per_pa * (band_pa - before_pa + error_pa * PERIOD_S / regulator.integral_s)
    duty = min(max(memory.duty + change, _LEAST_DUTY), 1.0)
    rounded = round(max(duty, 0.0) * regulator.duty_steps) / regulator.duty_steps
    return Orders(rounded, coils), dataclasses.replace(memory, duty=duty, band_pa=band_pa, running=True)
