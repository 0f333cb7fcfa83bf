"""What people read: tables that fit their terminal and leave nothing out in a pipe; when `status` has all reports."""

from __future__ import annotations

import io

import pytest
from rich.console import Console

from jammkle_bringup import channels
from jammkle_bringup.channels import ChannelStatus, HealthStatus, JamStatus, all_reported
from jammkle_bringup.core.bag_info import BagInfo, TopicInfo, custom_lines, info_line, info_table
from jammkle_bringup.core.landing import ChannelSummary, RunSummary
from jammkle_bringup.demo import summary_table
from jammkle_common.command.results import STATE_COLOURS
from jammkle_common.diagnostics import LIVENESS_LINE, MISSED_AFTER_S, SILENT_FOR
from jammkle_common.names import TOPICS
from jammkle_view.core.figure import STATE_TINTS, css

STATUS = JamStatus(1.0, False, 50.0, (ChannelStatus("achilles", "JAMMED", 50.0, 49.0, ""),))  # noqa: FBT003 - the message's order
HEALTH = (
    HealthStatus("/sim: simulation", "OK", "running", {"achieved real-time factor": "0.998", "late cycles": "3"}),
    HealthStatus("/driver: pump", "WARN", "weak", {"duty": "1.0"}),
)


def shown(*tables: object, width: int = 80) -> str:
    """Return what a terminal of a width shows."""
    out = io.StringIO()
    console = Console(file=out, width=width, highlight=False)
    for table in tables:
        console.print(table)
    return out.getvalue()


def test_info_breaks_no_name_in_80_columns() -> None:
    """Every topic of the graph and every type stands in one piece on a terminal of 80 columns."""
    topics = tuple(
        TopicInfo(f"/lf_ankle/{topic.name}", topic.message_type, 123456, 500.0, "stamp", "reliable", "transient_local")
        for topic in TOPICS
    )
    text = shown(info_table(BagInfo("bag", 0.0, 1.0, 1.0, 2, topics, {}, has_run_sheet=True)))
    for topic in topics:
        assert topic.name in text
        assert topic.message_type in text


def test_status_shows_values_where_something_is_wrong() -> None:
    """One line says it all; what is OK is counted and not shown, but with verbose."""
    line = channels.status_line({"": STATUS}, HEALTH, verbose=False)
    assert line.startswith("1 ankle; channels 1 JAMMED; 2 nodes, 1 WARN; real-time factor 0.998")
    assert "--all" in line
    assert "all OK" in channels.status_line({"": STATUS}, HEALTH[:1], verbose=True)
    brief = shown(*channels.status_tables({"": STATUS}, HEALTH, verbose=False))
    assert "duty: 1.0" in brief
    assert "/sim: simulation" not in brief
    assert "Health" not in shown(*channels.status_tables({"": STATUS}, HEALTH[:1], verbose=False))
    assert "late cycles: 3" in shown(*channels.status_tables({"": STATUS}, HEALTH, verbose=True))


def test_info_is_short_unless_asked() -> None:
    """First a line; of what the recorder added, what takes many lines is counted, and shown with verbose."""
    info = BagInfo("bag", 5.0, 1.0, 1.0, 2, (), {"rig": "drop", "parameters": "a: 1\nb: 2\n"}, has_run_sheet=True)
    assert info_line(info) == "bag: 2 messages on 0 topics in 1.000 s from ROS time 5.000 s"
    assert custom_lines(info, verbose=False) == ["rig: drop", "parameters: 2 lines (--verbose shows them)"]
    assert custom_lines(info, verbose=True) == ["rig: drop", "parameters:\na: 1\nb: 2"]


def test_a_state_has_one_colour_everywhere() -> None:
    """Tables, pictures of a run and the page in the browser take it from one place."""
    assert "[#196eeb]JAMMED[/#196eeb]" in str(
        channels.status_tables({"": STATUS}, (), verbose=False)[0].columns[1]._cells
    )
    assert {state.name: css(tint) for state, tint in STATE_TINTS.items()} == {
        name: css(tuple(bytes.fromhex(colour[1:]))) for name, colour in STATE_COLOURS.items()
    }


@pytest.mark.parametrize(
    ("late_s", "text"), [(0.0, "+0.0 ms"), (-1e-9, "+0.0 ms"), (0.0004, "+0.4 ms"), (-0.002, "-2.0 ms")]
)
def test_times_from_touch_down_have_a_tenth_of_a_millisecond(late_s: float, text: str) -> None:
    """The controller may decide on the very sample of touch-down, or half a millisecond later."""
    channel = ChannelSummary("achilles", 1.1, 50e3, 1.5, 50e3)
    summary = RunSummary("bag", "/", 2.0, 1.1, 1.1 + late_s, 0.0, 50.0, (channel,), ())
    assert f", {text} from touch-down" in shown(summary_table(summary))


DRIVERS = ("/lf_ankle/driver", "/rf_ankle/driver")


def lines(*nodes: str, **silent_s: float) -> dict[str, HealthStatus]:
    """Return reports of nodes; each says how long those given have been silent, which it knows by relative names."""
    values = {f"{name}{SILENT_FOR}": f"{each:.1f}" for name, each in silent_s.items()}
    return {f"{node}{LIVENESS_LINE}": HealthStatus(f"{node}{LIVENESS_LINE}", "OK", "", values) for node in nodes}


def test_every_driver_and_all_that_they_know_is_waited_for() -> None:
    """A driver that has not reported, or a node that another one receives, is still to come."""
    assert not all_reported({}, DRIVERS)
    assert not all_reported(lines(DRIVERS[0]), DRIVERS)
    assert all_reported(lines(*DRIVERS), DRIVERS)
    known = lines(*DRIVERS, controller=0.5)
    assert not all_reported(known, DRIVERS)
    assert not all_reported(known | lines("/lf_ankle/controller"), DRIVERS)
    assert all_reported(known | lines("/lf_ankle/controller", "/rf_ankle/controller"), DRIVERS)


def test_the_simulation_above_is_known_by_its_whole_name() -> None:
    """A robot's simulation stands outside the ankle's namespace."""
    known = lines(*DRIVERS, **{"/sim": 0.1})
    assert not all_reported(known, DRIVERS)
    assert all_reported(known | lines("/sim"), DRIVERS)


def test_the_dead_are_not_waited_for() -> None:
    """Whom the others miss already will not report: to wait for it would take seconds, each time."""
    assert all_reported(lines(*DRIVERS, controller=MISSED_AFTER_S + 0.1), DRIVERS)
