"""How a board is wired, the YAML file that says so, and the registers of the project's own firmware."""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass, field
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from jammkle_common.command.errors import InputError
from jammkle_common.names import CHANNELS
from jammkle_common.yaml_text import read_file
from jammkle_driver.core.hardware import MANIFOLD

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping


@dataclass(frozen=True)
class Register:
    """One register, or one bit of the two tables of bits.

    Its numbers, from `minimum` to `maximum`, count steps of `per_step` in `unit` (empty: a plain number). `default` is
    that after a start, if nothing is `stored` over a reset.
    """

    name: str
    address: int
    unit: str = ""
    per_step: float = 1.0
    minimum: int = 0
    maximum: int = 0xFFFF
    default: int = 0
    stored: bool = False
    note: str = ""

    def steps(self, value: float) -> int:
        """Return the number that stands for a value; the nearest one, bounded to what is taken."""
        return min(max(round(value / self.per_step), self.minimum), self.maximum)

    def value(self, steps: int) -> float:
        """Return the value that a number stands for."""
        return steps * self.per_step


@dataclass(frozen=True)
class RegisterList:
    """Every register by table and name, in the order of their addresses; names of bits from bit 0 on.

    All input registers can be read as holding registers from the address `mirror` on. `firmware_version` is that of the
    firmware that belongs to this driver.
    """

    version: int
    firmware_version: int
    tables: Mapping[str, tuple[Register, ...]]
    bits: Mapping[str, tuple[str, ...]]
    mirror: int

    def input(self, name: str) -> Register:
        """Return an input register."""
        return self._find("input_registers", name)

    def holding(self, name: str) -> Register:
        """Return a holding register."""
        return self._find("holding_registers", name)

    def _find(self, table: str, name: str) -> Register:
        return next(register for register in self.tables[table] if register.name == name)


@cache
def register_list() -> RegisterList:
    """Return the list of `config/registers.yaml`, read once."""
    text = files("jammkle_driver").joinpath("config/registers.yaml").read_text(encoding="utf-8")
    content: dict[str, Any] = yaml.safe_load(text)
    tables = {
        table: tuple(Register(address=address, **entry) for address, entry in enumerate(content[table]))
        for table in ("coils", "discrete_inputs", "input_registers", "holding_registers")
    }
    bits = {name: tuple(names) for name, names in content["bits"].items()}
    return RegisterList(content["version"], content["firmware_version"], tables, bits, content["mirror"])


def default_watchdog_s() -> float:
    """Return the silence of the host after which a board with the project's firmware lets go, s, as it is shipped."""
    return register_list().holding("watchdog_ms").default / 1000.0


class Firmware(enum.Enum):
    """Whose firmware the board has."""

    JAMMKLE = "jammkle"
    """The one of this project: watchdog, latched safe state, supply and counters are there."""
    OTHER = "other"
    """Any other Modbus server: coils and registers, and nothing that makes it safe."""


@dataclass(frozen=True)
class Solenoid:
    """One channel's solenoid: a coil. `inverted`: 0 energises."""

    coil: int
    inverted: bool = False

    def bit(self, *, energised: bool) -> bool:
        """Return what the coil must be."""
        return energised != self.inverted


@dataclass(frozen=True)
class Pump:
    """The pump: a holding register that takes a duty, or a coil that only switches.

    The register has `at_zero` for duty 0 and `at_full` for duty 1, which is less for a drive that runs faster with
    less. The coil is on above the duty `threshold`; `inverted`: 0 runs the pump.
    """

    register: int | None = None
    coil: int | None = None
    at_zero: int = 0
    at_full: int = 1000
    threshold: float = 0.5
    inverted: bool = False

    def number(self, duty: float) -> int:
        """Return the register's number for a duty from 0 to 1."""
        return round(self.at_zero + (self.at_full - self.at_zero) * min(max(duty, 0.0), 1.0))

    def bit(self, duty: float) -> bool:
        """Return what the coil must be for a duty from 0 to 1."""
        return (duty > self.threshold) != self.inverted


@dataclass(frozen=True)
class Sensor:
    """One pressure sensor: a register of the table `input` or `holding`, and the line from its number to Pa.

    `signed` numbers are 16-bit two's complements. The pressure is `offset_pa` and `scale` Pa per step, absolute or, for
    `vacuum`, below ambient and positive. Below `minimum` and above `maximum` the sensor counts as broken.
    """

    register: int
    table: str = "input"
    signed: bool = False
    scale: float = 1.0
    offset_pa: float = 0.0
    vacuum: bool = False
    minimum: int = -0x8000
    maximum: int = 0xFFFF

    def value(self, number: int) -> int:
        """Return what the 16 bits of a register stand for."""
        return number - 0x10000 if self.signed and number >= 0x8000 else number  # noqa: PLR2004 - two's complement

    def pascals(self, number: int) -> float:
        """Return what the number stands for, Pa; NaN outside the limits, as a broken wire gives."""
        value = self.value(number)
        return self.offset_pa + self.scale * value if self.minimum <= value <= self.maximum else math.nan

    def absolute_pa(self, measured_pa: float, ambient_pa: float) -> float:
        """Return the pressure behind what was measured, Pa absolute; vacuum is counted from `ambient_pa`."""
        return ambient_pa - measured_pa if self.vacuum else measured_pa


@dataclass(frozen=True)
class Wiring:
    """Everything that a board file says.

    Attributes:
        unit: Address of the board on the line, 1 to 247.
        rate_hz: How often outputs are written and all sensors read, 1/s.
        watchdog_ms: For the project's firmware: silence after which it goes to its safe state, ms.
        solenoids: By channel.
        sensors: By place: channels, and `manifold` if it has one.
        on_connect: Numbers that are written to holding registers whenever the link comes up, such as the time of a
            watchdog that the board has itself.
    """

    firmware: Firmware
    pump: Pump
    solenoids: Mapping[str, Solenoid]
    sensors: Mapping[str, Sensor]
    unit: int = 1
    baud_rate: int = 115200
    parity: str = "N"
    stop_bits: int = 1
    reply_timeout_s: float = 0.03
    rate_hz: float = 100.0
    watchdog_ms: int = field(default_factory=lambda: register_list().holding("watchdog_ms").default)
    on_connect: Mapping[int, int] = field(default_factory=dict)


SENSORS = 4
"""Pressure sensors that the project's firmware reads."""

_LARGEST_ADDRESS = 0xFFFF
_LARGEST_UNIT = 247
"""Highest address of a server on a serial line (MODBUS over Serial Line V1.02, 2.2)."""

_WATCHDOG = register_list().holding("watchdog_ms")


_BOUNDS: dict[str, tuple[float, float]] = {
    "unit": (1, _LARGEST_UNIT),
    "baud_rate": (1200, 4_000_000),
    "stop_bits": (1, 2),
    "reply_timeout_s": (0.005, 5.0),
    "rate_hz": (1.0, 1000.0),
    "watchdog_ms": (_WATCHDOG.minimum, _WATCHDOG.maximum),
    "register": (0, _LARGEST_ADDRESS),
    "coil": (0, _LARGEST_ADDRESS),
    "at_zero": (0, 0xFFFF),
    "at_full": (0, 0xFFFF),
    "threshold": (0.0, 1.0),
    "scale": (-1e6, 1e6),
    "offset_pa": (-1e6, 1e6),
    "minimum": (-0x8000, 0xFFFF),
    "maximum": (-0x8000, 0xFFFF),
}
_CHOICES = {"parity": ("N", "E", "O"), "table": ("input", "holding"), "firmware": tuple(f.value for f in Firmware)}


def standard_board_file() -> Path:
    """Return the file for the project's own firmware, as it is shipped."""
    return Path(str(files("jammkle_driver").joinpath("config/board.yaml")))


def load_wiring(path: Path | None) -> Wiring:
    """Read a board file; None takes the shipped one.

    Raises:
        InputError: it cannot be read, or says something that cannot be.

    """
    path = path or standard_board_file()
    content = read_file(path, f"board file {path}")
    try:
        return _wiring(content)
    except InputError as error:
        msg = f"board file {path}: {error}"
        raise InputError(msg) from error


def _wiring(content: object) -> Wiring:
    entries = _mapping("the file", content)
    solenoids = _mapping("solenoids", entries.pop("solenoids", None))
    sensors = _mapping("sensors", entries.pop("sensors", None))
    pump = _mapping("pump", entries.pop("pump", None))
    on_connect = _mapping("on_connect", entries.pop("on_connect", {}))
    if set(solenoids) != set(CHANNELS):
        msg = f"solenoids names {', '.join(solenoids) or 'none'}; it must name {', '.join(CHANNELS)}"
        raise InputError(msg)
    strangers = sorted(set(sensors) - {*CHANNELS, MANIFOLD})
    missing = [channel for channel in CHANNELS if channel not in sensors]
    if strangers or missing:
        msg = f"sensors must name {', '.join(CHANNELS)}, and may name {MANIFOLD}; wrong: {(strangers + missing)[0]}"
        raise InputError(msg)
    made = Wiring(
        pump=_made(Pump, "pump", pump),
        solenoids={name: _made(Solenoid, f"solenoid {name}", _mapping(name, solenoids[name])) for name in CHANNELS},
        sensors={name: _made(Sensor, f"sensor {name}", _mapping(name, entry)) for name, entry in sensors.items()},
        on_connect={
            int(_checked("on_connect", "register", key, 0)): int(_checked("on_connect", "at_zero", value, 0))
            for key, value in on_connect.items()
        },
        **_checked_entries(Wiring, "", {"firmware": Firmware.OTHER.value, **entries}),
    )
    for problem in _problems(made):
        raise InputError(problem)
    return made


def _mapping(name: str, content: object) -> dict[Any, Any]:
    if not isinstance(content, dict):
        msg = f"{name} is {content!r}; it must be a list of names and values"
        raise InputError(msg)
    return dict(content)


def _made(kind: Any, name: str, entries: dict[str, Any]) -> Any:
    try:
        return kind(**_checked_entries(kind, name, entries))
    except TypeError as error:
        msg = f"{name} lacks a value: {error}"
        raise InputError(msg) from error


def _checked_entries(kind: Any, name: str, entries: dict[str, Any]) -> dict[str, Any]:
    known = {key for key in kind.__dataclass_fields__ if key not in ("pump", "solenoids", "sensors", "on_connect")}
    for key in entries:
        if key not in known:
            msg = f"{name or 'the file'} says '{key}', which means nothing; known are {', '.join(sorted(known))}"
            raise InputError(msg)
    fields = kind.__dataclass_fields__
    checked = {key: _checked(name, key, value, fields[key].default) for key, value in entries.items()}
    if "firmware" in checked:
        checked["firmware"] = Firmware(checked["firmware"])
    return checked


def _checked(name: str, key: str, value: object, default: object) -> Any:
    where = f"{key} of {name}" if name else key
    if key in _CHOICES:
        if value not in _CHOICES[key]:
            msg = f"{where} is {value!r}; it must be one of {', '.join(_CHOICES[key])}"
            raise InputError(msg)
        return value
    if isinstance(default, bool):
        if not isinstance(value, bool):
            msg = f"{where} is {value!r}; it must be true or false"
            raise InputError(msg)
        return value
    whole = not isinstance(default, float)
    low, high = _BOUNDS[key]
    number = isinstance(value, int) or (isinstance(value, float) and not whole)
    if isinstance(value, bool) or not number or not low <= float(str(value)) <= high:
        msg = f"{where} is {value!r}; it must be a {'whole ' if whole else ''}number from {low:g} to {high:g}"
        raise InputError(msg)
    return value


def _problems(wiring: Wiring) -> Iterator[str]:
    """Yield what cannot be, though each value can: two outputs on one coil are a typing error."""
    pump = wiring.pump
    if (pump.register is None) == (pump.coil is None):
        yield "pump needs either register (a duty) or coil (on and off)"
    if pump.register is not None and pump.at_zero == pump.at_full:
        yield f"pump: at_zero and at_full are both {pump.at_zero}; the pump would never change"
    if pump.register in wiring.on_connect:
        yield f"on_connect writes register {pump.register}, which is the pump's; it must be left to the driver"
    coils = [solenoid.coil for solenoid in wiring.solenoids.values()] + ([] if pump.coil is None else [pump.coil])
    registers = [(sensor.table, sensor.register) for sensor in wiring.sensors.values()]
    used = [f"coil {coil}" for coil in coils] + [f"{table} register {address}" for table, address in registers]
    for each in used:
        if used.count(each) > 1:
            yield f"{each} is used twice; give each pump, solenoid and sensor its own"
    for name, sensor in wiring.sensors.items():
        if sensor.scale == 0.0 or sensor.minimum >= sensor.maximum:
            yield f"sensor {name}: scale must not be 0, and minimum must be below maximum"
    if wiring.firmware is Firmware.JAMMKLE:
        yield from _problems_of_own(wiring)


def _problems_of_own(wiring: Wiring) -> Iterator[str]:
    registers, pump, solenoids = register_list(), wiring.pump, wiring.solenoids.values()
    full = registers.holding("pump_duty").maximum
    free = registers.holding("supply_minimum").address
    addresses = {register.address for register in registers.tables["input_registers"][:SENSORS]}
    if pump.register != registers.holding("pump_duty").address:
        yield "pump: the firmware jammkle takes the duty in register 1"
    if (pump.at_zero, pump.at_full) != (0, full):
        yield f"pump: the firmware jammkle has at_zero 0 and at_full {full}; with others its safe state would run it"
    period_ms = 1000.0 / wiring.rate_hz
    if period_ms >= wiring.watchdog_ms:
        yield (
            f"rate_hz is {wiring.rate_hz:g}, a command each {period_ms:.0f} ms, and watchdog_ms {wiring.watchdog_ms}: "
            "the board would let go between two commands; raise one of them"
        )
    if any(address < free for address in wiring.on_connect):
        yield f"on_connect: registers below {free} of the firmware jammkle are the driver's; see watchdog_ms here"
    names = ("sensor_1_raw_low", f"sensor_{SENSORS}_pressure_high")
    first, last = (registers.holding(name).address for name in names)
    if any(first <= address <= last for address in wiring.on_connect):
        yield f"on_connect: registers {first} to {last} hold what `jammkle hardware check` calibrates; leave them to it"
    if any(sensor.vacuum for sensor in wiring.sensors.values()):
        yield "sensors: the firmware jammkle gives absolute pressures; vacuum must be false"
    if any(solenoid.coil >= len(registers.tables["coils"]) for solenoid in solenoids):
        yield "solenoids: the firmware jammkle has coils 0 to 2"
    if any(sensor.table != "input" or sensor.register not in addresses for sensor in wiring.sensors.values()):
        yield "sensors: the firmware jammkle has input registers 0 to 3"
    if any(solenoid.inverted for solenoid in solenoids):
        yield "solenoids: inverted would turn the safe state of the firmware jammkle into its opposite; wire them so"
