"""Every subcommand of `jammkle` with its options, for tests and documents."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import typer

from command_reference import RIG, rigs, root

if TYPE_CHECKING:
    from collections.abc import Iterator


def subcommands() -> dict[str, Any]:
    """Every subcommand that does something, by its words: `gap diagnose`; the rigs as `rig tensile`."""
    found = dict(_leaves((), root()))
    del found[RIG]  # it hands its arguments to a command line of its own
    return {**found, **dict(_leaves((RIG,), rigs()))}


def options(command: Any) -> list[Any]:
    """Options of a subcommand without `--help` and those that are hidden."""
    return [
        each
        for each in command.params
        if each.param_type_name == "option" and "--help" not in each.opts and not each.hidden
    ]


def long_name(option: Any) -> str:
    """Return `--output` of `-o`, `--output`."""
    return str(max(option.opts, key=len))


def kind(option: Any) -> Any:
    """Return the Python type of what an option takes, once."""
    annotation = option.type_descriptor.annotation
    return annotation.__args__[0] if option.multiple else annotation


def _leaves(words: tuple[str, ...], command: Any) -> Iterator[tuple[str, Any]]:
    if not hasattr(command, "list_commands"):
        yield " ".join(words), command
        return
    context = typer.Context(command)
    for name in command.list_commands(context):
        inner = command.get_command(context, name)
        if not inner.hidden:
            yield from _leaves((*words, name), inner)
