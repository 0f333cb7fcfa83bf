"""Pressure sensors of a plant: offset and noise, and what can be wrong with them."""

from __future__ import annotations

import random
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from jammkle_driver.fake.faults import FakeFault

if TYPE_CHECKING:
    from collections.abc import Mapping


@dataclass(frozen=True)
class SensorErrors:
    """Noise of each reading, step of the converter (0: none), and offsets of the sensors by place, Pa."""

    noise_pa: float = 50.0
    step_pa: float = 0.0
    offsets_pa: Mapping[str, float] = field(default_factory=dict)


class FakeSensors:
    """One sensor per place, each of which may fail."""

    def __init__(self, errors: SensorErrors, seed: int) -> None:
        """Make healthy ones.

        Args:
            errors: Of healthy sensors.
            seed: Of the noise.

        """
        self._errors = errors
        self._random = random.Random(seed)  # noqa: S311, sensor noise and not a secret
        self.heal()

    def heal(self) -> None:
        """Undo every fault."""
        self._dead: set[str] = set()
        self._stuck_pa: dict[str, float] = {}
        self._drift: dict[str, tuple[float, float]] = {}
        self._bias_pa: dict[str, float] = {}

    def inject(self, fault: FakeFault, place: str, size: float, true_pa: float, time_s: float) -> None:
        """Let one sensor fail now; what is no fault of a sensor is ignored.

        Args:
            fault: What fails.
            place: Where.
            size: See `FakeFault`.
            true_pa: The pressure there, Pa absolute.
            time_s: Now, s.

        """
        if fault is FakeFault.SENSOR_DEAD:
            self._dead.add(place)
        elif fault is FakeFault.SENSOR_STUCK:
            self._stuck_pa[place] = self._reading_pa(place, true_pa, time_s)
        elif fault is FakeFault.SENSOR_DRIFT:
            self._drift[place] = (time_s, size)
        elif fault is FakeFault.SENSOR_BIAS:
            self._bias_pa[place] = size
        elif fault is FakeFault.SENSOR_OUT_OF_RANGE:
            self._stuck_pa[place] = size

    def readings_pa(self, pressures_pa: Mapping[str, float], time_s: float) -> dict[str, float]:
        """Return what they read at these pressures, Pa absolute, by place; a dead one is left out."""
        return {
            place: self._stuck_pa[place] if place in self._stuck_pa else self._reading_pa(place, true_pa, time_s)
            for place, true_pa in pressures_pa.items()
            if place not in self._dead
        }

    def _reading_pa(self, place: str, true_pa: float, time_s: float) -> float:
        since_s, rate_pa_s = self._drift.get(place, (0.0, 0.0))
        error_pa = self._errors.offsets_pa.get(place, 0.0) + rate_pa_s * (time_s - since_s)
        error_pa += self._bias_pa.get(place, 0.0)
        reading_pa = true_pa + error_pa + self._random.gauss(0.0, self._errors.noise_pa)
        step_pa = self._errors.step_pa
        return round(reading_pa / step_pa) * step_pa if step_pa else reading_pa
