"""The parameter mechanism: what a table accepts, and how it refuses."""

from __future__ import annotations

import math
from dataclasses import dataclass

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter

from domains import own_domain
from jammkle_common.parameters import ParameterError, declare, from_mapping, on_change, parameter, rows


@dataclass(frozen=True)
class Table:
    """A table with one parameter of each type."""

    vacuum_pa: float = parameter(50e3, "Vacuum", "Pa", 5e3, 80e3)
    count: int = parameter(3, "How many", "", 1, 5)
    robot: str = parameter("ankle", "Which robot", choices=("ankle", "leg"))
    autostart: bool = parameter(default=True, description="Start by itself")


def test_defaults_stand_when_nothing_is_given() -> None:
    """An empty mapping gives the defaults."""
    assert from_mapping(Table, {}) == Table()


def test_rows_document_name_unit_and_range() -> None:
    """A row knows its own name and prints its range with the unit."""
    assert [row.name for row in rows(Table)] == ["vacuum_pa", "count", "robot", "autostart"]
    assert rows(Table)[0].range_text == "5000 to 80000 Pa"


@given(st.floats(allow_nan=True, allow_infinity=True))
def test_a_float_is_taken_exactly_within_its_range(value: float) -> None:
    """In range it is kept to the bit, outside (or not finite) it is refused with value and limit."""
    if math.isfinite(value) and 5e3 <= value <= 80e3:
        assert from_mapping(Table, {"vacuum_pa": value}).vacuum_pa == value
    else:
        with pytest.raises(ParameterError, match=r"vacuum_pa.*must be"):
            from_mapping(Table, {"vacuum_pa": value})


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (
            {"vacuum_kpa": 50.0},
            "unknown parameter 'vacuum_kpa'; known are: autostart, count, robot, vacuum_pa; did you mean vacuum_pa?",
        ),
        ({"vacuum_pa": "much"}, "must be a number"),
        ({"count": 2.5}, "must be a whole number"),
        ({"count": True}, "must be a whole number"),
        ({"autostart": 1}, "must be true or false"),
        ({"robot": "hand"}, "one of ankle, leg"),
        ({"count": 9}, "must be 1 to 5"),
    ],
)
def test_bad_values_are_refused_in_one_line(values: dict[str, object], message: str) -> None:
    """The message names the parameter, what was given and what would be right."""
    with pytest.raises(ParameterError) as caught:
        from_mapping(Table, values)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_whole_number_serves_as_a_float() -> None:
    """YAML writers drop the point: 50000 is 50000.0."""
    assert from_mapping(Table, {"vacuum_pa": 50000}).vacuum_pa == 50e3


@pytest.mark.parametrize("has_dynamic", [False, True])
@pytest.mark.parametrize("simulated", [False, True])
def test_a_node_keeps_the_clock_that_it_began_with(
    monkeypatch: pytest.MonkeyPatch, *, simulated: bool, has_dynamic: bool
) -> None:
    """It starts with either; while it runs another one is refused, with the reason, and the same one is taken."""
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    with own_domain() as domain_id:
        context = Context()
        context.init(domain_id=domain_id)
        clock = Parameter("use_sim_time", value=simulated)
        node = Node(
            "any",
            context=context,
            parameter_overrides=[clock],
            automatically_declare_parameters_from_overrides=True,
        )
        declare(node, Table)
        if has_dynamic:
            on_change(node, Table, lambda _table: None)
        other = node.set_parameters_atomically([Parameter("use_sim_time", value=not simulated)])
        same = node.set_parameters_atomically([clock])
        kept = node.get_clock().ros_time_is_active
        node.destroy_node()
        context.shutdown()
    assert not other.successful
    assert f"'use_sim_time' is {simulated}; it stays so while the node runs" in other.reason
    assert (same.successful, kept) == (True, simulated)
