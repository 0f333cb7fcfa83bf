"""Command-line options made from a table of options: names, types, defaults, ranges, help."""

from __future__ import annotations

import inspect
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer

from jammkle_common.command.errors import InputError
from jammkle_common.parameters import ParameterClass, ParameterError, as_typed, from_mapping, in_si, rows, typed_row

if TYPE_CHECKING:
    from collections.abc import Callable

    from jammkle_common.parameters import ParameterRow

P = TypeVar("P", bound=ParameterClass)
Option = tuple[Any, Any]
"""What typer needs of an option: its annotation, and its default or REQUIRED."""
REQUIRED = inspect.Parameter.empty


def command_of(
    table: type[P], common: dict[str, Option], run: Callable[[dict[str, Any], P], int]
) -> Callable[..., int]:
    """Return a function whose signature typer turns into options.

    Args:
        table: Dataclass of options; each becomes one.
        common: Further options, in the order of the help, by name.
        run: Gets the values of the common options by name, and the others as `table`; returns the exit code.

    """
    typed = {row.name: typed_row(row) for row in rows(table)}
    own = {
        row.name: (Annotated[type(row.default), typer.Option(help=_help(row))], row.default) for row in typed.values()
    }
    parameters = {**common, **own}

    def command(**values: Any) -> int:
        options = checked(table, {name: in_si(name, values[row.name]) for name, row in typed.items()})
        return run({name: values[name] for name in common}, options)

    command.__signature__ = inspect.Signature(  # type: ignore[attr-defined]  # typer asks inspect, which knows it
        [
            inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=annotation)
            for name, (annotation, default) in parameters.items()
        ]
    )
    command.__annotations__ = {name: annotation for name, (annotation, _) in parameters.items()}
    return command


def checked(table: type[P], values: dict[str, Any]) -> P:
    """Return options from values in SI.

    Raises:
        InputError: a value is out of range or not one of the choices.

    """
    try:
        return from_mapping(table, values)
    except ParameterError as error:
        raise InputError(as_typed(error)) from error


def _help(row: ParameterRow) -> str:
    return f"{row.description}. {row.range_text or row.unit}".rstrip(". ") + "."
