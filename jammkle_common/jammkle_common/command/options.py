"""Options that more than one command takes."""

from __future__ import annotations

import dataclasses
import re
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from jammkle_common.command import results

if TYPE_CHECKING:
    from collections.abc import Collection

    from jammkle_common.parameters import ParameterRow, Value

ON_THE_GRAPH, ON_BAGS, ON_THE_BOARD = "On the graph", "On bags", "On the board"
WITHOUT_A_ROBOT, ON_THE_GAP = "Simulated, without the graph", "Simulation against reality"
"""Groups of verbs in `jammkle --help`."""


def _keep_stdout(path: Path | None) -> Path | None:
    if str(path) == results.STDOUT:
        results.keep_stdout_for_json()
    return path


JsonOption = Annotated[
    Path | None,
    typer.Option(
        "--json",
        help="Write the results to this file as JSON too; -: to stdout, and the rest to stderr.",
        metavar="FILE",
        callback=_keep_stdout,
    ),
]
NamespaceOption = Annotated[str, typer.Option("--namespace", help="ROS namespace of the ankle, for example lf_ankle.")]


@dataclass(frozen=True)
class TypedUnit:
    """A unit of the command line beside its SI unit, and how names of options and parameters end in them.

    Attributes:
        si: Unit inside.
        typed: Unit on the command line.
        si_end: End of a parameter's name.
        typed_end: End of an option's name, with underscores.
        exponent: One typed unit is 10 to this power of the SI unit.
        example: What to type for a value in SI.

    """

    si: str
    typed: str
    si_end: str
    typed_end: str
    exponent: int
    example: str


TYPED_UNITS = (
    TypedUnit("Pa", "kPa", "_pa", "_kpa", 3, "50 for 50000 Pa"),
    TypedUnit("m/s", "mm/s", "_m_s", "_mm_s", -3, "5 for 0.005 m/s"),
    TypedUnit("m", "mm", "_m", "_mm", -3, "20 for 0.02 m"),
)
"""Every other unit is typed as it is inside: s, Hz, kg, deg, l/min."""

RENAMED = {"hardware check": {"--output": "--save-board-file"}}
"""Options that have another name now, by subcommand; those of the units above follow by themselves."""

_NUMBER = r"[-+]?(?:\d[\d.]*(?:e[-+]?\d+)?|nan|inf)"
_PARAMETER = re.compile(r"parameter '(\w+)'")
_VALUES = re.compile(
    rf"(?P<before>^ (?:is|of) |\(it is |it must be | to )(?P<number>{_NUMBER})(?P<unit> (?:Pa|m/s|m)\b(?!/))?"
)


def typed_row(row: ParameterRow) -> ParameterRow:
    """Return a parameter as it is on the command line: name, unit, default and range in the units that are typed."""
    unit = _of_parameter(row.name)
    if unit is None or isinstance(row.default, (bool, int, str)):
        return row
    return dataclasses.replace(
        row,
        name=_renamed(row.name, unit),
        unit=unit.typed,
        default=_scaled(row.default, -unit.exponent),
        minimum=None if row.minimum is None else _scaled(row.minimum, -unit.exponent),
        maximum=None if row.maximum is None else _scaled(row.maximum, -unit.exponent),
    )


def option_name(parameter: str) -> str:
    """Return the option of a parameter: `--vacuum-kpa` for `vacuum_pa`."""
    return f"--{typed_name(parameter)}"


def typed_name(parameter: str) -> str:
    """Return how a parameter is called where its name is typed: `vacuum-kpa` for `vacuum_pa`."""
    unit = _of_parameter(parameter)
    return (_renamed(parameter, unit) if unit else parameter).replace("_", "-")


def in_si(parameter: str, typed: Value) -> Value:
    """Return what was typed for a parameter in the unit that the parameter has."""
    unit = _of_parameter(parameter)
    return _scaled(typed, unit.exponent) if unit and isinstance(typed, (int, float)) else typed


def typed_value(parameter: str, value: Value) -> Value:
    """Return what to type for a value of a parameter, in SI: the inverse of `in_si`."""
    unit = _of_parameter(parameter)
    return _scaled(value, -unit.exponent) if unit and isinstance(value, (int, float)) else value


def parameter_of(typed: str) -> str:
    """Return the parameter that a typed name stands for: `vacuum_pa` for `vacuum-kpa`."""
    name = typed.replace("-", "_")
    for unit in TYPED_UNITS:
        if name.endswith(unit.typed_end):
            return name.removesuffix(unit.typed_end) + unit.si_end
    return name


def as_typed(message: str, lead: str = "--") -> str:
    """Write the parameters that a message names as options, with their values in the units that are typed.

    Args:
        message: In the words of `jammkle_common.parameters`: `parameter 'vacuum_pa' is 1; it must be 0 to 75000 Pa`.
        lead: What stands before a name; `--set ` where it is no option of its own.

    """
    first, *others = _PARAMETER.split(message)
    parts = [first]
    for name, rest in zip(others[::2], others[1::2], strict=True):
        unit = _of_parameter(name)
        parts += [lead + typed_name(name), _with_typed_values(rest, unit) if unit else rest]
    return "".join(parts)


def renamed(option: str, known: Collection[str], command: str = "") -> str | None:
    """Return one line on where an option went that a subcommand does not know; None if it never was one.

    Args:
        option: As typed: `--vacuum-pa`.
        known: Options of the subcommand.
        command: The subcommand, with all its words.

    """
    for words, names in RENAMED.items():
        if command.endswith(words) and option in names:
            return f"{option} is {names[option]} now"
    name = option.removeprefix("--").replace("-", "_")
    unit = _of_parameter(name)
    if unit is None or option_name(name) not in known:
        return None
    return f"{option} is {option_name(name)} now, in {unit.typed}: {unit.example}"


def _with_typed_values(text: str, unit: TypedUnit) -> str:
    def typed(match: re.Match[str]) -> str:
        number = _scaled(float(match["number"]), -unit.exponent)
        return f"{match['before']}{number:g}" + (f" {unit.typed}" if match["unit"] else "")

    return _VALUES.sub(typed, text)


def _of_parameter(name: str) -> TypedUnit | None:
    """Return the unit of a parameter by the end of its name, in SI."""
    return next((unit for unit in TYPED_UNITS if name.endswith(unit.si_end)), None)


def _renamed(parameter: str, unit: TypedUnit) -> str:
    return parameter.removesuffix(unit.si_end) + unit.typed_end


def _scaled(value: float, exponent: int) -> float:
    """Return a value times a power of ten, as its digits say: 0.55 mm are the number that 0.00055 m is written as."""
    return float(Decimal(repr(float(value))).scaleb(exponent))
