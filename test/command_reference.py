"""The command line as the code has it: its verbs for the reference, and the parser for lines of examples."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

from typer.main import get_command

from jammkle_common.command.main import app
from jammkle_common.parameters import rows, typed_row
from jammkle_sim.commands.rig import rig_app
from jammkle_sim.rigs.catalogue import RIGS

if TYPE_CHECKING:
    from collections.abc import Iterator

NAME = "jammkle"
RIG = "rig"


def root() -> Any:
    """Return the whole command."""
    return get_command(app)


def context(command: Any, name: str, parent: Any = None) -> Any:
    """Return what the argument parser asks for beside a command, without having parsed anything."""
    return command.make_context(name, [], parent=parent, resilient_parsing=True)


def rigs() -> Any:
    """Return the group of `jammkle rig`, which has a command line of its own."""
    return get_command(rig_app(lambda *_: 0))


def command_text() -> str:
    """Reference of every verb, as Markdown. The options that each rig has for itself stand on the page of the rigs."""
    command = root()
    at = context(command, NAME)
    parts: list[str] = []
    for name in command.list_commands(at):
        if name == RIG:
            parts += [f"## {NAME} {RIG}", rigs().help, *rig_sections()]
        else:
            verb = command.get_command(at, name)
            parts += sections(verb, context(verb, name, at), f"{NAME} {name}", "##")
    return "\n\n".join(parts)


def sections(command: Any, at: Any, name: str, marks: str) -> Iterator[str]:
    """Every paragraph of a verb and of those below it: what it does, how it is called, its arguments and options."""
    yield f"{marks} {name}"
    yield re.sub(r"\s*\n\s*", " ", command.help.strip())
    yield from usage(command, at, name)
    for below, each in getattr(command, "commands", {}).items():
        if not each.hidden:
            yield from sections(each, context(each, below, at), f"{name} {below}", f"{marks}#")


def usage(command: Any, at: Any, name: str) -> Iterator[str]:
    """How a verb is called, and its arguments and options."""
    if not hasattr(command, "commands"):
        yield f"`{name} {' '.join(command.collect_usage_pieces(at))}`"
    records = [each.get_help_record(at) for each in command.get_params(at) if each.name != "help"]
    lines = [f"| `{cell(signature)}` | {cell(text)} |" for signature, text in filter(None, records)]
    if lines:
        yield "\n".join(["| argument or option | what |", "|---|---|", *lines])


def rig_sections() -> Iterator[str]:
    """What all rigs have in common."""
    yield "\n".join(["| rig | what |", "|---|---|", *(f"| `{name}` | {kind.title} |" for name, kind in RIGS.items())])
    name, kind = next(iter(RIGS.items()))
    own = {typed_row(row).name for row in rows(kind.options)}
    command = rigs().commands[name]
    command.params = [each for each in command.params if each.name not in own]
    yield from usage(command, context(command, name), f"{NAME} {RIG} RIG")
    yield "And what [each rig](rigs.md#options-of-the-rigs) has to choose."


def cell(text: str) -> str:
    """Text of a help line as a cell of a table."""
    return re.sub(r"\s+", " ", text).replace("|", "\\|")


def parse(words: list[str]) -> None:
    """Parse a line of the command without running it.

    Raises:
        Exception: what the argument parser says of a wrong line.

    """
    command, parent = root(), None
    name, *rest = words
    while hasattr(command, "get_command") and rest and not rest[0].startswith("-"):
        parent = context(command, name, parent)
        name, *rest = rest
        found = command.get_command(parent, name)
        if found is None:
            msg = f"{parent.command_path} has no command {name}"
            raise ValueError(msg)
        command = rigs() if name == RIG and parent.parent is None else found
    command.make_context(name, rest, parent=parent)
