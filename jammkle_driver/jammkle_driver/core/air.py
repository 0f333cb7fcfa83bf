"""The air of one ankle: its law, what heat adds to it, the atmosphere, and leaks.

One mass balance per volume, with orifices after ISO 6358 and a linear pump curve: the law that faults are judged by,
and that the fake plant runs. Isothermal: `V dp/dt` is the sum of the flows, each in Pa m^3/s (power of air at the
temperature of all of it). Written for arrays: many hypotheses are advanced at once.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import median_low
from typing import TYPE_CHECKING

import numpy as np

from jammkle_common.constants import STANDARD_ATMOSPHERE_PA

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from collections.abc import Set as AbstractSet

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
        reservoir_volume_m3: Reservoir at the manifold, m^3; 0: none.

    """

    manifold_volume_m3: float
    channel_volumes_m3: tuple[float, ...]
    valve_conductance_m3_s_pa: float
    leak_conductance_m3_s_pa: float
    pump_free_flow_m3_s: float
    pump_ultimate_vacuum_pa: float
    valve_dead_time_s: float
    reservoir_volume_m3: float = 0.0

    @property
    def shared_volume_m3(self) -> float:
        """Manifold and reservoir, which have one pressure, m^3."""
        return self.manifold_volume_m3 + self.reservoir_volume_m3

    @property
    def volumes_m3(self) -> tuple[float, ...]:
        """All volumes, m^3: what is shared, then the channels'."""
        return (self.shared_volume_m3, *self.channel_volumes_m3)

    def evacuation_s(self, volume_m3: float, vacuum_pa: float) -> float:
        """How long the pump takes at full duty to evacuate a volume from the standard atmosphere, s.

        `dp/dt = -S (1 - (p_a - p) / p_end) p / V`, the mass balance of one volume, integrated by partial fractions.
        """
        ambient_pa = STANDARD_ATMOSPHERE_PA
        least_pa, pressure_pa = ambient_pa - self.pump_ultimate_vacuum_pa, ambient_pa - vacuum_pa
        shares = (1.0 - least_pa / ambient_pa) / (1.0 - least_pa / pressure_pa)
        return volume_m3 / self.pump_free_flow_m3_s * self.pump_ultimate_vacuum_pa / least_pa * math.log(shares)


def orifice(from_pa: Array, to_pa: Array) -> tuple[Array, Array, Array]:
    """Return flow per conductance, Pa^2, and its slopes by both absolute pressures, Pa.

    ISO 6358-1: elliptic below choking.
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


HEAT_TIME_S = 0.2
"""In which air takes the temperature of its wall, s: density c_v volume / (h area) of 15 ml, h = 10 to 15 W/(m^2 K)."""

HEAT_SHARE = 0.1
"""Of a change of pressure, how much comes back as the heat goes, 1: a third of the (k - 1) / k = 0.29 of an adiabatic
change, as two thirds go while it lasts. Assumed."""


class HeatMeter:
    """Follows each reading with a lag of `HEAT_TIME_S`: what it is ahead is a change whose heat has not gone yet."""

    def __init__(self, volumes: int) -> None:
        """Begin at the temperature of the walls."""
        self._volumes = volumes
        self.reset()

    def reset(self) -> None:
        """Forget what was measured."""
        self._followed_pa = [math.nan] * self._volumes
        self._ahead_pa = [0.0] * self._volumes

    def measure(self, readings_pa: Sequence[float], duration_s: float) -> tuple[float, ...]:
        """Take what the sensors read after `duration_s` s, Pa, NaN where one is silent; return what may come back, Pa.

        From the readings alone, and so the same for every hypothesis.
        """
        share = -math.expm1(-duration_s / HEAT_TIME_S)
        for place, reading_pa in enumerate(readings_pa):
            if math.isfinite(reading_pa):
                if math.isnan(self._followed_pa[place]):
                    self._followed_pa[place] = reading_pa
                self._ahead_pa[place] = reading_pa - self._followed_pa[place]
                self._followed_pa[place] += share * self._ahead_pa[place]
            else:
                self._ahead_pa[place] *= 1.0 - share
        return tuple(HEAT_SHARE * abs(ahead_pa) for ahead_pa in self._ahead_pa)


VENTED_FOR_S = 0.7
"""After how long at the vent a channel is at the atmosphere, s: 0.15 s to vent, and a factor for a narrow line."""

AGREE_PA = 1.5e3
"""How far two vented channels may be apart and still agree, Pa: four standard deviations of two sensors' offsets."""

DOUBT_PA = 2.5e3
"""How far the parameter may be from what is read before it is doubted, Pa: weather and half a storey are less."""

_FIRST_LOOK_S = 0.2
"""How long a channel is looked at before it is believed for the first time, s."""

_FOLLOW_S = 1.0
"""Time in which the estimate follows what is read, s."""


class Atmosphere:
    """Weighs the parameter against the sensors: two vented channels that agree are believed more than one number.

    Attributes:
        pressure_pa: Pressure from which vacuum is counted, Pa absolute.
        declared_pa: What the parameter says, Pa.
        measured: Whether vented channels have shown it.

    """

    def __init__(self, channels: Sequence[str], declared_pa: float) -> None:
        """Believe the parameter until channels have been vented for a while."""
        # Nothing was ever drawn from channels of a driver that has just begun: they need not vent first.
        self._vented_s = dict.fromkeys(channels, VENTED_FOR_S - _FIRST_LOOK_S)
        self._readings_pa: dict[str, float] = {}
        self.declared_pa = declared_pa
        self.pressure_pa = declared_pa
        self.measured = False

    @property
    def doubtful(self) -> bool:
        """Whether the parameter cannot be right."""
        return self.measured and abs(self.declared_pa - self.pressure_pa) > DOUBT_PA

    def declare(self, pressure_pa: float, counted: AbstractSet[str] = frozenset()) -> None:
        """Take what the parameter says now, Pa; it counts where nothing was measured.

        Readings of the channels that are counted from it go with it: sensors of vacuum do not show the atmosphere.
        Where all are, the estimate goes along, and keeps what it has learned of their zero.
        """
        step_pa = pressure_pa - self.declared_pa
        self.declared_pa = pressure_pa
        for channel in counted & self._readings_pa.keys():
            self._readings_pa[channel] += step_pa
        if not self.measured:
            self.pressure_pa = pressure_pa
        elif counted >= self._vented_s.keys():
            self.pressure_pa += step_pa

    def read(self, channel: str, pressure_pa: float, elapsed_s: float, *, vented: bool) -> None:
        """Take a reading of a channel, Pa absolute, `elapsed_s` s after the one before, and whether it is vented."""
        self._vented_s[channel] = self._vented_s[channel] + elapsed_s if vented else 0.0
        self._readings_pa[channel] = pressure_pa
        still = [self._readings_pa[name] for name, since_s in self._vented_s.items() if since_s >= VENTED_FOR_S]
        if len(still) < min(2, len(self._vented_s)):
            return
        centre_pa = median_low(still)
        agreed = [reading for reading in still if abs(reading - centre_pa) <= AGREE_PA]
        if len(agreed) < min(2, len(self._vented_s)):
            return
        target_pa = sum(agreed) / len(agreed)
        share = min(elapsed_s / _FOLLOW_S, 1.0) if self.measured else 1.0
        self.pressure_pa += share * (target_pa - self.pressure_pa)
        self.measured = True


SHORTEST_S = 0.25
"""Shortest rest that gives a rate, s: 50 Pa of noise in 25 readings then make 0.14 kPa/s, less over several rests."""

_LATEST = 0.3
"""Weight of the latest rest in the mean over rests of the same set of channels."""

SETTLING_S = 0.15
"""After what time of rest air has spread evenly, s: two time constants of a channel."""


@dataclass(frozen=True)
class LeakRate:
    """A leak as it was seen last: the rise of the pressure, and what it is into all that was connected.

    The channels that were connected decayed together with the manifold; `conductance_m3_s_pa` is sonic.
    """

    rate_pa_s: float
    conductance_m3_s_pa: float
    connected: frozenset[str]


class LeakMeter:
    """Fits a line to each channel's pressure over a rest of the pump, and makes a conductance of all that is connected.

    What is connected shares one pressure and decays together. Each set of channels has its own estimate: a
    larger leak of one channel shows once that was connected alone.

    While the pump rests, `V dp/dt = C p_ref p_ambient` for all volumes that are connected, choked, as a leak from the
    atmosphere into half of it or less is (ISO 6358-1); above that the flow is less, and the conductance
    reported is too small.
    """

    def __init__(self, channels: tuple[str, ...], air: AirSettings) -> None:
        """Make a meter that has seen no rest."""
        self._air = air
        self._volumes_m3 = dict(zip(channels, air.channel_volumes_m3, strict=False))
        self._times_s: dict[str, float] = {}
        self._sums: dict[str, Array] = {}
        self._connected: frozenset[str] = frozenset()
        self._rising: dict[str, float] = {}
        self._reported: dict[frozenset[str], float] = {}
        self._last: frozenset[str] = frozenset()
        self._ambient_pa = STANDARD_ATMOSPHERE_PA

    def read(
        self, channel: str, pressure_pa: float, elapsed_s: float, connected: frozenset[str], ambient_pa: float
    ) -> None:
        """Take a reading of a rest, Pa absolute, `elapsed_s` s after the last one of this channel.

        A reading with another set of connected channels, which share the vacuum, begins a new rest.
        """
        self._ambient_pa = ambient_pa
        if connected != self._connected:
            self.stop()
            self._connected = connected
        if channel not in connected:
            return
        time_s = self._times_s[channel] = self._times_s.get(channel, -SETTLING_S) + elapsed_s
        if time_s < 0.0:
            return
        sums = self._sums.setdefault(channel, np.zeros(5))
        sums += (1.0, time_s, pressure_pa, time_s * time_s, time_s * pressure_pa)
        count, sum_x, sum_y, sum_xx, sum_xy = sums.tolist()
        spread = count * sum_xx - sum_x * sum_x
        if time_s >= SHORTEST_S and spread > 0.0:
            self._rising[channel] = (count * sum_xy - sum_x * sum_y) / spread
            self._last = connected

    def stop(self) -> None:
        """End the rest, and take its rates into the mean; that stays."""
        self._reported.update(self._resting)
        self._rising.clear()
        self._times_s.clear()
        self._sums.clear()
        self._connected = frozenset()

    @property
    def alone(self) -> Mapping[str, LeakRate]:
        """The leak of each channel that was connected alone, with the manifold's, over all such rests."""
        reported = {**self._reported, **self._resting}
        return {next(iter(names)): self._rate(rate, names) for names, rate in reported.items() if len(names) == 1}

    @property
    def latest(self) -> LeakRate | None:
        """The leak of what was connected in the last rest, over all rests of the same channels; None before one."""
        rate_pa_s = {**self._reported, **self._resting}.get(self._last)
        return None if rate_pa_s is None else self._rate(rate_pa_s, self._last)

    @property
    def _resting(self) -> dict[frozenset[str], float]:
        """What the rest that is under way makes of the mean of its channels, Pa/s."""
        if not self._rising:
            return {}
        rising_pa_s = sum(self._rising.values()) / len(self._rising)
        before_pa_s = self._reported.get(self._connected, rising_pa_s)
        return {self._connected: before_pa_s + _LATEST * (rising_pa_s - before_pa_s)}

    def _rate(self, rate_pa_s: float, connected: frozenset[str]) -> LeakRate:
        volume_m3 = self._air.shared_volume_m3 + sum(self._volumes_m3[name] for name in connected)
        conductance = max(rate_pa_s, 0.0) * volume_m3 / (REFERENCE_PA * self._ambient_pa)
        return LeakRate(rate_pa_s, conductance, connected)
