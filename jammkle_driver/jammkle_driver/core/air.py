"""The air between pump and tendons: one mass balance per volume, with orifices after ISO 6358 and a linear pump curve.

The law that faults are judged by, and that the fake plant runs. Isothermal: `V dp/dt` is the sum of the flows, each in
Pa m^3/s (power of air at the temperature of all of it). Written for arrays: many hypotheses are advanced at once.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

REFERENCE_PA = 1e5
"""Pressure of the reference state of a sonic conductance, Pa (ISO 6358-1)."""

CRITICAL_RATIO = 0.5
"""Pressure ratio below which an orifice chokes (`b` of ISO 6358). Data sheets say 0.2 to 0.5."""

LINEAR_RATIO = 0.99
"""Pressure ratio above which an orifice is taken as linear; ISO 6358 leaves it to the user."""


@dataclass(frozen=True)
class AirSettings:
    """Volumes, conductances and pump of one ankle, as built.

    Attributes:
        manifold_volume_m3: Manifold and the hose to the pump, m^3.
        channel_volumes_m3: Free air of each channel with its hose, m^3, in the driver's order.
        valve_conductance_m3_s_pa: Sonic conductance of solenoid and hose in series, either way, m^3/(s Pa).
        leak_conductance_m3_s_pa: Sonic conductance of a good membrane's leak into each volume, m^3/(s Pa).
        pump_free_flow_m3_s: Volume that the pump draws at full duty without vacuum, m^3/s.
        pump_ultimate_vacuum_pa: Vacuum at which the pump stops drawing, Pa.
        valve_dead_time_s: Time from command to movement, s.

    """

    manifold_volume_m3: float
    channel_volumes_m3: tuple[float, ...]
    valve_conductance_m3_s_pa: float
    leak_conductance_m3_s_pa: float
    pump_free_flow_m3_s: float
    pump_ultimate_vacuum_pa: float
    valve_dead_time_s: float

    @property
    def volumes_m3(self) -> tuple[float, ...]:
        """All volumes, m^3: the manifold's, then the channels'."""
        return (self.manifold_volume_m3, *self.channel_volumes_m3)


def orifice(from_pa: Array, to_pa: Array) -> tuple[Array, Array, Array]:
    """Return flow per conductance, Pa^2, and its slopes by both pressures, Pa (ISO 6358-1, elliptic below choking).

    Args:
        from_pa: Absolute pressures on one side, Pa; the flow is positive from here.
        to_pa: Absolute pressures on the other side, Pa.

    """
    forward = from_pa >= to_pa
    high = np.where(forward, from_pa, to_pa)
    low = np.where(forward, to_pa, from_pa)
    ratio = low / high
    width = 1.0 - CRITICAL_RATIO
    bend = np.maximum(np.minimum(ratio, LINEAR_RATIO) - CRITICAL_RATIO, 0.0) / width
    share = np.sqrt(1.0 - bend * bend)
    linear = ratio > LINEAR_RATIO
    edge_slope = -share / (1.0 - LINEAR_RATIO)
    slope = np.where(linear, edge_slope, -bend / (share * width))
    share = np.where(linear, share * (1.0 - ratio) / (1.0 - LINEAR_RATIO), share)
    by_low = REFERENCE_PA * slope
    by_high = REFERENCE_PA * share - by_low * ratio
    flow = REFERENCE_PA * high * share
    sign = np.where(forward, 1.0, -1.0)
    return sign * flow, sign * np.where(forward, by_high, by_low), sign * np.where(forward, by_low, by_high)
