"""What `jammkle rig` and `robot` share: options made from a table of them, errors of a run, a table of its figures."""

# ruff: noqa: PLC0415 - imported where needed: `jammkle --help` shall not wait for NumPy and MuJoCo

from __future__ import annotations

import contextlib
import inspect
import math
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer

from jammkle_common.command.errors import GraphError, InputError, Interrupted
from jammkle_common.parameters import ParameterClass, ParameterError, as_typed, from_mapping, in_si, rows, typed_row

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from jammkle_common.parameters import ParameterRow

P = TypeVar("P", bound=ParameterClass)
Option = tuple[Any, Any]
"""What typer needs of an option: its annotation, and its default or REQUIRED."""
REQUIRED = inspect.Parameter.empty


def command_of(
    table: type[P], common: dict[str, Option], run: Callable[[dict[str, Any], P], int]
) -> Callable[..., int]:
    """Return a function whose signature typer turns into options: the common ones, then those of a table.

    `run` gets the values of the common options by name, and the others as the table; it returns the exit code.
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


@contextlib.contextmanager
def errors_of_a_run() -> Iterator[None]:
    """Raise what goes wrong in a run as errors of the command.

    Raises:
        InputError: an option or an effect does not fit.
        Interrupted: it was cancelled.
        GraphError: the simulation blew up.

    """
    from jammkle_sim.rigs.rig import BadChangeError
    from jammkle_sim.rigs.run import RigCancelledError
    from jammkle_sim.rigs.simulation import UnstableSimulationError

    try:
        yield
    except ParameterError as error:
        raise InputError(as_typed(error)) from error
    except BadChangeError as error:
        raise InputError(str(error)) from error
    except RigCancelledError as error:
        raise Interrupted from error
    except UnstableSimulationError as error:
        raise GraphError(as_typed(error)) from error


def figures_table(title: str, columns: Mapping[str, Mapping[str, float]]) -> Any:
    """Return a rich table of figures by name, one column per run."""
    from rich.table import Table

    table = Table(title=title, title_justify="left")
    table.add_column("figure")
    for column in columns:
        table.add_column(column, justify="right")
    for name in dict.fromkeys(name for figures in columns.values() for name in figures):
        table.add_row(name, *(f"{figures.get(name, math.nan):.5g}" for figures in columns.values()))
    return table
