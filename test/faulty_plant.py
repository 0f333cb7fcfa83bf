"""What is behind a board's pins, any part of which can be made to fail and be repaired, while the board runs."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from board_bench import BoardPlant
from jammkle_common.names import CHANNELS
from jammkle_driver.fake import FakeFault

if TYPE_CHECKING:
    from collections.abc import Callable

_DM3_S_BAR_PER_M3_S_PA = 1e8


class FaultyPlant(BoardPlant):
    """The simulation's air, and between it and the pins a pump, valves and sensors that fail on demand.

    Implements as much of `jammkle_driver.fake.FakePlant` as a fault needs: `inject`, `heal`.
    """

    def __init__(self) -> None:
        """Start well."""
        super().__init__()
        self._asked = (0, 0.0)
        self._stays_open = self._stays_shut = 0
        self._pump_share = 1.0
        self._reads: dict[str, Callable[[float], float]] = {}
        self._steps_s = 0.0

    def drive(self, solenoids: int, duty: float) -> None:
        """Set what the pins do; what has failed does something else."""
        self._asked = (solenoids, duty)
        super().drive((solenoids | self._stays_open) & ~self._stays_shut, duty * self._pump_share)

    def advance(self, elapsed_s: float) -> None:
        """Let time pass."""
        self._steps_s += elapsed_s
        super().advance(elapsed_s)

    def sensed_pa(self) -> dict[str, float]:
        """Return what the sensors make of the pressures, Pa absolute; one whose wire is off is at its upper rail."""
        sensed = super().sensed_pa()
        return {**sensed, **{place: reads(sensed[place]) for place, reads in self._reads.items()}}

    def inject(self, fault: FakeFault, place: str, size: float = 0.0) -> None:
        """Let something fail now, and until `heal`; see `FakeFault`."""
        if fault is FakeFault.LEAK:
            self.air.puncture(place, size * _DM3_S_BAR_PER_M3_S_PA)
        elif fault is FakeFault.BLOCKED:
            self.air.pinch(place, size)
        elif fault is FakeFault.STUCK_OPEN:
            self._stays_open = 1 << CHANNELS.index(place)
        elif fault is FakeFault.STUCK_CLOSED:
            self._stays_shut = 1 << CHANNELS.index(place)
        elif fault in {FakeFault.PUMP_DEAD, FakeFault.PUMP_WEAK}:
            self._pump_share = size
        else:
            self._reads[place] = self._failed_sensor(fault, place, size)
        self.drive(*self._asked)

    def heal(self) -> None:
        """Undo every fault."""
        self.air.repair()
        self._stays_open = self._stays_shut = 0
        self._pump_share = 1.0
        self._reads.clear()
        self.drive(*self._asked)

    def _failed_sensor(self, fault: FakeFault, place: str, size: float) -> Callable[[float], float]:
        begun_s, stood_pa = self._steps_s, self.pressures_pa[place]
        return {
            FakeFault.SENSOR_DEAD: lambda _: math.inf,
            FakeFault.SENSOR_STUCK: lambda _: stood_pa,
            FakeFault.SENSOR_DRIFT: lambda true_pa: true_pa + size * (self._steps_s - begun_s),
            FakeFault.SENSOR_BIAS: lambda true_pa: true_pa + size,
            FakeFault.SENSOR_OUT_OF_RANGE: lambda _: size,
        }[fault]
