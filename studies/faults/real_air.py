"""The air of the independent model as a plant for the driver: gas that has heat, tubes, and a pump that pulsates."""

from __future__ import annotations

import random
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from fault_bench import pump_end
from jammkle_common.names import CHANNELS
from jammkle_driver.core.hardware import MANIFOLD
from jammkle_driver.fake import FakeFault, FakeSensors, SensorErrors
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


def real_plant(_declared: AirSettings, draw: random.Random, seed: int) -> RealAirPlant:
    """Return one specimen on one day; what the driver has declared is the type, of which it is one."""
    offsets_pa = {place: draw.gauss(0.0, _OFFSET_PA) for place in (MANIFOLD, *CHANNELS)}
    return RealAirPlant(seed, SensorErrors(offsets_pa=offsets_pa), pump_end(draw))


class RealAirPlant:
    """A `jammkle_driver.fake.Plant` on the law of `studies.blind.reality.air`."""

    def __init__(self, seed: int, errors: SensorErrors, end: float = 1.0) -> None:
        """Make a specimen, vented, pump off.

        Args:
            seed: Of the specimen, its day, its switching and the sensors' noise.
            errors: Of healthy sensors.
            end: Where the pump ends, over where the specimen's does.

        """
        air = today(machine(seed + 1), seed).air
        self._air = replace(air, pump=replace(air.pump, ultimate_vacuum_pa=air.pump.ultimate_vacuum_pa * end))
        self._law = air_law(self._air)
        self._state = vented(self._law)
        self._switching = random.Random(seed + 7)  # noqa: S311 - a simulation
        self._history_pa = np.zeros((1, NODES))
        self._steps = 0
        self._due: list[tuple[float, str, bool]] = []
        self._wanted = dict.fromkeys(CHANNELS, False)
        self._duty = 0.0
        self._valves: dict[str, bool] = {}
        self._sensors = FakeSensors(errors, seed)
        self.time_s = 0.0

    @property
    def pump_ultimate_vacuum_pa(self) -> float:
        """See `Plant`."""
        return self._air.pump.ultimate_vacuum_pa

    @property
    def pressures_pa(self) -> Mapping[str, float]:
        """True pressures at the sensors, Pa absolute: of the manifold, and of the tendons."""
        found = pressures_pa(self._law, self._state).tolist()
        return {MANIFOLD: found[0], **{name: found[_tendon(name)] for name in CHANNELS}}

    def readings_pa(self) -> dict[str, float]:
        """See `Plant`."""
        return self._sensors.readings_pa(self.pressures_pa, self.time_s)

    def command(self, solenoids: Mapping[str, bool], duty: float, late_s: float = 0.0) -> None:
        """See `Plant`."""
        self._due += [(self.time_s + late_s, name, energised) for name, energised in solenoids.items()]
        self._duty = duty

    def inject(self, fault: FakeFault, place: str, size: float = 0.0) -> None:
        """See `Plant`; a line is blocked by a kink, whose loss adds to that of the tube."""
        scalars, lines, nodes = (table.copy() for table in self._law)
        if fault is FakeFault.LEAK:
            node = 0 if place == MANIFOLD else _tendon(place)
            nodes[LEAK, node] += nozzle_area_m2(size / _OF_UNIT)
        elif fault is FakeFault.BLOCKED:
            lines[TURBULENT, CHANNELS.index(place)] += 0.5 / (size * _LINE_M2) ** 2 - 0.5 / _LINE_M2**2
        elif fault in {FakeFault.STUCK_OPEN, FakeFault.STUCK_CLOSED}:
            self._valves[place] = fault is FakeFault.STUCK_OPEN
            self._move(place, energised=self._valves[place])
        elif fault in {FakeFault.PUMP_DEAD, FakeFault.PUMP_WEAK}:
            scalars[FREE_FLOW] *= size if fault is FakeFault.PUMP_WEAK else 0.0
        else:
            self._sensors.inject(fault, place, size, self.pressures_pa[place], self.time_s)
        self._law = AirLaw(scalars, lines, nodes)

    def heal(self) -> None:
        """See `Plant`."""
        self._law = air_law(self._air)
        self._valves.clear()
        for name, energised in self._wanted.items():
            self._move(name, energised=energised)
        self._sensors.heal()

    def advance(self, duration_s: float) -> None:
        """See `Plant`."""
        for _ in range(round(duration_s / _CHUNK_S)):
            self.time_s += _CHUNK_S
            while self._due and self._due[0][0] <= self.time_s:
                _, name, energised = self._due.pop(0)
                self._wanted[name] = energised
                self._move(name, energised=self._valves.get(name, energised))
            self._state.more[0] = self._duty
            advance_air(self._law, self._state, self._steps, _PER_CHUNK, 2**62, self._history_pa)
            self._steps += _PER_CHUNK

    def _move(self, channel: str, *, energised: bool) -> None:
        place = CHANNELS.index(channel)
        if self._state.goal[place] != float(energised):
            line = self._air.lines[place]
            self._state.goal[place] = float(energised)
            self._state.wait_s[place] = max(line.dead_s + line.dead_jitter_s * self._switching.gauss(0.0, 1.0), 0.0)


def _tendon(channel: str) -> int:
    """Node of a channel's tendons, where its sensor is."""
    return 2 + 2 * CHANNELS.index(channel)
