"""Take a parameter table onto a node: declare, describe, bound, validate, and apply changes."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeVar

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult

from jammkle_common.parameters import ParameterClass, ParameterError, ParameterRow, from_mapping, of_table, rows

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from rclpy.node import Node
    from rclpy.parameter import Parameter

P = TypeVar("P", bound=ParameterClass)


def declare(node: Node, table: type[P]) -> P:
    """Declare every row of `table` on `node` and return the values in force.

    Args:
        node: The node; values come from its command line, launch file or YAML file.
        table: The node's parameter dataclass.

    Raises:
        ParameterError: an unknown parameter was given, or a value has the wrong type or is out of range.

    """
    known = {row.name: row for row in rows(table)}
    # rclpy drops what nobody declares without a word, and a typing error in a YAML file would go unseen.
    # Its public interface does not tell what was given.
    given = {name: value.value for name, value in node._parameter_overrides.items()}  # noqa: SLF001
    try:
        values = from_mapping(table, of_table(given))
    except ParameterError as error:
        msg = f"{node.get_fully_qualified_name()}: {error}"
        raise ParameterError(msg) from error
    for row in known.values():
        value = getattr(values, row.name)
        node.declare_parameter(row.name, value, _descriptor(row), ignore_override=True)
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

    def validate(changes: list[Parameter]) -> SetParametersResult:
        try:
            for name in (change.name for change in changes if change.name in known):
                _check_dynamic(known[name], node.get_parameter(name).value)
            merged(changes)
        except ParameterError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    take = node.set_parameters_atomically

    def explained(changes: list[Parameter]) -> SetParametersResult:
        refused = validate(changes)
        return take(changes) if refused.successful else refused

    # What the parameter services call; a callback comes after rclpy's own checks.
    node.set_parameters_atomically = explained  # type: ignore[method-assign]
    node.add_on_set_parameters_callback(validate)
    node.add_post_set_parameters_callback(lambda changes: apply(merged(changes)))


def _check_dynamic(row: ParameterRow, value: object) -> None:
    if not row.dynamic:
        msg = (
            f"parameter '{row.name}' is {value!r} and stays so while the node runs, which is built on it; "
            f"stop the node and start it with -p {row.name}:=VALUE"
        )
        raise ParameterError(msg)


def _descriptor(row: ParameterRow) -> ParameterDescriptor:
    unit = f" [{row.unit}]" if row.unit else ""
    descriptor = ParameterDescriptor(
        name=row.name,
        description=f"{row.description}{unit}",
        additional_constraints=", ".join(row.choices),
        read_only=not row.dynamic,
    )
    if row.minimum is not None and row.maximum is not None:
        if isinstance(row.default, float):
            bounds = FloatingPointRange(from_value=row.minimum, to_value=row.maximum)
            descriptor.floating_point_range = [bounds]
        else:
            descriptor.integer_range = [IntegerRange(from_value=int(row.minimum), to_value=int(row.maximum), step=1)]
    return descriptor
