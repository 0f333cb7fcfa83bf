"""An ankle of plain numbers behind a board, each part of which can be made to fail: hardware `fake`, and for tests."""

from __future__ import annotations

import enum
import math
import random
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from jammkle_common.command.errors import InputError
from jammkle_common.names import CHANNELS
from jammkle_driver.board.wiring import default_watchdog_s
from jammkle_driver.core.air import CRITICAL_RATIO, LINEAR_RATIO, REFERENCE_PA
from jammkle_driver.core.hardware import MANIFOLD, LinkState, LinkStatus, ResetCause, SafeCause, released

if TYPE_CHECKING:
    from collections.abc import Mapping

    from jammkle_driver.core.air import AirSettings
    from jammkle_driver.core.hardware import ActuatorCommand


class FakeFault(enum.Enum):
    """What can be made to fail; the size's meaning and unit stand beside it."""

    LEAK = "leak"
    """Sonic conductance of the hole, m^3/(s Pa)."""
    BLOCKED = "blocked"
    """Share of the line's conductance that is left, 0 to 1."""
    STUCK_OPEN = "stuck_open"
    """The valve stays at the manifold; no size."""
    STUCK_CLOSED = "stuck_closed"
    """The valve stays at the vent; no size."""
    PUMP_DEAD = "pump_dead"
    """No size."""
    PUMP_WEAK = "pump_weak"
    """Share of the flow that is left, 0 to 1."""
    SENSOR_DEAD = "sensor_dead"
    """No reading comes; no size."""
    SENSOR_STUCK = "sensor_stuck"
    """The reading stands still where it is; no size."""
    SENSOR_DRIFT = "sensor_drift"
    """Rate at which the reading runs away, Pa/s."""
    SENSOR_BIAS = "sensor_bias"
    """How much the sensor reads too high from now on, Pa."""
    SENSOR_OUT_OF_RANGE = "sensor_out_of_range"
    """What is read, Pa absolute."""


class LinkFault(enum.Enum):
    """What can be made to fail at the board, and on the line to it; the size's meaning stands beside it."""

    UNPLUGGED = "unplugged"
    """The cable is pulled; no size."""
    REBOOTED = "rebooted"
    """The board starts anew, by its reset pin; no size."""
    BROWN_OUT = "brown_out"
    """The supply falls below what the board works with; no size."""
    LINE_NOISE = "line_noise"
    """Share of telegrams whose check sum is wrong, 0 to 1."""


@dataclass(frozen=True)
class SensorErrors:
    """Noise of each reading, step of the converter (0: none), and offsets of the sensors by place, Pa."""

    noise_pa: float = 50.0
    step_pa: float = 0.0
    offsets_pa: Mapping[str, float] = field(default_factory=dict)


PLANT_STEP_S = 0.001
"""Time step of the plant, s: below the 1.3 ms in which a manifold with three open valves follows."""


class FakePlant:
    """Isothermal volumes behind valves with dead time, a pump with a linear curve, and sensors; any may fail.

    It is built of `air` where nothing has failed; `pressures_pa` are the true ones by place, absolute.
    """

    def __init__(self, air: AirSettings, ambient_pa: float, sensors: SensorErrors | None = None, seed: int = 0) -> None:
        """Make a vented plant, pump off, in an atmosphere of so many Pa; the sensors' noise comes from `seed`."""
        self.air = air
        self.time_s = 0.0
        self.pressures_pa = dict.fromkeys((MANIFOLD, *CHANNELS), ambient_pa)
        self._ambient_pa = ambient_pa
        self._errors = sensors or SensorErrors()
        self._random = random.Random(seed)  # noqa: S311, sensor noise and not a secret
        self._volumes_m3 = dict(zip(self.pressures_pa, air.volumes_m3, strict=True))
        self._wanted: list[tuple[float, str, bool]] = []
        self._open = dict.fromkeys(CHANNELS, False)
        self._duty = 0.0
        self.heal()

    def heal(self) -> None:
        """Undo every fault."""
        self._leaks = dict.fromkeys(self.pressures_pa, self.air.leak_conductance_m3_s_pa)
        self._lines = dict.fromkeys(CHANNELS, 1.0)
        self._valves: dict[str, bool] = {}
        self._pump_share = 1.0
        self._dead: set[str] = set()
        self._stuck_pa: dict[str, float] = {}
        self._drift: dict[str, tuple[float, float]] = {}
        self._bias_pa: dict[str, float] = {}

    def inject(self, fault: FakeFault, place: str, size: float = 0.0) -> None:
        """Let something fail now, and until `heal`, at a channel or the manifold; `size` as `FakeFault` says."""
        if fault is FakeFault.LEAK:
            self._leaks[place] = self.air.leak_conductance_m3_s_pa + size
        elif fault is FakeFault.BLOCKED:
            self._lines[place] = size
        elif fault in {FakeFault.STUCK_OPEN, FakeFault.STUCK_CLOSED}:
            self._valves[place] = fault is FakeFault.STUCK_OPEN
        elif fault in {FakeFault.PUMP_DEAD, FakeFault.PUMP_WEAK}:
            self._pump_share = 0.0 if fault is FakeFault.PUMP_DEAD else size
        elif fault is FakeFault.SENSOR_DEAD:
            self._dead.add(place)
        elif fault is FakeFault.SENSOR_STUCK:
            self._stuck_pa[place] = self._reading_pa(place)
        elif fault is FakeFault.SENSOR_DRIFT:
            self._drift[place] = (self.time_s, size)
        elif fault is FakeFault.SENSOR_BIAS:
            self._bias_pa[place] = size
        else:
            self._stuck_pa[place] = size

    def readings_pa(self) -> dict[str, float]:
        """Return what the sensors read, Pa absolute, by place; a dead one is left out."""
        return {
            place: self._stuck_pa[place] if place in self._stuck_pa else self._reading_pa(place)
            for place in self.pressures_pa
            if place not in self._dead
        }

    def command(self, solenoids: Mapping[str, bool], duty: float, late_s: float = 0.0) -> None:
        """Take a command, which reaches the valves `late_s` s later; each moves after its dead time."""
        due_s = self.time_s + self.air.valve_dead_time_s + late_s
        self._wanted += [(due_s, name, energised) for name, energised in solenoids.items()]
        self._duty = duty

    def advance(self, duration_s: float) -> None:
        """Let time pass."""
        for _ in range(round(duration_s / PLANT_STEP_S)):
            self.time_s += PLANT_STEP_S
            while self._wanted and self._wanted[0][0] <= self.time_s:
                _, name, energised = self._wanted.pop(0)
                self._open[name] = energised
            self._step()

    def _reading_pa(self, place: str) -> float:
        since_s, rate_pa_s = self._drift.get(place, (0.0, 0.0))
        error_pa = self._errors.offsets_pa.get(place, 0.0) + rate_pa_s * (self.time_s - since_s)
        error_pa += self._bias_pa.get(place, 0.0)
        reading_pa = self.pressures_pa[place] + error_pa + self._random.gauss(0.0, self._errors.noise_pa)
        step_pa = self._errors.step_pa
        return round(reading_pa / step_pa) * step_pa if step_pa else reading_pa

    def _step(self) -> None:
        air, pressures = self.air, self.pressures_pa
        manifold_pa = pressures[MANIFOLD]
        curve = max(1.0 - (self._ambient_pa - manifold_pa) / air.pump_ultimate_vacuum_pa, 0.0)
        into_manifold = -self._pump_share * self._duty * air.pump_free_flow_m3_s * curve * manifold_pa
        into_manifold += self._leaks[MANIFOLD] * _flow(self._ambient_pa, manifold_pa)
        for name in CHANNELS:
            pressure_pa = pressures[name]
            line = self._lines[name] * air.valve_conductance_m3_s_pa
            into = self._leaks[name] * _flow(self._ambient_pa, pressure_pa)
            if self._valves.get(name, self._open[name]):
                drawn = line * _flow(pressure_pa, manifold_pa)
                into -= drawn
                into_manifold += drawn
            else:
                into += line * _flow(self._ambient_pa, pressure_pa)
            pressures[name] = pressure_pa + PLANT_STEP_S * into / self._volumes_m3[name]
        pressures[MANIFOLD] = manifold_pa + PLANT_STEP_S * into_manifold / self._volumes_m3[MANIFOLD]


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


WATCHDOG_S = default_watchdog_s()
"""Silence of the host after which the board lets go, s."""

STEP_S = 0.01
"""Time by which a board and its plant go on at once, s."""

_SUPPLY_V, _SAGGED_V = 12.0, 8.0


class FakeBoard:
    """Outputs, host watchdog, latches and the link to them, before a plant.

    `driven` is what the outputs do, `noise_share` the share of telegrams whose check sum is wrong, for who exchanges
    them.
    """

    def __init__(self, plant: FakePlant) -> None:
        """Make one that is connected and drives nothing."""
        self.plant = plant
        self.link = LinkStatus(LinkState.CONNECTED, supply_v=_SUPPLY_V, starts=1, connects=1)
        self.noise_share = 0.0
        self.driven: ActuatorCommand = released(CHANNELS)
        self._silent_s = 0.0

    def take(self, command: ActuatorCommand, late_s: float = 0.0) -> None:
        """Take a command, which the valves get `late_s` s later: a sign of life; latched, it takes none that jams."""
        self._silent_s = 0.0
        if command != self.driven and not (self.link.latched and any(command.solenoids.values())):
            self._drive(command, late_s)

    def advance(self, duration_s: float) -> None:
        """Let time pass, and let go once no command came for `WATCHDOG_S`."""
        for _ in range(round(duration_s / STEP_S)):
            self.plant.advance(STEP_S)
            self._silent_s += STEP_S
            if self._silent_s >= WATCHDOG_S and self.driven != released(CHANNELS):
                self._latch(SafeCause.HOST_SILENT)

    def count(self, exchanges: int, crc_errors: int) -> None:
        """Count telegrams that were answered, and those with a wrong check sum."""
        self.link = replace(
            self.link, exchanges=self.link.exchanges + exchanges, crc_errors=self.link.crc_errors + crc_errors
        )

    def acknowledge(self) -> None:
        """Take jams again."""
        self.link = replace(self.link, latched=frozenset())

    def inject(self, fault: FakeFault | LinkFault, place: str = MANIFOLD, size: float = 0.0) -> None:
        """Let something fail at board or line, or in the plant, where `place` counts; `size` stands at the fault."""
        if isinstance(fault, FakeFault):
            self.plant.inject(fault, place, size)
        elif fault is LinkFault.UNPLUGGED:
            self.link = replace(self.link, state=LinkState.LOST, detail="no such device")
        elif fault is LinkFault.REBOOTED:
            self.reboot()
        elif fault is LinkFault.BROWN_OUT:
            self._latch(SafeCause.SUPPLY_LOW)
            self.link = replace(self.link, supply_v=_SAGGED_V)
        else:
            self.noise_share = size

    def heal(self) -> None:
        """Repair everything; what is latched stays until it is acknowledged."""
        self.plant.heal()
        self.noise_share = 0.0
        self.plug()

    def plug(self) -> None:
        """Put the cable in again, with a supply that is well."""
        connects = self.link.connects + int(self.link.state is not LinkState.CONNECTED)
        self.link = replace(self.link, state=LinkState.CONNECTED, detail="", supply_v=_SUPPLY_V, connects=connects)

    def reboot(self, cause: ResetCause = ResetCause.EXTERNAL) -> None:
        """Start anew."""
        self._latch(SafeCause.RESET)
        self.link = replace(self.link, reset_cause=cause, starts=self.link.starts + 1)

    def _latch(self, cause: SafeCause) -> None:
        self._drive(released(CHANNELS), 0.0)
        self.link = replace(self.link, latched=self.link.latched | {cause})

    def _drive(self, command: ActuatorCommand, late_s: float) -> None:
        self.driven = command
        self.plant.command(command.solenoids, command.pump_duty, late_s)


HEAL = "heal"
_WORDS = "TIME_S FAULT [PLACE [SIZE]]"
"""Of what befalls the board or its line there is no PLACE."""


@dataclass(frozen=True)
class ScriptedFault:
    """One line of a script: when, s after the start, what fails (None heals everything), where, and how much."""

    time_s: float
    fault: FakeFault | LinkFault | None
    place: str
    size: float


def read_script(text: str) -> tuple[ScriptedFault, ...]:
    """Return what a script says, in the order of time; empty lines and what follows a # are left out.

    Raises:
        InputError: a line cannot be understood.

    """
    lines = [
        (number, line.split("#")[0].split()) for number, line in enumerate(text.replace(";", "\n").splitlines(), 1)
    ]
    return tuple(sorted((_line(number, words) for number, words in lines if words), key=lambda each: each.time_s))


def _line(number: int, words: list[str]) -> ScriptedFault:
    known: dict[str, FakeFault | LinkFault] = {fault.value: fault for fault in (*FakeFault, *LinkFault)}
    places = (MANIFOLD, *CHANNELS)
    word = words[1] if len(words) > 1 else ""
    if word not in {HEAL, *known}:
        choices = ", ".join((HEAL, *known))
        msg = f"line {number} of the script of faults has '{word}'; it must be {_WORDS} with one of: {choices}"
        raise InputError(msg)
    sizes = words[2:3] if isinstance(known.get(word), LinkFault) else words[3:4]
    place = words[2] if len(words) > 2 and sizes != words[2:3] else MANIFOLD  # noqa: PLR2004 - the third word
    if place not in places:
        msg = f"line {number} of the script of faults has '{place}'; the place must be one of: {', '.join(places)}"
        raise InputError(msg)
    if place == MANIFOLD and known.get(word) in {FakeFault.BLOCKED, FakeFault.STUCK_OPEN, FakeFault.STUCK_CLOSED}:
        msg = f"line {number} of the script of faults: {word} needs a channel, one of: {', '.join(CHANNELS)}"
        raise InputError(msg)
    try:
        time_s, size = float(words[0]), float(sizes[0]) if sizes else 0.0
    except ValueError as error:
        msg = f"line {number} of the script of faults: {error}; it must be {_WORDS}"
        raise InputError(msg) from error
    return ScriptedFault(time_s, known.get(word), place, size)
