"""What is made from the code: the tables of README.md and docs/hardware.md, and the firmware's header of registers.

`python test/readme_tables.py` writes them; a test fails when they differ.
"""

from __future__ import annotations

import re
from pathlib import Path

from jammkle_controller.parameters import ControllerParameters
from jammkle_driver.core.register_texts import header_text, register_table
from jammkle_driver.parameters import DriverParameters
from jammkle_gap.monitor.parameters import GapMonitorParameters
from jammkle_graph.names import ACTIONS, CHANNELS, SERVICES, TOPICS
from jammkle_graph.parameters import ParameterClass, ParameterRow, Value, rows
from jammkle_sim.parameters import SimParameters
from jammkle_sim.rigs.catalogue import RIGS

ROOT = Path(__file__).parents[1]
README = ROOT / "README.md"
HARDWARE = ROOT / "docs" / "hardware.md"
HEADER = ROOT / "jammkle_driver" / "firmware" / "core" / "registers.h"
NODES: dict[str, type[ParameterClass]] = {
    "driver": DriverParameters,
    "controller": ControllerParameters,
    "sim": SimParameters,
    "gap_monitor": GapMonitorParameters,
}


def table(head: tuple[str, ...], lines: list[tuple[str, ...]]) -> str:
    """Markdown table without repeated lines; a bar inside a cell would end the cell, so it is escaped."""
    unique = list(dict.fromkeys(tuple(cell.replace("|", "\\|") for cell in line) for line in lines))
    return "\n".join(
        [f"| {' | '.join(head)} |", f"|{'---|' * len(head)}", *(f"| {' | '.join(line)} |" for line in unique)]
    )


def any_channel(name: str) -> str:
    """Write `<channel>` for the name of a channel at its start."""
    return re.sub(rf"\b({'|'.join(CHANNELS)})/", "<channel>/", name)


def value_text(value: Value) -> str:
    """Value as it stands in a YAML file."""
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:g}" if isinstance(value, float) else str(value)


def option_line(row: ParameterRow) -> tuple[str, ...]:
    """One line of a table of options of the command."""
    name, *rest = parameter_line(row)
    return (f"`--{name.strip('`').replace('_', '-')}`", *rest)


def parameter_line(row: ParameterRow) -> tuple[str, ...]:
    """One line of a parameter table."""
    default = f"{value_text(row.default)} {row.unit}".rstrip()
    description = row.description.rstrip(".") + (" (may be changed while running)" if row.dynamic else "")
    return (f"`{row.name}`", default, row.range_text, description)


def tables() -> dict[str, str]:
    """Every table by the name of its place in the README."""
    made = {
        "topics": table(
            ("topic", "type", "delivery", "what"),
            [(f"`{any_channel(t.name)}`", f"`{t.message_type}`", t.kind.value, t.note) for t in TOPICS],
        ),
        "services": table(
            ("service", "type", "what"),
            [(f"`{any_channel(s.path)}`", f"`{s.service_type}`", s.note) for s in SERVICES],
        ),
        "actions": table(
            ("action", "type", "what"),
            [(f"`{a.path}`", f"`{a.action_type}`", a.note) for a in ACTIONS],
        ),
    }
    for node, parameters in NODES.items():
        made[f"parameters of {node}"] = table(
            ("parameter", "default", "range", "what"), [parameter_line(row) for row in rows(parameters)]
        )
    for rig in RIGS.values():
        made[f"options of rig {rig.name}"] = table(
            ("option", "default", "range", "what"), [option_line(row) for row in rows(rig.options)]
        )
    return made


def filled(path: Path) -> str:
    """Return the text of a page with every table as the code has it."""
    text = path.read_text()
    for name, made in (tables() if path == README else {"registers": register_table()}).items():
        begin, end = f"<!-- table: {name} -->", "<!-- end of table -->"
        pattern = re.compile(rf"{re.escape(begin)}\n.*?{re.escape(end)}", re.DOTALL)
        if not pattern.search(text):
            msg = f"{path.name} has no place for the table '{name}': add the lines '{begin}' and '{end}'"
            raise ValueError(msg)
        text = pattern.sub(lambda _, block=f"{begin}\n{made}\n{end}": block, text)
    return text


def made() -> dict[Path, str]:
    """Return every file that is made from the code, whole or in part, with its text."""
    return {README: filled(README), HARDWARE: filled(HARDWARE), HEADER: header_text()}


if __name__ == "__main__":
    for target, content in made().items():
        target.write_text(content)
