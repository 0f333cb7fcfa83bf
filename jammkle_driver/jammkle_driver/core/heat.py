"""How far pressures may still move by themselves after a change, as air takes the temperature of its walls."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

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
