"""The registers of the board's own firmware, read from the one list of them, `config/registers.yaml`."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from importlib.resources import files
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

    All input registers can be read as holding registers from the address `mirror` on.
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
