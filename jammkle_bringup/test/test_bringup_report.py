"""What people read: tables that fit their terminal and leave nothing out in a pipe."""

from __future__ import annotations

import io

import pytest
from rich.console import Console

from jammkle_bringup import report
from jammkle_bringup.conversions import ChannelStatus, HealthStatus, JamStatus
from jammkle_bringup.core.bag_info import BagInfo, TopicInfo
from jammkle_bringup.core.run_summary import ChannelSummary, RunSummary
from jammkle_common.command.results import STATE_COLOURS
from jammkle_common.names import TOPICS
from jammkle_view.core.tints import STATE_TINTS, css

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
    text = shown(*report.info_tables(BagInfo("bag", 0.0, 1.0, 1.0, 2, topics, {})))
    for topic in topics:
        assert topic.name in text
        assert topic.message_type in text


def test_status_shows_values_where_something_is_wrong() -> None:
    """One line says it all; what is OK is counted and not shown, but with verbose."""
    line = report.status_line({"": STATUS}, HEALTH, verbose=False)
    assert line.startswith("1 ankle; channels 1 JAMMED; 2 nodes, 1 WARN; real-time factor 0.998")
    assert "--all" in line
    assert "all OK" in report.status_line({"": STATUS}, HEALTH[:1], verbose=True)
    brief = shown(*report.status_tables({"": STATUS}, HEALTH, verbose=False))
    assert "duty: 1.0" in brief
    assert "/sim: simulation" not in brief
    assert "Health" not in shown(*report.status_tables({"": STATUS}, HEALTH[:1], verbose=False))
    assert "late cycles: 3" in shown(*report.status_tables({"": STATUS}, HEALTH, verbose=True))


def test_info_is_short_unless_asked() -> None:
    """First a line; of what the recorder added, what takes many lines is counted, and shown with verbose."""
    info = BagInfo("bag", 5.0, 1.0, 1.0, 2, (), {"rig": "drop", "parameters": "a: 1\nb: 2\n"})
    assert report.info_line(info) == "bag: 2 messages on 0 topics in 1.000 s from ROS time 5.000 s"
    assert report.custom_lines(info, verbose=False) == ["rig: drop", "parameters: 2 lines (--verbose shows them)"]
    assert report.custom_lines(info, verbose=True) == ["rig: drop", "parameters:\na: 1\nb: 2"]


def test_a_state_has_one_colour_everywhere() -> None:
    """Tables, pictures of a run and the page in the browser take it from one place."""
    assert "[#196eeb]JAMMED[/#196eeb]" in str(
        report.status_tables({"": STATUS}, (), verbose=False)[0].columns[1]._cells
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
    assert f", {text} from touch-down" in shown(report.summary_table(summary))
