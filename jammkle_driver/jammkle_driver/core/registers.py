"""The registers of the board's own firmware, read from the one list of them, `config/registers.yaml`."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from itertools import groupby
from typing import TYPE_CHECKING, Any

import yaml

if TYPE_CHECKING:
    from collections.abc import Mapping


FIRMWARE_VERSION = 0x0100
"""Major * 256 + minor of the firmware that belongs to this driver."""

TABLES = {"coils": 1, "discrete_inputs": 2, "input_registers": 4, "holding_registers": 3}
"""The tables of the Modbus data model, each with the function that reads it."""


@dataclass(frozen=True)
class Register:
    """One register, or one bit of the two tables of bits.

    Attributes:
        name: Its name.
        address: Its address, from 0.
        unit: Unit of the value, or empty for a plain number.
        per_step: Value of one step, in `unit`.
        minimum: Smallest number taken.
        maximum: Largest number taken.
        default: Number after a start, if nothing is stored.
        stored: Whether the board can keep it over a reset.
        note: What it is.

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
    """Every register by table and name.

    Attributes:
        version: Of the list.
        tables: Registers by table, in the order of their addresses.
        bits: Names of the bits of the registers that hold bits, from bit 0 on.
        mirror: Address from which all input registers can be read as holding registers.

    """

    version: int
    tables: Mapping[str, tuple[Register, ...]]
    bits: Mapping[str, tuple[str, ...]]
    mirror: int

    def input(self, name: str) -> Register:
        """Return an input register."""
        return self._find("input_registers", name)

    def holding(self, name: str) -> Register:
        """Return a holding register."""
        return self._find("holding_registers", name)

    def coil(self, name: str) -> Register:
        """Return a coil."""
        return self._find("coils", name)

    def _find(self, table: str, name: str) -> Register:
        for register in self.tables[table]:
            if register.name == name:
                return register
        msg = f"no register '{name}' among the {table}"
        raise KeyError(msg)


def default_watchdog_s() -> float:
    """Return the silence of the host after which a board with the project's firmware lets go, s, as it is shipped."""
    return register_list().holding("watchdog_ms").default / 1000.0


@cache
def register_list() -> RegisterList:
    """Return the list, read once."""
    text = files("jammkle_driver").joinpath("config/registers.yaml").read_text(encoding="utf-8")
    content: dict[str, Any] = yaml.safe_load(text)
    tables = {
        table: tuple(Register(address=address, **entry) for address, entry in enumerate(content[table]))
        for table in TABLES
    }
    bits = {name: tuple(names) for name, names in content["bits"].items()}
    return RegisterList(content["version"], tables, bits, content["mirror"])


_AS_FIRST = "as of sensor 1"
"""What the list notes of the calibration of the sensors that follow."""
_PREFIXES = {"coils": "COIL", "discrete_inputs": "DISCRETE", "input_registers": "INPUT", "holding_registers": "HOLDING"}


def header_text() -> str:
    """Return `firmware/core/registers.h`."""
    registers = register_list()
    lines = [
        "/* Written from config/registers.yaml by `make readme`: edit that file. */",
        "#ifndef JAMMKLE_REGISTERS_H",
        "#define JAMMKLE_REGISTERS_H",
        "",
        "#include <stdbool.h>",
        "#include <stdint.h>",
        "",
        f"#define FIRMWARE_VERSION {FIRMWARE_VERSION:#06x}u",
        f"#define REGISTER_VERSION {registers.version}u",
        f"#define MIRROR_ADDRESS {registers.mirror}u",
        "",
    ]
    for table, prefix in _PREFIXES.items():
        entries = [f"{prefix}_{register.name.upper()}" for register in registers.tables[table]]
        lines += ["enum {", *(f"    {entry}," for entry in entries), f"    {prefix}_COUNT", "};", ""]
    for name, bits in registers.bits.items():
        lines.append("enum {")
        lines += [f"    {name.upper()}_{bit.upper()} = {1 << place}," for place, bit in enumerate(bits)]
        lines += ["};", ""]
    lines += [
        "typedef struct {",
        "    uint16_t minimum;",
        "    uint16_t maximum;",
        "    uint16_t default_value;",
        "} holding_range;",
        "",
        "static const holding_range HOLDING_RANGES[HOLDING_COUNT] = {",
        *(
            f"    {{{register.minimum}u, {register.maximum}u, {register.default}u}}, /* {register.name} */"
            for register in registers.tables["holding_registers"]
        ),
        "};",
        "",
        *_stored_lines(registers),
        "",
        "#endif",
        "",
    ]
    return "\n".join(lines)


def register_table() -> str:
    """Return all registers as a Markdown table for docs/hardware.md; registers that are alike share a line."""
    head = ("table", "address", "register", "unit of a step", "range", "default", "what")
    lines = [f"| {' | '.join(head)} |", f"|{'---|' * len(head)}"]
    for table, function in TABLES.items():
        name = f"{table.replace('_', ' ')} (read by function {function})"
        for _, alike in groupby(register_list().tables[table], _kind):
            lines.append(f"| {' | '.join(_cells(name, table, list(alike)))} |")
    lines += ["", *_bit_lines(register_list())]
    return "\n".join(lines)


def _kind(register: Register) -> str:
    """What registers that follow each other have in common: their name but for a number, or their note."""
    return register.note if register.note == _AS_FIRST else re.sub(r"\d", "", register.name)


def _stored_lines(registers: RegisterList) -> list[str]:
    stored = [register.address for register in registers.tables["holding_registers"] if register.stored]
    if stored != list(range(stored[0], stored[-1] + 1)):
        msg = "stored registers must follow each other: the firmware keeps them as one block"
        raise ValueError(msg)
    return [f"#define STORED_FIRST {stored[0]}u", f"#define STORED_COUNT {len(stored)}u"]


def _cells(name: str, table: str, alike: list[Register]) -> tuple[str, ...]:
    first, last = alike[0], alike[-1]
    writable = table == "holding_registers" and first.note != _AS_FIRST
    unit = f"{first.per_step:g} {first.unit}".replace(" 1", "") if first.unit and first.note != _AS_FIRST else ""
    return (
        name,
        str(first.address) if first is last else f"{first.address} to {last.address}",
        f"`{first.name}`" if first is last else f"`{first.name}` to `{last.name}`",
        unit,
        f"{first.minimum} to {first.maximum}" if writable else "",
        f"{first.default}{', can be stored' if first.stored else ''}" if writable else "",
        first.note,
    )


def _bit_lines(registers: RegisterList) -> list[str]:
    return [
        f"Bits of `{name}`: " + ", ".join(f"{place} {bit}" for place, bit in enumerate(bits)) + "."
        for name, bits in registers.bits.items()
    ]
