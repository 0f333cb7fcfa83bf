"""A small plant in plain Python: pump, manifold, solenoids, channels and sensors, any of which can be made to fail."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Protocol

from jammkle_driver.core.air import CRITICAL_RATIO, LINEAR_RATIO, REFERENCE_PA
from jammkle_driver.core.hardware import MANIFOLD
from jammkle_driver.fake.faults import FakeFault
from jammkle_driver.fake.sensors import FakeSensors, SensorErrors

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from jammkle_driver.core.air import AirSettings

STEP_S = 0.001
"""Time step of the plant, s: below the 1.3 ms in which a manifold with three open valves follows."""


class Plant(Protocol):
    """Pump, valves, volumes and sensors of one ankle, any of which can be made to fail."""

    @property
    def time_s(self) -> float:
        """Time since it was made, s."""

    @property
    def pump_ultimate_vacuum_pa(self) -> float:
        """Vacuum at which its pump stops drawing, Pa."""

    @property
    def pressures_pa(self) -> Mapping[str, float]:
        """True pressures by place, Pa absolute."""

    def command(self, solenoids: Mapping[str, bool], duty: float, late_s: float = 0.0) -> None:
        """Take a command, which reaches the valves `late_s` s later."""

    def advance(self, duration_s: float) -> None:
        """Let time pass."""

    def readings_pa(self) -> dict[str, float]:
        """Return what the sensors read, Pa absolute, by place; a dead one is left out."""

    def inject(self, fault: FakeFault, place: str, size: float = 0.0) -> None:
        """Let something fail now, and until `heal`; see `FakeFault`."""

    def heal(self) -> None:
        """Undo every fault."""


class FakePlant:
    """Isothermal volumes behind valves with dead time, and a pump with a linear curve; stepped by `advance`."""

    def __init__(
        self,
        channels: Sequence[str],
        air: AirSettings,
        ambient_pa: float,
        sensors: SensorErrors | None = None,
        seed: int = 0,
    ) -> None:
        """Make a vented plant, pump off."""
        self._names = tuple(channels)
        self._air = air
        self._ambient_pa = ambient_pa
        self._sensors = FakeSensors(sensors or SensorErrors(), seed)
        self.places = (MANIFOLD, *self._names)
        self.time_s = 0.0
        self.pressures_pa = dict.fromkeys(self.places, ambient_pa)
        self._volumes_m3 = dict(zip(self.places, air.volumes_m3, strict=True))
        self._leaks = dict.fromkeys(self.places, air.leak_conductance_m3_s_pa)
        self._lines = dict.fromkeys(self._names, 1.0)
        self._valves: dict[str, bool] = {}
        self._pump_share = 1.0
        self._wanted: list[tuple[float, str, bool]] = []
        self._open = dict.fromkeys(self._names, False)
        self._duty = 0.0

    @property
    def pump_ultimate_vacuum_pa(self) -> float:
        """See `Plant`."""
        return self._air.pump_ultimate_vacuum_pa

    @property
    def healthy_air(self) -> AirSettings:
        """What the plant is built of, without faults."""
        return replace(self._air)

    def command(self, solenoids: Mapping[str, bool], duty: float, late_s: float = 0.0) -> None:
        """Take a command; a valve moves after its dead time."""
        due_s = self.time_s + self._air.valve_dead_time_s + late_s
        self._wanted += [(due_s, name, energised) for name, energised in solenoids.items()]
        self._duty = duty

    def inject(self, fault: FakeFault, place: str, size: float = 0.0) -> None:
        """Let something fail now, and until `heal`.

        Args:
            fault: What fails.
            place: Channel or manifold; a pump's is not looked at.
            size: See `FakeFault`.

        """
        if fault is FakeFault.LEAK:
            self._leaks[place] = self._air.leak_conductance_m3_s_pa + size
        elif fault is FakeFault.BLOCKED:
            self._lines[place] = size
        elif fault in {FakeFault.STUCK_OPEN, FakeFault.STUCK_CLOSED}:
            self._valves[place] = fault is FakeFault.STUCK_OPEN
        elif fault in {FakeFault.PUMP_DEAD, FakeFault.PUMP_WEAK}:
            self._pump_share = 0.0 if fault is FakeFault.PUMP_DEAD else size
        else:
            self._sensors.inject(fault, place, size, self.pressures_pa[place], self.time_s)

    def heal(self) -> None:
        """Undo every fault."""
        self._leaks = dict.fromkeys(self.places, self._air.leak_conductance_m3_s_pa)
        self._lines = dict.fromkeys(self._names, 1.0)
        self._valves.clear()
        self._pump_share = 1.0
        self._sensors.heal()

    def advance(self, duration_s: float) -> None:
        """Let time pass."""
        for _ in range(round(duration_s / STEP_S)):
            self.time_s += STEP_S
            while self._wanted and self._wanted[0][0] <= self.time_s:
                _, name, energised = self._wanted.pop(0)
                self._open[name] = energised
            self._step()

    def readings_pa(self) -> dict[str, float]:
        """Return what the sensors read, Pa absolute, by place; a dead one is left out."""
        return self._sensors.readings_pa(self.pressures_pa, self.time_s)

    def is_open(self, channel: str) -> bool:
        """Return whether the channel is connected to the manifold, whatever was commanded."""
        return self._valves.get(channel, self._open[channel])

    def _step(self) -> None:
        air, pressures = self._air, self.pressures_pa
        manifold_pa = pressures[MANIFOLD]
        curve = max(1.0 - (self._ambient_pa - manifold_pa) / air.pump_ultimate_vacuum_pa, 0.0)
        into_manifold = -self._pump_share * self._duty * air.pump_free_flow_m3_s * curve * manifold_pa
        into_manifold += self._leaks[MANIFOLD] * _flow(self._ambient_pa, manifold_pa)
        for name in self._names:
            pressure_pa = pressures[name]
            line = self._lines[name] * air.valve_conductance_m3_s_pa
            into = self._leaks[name] * _flow(self._ambient_pa, pressure_pa)
            if self.is_open(name):
                drawn = line * _flow(pressure_pa, manifold_pa)
                into -= drawn
                into_manifold += drawn
            else:
                into += line * _flow(self._ambient_pa, pressure_pa)
            pressures[name] = pressure_pa + STEP_S * into / self._volumes_m3[name]
        pressures[MANIFOLD] = manifold_pa + STEP_S * into_manifold / self._volumes_m3[MANIFOLD]


def _flow(from_pa: float, to_pa: float) -> float:
    """Return flow per conductance, Pa^2: as `core.air.orifice`, for plain numbers."""
    if to_pa > from_pa:
        return -_flow(to_pa, from_pa)
    ratio = to_pa / from_pa
    bend = max(min(ratio, LINEAR_RATIO) - CRITICAL_RATIO, 0.0) / (1.0 - CRITICAL_RATIO)
    share = math.sqrt(1.0 - bend * bend)
    if ratio > LINEAR_RATIO:
        share *= (1.0 - ratio) / (1.0 - LINEAR_RATIO)
    return REFERENCE_PA * from_pa * share
