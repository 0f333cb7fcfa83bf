"""How fast the ankle leaks, from the decay of its vacuum while the pump rests."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from jammkle_common.constants import STANDARD_ATMOSPHERE_PA
from jammkle_driver.core.air import REFERENCE_PA

if TYPE_CHECKING:
    from collections.abc import Mapping

    from jammkle_driver.core.air import AirSettings

SHORTEST_S = 0.25
"""Shortest rest that tells a rate, s: 50 Pa of noise in 25 readings then make 0.14 kPa/s, less over several rests."""

_LATEST = 0.3
"""Weight of the latest rest in the mean over rests of the same set of channels."""

SETTLING_S = 0.15
"""After what time of rest air has spread evenly, s: two time constants of a channel."""


@dataclass(frozen=True)
class LeakRate:
    """A leak as it was seen last.

    Attributes:
        rate_pa_s: Rise of the pressure, Pa/s.
        conductance_m3_s_pa: Sonic conductance of the leak into all that was connected, m^3/(s Pa).
        connected: Channels that were connected, and decayed together with the manifold.

    """

    rate_pa_s: float
    conductance_m3_s_pa: float
    connected: frozenset[str]


class LeakMeter:
    """Fits a line to each channel's pressure over a rest of the pump, and makes a conductance of all that is connected.

    What is connected shares one pressure and decays together. Each set of channels has its own estimate: a
    larger leak of one channel shows once that was connected alone.

    While the pump rests, `V dp/dt = C p_ref p_ambient` for all volumes that are connected, choked, as a leak from the
    atmosphere into half of it or less is (ISO 6358-1); above that the flow is less, and the conductance told too small.
    """

    def __init__(self, channels: tuple[str, ...], air: AirSettings) -> None:
        """Make a meter that has seen no rest."""
        self._air = air
        self._volumes_m3 = dict(zip(channels, air.channel_volumes_m3, strict=False))
        self._sums: dict[str, tuple[int, float, float, float, float]] = {}
        self._connected: frozenset[str] = frozenset()
        self._products: dict[str, float] = {}
        self._rising: dict[str, float] = {}
        self._told: dict[frozenset[str], float] = {}
        self._last: frozenset[str] = frozenset()
        self._ambient_pa = STANDARD_ATMOSPHERE_PA

    def read(
        self, channel: str, pressure_pa: float, elapsed_s: float, connected: frozenset[str], ambient_pa: float
    ) -> None:
        """Take a reading of a rest.

        Args:
            channel: Whose reading it is.
            pressure_pa: Pa absolute.
            elapsed_s: Time since the last one of this channel, s.
            connected: Channels that share the vacuum; one with another set of them begins a new rest.
            ambient_pa: Pressure of the atmosphere, Pa.

        """
        self._ambient_pa = ambient_pa
        if connected != self._connected:
            self.stop()
            self._connected = connected
        if channel not in connected:
            return
        count, time_s, sum_x, sum_y, sum_xx = self._sums.get(channel, (0, -SETTLING_S, 0.0, 0.0, 0.0))
        product = self._products.get(channel, 0.0)
        time_s += elapsed_s
        if time_s < 0.0:
            self._sums[channel] = (0, time_s, 0.0, 0.0, 0.0)
            return
        count, sum_x, sum_y, sum_xx = count + 1, sum_x + time_s, sum_y + pressure_pa, sum_xx + time_s * time_s
        product += time_s * pressure_pa
        self._sums[channel] = (count, time_s, sum_x, sum_y, sum_xx)
        self._products[channel] = product
        spread = count * sum_xx - sum_x * sum_x
        if time_s >= SHORTEST_S and spread > 0.0:
            self._rising[channel] = (count * product - sum_x * sum_y) / spread
            self._last = connected

    def stop(self) -> None:
        """End the rest, and take what it told into the mean; that stays."""
        self._told.update(self._resting)
        self._rising.clear()
        self._sums.clear()
        self._products.clear()
        self._connected = frozenset()

    @property
    def alone(self) -> Mapping[str, LeakRate]:
        """The leak of each channel that was connected alone, with the manifold's, over all such rests."""
        told = {**self._told, **self._resting}
        return {next(iter(names)): self._rate(rate, names) for names, rate in told.items() if len(names) == 1}

    @property
    def latest(self) -> LeakRate | None:
        """The leak of what was connected in the last rest, over all rests of the same channels; None before one."""
        rate_pa_s = {**self._told, **self._resting}.get(self._last)
        return None if rate_pa_s is None else self._rate(rate_pa_s, self._last)

    @property
    def _resting(self) -> dict[frozenset[str], float]:
        """What the rest that is under way makes of the mean of its channels, Pa/s."""
        if not self._rising:
            return {}
        rising_pa_s = sum(self._rising.values()) / len(self._rising)
        before_pa_s = self._told.get(self._connected, rising_pa_s)
        return {self._connected: before_pa_s + _LATEST * (rising_pa_s - before_pa_s)}

    def _rate(self, rate_pa_s: float, connected: frozenset[str]) -> LeakRate:
        volume_m3 = self._air.manifold_volume_m3 + sum(self._volumes_m3[name] for name in connected)
        conductance = max(rate_pa_s, 0.0) * volume_m3 / (REFERENCE_PA * self._ambient_pa)
        return LeakRate(rate_pa_s, conductance, connected)
