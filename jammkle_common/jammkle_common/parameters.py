"""A node's parameters as one frozen dataclass: declared, described, bounded, validated and documented from it.

    @dataclass(frozen=True)
    class DriverParameters:
        default_vacuum_pa: float = parameter(50e3, "Vacuum of a jam request that names none", "Pa", 5e3, 80e3)

`declare` takes such a class onto a node. Does not import rclpy.

Inside everything is SI. Whoever types, types kPa and mm, as gauges and rulers show them; parameters of nodes, messages
and JSON stay in SI.
"""

from __future__ import annotations

import contextlib
import dataclasses
import difflib
import math
import reprlib
from dataclasses import dataclass
from decimal import Decimal
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, TypeVar, cast

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Mapping, Sequence

    from rclpy.node import Node
    from rclpy.parameter import Parameter

Value = bool | int | float | str
_METADATA_KEY = "jammkle_parameter"
_SIMULATED_TIME = "use_sim_time"
_RCLPY_PARAMETERS = (_SIMULATED_TIME, "start_type_description_service")
_RCLPY_PREFIX = "qos_overrides."
_TYPE_TEXT: dict[type, str] = {bool: "true or false", int: "a whole number", float: "a number", str: "text"}


_SHORT = reprlib.Repr()
_SHORT.maxstring = _SHORT.maxother = 60


def shortened(value: object) -> str:
    """Return a value as Python writes it, without its middle where it is long: lists, texts, whole numbers."""
    try:
        return _SHORT.repr(value)
    except ValueError:  # Python writes no whole number of more than 4300 digits
        return f"{type(value).__name__} with a number of too many digits"


def is_number(text: str) -> bool:
    """Return whether a text would be a number without its quotes."""
    try:
        float(text)
    except ValueError:
        return False
    return True


class ParameterError(ValueError):
    """A parameter that does not exist, has the wrong type or is out of range. The message is one clear line, in SI.

    Attributes:
        name: Of the parameter; empty where the problem says all.
        value: Given for it.
        problem: What is wrong with the value; empty where limits say it.
        limits: Smallest and largest value allowed.
        unit: Of value and limits; may be empty.

    """

    def __init__(
        self,
        problem: str,
        name: str = "",
        value: object = None,
        *,
        limits: tuple[float, float] | None = None,
        unit: str = "",
    ) -> None:
        """Keep what the command needs to say it in the units that people type."""
        self.name, self.value, self.problem, self.limits, self.unit = name, value, problem, limits, unit
        super().__init__(self.text(f"parameter '{name}'", lambda number: number, unit) if name else problem)

    def text(self, name: str, scale: Callable[[float], float], unit: str) -> str:
        """Return the line for a parameter that is called otherwise, with its numbers in another unit."""
        problem, given = self.problem, shortened(self.value)
        if isinstance(self.value, str) and is_number(self.value):
            given = f"{given}, a text"
        if isinstance(self.value, (int, float)) and not isinstance(self.value, bool):
            with contextlib.suppress(OverflowError):  # a whole number beyond all floats stays as it is written
                given = f"{scale(self.value):g}"
        if self.limits is not None:
            problem = f"it must be {_range_text(*map(scale, self.limits))} {unit}".rstrip()
        return f"{name} is {given}; {problem}"


class ParameterClass(Protocol):
    """Any dataclass whose fields were made by `parameter`."""

    __dataclass_fields__: ClassVar[dict[str, Any]]


P = TypeVar("P", bound=ParameterClass)


@dataclass(frozen=True)
class ParameterRow:
    """What is known of one parameter. `unit` is empty where there is none; bounds are inclusive."""

    name: str
    default: Value
    description: str
    unit: str
    minimum: float | None
    maximum: float | None
    choices: tuple[str, ...]
    dynamic: bool
    flag: bool = True
    """Whether `jammkle rig` and `robot` have an option for it; if not, it is set in a file (`--params`) alone."""

    @property
    def range_text(self) -> str:
        """Range for people: `5000 to 80000 Pa`, `ankle, leg`, or empty."""
        if self.choices:
            return ", ".join(self.choices)
        if self.minimum is None or self.maximum is None:
            return ""
        return f"{_range_text(self.minimum, self.maximum)} {self.unit}".rstrip()

    def check(self, value: object) -> Value:
        """Return `value` in the parameter's type.

        Raises:
            ParameterError: wrong type, NaN, out of range, or not one of the choices.

        """
        kind, given = type(self.default), value
        if kind is float and isinstance(value, int) and not isinstance(value, bool):
            value = float(Decimal(value))  # infinite where it is beyond all floats
        problem, limits = "", None
        if self.choices and value not in self.choices:
            problem = f"it must be one of {self.range_text}"
        elif type(value) is not kind:
            problem = f"it must be {_TYPE_TEXT[kind]}"
        elif isinstance(given, float) and not math.isfinite(given):
            problem = "it must be a finite number"
        elif isinstance(value, (int, float)) and self.minimum is not None and self.maximum is not None:
            limits = None if self.minimum <= value <= self.maximum else (self.minimum, self.maximum)
        elif isinstance(value, float) and not math.isfinite(value):
            problem = "it must be a smaller number"
        if problem or limits:
            raise ParameterError(problem, self.name, given, limits=limits, unit=self.unit)
        return cast("Value", value)


def _range_text(minimum: float, maximum: float) -> str:
    return " to ".join(f"{number:.0f}" if isinstance(number, int) else f"{number:g}" for number in (minimum, maximum))


def parameter(
    default: Value,
    description: str,
    unit: str = "",
    minimum: float | None = None,
    maximum: float | None = None,
    *,
    choices: Sequence[str] = (),
    dynamic: bool = False,
    flag: bool = True,
) -> Any:
    """Make a dataclass field that is a parameter.

    Args:
        default: Value when nothing else is given; its type is the parameter's type.
        description: What it does, in plain English, without unit or range.
        unit: SI unit, or empty.
        minimum: Smallest value allowed, inclusive; needs `maximum`.
        maximum: Largest value allowed, inclusive.
        choices: For text: the values allowed.
        dynamic: True if it may be changed while the node runs; else it is read-only.
        flag: False if it is set so rarely that `jammkle rig` and `robot` take it from a file (`--params`) alone.

    """
    row = ParameterRow("", default, description, unit, minimum, maximum, tuple(choices), dynamic, flag)
    return dataclasses.field(default=default, metadata={_METADATA_KEY: row})


def rows(table: type[ParameterClass]) -> tuple[ParameterRow, ...]:
    """All parameters of a table, in the order in which they stand in it."""
    fields = table.__dataclass_fields__.values()
    return tuple(dataclasses.replace(field.metadata[_METADATA_KEY], name=field.name) for field in fields)


def of_table(values: Mapping[str, object]) -> dict[str, object]:
    """Return the values without those of parameters that rclpy gives every node, and that no table lists."""
    return {
        name: value
        for name, value in values.items()
        if name not in _RCLPY_PARAMETERS and not name.startswith(_RCLPY_PREFIX)
    }


def from_mapping(table: type[P], values: Mapping[str, object]) -> P:
    """Make a table from values by name; what is missing keeps its default.

    Raises:
        ParameterError: an unknown name, a value of the wrong type or out of range.

    """
    known = {row.name: row for row in rows(table)}
    unknown = sorted(set(values) - set(known))
    if unknown:
        msg = f"unknown parameter '{unknown[0]}'; known are: {', '.join(sorted(known))}"
        near = difflib.get_close_matches(unknown[0], known, 1)
        msg += f"; did you mean {near[0]}?" if near else ""
        raise ParameterError(msg)
    return table(**{name: known[name].check(value) for name, value in values.items()})


def declare(node: Node, table: type[P]) -> P:
    """Declare every row of `table` on `node` and return the values in force; the node's clock stays what it is then.

    Args:
        node: The node; values come from its command line, launch file or YAML file. It was made with
            `automatically_declare_parameters_from_overrides=True`, as a LockstepNode is: rclpy drops what nobody
            declares without a word, and a typing error in a YAML file would go unseen.
        table: The node's parameter dataclass.

    Raises:
        ParameterError: an unknown parameter was given, or a value has the wrong type or is out of range.

    """
    declared: Any = node.get_parameters_by_prefix("")  # rclpy 7.1.6 says values, and returns parameters
    given = of_table({name: found.value for name, found in declared.items()})
    try:
        values = from_mapping(table, given)
    except ParameterError as error:
        msg = f"{node.get_fully_qualified_name()}: {error}"
        raise ParameterError(msg) from error
    for name in given:  # declared without description and bounds
        node.undeclare_parameter(name)
    for row in rows(table):
        node.declare_parameter(row.name, getattr(values, row.name), _descriptor(row), ignore_override=True)
    # Callbacks that come later are asked earlier: rclpy's own would change the clock at once.
    node.add_on_set_parameters_callback(lambda changes: _verdict(lambda: _check_clock(node, changes)))
    return values


def on_change(node: Node, table: type[P], apply: Callable[[P], None]) -> None:
    """Validate changes of dynamic parameters before they are taken, and hand the new table to `apply` after.

    What is refused is refused in this project's words: rclpy's own name neither the value, nor why, nor the way out.
    """
    known = {row.name: row for row in rows(table)}

    def merged(changes: Iterable[Parameter]) -> P:
        values = {name: node.get_parameter(name).value for name in known}
        values.update({change.name: change.value for change in changes if change.name in values})
        return from_mapping(table, values)

    def check(changes: list[Parameter]) -> None:
        _check_clock(node, changes)
        for name in (change.name for change in changes if change.name in known):
            if not known[name].dynamic:
                raise _fixed(name, node.get_parameter(name).value)
        merged(changes)

    def validate(changes: list[Parameter]) -> Any:
        return _verdict(lambda: check(changes))

    take = node.set_parameters_atomically

    def explained(changes: list[Parameter]) -> Any:
        refused = validate(changes)
        return take(changes) if refused.successful else refused

    # What the parameter services call; a callback comes after rclpy's own checks.
    node.set_parameters_atomically = explained  # type: ignore[assignment, method-assign]
    node.add_on_set_parameters_callback(validate)
    node.add_post_set_parameters_callback(lambda changes: apply(merged(changes)))


def _check_clock(node: Node, changes: Iterable[Parameter]) -> None:
    """Refuse another clock: what the node has made keeps time by the one that it began with."""
    value = node.get_parameter(_SIMULATED_TIME).value
    if any(change.name == _SIMULATED_TIME and change.value is not value for change in changes):
        raise _fixed(_SIMULATED_TIME, value)


def _fixed(name: str, value: object) -> ParameterError:
    problem = f"it stays so while the node runs, which is built on it; stop the node and start it with -p {name}:=VALUE"
    return ParameterError(problem, name, value)


def _verdict(check: Callable[[], object]) -> Any:
    """Return the answer to a change of parameters: refused with the line of the error that the check raises."""
    from jammkle_common.messages import message_class  # noqa: PLC0415 - rigs take parameters and no messages

    result = message_class("rcl_interfaces/msg/SetParametersResult")
    try:
        check()
    except ParameterError as error:
        return result(successful=False, reason=str(error))
    return result(successful=True)


def _descriptor(row: ParameterRow) -> Any:
    unit = f" [{row.unit}]" if row.unit else ""
    from jammkle_common.messages import message_class  # noqa: PLC0415 - rigs take parameters and no messages

    descriptor = message_class("rcl_interfaces/msg/ParameterDescriptor")(
        name=row.name,
        description=f"{row.description}{unit}",
        additional_constraints=", ".join(row.choices),
        read_only=not row.dynamic,
    )
    if row.minimum is not None and row.maximum is not None:
        if isinstance(row.default, float):
            kind = message_class("rcl_interfaces/msg/FloatingPointRange")
            descriptor.floating_point_range = [kind(from_value=row.minimum, to_value=row.maximum)]
        else:
            kind = message_class("rcl_interfaces/msg/IntegerRange")
            descriptor.integer_range = [kind(from_value=int(row.minimum), to_value=int(row.maximum), step=1)]
    return descriptor


@dataclass(frozen=True)
class TypedUnit:
    """A unit of the command line beside its SI unit, and how names of options and parameters end in them."""

    typed: str
    """Unit on the command line."""
    si_end: str
    """End of a parameter's name."""
    typed_end: str
    """End of an option's name, with underscores."""
    exponent: int
    """One typed unit is 10 to this power of the SI unit."""
    example: str
    """What to type for a value in SI."""


TYPED_UNITS = (
    TypedUnit("kPa", "_pa", "_kpa", 3, "50 for 50000 Pa"),
    TypedUnit("mm/s", "_m_s", "_mm_s", -3, "5 for 0.005 m/s"),
    TypedUnit("mm", "_m", "_mm", -3, "20 for 0.02 m"),
    TypedUnit("ml", "_m3", "_ml", -6, "100 for 0.0001 m^3"),
)
"""Every other unit is typed as it is inside: s, Hz, kg, deg, l/min."""

RENAMED = {"hardware check": {"--output": "--save-board-file"}}
"""Options that have another name now, by subcommand; those of the units above follow by themselves."""


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


def typed(parameter: str, value: float) -> str:
    """Return an option and what to give for it, for a sentence: `--drop-height-mm of 30` for 0.03 m."""
    return f"{option_name(parameter)} of {typed_value(parameter, value):g}"


def as_typed(error: Exception) -> str:
    """Return the line of an error with parameters as options, and values and limits in the units that are typed.

    It is a ParameterError, or what was raised from one.
    """
    text, cause = str(error), error
    while not isinstance(cause, ParameterError):
        if cause.__cause__ is None or not isinstance(cause.__cause__, Exception):
            return text
        cause = cause.__cause__
    if not cause.name:
        return text
    unit, name = _of_parameter(cause.name), f"--{typed_name(cause.name)}"
    if unit is None:
        return text.replace(str(cause), cause.text(name, lambda number: number, cause.unit))
    shift = -unit.exponent
    return text.replace(str(cause), cause.text(name, lambda number: _scaled(number, shift), unit.typed))


def renamed(option: str, known: Collection[str], command: str = "") -> str | None:
    """Return one line on where an option, as typed, went that a subcommand does not know; None if it never was one."""
    for words, names in RENAMED.items():
        if command.endswith(words) and option in names:
            return f"{option} is {names[option]} now"
    name = option.removeprefix("--").replace("-", "_")
    unit = _of_parameter(name)
    if unit is None or option_name(name) not in known:
        return None
    return f"{option} is {option_name(name)} now, in {unit.typed}: {unit.example}"


def _of_parameter(name: str) -> TypedUnit | None:
    """Return the unit of a parameter by the end of its name, in SI."""
    return next((unit for unit in TYPED_UNITS if name.endswith(unit.si_end)), None)


def _renamed(parameter: str, unit: TypedUnit) -> str:
    return parameter.removesuffix(unit.si_end) + unit.typed_end


def _scaled(value: float, exponent: int) -> float:
    """Return a value times a power of ten, as its digits say: 0.55 mm are the number that 0.00055 m is written as."""
    return float((Decimal(value) if isinstance(value, int) else Decimal(repr(float(value)))).scaleb(exponent))
