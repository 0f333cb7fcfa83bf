"""A node's parameters as one frozen dataclass: declared, described, bounded, validated and documented from it.

    @dataclass(frozen=True)
    class DriverParameters:
        default_vacuum_pa: float = parameter(50e3, "Vacuum of a jam request that names none", "Pa", 5e3, 80e3)

`declare` takes such a class onto a node. Does not import rclpy.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, TypeVar

from jammkle_common.messages import message_class

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from rclpy.node import Node
    from rclpy.parameter import Parameter

Value = bool | int | float | str
_METADATA_KEY = "jammkle_parameter"
_RCLPY_PARAMETERS = ("use_sim_time", "start_type_description_service")
_RCLPY_PREFIX = "qos_overrides."
_TYPE_TEXT: dict[type, str] = {bool: "true or false", int: "a whole number", float: "a number", str: "text"}


class ParameterError(ValueError):
    """A parameter that does not exist, has the wrong type or is out of range. The message is one clear line."""


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

    @property
    def range_text(self) -> str:
        """Range for people: `5000 to 80000 Pa`, `ankle, leg`, or empty."""
        if self.choices:
            return ", ".join(self.choices)
        if self.minimum is None or self.maximum is None:
            return ""
        style = "g" if isinstance(self.default, float) else ".0f"
        return f"{self.minimum:{style}} to {self.maximum:{style}} {self.unit}".rstrip()

    def check(self, value: object) -> Value:
        """Return `value` in the parameter's type.

        Raises:
            ParameterError: wrong type, NaN, out of range, or not one of the choices.

        """
        kind = type(self.default)
        if kind is float and isinstance(value, int) and not isinstance(value, bool):
            value = float(value)
        if type(value) is not kind:
            msg = f"parameter '{self.name}' is {value!r}, and must be {_TYPE_TEXT[kind]}"
            raise ParameterError(msg)
        if isinstance(value, float) and not math.isfinite(value):
            msg = f"parameter '{self.name}' is {value}; it must be a finite number"
            raise ParameterError(msg)
        if self.choices and value not in self.choices:
            msg = f"parameter '{self.name}' is '{value}'; it must be one of {self.range_text}"
            raise ParameterError(msg)
        if (
            isinstance(value, (int, float))
            and self.minimum is not None
            and self.maximum is not None
            and not self.minimum <= value <= self.maximum
        ):
            msg = f"parameter '{self.name}' is {value:g}; it must be {self.range_text}"
            raise ParameterError(msg)
        return value


def parameter(
    default: Value,
    description: str,
    unit: str = "",
    minimum: float | None = None,
    maximum: float | None = None,
    *,
    choices: Sequence[str] = (),
    dynamic: bool = False,
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

    """
    row = ParameterRow("", default, description, unit, minimum, maximum, tuple(choices), dynamic)
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
        raise ParameterError(msg)
    return table(**{name: known[name].check(value) for name, value in values.items()})


def declare(node: Node, table: type[P]) -> P:
    """Declare every row of `table` on `node` and return the values in force.

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
    return values


def on_change(node: Node, table: type[P], apply: Callable[[P], None]) -> None:
    """Validate changes of dynamic parameters before they are taken, and hand the new table to `apply` after.

    What is refused is refused in this project's words: rclpy's own name neither the value, nor why, nor the way out.
    """
    known = {row.name: row for row in rows(table)}
    result = message_class("rcl_interfaces/msg/SetParametersResult")

    def merged(changes: Iterable[Parameter]) -> P:
        values = {name: node.get_parameter(name).value for name in known}
        values.update({change.name: change.value for change in changes if change.name in values})
        return from_mapping(table, values)

    def validate(changes: list[Parameter]) -> Any:
        try:
            for name in (change.name for change in changes if change.name in known):
                _check_dynamic(known[name], node.get_parameter(name).value)
            merged(changes)
        except ParameterError as error:
            return result(successful=False, reason=str(error))
        return result(successful=True)

    take = node.set_parameters_atomically

    def explained(changes: list[Parameter]) -> Any:
        refused = validate(changes)
        return take(changes) if refused.successful else refused

    # What the parameter services call; a callback comes after rclpy's own checks.
    node.set_parameters_atomically = explained  # type: ignore[assignment, method-assign]
    node.add_on_set_parameters_callback(validate)
    node.add_post_set_parameters_callback(lambda changes: apply(merged(changes)))


def _check_dynamic(row: ParameterRow, value: object) -> None:
    if not row.dynamic:
        msg = (
            f"parameter '{row.name}' is {value!r} and stays so while the node runs, which is built on it; "
            f"stop the node and start it with -p {row.name}:=VALUE"
        )
        raise ParameterError(msg)


def _descriptor(row: ParameterRow) -> Any:
    """Return rcl_interfaces/ParameterDescriptor."""
    unit = f" [{row.unit}]" if row.unit else ""
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
