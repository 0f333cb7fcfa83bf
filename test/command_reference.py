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
"""How the signature or text of options begins that many verbs have: the page says them above the table."""


def root() -> Any:
    """Return the whole command."""
    return get_command(app)


def context(command: Any, name: str, parent: Any = None) -> Any:
    """Return what the argument parser asks for beside a command, without having parsed anything."""
    return command.make_context(name, [], parent=parent, resilient_parsing=True)


def rigs() -> Any:
    """Return the group of `jammkle rig`, which has a command line of its own."""
    return get_command(rig_app(lambda *_: 0))


def command_lines() -> list[tuple[str, str, str]]:
    """Every verb with what it does, its arguments and its options; those of each rig and robot stand on their pages."""
    command = root()
    at = context(command, NAME)
    lines: list[tuple[str, str, str]] = []
    for name in command.list_commands(at):
        if name == RIG:
            lines += rig_lines()
            continue
        verb = command.get_command(at, name)
        elsewhere = typed_names(RobotOptions) if name == ROBOT else set()
        lines += verb_lines(verb, context(verb, name, at), name, elsewhere)
        if elsewhere:
            lines.append((name, "and", "the [options of robots](robots.md#options)"))
    return lines


def typed_names(options: Any) -> set[str]:
    """Return the names of options as the command has them."""
    return {typed_row(row).name for row in rows(options)}


def verb_lines(command: Any, at: Any, name: str, elsewhere: Collection[str] = ()) -> Iterator[tuple[str, str, str]]:
    """What a verb does, its arguments and options, and the same of the verbs below it."""
    yield f"**{name}**", "", spaced(command.help)
    yield from ((name, *line) for line in arguments(command, at, elsewhere))
    for below, each in getattr(command, "commands", {}).items():
        if not each.hidden:
            yield from verb_lines(each, context(each, below, at), f"{name} {below}")


def arguments(command: Any, at: Any, elsewhere: Collection[str] = ()) -> Iterator[tuple[str, str]]:
    """Arguments and options of a verb, without those that stand elsewhere."""
    shown = [each for each in command.get_params(at) if each.name not in {"help", *elsewhere}]
    for signature, text in filter(None, (each.get_help_record(at) for each in shown)):
        if not any(part.startswith(SAID_ONCE) for part in (signature, text)):
            yield f"`{spaced(signature)}`", spaced(text)


def rig_lines() -> Iterator[tuple[str, str, str]]:
    """The rigs that there are, and what all of them have in common."""
    yield f"**{RIG}**", "", f"{spaced(rigs().help)} Which one is the first argument:"
    yield from ((RIG, f"`{name}`", kind.title) for name, kind in RIGS.items())
    name, kind = next(iter(RIGS.items()))
    command = rigs().commands[name]
    yield from ((RIG, *line) for line in arguments(command, context(command, name), typed_names(kind.options)))
    yield RIG, "and", "the [options of rigs](rigs.md#options)"


def spaced(text: str) -> str:
    """Text of a help line on one line of a page."""
    return re.sub(r"\s+", " ", text).strip()


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
