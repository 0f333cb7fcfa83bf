"""The command line as the code has it: its verbs for the reference, and the parser for lines of examples."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

from typer.main import get_command

from jammkle_common.command.main import app
from jammkle_common.parameters import rows, typed_row
from jammkle_sim.commands.rig import rig_app
from jammkle_sim.rigs.catalogue import RIGS
from jammkle_sim.robots.options import RobotOptions

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator

NAME = "jammkle"
RIG = "rig"
ROBOT = "robot"
SAID_ONCE = ("--json FILE", "ROS namespace of the ankle")
"""How the signature or text of options begins that many verbs have: the page says them above the verbs."""


def root() -> Any:
    """Return the whole command."""
    return get_command(app)


def context(command: Any, name: str, parent: Any = None) -> Any:
    """Return what the argument parser asks for beside a command, without having parsed anything."""
    return command.make_context(name, [], parent=parent, resilient_parsing=True)


def rigs() -> Any:
    """Return the group of `jammkle rig`, which has a command line of its own."""
    return get_command(rig_app(lambda _: 0))


def command_text() -> str:
    """Reference of every verb, as Markdown. What each rig and robot has to choose stands on their own pages."""
    command = root()
    at = context(command, NAME)
    parts: list[str] = []
    for name in command.list_commands(at):
        if name == RIG:
            parts += rig_section()
            continue
        verb = command.get_command(at, name)
        elsewhere = typed_names(RobotOptions) if name == ROBOT else set()
        parts += sections(verb, context(verb, name, at), f"{NAME} {name}", "##", elsewhere)
        if elsewhere:
            parts.append("And the [options of robots](robots.md#options).")
    return "\n\n".join(parts)


def typed_names(options: Any) -> set[str]:
    """Return the names of options as the command has them."""
    return {typed_row(row).name for row in rows(options)}


def sections(command: Any, at: Any, name: str, marks: str, elsewhere: Collection[str] = ()) -> Iterator[str]:
    """Every paragraph of a verb and of those below it: what it does, its arguments and options."""
    yield f"{marks} {name}"
    yield re.sub(r"\s*\n\s*", " ", command.help.strip())
    yield from arguments(command, at, elsewhere)
    for below, each in getattr(command, "commands", {}).items():
        if not each.hidden:
            yield from sections(each, context(each, below, at), f"{name} {below}", f"{marks}#")


def arguments(command: Any, at: Any, elsewhere: Collection[str] = ()) -> Iterator[str]:
    """Arguments and options of a verb, as a list, without those that stand elsewhere."""
    shown = [each for each in command.get_params(at) if each.name not in {"help", *elsewhere}]
    records = filter(None, (each.get_help_record(at) for each in shown))
    lines = [
        f"- `{spaced(each)}`: {spaced(text)}"
        for each, text in records
        if not any(part.startswith(SAID_ONCE) for part in (each, text))
    ]
    if lines:
        yield "\n".join(lines)


def rig_section() -> Iterator[str]:
    """The rigs that there are, and what all of them have in common."""
    yield f"## {NAME} {RIG}"
    yield f"{rigs().help} `{NAME} {RIG} RIG`, which is one of:"
    yield "\n".join(f"- `{name}`: {kind.title}" for name, kind in RIGS.items())
    yield "Every rig takes the following, and [options of its own](rigs.md#options):"
    name, kind = next(iter(RIGS.items()))
    command = rigs().commands[name]
    yield from arguments(command, context(command, name), typed_names(kind.options))


def spaced(text: str) -> str:
    """Text of a help line on one line of a page."""
    return re.sub(r"\s+", " ", text)


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
