"""`jammkle gap effects`: which effects a diagnosis may name, and what it fits of each."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rich.markup import escape
from rich.table import Table

from jammkle_common.command import results
from jammkle_gap.inputs import library_of

if TYPE_CHECKING:
    from pathlib import Path

    from jammkle_gap.core.effects import Effect, Library


def effects(library: Path | None, json: Path | None) -> int:
    """List the library, and return the exit code.

    Args:
        library: Effects of the user's own (YAML), beside the built-in ones.
        json: Where the list is written too.

    Raises:
        InputError: the library or the file cannot be used.

    """
    results.check_writable(json)
    offered = library_of(library, (), ())
    results.console().print(_table(offered))
    results.write_json(json, {"effects": [_content(effect) for effect in offered]})
    return 0


def _table(library: Library) -> Table:
    table = Table(title=f"{len(library.effects)} effects on offer", title_justify="left")
    table.add_column("effect", overflow="fold")
    table.add_column("subsystem", overflow="fold")
    table.add_column("parameter", overflow="fold")
    table.add_column("null", justify="right")
    table.add_column("fitted within", overflow="fold")
    for effect in sorted(library, key=lambda each: each.subsystem):
        for place, each in enumerate(effect.parameters):
            unit = "" if each.unit == "1" else f" {each.unit}"
            span = f"{each.minimum:g} to {each.maximum:g}{unit}"
            first = (effect.name, effect.subsystem) if place == 0 else ("", "")
            table.add_row(*(escape(cell) for cell in (*first, each.name, f"{each.null:g}", span)))
    return table


def _content(effect: Effect) -> dict[str, Any]:
    return {
        "name": effect.name,
        "subsystem": effect.subsystem,
        "check": effect.sentence,
        "parameters": {
            each.name: {
                "unit": each.unit,
                "null": each.null,
                "minimum": each.minimum,
                "maximum": each.maximum,
                "source": each.source,
            }
            for each in effect.parameters
        },
    }
