"""The air of the independent model as a plant for the driver: gas that has heat, tubes, and a pump that pulsates."""

from __future__ import annotations

import random
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from fault_bench import pump_end
from jammkle_common.constants import STANDARD_ATMOSPHERE_PA
from jammkle_common.names import CHANNELS
from jammkle_driver.core.hardware import MANIFOLD
from jammkle_driver.fake import FakeFault, FakePlant, SensorErrors
from studies.blind.reality.air import (
    FREE_FLOW,
    LEAK,
    NODES,
    STEP_S,
    TURBULENT,
    AirLaw,
    advance_air,
    air_law,
    pressures_pa,
    vented,
)
from studies.blind.reality.machine import nozzle_area_m2
from studies.blind.reality.specimen import machine, today

if TYPE_CHECKING:
    from collections.abc import Mapping

    from jammkle_driver.core.air import AirSettings

_CHUNK_S = 0.001
_PER_CHUNK = round(_CHUNK_S / STEP_S)
_OF_UNIT = 1e-8
"""A sonic conductance of 1 dm^3/(s bar), in m^3/(s Pa)."""
_LINE_M2 = nozzle_area_m2(0.1)
"""Effective area of a whole line in order, m^2."""
_OFFSET_PA = 150.0
"""Standard deviation of a sensor's offset, Pa: as on the bench's own plant."""


def real_plant(declared: AirSettings, draw: random.Random, seed: int) -> RealAirPlant:
    """Return one specimen on one day; what the driver has declared is the type, of which it is one."""
    offsets_pa = {place: draw.gauss(0.0, _OFFSET_PA) for place in (MANIFOLD, *CHANNELS)}
    return RealAirPlant(declared, seed, SensorErrors(offsets_pa=offsets_pa), pump_end(draw))


class RealAirPlant(FakePlant):
    """The fake plant's sensors on the law of `studies.blind.reality.air`."""

    def __init__(self, declared: AirSettings, seed: int, errors: SensorErrors, end: float = 1.0) -> None:
        """Make a specimen, vented, pump off.

        Args:
            declared: What the parameters of the driver say.
            seed: Of the specimen, its day, its switching and the sensors' noise.
            errors: Of healthy sensors.
            end: Where the pump ends, over where the specimen's does.

        """
        air = today(machine(seed + 1), seed).air
        end_pa = air.pump.ultimate_vacuum_pa * end
        self._real = replace(air, pump=replace(air.pump, ultimate_vacuum_pa=end_pa))
        self._law = air_law(self._real)
        self._state = vented(self._law)
        self._switching = random.Random(seed + 7)  # noqa: S311 - a simulation
        self._history_pa = np.zeros((1, NODES))
        self._steps = 0
        super().__init__(replace(declared, pump_ultimate_vacuum_pa=end_pa), STANDARD_ATMOSPHERE_PA, errors, seed)
        self._sense()

    def command(self, solenoids: Mapping[str, bool], duty: float, late_s: float = 0.0) -> None:
        """See `FakePlant`."""
        self._wanted += [(self.time_s + late_s, name, energised) for name, energised in solenoids.items()]
        self._duty = duty

    def inject(self, fault: FakeFault, place: str, size: float = 0.0) -> None:
        """See `FakePlant`; a line is blocked by a kink, whose loss adds to that of the tube."""
        super().inject(fault, place, size)
        scalars, lines, nodes = (table.copy() for table in self._law)
        if fault is FakeFault.LEAK:
            node = 0 if place == MANIFOLD else _tendon(place)
            nodes[LEAK, node] += nozzle_area_m2(size / _OF_UNIT)
        elif fault is FakeFault.BLOCKED:
            lines[TURBULENT, CHANNELS.index(place)] += 0.5 / (size * _LINE_M2) ** 2 - 0.5 / _LINE_M2**2
        elif fault in {FakeFault.STUCK_OPEN, FakeFault.STUCK_CLOSED}:
            self._move(place, energised=self._valves[place])
        elif fault in {FakeFault.PUMP_DEAD, FakeFault.PUMP_WEAK}:
            scalars[FREE_FLOW] *= size if fault is FakeFault.PUMP_WEAK else 0.0
        self._law = AirLaw(scalars, lines, nodes)

    def heal(self) -> None:
        """See `FakePlant`."""
        super().heal()
        self._law = air_law(self._real)
        for name, energised in self._open.items():
            self._move(name, energised=energised)

    def advance(self, duration_s: float) -> None:
        """See `FakePlant`."""
        for _ in range(round(duration_s / _CHUNK_S)):
            self.time_s += _CHUNK_S
            while self._wanted and self._wanted[0][0] <= self.time_s:
                _, name, energised = self._wanted.pop(0)
                self._open[name] = energised
                self._move(name, energised=self._valves.get(name, energised))
            self._state.more[0] = self._duty
            advance_air(self._law, self._state, self._steps, _PER_CHUNK, 2**62, self._history_pa)
            self._steps += _PER_CHUNK
        self._sense()

    def _sense(self) -> None:
        """Take the pressures at the sensors: of the manifold, and of the tendons."""
        found = pressures_pa(self._law, self._state).tolist()
        self.pressures_pa = {MANIFOLD: found[0], **{name: found[_tendon(name)] for name in CHANNELS}}

    def _move(self, channel: str, *, energised: bool) -> None:
        place = CHANNELS.index(channel)
        if self._state.goal[place] != float(energised):
            line = self._real.lines[place]
            self._state.goal[place] = float(energised)
            self._state.wait_s[place] = max(line.dead_s + line.dead_jitter_s * self._switching.gauss(0.0, 1.0), 0.0)


def _tendon(channel: str) -> int:
    """Node of a channel's tendons, where its sensor is."""
    return 2 + 2 * CHANNELS.index(channel)
