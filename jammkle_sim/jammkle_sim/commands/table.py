"""What `jammkle rig` and `robot` share: options made from a table of them, errors of a run, a table of its figures.

What is set often is an option of the command line. The rest, rows with `flag=False`, stands in files that `--params`
names: NAME: VALUE in the units of the command line, or a run sheet, SI.
"""

# ruff: noqa: PLC0415 - imported where needed: `jammkle --help` shall not wait for NumPy and MuJoCo

from __future__ import annotations

import contextlib
import difflib
import inspect
import math
import re
import textwrap
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer

from jammkle_common.bags.run_sheet import KEYS, RECORDED, RunSheet, read_options, read_sheet, read_text
from jammkle_common.command.errors import GraphError, InputError, Interrupted
from jammkle_common.names import SIM_PARAMETERS
from jammkle_common.parameters import (
    ParameterClass,
    ParameterError,
    as_typed,
    from_mapping,
    in_si,
    option_name,
    rows,
    shortened,
    typed_row,
    typed_value,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from jammkle_common.parameters import ParameterRow, Value

P = TypeVar("P", bound=ParameterClass)
Option = tuple[Any, Any]
"""What typer needs of an option: its annotation, and its default or REQUIRED."""
REQUIRED = inspect.Parameter.empty
_COMMENT_COLUMNS = 76
"""Within the 80 of a terminal, less the margins of `--help`."""


def _named_file(text: str) -> Path:
    """Return a path that is not empty; pathlib makes of an empty one the folder that one is in."""
    if not text:
        msg = "it is empty; give a file, or the folder of a bag"
        raise typer.BadParameter(msg)
    return Path(text)


_PARAMS: Option = (
    Annotated[
        list[Path] | None,
        typer.Option(
            "--params",
            help="File of options (YAML), NAME: VALUE a line; or a run sheet, or a bag that has one, to do the same "
            "again, apart from its effects; may be repeated. What is typed wins.",
            metavar="FILE",
            parser=_named_file,
        ),
    ],
    None,
)


def command_of(
    words: str, table: type[P], common: dict[str, Option], run: Callable[[dict[str, Any], P], int]
) -> Callable[..., int]:
    """Return a function whose signature typer turns into options: the common ones, `--params`, then those of a table.

    `run` gets the values of the common options by name, and the others as the table; it returns the exit code.

    Args:
        words: What is run, as it is typed: `rig drop`; `{NAME}` stands for a common option or argument.
        table: Options of it; those without a flag are taken from files alone.
        common: Options and arguments that are not in the table.
        run: What is done with them.

    """
    typed = {row.name: typed_row(row) for row in rows(table)}
    own = {row.name: _flag(row) if row.flag else _no_flag(row) for row in typed.values()}
    parameters: dict[str, Option] = {"context": (typer.Context, REQUIRED), **common, "params": _PARAMS, **own}

    def command(context: typer.Context, **values: Any) -> int:
        read: dict[str, Any] = {}
        places: dict[str, Path] = {}
        for path in values["params"] or ():
            found = options_in(path, table, words.format(**values))
            read |= found
            places |= dict.fromkeys(found, path)
        for name, row in typed.items():
            if row.flag and _was_typed(context, row.name):
                read[name] = in_si(name, values[row.name])
                places.pop(name, None)
        try:
            return run({name: values[name] for name in common}, checked(table, read))
        except (InputError, GraphError) as error:
            raise type(error)(_with_files(str(error), table, places)) from error

    command.__signature__ = inspect.Signature(  # type: ignore[attr-defined]  # typer asks inspect, which knows it
        [
            inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=annotation)
            for name, (annotation, default) in parameters.items()
        ]
    )
    command.__annotations__ = {name: annotation for name, (annotation, _) in parameters.items()}
    return command


def _flag(row: ParameterRow) -> Option:
    text = f"{row.description}. {row.range_text or row.unit}".rstrip(". ") + "."
    return Annotated[type(row.default), typer.Option(help=text)], row.default


def _no_flag(row: ParameterRow) -> Option:
    """Return an option that is not shown, and says where the value belongs that it is given."""
    option = f"--{row.name.replace('_', '-')}"

    def refuse(value: str | None) -> None:
        if value is not None:
            msg = f"{option} {value} is no option: write '{row.name}: {value}' into a file and give it by --params FILE"
            raise InputError(msg)

    return Annotated[str | None, typer.Option(option, hidden=True, callback=refuse)], None


def _was_typed(context: typer.Context, name: str) -> bool:
    source = context.get_parameter_source(name)
    return source is not None and source.name != "DEFAULT"


def epilog_of(table: type[ParameterClass]) -> str:
    """Return what `--help` says at its end: options without a flag, as a file has them, each with its default.

    Lines are so short that a terminal of 80 columns does not wrap them: what is copied from it is YAML.
    """
    lines = [
        f"{_comment(f'{row.range_text or row.unit}; {row.description}')}\n{row.name}: {row.default}"
        for row in map(typed_row, rows(table))
        if not row.flag
    ]
    head = "What a file for --params may hold besides the options above (write _ for -), with defaults:"
    return "\n".join([head, *lines]) if lines else ""


def _comment(text: str) -> str:
    return textwrap.fill(text.removeprefix("; "), _COMMENT_COLUMNS, initial_indent="# ", subsequent_indent="# ")


def options_in(path: Path, table: type[P], words: str) -> dict[str, Value]:
    """Return the options that a file for `--params` holds, in SI, each within its range.

    Args:
        path: A file with names and values in the units that are typed; or with a run sheet, SI; or a bag that has one.
        table: Options that there are.
        words: Whose they are, as it is typed: `rig drop`.

    Raises:
        InputError: it cannot be read, is of another rig or robot, or holds what is no option or out of its range.

    """
    source = f"--params {path}"
    given = _read(path, source)
    if isinstance(given, RunSheet):
        of = f"rig {given.rig}" if given.rig else f"robot {given.robot}" if given.robot else words
        if of != words:
            _check_exists(source, given)
            msg = f"{source} is the run sheet of {of}, and this is {words}; run `jammkle {of} --params {path}`"
            raise InputError(msg)
        _check_beside(source, given, table)
        return _checked_file(source, given.options, {row.name: (row, row) for row in rows(table)}, words)
    return _checked_file(source, given, {typed_row(row).name: (row, typed_row(row)) for row in rows(table)}, words)


def _check_exists(source: str, sheet: RunSheet) -> None:
    """Refuse a run sheet of what is no rig and no robot of ours."""
    from jammkle_sim.rigs.catalogue import RIGS
    from jammkle_sim.robots.options import ROBOTS

    kind, name, known = ("rig", sheet.rig, tuple(RIGS)) if sheet.rig else ("robot", sheet.robot, ROBOTS)
    if name not in known:
        msg = f"{source}: {kind} is {shortened(name)}, which does not exist; there are {', '.join(known)}"
        raise InputError(msg)


def _check_beside(source: str, sheet: RunSheet, table: type[ParameterClass]) -> None:
    """Refuse what a run sheet holds beside its options, but for the constants that a bag of ours has there."""
    known = {name: row for row in rows(table) for name in (row.name, typed_row(row).name)}
    for name, value in sheet.beside.items():
        if name in RECORDED and (isinstance(value, (dict, list)) or sheet.options.get(name) == value):
            continue
        given = f"{source}: {name} is {shortened(value)}"
        if name in known:
            row = known[name]
            unit = f", in {row.unit}" if row.unit else ""
            msg = f"{given}, and stands beside 'options'; write it below 'options:' as {row.name}{unit}"
        else:
            near = difflib.get_close_matches(name, (*KEYS, *(row.name for row in known.values())), 1)
            below = "" if near and near[0] in KEYS else "options stand below 'options:'"
            meant = ", ".join(filter(None, (f"'{near[0]}' is the nearest" if near else "", below)))
            msg = f"{given}; a run sheet has {', '.join(KEYS)}, and no such name: {meant}"
        raise InputError(msg)


def _checked_file(
    source: str, given: Mapping[str, Any], named: Mapping[str, tuple[ParameterRow, ParameterRow]], words: str
) -> dict[str, Value]:
    """Return options in SI; `named` has the row of each, and that row in the units of the file."""
    found: dict[str, Value] = {}
    for name, value in given.items():
        if name not in named:
            msg = f"{source}: {name} is {shortened(value)}; {_advice(source, name, value, named, words)}"
            raise InputError(msg)
        row, shown = named[name]
        checked_value = _checked_value(source, value, shown)
        found[row.name] = checked_value if shown is row else in_si(row.name, checked_value)
    return found


def _checked_value(source: str, value: Any, row: ParameterRow) -> Value:
    """Return a value of a file, in the unit of its row."""
    if isinstance(row.default, bool) and value in ("yes", "no"):  # a run sheet has them as words
        value = value == "yes"
    elif type(row.default) is int and isinstance(value, float) and value.is_integer():
        value = int(value)
    try:
        return row.check(value)
    except ParameterError as error:
        also = " (or true, false)" if set(row.choices) == {"yes", "no"} else ""
        msg = f"{source}: {error.text(row.name, lambda number: number, row.unit)}{also}"
        raise InputError(msg) from error


def _read(path: Path, source: str) -> RunSheet | dict[str, Any]:
    """Return the run sheet or the options of a file, or the run sheet of a bag."""
    if path.is_file() and path.suffix in {".mcap", ".db3"}:
        msg = f"{source} is a file of a bag; give its folder, {path.absolute().parent}"
        raise InputError(msg)
    try:
        if not path.is_dir():
            return read_options(path.read_text(encoding="utf-8"), source)
        from jammkle_common.bags.contents import contents_of

        try:
            recorded = contents_of(path).custom_data.get(SIM_PARAMETERS.name)
        except InputError as error:
            msg = f"{source}: {error}"
            raise InputError(msg) from error
        sheet, written = read_sheet(path, recorded), read_sheet(path, None)
        if written.rig and recorded is not None and read_text(recorded, source).rig != written.rig:
            sheet = written  # of an exercise: the options that were recorded are of the machine that did it
    except OSError as error:
        msg = f"{source} cannot be read: {error.strerror or error}"
        raise InputError(msg) from error
    except UnicodeDecodeError as error:
        msg = f"{source} is no text; give a YAML file, or the folder of a bag"
        raise InputError(msg) from error
    if sheet == RunSheet():
        msg = f"{source} is a bag without a run sheet; give a file of options"
        raise InputError(msg)
    return sheet


def _advice(
    source: str, name: str, value: Any, named: Mapping[str, tuple[ParameterRow, ParameterRow]], words: str
) -> str:
    """Say what to write instead of a name that does not exist; raise InputError if the value fits no unit."""
    for right, (row, shown) in named.items():
        if shown is row and name == typed_row(row).name:
            number = in_si(row.name, _checked_value(source, value, typed_row(row)))
            return f"a run sheet has SI units: write '{right}: {number}'"
        if shown is not row and name == row.name:
            number = typed_value(row.name, _checked_value(source, value, row))
            return f"a file of options has the units that are typed: write '{right}: {number}'"
    near = difflib.get_close_matches(name.replace("-", "_"), (*named, *KEYS), 1)
    meant = f"'{near[0]}' is the nearest" if near else f"there are {', '.join(named)}"
    return f"{words} has no option of this name: {meant}"


def _with_files(text: str, table: type[ParameterClass], places: Mapping[str, Path]) -> str:
    """Return the line of an error with options that no flag has set as they stand in a file, and with the file."""
    rest = {
        option_name(row.name): (row.name, typed_row(row).name)
        for row in rows(table)
        if not row.flag or row.name in places
    }
    found = [rest[each] for each in dict.fromkeys(re.findall(r"--[a-z][a-z0-9-]*", text)) if each in rest]
    for option, (_, name) in rest.items():
        text = re.sub(rf"{option}(?![a-z0-9-])", name, text)
    files = dict.fromkeys(str(places[name]) for name, _ in found if name in places)
    in_no_file = [typed for name, typed in found if name not in places]
    text = f"--params {', '.join(files)}: {text}" if files else text
    return f"{text} ({', '.join(in_no_file)}: in a file, --params FILE)" if in_no_file else text


def checked(table: type[P], values: dict[str, Any]) -> P:
    """Return options from values in SI.

    Raises:
        InputError: a value is out of range or not one of the choices.

    """
    try:
        return from_mapping(table, values)
    except ParameterError as error:
        raise InputError(as_typed(error)) from error


@contextlib.contextmanager
def errors_of_a_run() -> Iterator[None]:
    """Raise what goes wrong in a run as errors of the command.

    Raises:
        InputError: an option or an effect does not fit.
        Interrupted: it was cancelled.
        GraphError: the simulation blew up.

    """
    from jammkle_sim.rigs.run import RigCancelledError
    from jammkle_sim.rigs.simulation import UnstableSimulationError

    try:
        yield
    except ParameterError as error:
        raise InputError(as_typed(error)) from error
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
