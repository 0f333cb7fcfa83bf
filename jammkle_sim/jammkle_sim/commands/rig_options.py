"""Options of `jammkle rig` from the rigs' own tables of options: names, types, defaults, ranges, help."""

from __future__ import annotations

import inspect
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from jammkle_common.command.errors import InputError
from jammkle_common.command.options import JsonOption, NamespaceOption
from jammkle_common.constants import MAX_REPEATS
from jammkle_common.parameters import ParameterError, as_typed, from_mapping, in_si, rows, typed_row
from jammkle_sim.rigs.catalogue import RIGS

if TYPE_CHECKING:
    from collections.abc import Callable

    from jammkle_common.parameters import ParameterRow
    from jammkle_sim.rigs.catalogue import RigKind


@dataclass(frozen=True)
class RigRequest:
    """One call of `jammkle rig`."""

    rig: str
    options: Any
    """The options dataclass of the rig."""
    bag: Path | None
    """Folder of the bag; with repeats the name that each one's number is put behind."""
    repeats: int
    namespace: str
    json: Path | None
    mjcf: Path | None
    effects: Path | None = None
    """File of effects that are put into the rig."""


# Annotated with what typer needs, in the order of the help.
_COMMON: dict[str, tuple[Any, Any]] = {
    "output": (
        Annotated[
            Path | None,
            typer.Option(
                "-o",
                "--output",
                help="Folder of the new bag; with --repeats one each: NAME_0, NAME_1, ...",
                metavar="DIR",
            ),
        ],
        None,
    ),
    "repeats": (
        Annotated[
            int,
            typer.Option(help=f"Runs, 1 to {MAX_REPEATS}; more than one scatter as the rig does, drawn from --seed."),
        ],
        1,
    ),
    "namespace": (NamespaceOption, "/"),
    "effects": (
        Annotated[
            Path | None,
            typer.Option(
                help="File of effects to put into the rig, such as the corrected.yaml of a gap diagnosis.",
                metavar="FILE",
            ),
        ],
        None,
    ),
    "json": (JsonOption, None),
    "save_mjcf": (
        Annotated[
            Path | None,
            typer.Option(
                help="Write the model that is simulated to this file (MJCF): bodies and contacts, without the law of "
                "the tendons, the air, or the release and drive of the carriage.",
                metavar="FILE",
            ),
        ],
        None,
    ),
}


def rig_app(run: Callable[[RigRequest], int]) -> typer.Typer:
    """Return the command line of all rigs; `run` gets what was asked for and returns the exit code."""
    app = typer.Typer(
        help="Run a rig without the graph, as fast as it can, and write a bag.",
        pretty_exceptions_enable=False,
        context_settings={"help_option_names": ["-h", "--help"]},
        add_completion=False,
    )
    for kind in RIGS.values():
        app.command(kind.name, help=f"{kind.title[0].upper()}{kind.title[1:]}.")(_command(kind, run))
    # A single command would swallow its own name.
    app.callback()(lambda: None)
    return app


def _command(kind: RigKind, run: Callable[[RigRequest], int]) -> Callable[..., int]:
    """Make the function whose signature typer turns into options."""
    typed = {row.name: typed_row(row) for row in rows(kind.options)}
    own = {
        row.name: (Annotated[type(row.default), typer.Option(help=_help(row))], row.default) for row in typed.values()
    }
    parameters = {**_COMMON, **own}

    def command(**values: Any) -> int:
        return run(
            RigRequest(
                rig=kind.name,
                options=checked(kind, {name: in_si(name, values[row.name]) for name, row in typed.items()}),
                bag=values["output"],
                repeats=values["repeats"],
                namespace=values["namespace"],
                json=values["json"],
                mjcf=values["save_mjcf"],
                effects=values["effects"],
            )
        )

    command.__signature__ = inspect.Signature(  # type: ignore[attr-defined]  # typer asks inspect, which knows it
        [
            inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=annotation)
            for name, (annotation, default) in parameters.items()
        ]
    )
    command.__annotations__ = {name: annotation for name, (annotation, _) in parameters.items()}
    return command


def checked(kind: RigKind, values: dict[str, Any]) -> Any:
    """Return the options of a rig from values in SI.

    Raises:
        InputError: a value is out of range or not one of the choices.

    """
    try:
        return from_mapping(kind.options, values)
    except ParameterError as error:
        raise InputError(as_typed(error)) from error


def _help(row: ParameterRow) -> str:
    unit_or_range = row.range_text or row.unit
    return f"{row.description}. {unit_or_range}".rstrip(". ") + "."
