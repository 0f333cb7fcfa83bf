"""What is written from the list of registers: the firmware's header, and the table for people."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jammkle_driver.core.registers import FIRMWARE_VERSION, TABLES, register_list

if TYPE_CHECKING:
    from jammkle_driver.core.registers import Register, RegisterList

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
    """Return all registers as a Markdown table for docs/hardware.md."""
    head = ("table", "address", "register", "unit of a step", "range", "default", "what")
    lines = [f"| {' | '.join(head)} |", f"|{'---|' * len(head)}"]
    for table, function in TABLES.items():
        name = f"{table.replace('_', ' ')} (read by function {function})"
        lines += [f"| {' | '.join(_cells(name, table, register))} |" for register in register_list().tables[table]]
    lines += ["", *_bit_lines(register_list())]
    return "\n".join(lines)


def _stored_lines(registers: RegisterList) -> list[str]:
    stored = [register.address for register in registers.tables["holding_registers"] if register.stored]
    if stored != list(range(stored[0], stored[-1] + 1)):
        msg = "stored registers must follow each other: the firmware keeps them as one block"
        raise ValueError(msg)
    return [f"#define STORED_FIRST {stored[0]}u", f"#define STORED_COUNT {len(stored)}u"]


def _cells(name: str, table: str, register: Register) -> tuple[str, ...]:
    writable = table == "holding_registers"
    unit = f"{register.per_step:g} {register.unit}".replace(" 1", "") if register.unit else ""
    return (
        name,
        str(register.address),
        f"`{register.name}`",
        unit,
        f"{register.minimum} to {register.maximum}" if writable else "",
        f"{register.default}{', can be stored' if register.stored else ''}" if writable else "",
        register.note,
    )


def _bit_lines(registers: RegisterList) -> list[str]:
    return [
        f"Bits of `{name}`: " + ", ".join(f"{place} {bit}" for place, bit in enumerate(bits)) + "."
        for name, bits in registers.bits.items()
    ]
