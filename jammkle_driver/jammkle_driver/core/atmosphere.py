"""Pressure of the atmosphere: what a parameter says, and what the vented channels read."""

from __future__ import annotations

from dataclasses import dataclass
from statistics import median_low
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence
    from collections.abc import Set as AbstractSet

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


@dataclass(frozen=True)
class AtmosphereStatus:
    """What is known of the atmosphere.

    Attributes:
        pressure_pa: Pressure from which vacuum is counted, Pa absolute.
        declared_pa: What the parameter says, Pa.
        measured: Whether vented channels have told it.

    """

    pressure_pa: float
    declared_pa: float
    measured: bool

    @property
    def doubtful(self) -> bool:
        """Whether the parameter cannot be right."""
        return self.measured and abs(self.declared_pa - self.pressure_pa) > DOUBT_PA


class Atmosphere:
    """Weighs the parameter against the sensors: two vented channels that agree are believed more than one number."""

    def __init__(self, channels: Sequence[str], declared_pa: float) -> None:
        """Believe the parameter until channels have been vented for a while."""
        # Nothing was ever drawn from channels of a driver that has just begun: they need not vent first.
        self._vented_s = dict.fromkeys(channels, VENTED_FOR_S - _FIRST_LOOK_S)
        self._readings_pa: dict[str, float] = {}
        self._declared_pa = declared_pa
        self._pressure_pa = declared_pa
        self._measured = False

    @property
    def status(self) -> AtmosphereStatus:
        """What is known now."""
        return AtmosphereStatus(self._pressure_pa, self._declared_pa, self._measured)

    @property
    def pressure_pa(self) -> float:
        """Pressure from which vacuum is counted, Pa absolute."""
        return self._pressure_pa

    def declare(self, pressure_pa: float, counted: AbstractSet[str] = frozenset()) -> None:
        """Take what the parameter says now; it counts where nothing was measured.

        Args:
            pressure_pa: What it says, Pa.
            counted: Channels whose readings are counted from it, and so go with it: sensors of vacuum cannot tell the
                atmosphere. Where all are, the estimate goes along, and keeps what it has learned of their zero.

        """
        step_pa = pressure_pa - self._declared_pa
        self._declared_pa = pressure_pa
        for channel in counted & self._readings_pa.keys():
            self._readings_pa[channel] += step_pa
        if not self._measured:
            self._pressure_pa = pressure_pa
        elif counted >= self._vented_s.keys():
            self._pressure_pa += step_pa

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
        share = min(elapsed_s / _FOLLOW_S, 1.0) if self._measured else 1.0
        self._pressure_pa += share * (target_pa - self._pressure_pa)
        self._measured = True
