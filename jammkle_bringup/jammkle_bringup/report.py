"""Tables for people."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

from rich.markup import escape
from rich.table import Table

from jammkle_common.command.results import STATE_COLOURS

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from jammkle_bringup.conversions import HealthStatus, JamStatus
    from jammkle_bringup.core.bag_info import BagInfo
    from jammkle_bringup.core.run_summary import RunSummary
    from jammkle_common.bags.recovery import Recovered

_PA_PER_KPA = 1e3
_ALIKE = 0.02
_OK = "OK"
_PACE = "achieved real-time factor"
_LEVEL_STYLES = {"OK": "green", "WARN": "yellow", "ERROR": "bold red", "STALE": "dim"}


def status_tables(ankles: Mapping[str, JamStatus], health: Sequence[HealthStatus], *, verbose: bool) -> list[Table]:
    """Return the tables of `jammkle status`, one for each ankle; `verbose` shows every value that nodes report."""
    tables = [_channels(ankle, status) for ankle, status in ankles.items()]
    lines = Table(title="Health" if verbose else "Health: what is not OK", title_justify="left")
    for heading in ("node: what", "level", "message"):
        lines.add_column(heading, overflow="fold")
    shown = [line for line in health if verbose or line.level != _OK]
    for line in shown:
        text = "\n".join([line.message, *(f"{key}: {value}" for key, value in line.values.items())])
        lines.add_row(escape(line.name), _styled(line.level, _LEVEL_STYLES), escape(text))
    return [*tables, lines] if shown else tables


def status_line(ankles: Mapping[str, JamStatus], health: Sequence[HealthStatus], *, verbose: bool) -> str:
    """Return all of `jammkle status` in one line: ankles, states of their channels, nodes, what is not OK, the pace."""
    states = Counter(channel.state for status in ankles.values() for channel in status.channels)
    channels = ", ".join(f"{count} {state}" for state, count in states.most_common())
    nodes = len({line.name.partition(":")[0] for line in health})
    bad = Counter(line.level for line in health if line.level != _OK)
    levels = ", ".join(f"{count} {level}" for level, count in bad.most_common()) or "all OK"
    parts = [_count(len(ankles), "ankle"), f"channels {channels}", f"{_count(nodes, 'node')}, {levels}"]
    parts += [f"real-time factor {line.values[_PACE]}" for line in health if _PACE in line.values]
    return "; ".join(parts) + ("" if verbose else " (--all shows every line)")


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"


def _channels(ankle: str, status: JamStatus) -> Table:
    channels = Table(title=f"Channels of {ankle}" if ankle else "Channels", title_justify="left")
    for heading in ("channel", "state"):
        channels.add_column(heading)
    for heading in ("commanded, kPa", "measured, kPa"):
        channels.add_column(heading, justify="right")
    channels.add_column("reason")
    for channel in status.channels:
        channels.add_row(
            channel.channel,
            _styled(channel.state, STATE_COLOURS),
            f"{channel.commanded_vacuum_kpa:.1f}",
            _kpa(channel.measured_vacuum_kpa),
            escape(channel.reason),
        )
    channels.add_row("manifold", "", "", _kpa(status.manifold_vacuum_kpa), "")
    return channels


def info_line(info: BagInfo) -> str:
    """Return all of a bag in one line: what it holds, over which time, and by whose clock."""
    return (
        f"{info.bag}: {info.messages} messages on {_count(len(info.topics), 'topic')} in {info.duration_s:.3f} s from "
        f"ROS time {info.start_s:.3f} s{_other_clock(info)}"
    )


def custom_lines(info: BagInfo, *, verbose: bool) -> list[str]:
    """Return what the recorder added, whole if `verbose`; else what fits in a line each, and how much more there is."""
    lines = []
    for key, value in info.custom_data.items():
        text = value.rstrip()
        count = text.count("\n") + 1
        if count == 1:
            lines.append(f"{key}: {text}")
        else:
            lines.append(f"{key}:\n{text}" if verbose else f"{key}: {count} lines (--verbose shows them)")
    return lines


def info_tables(info: BagInfo) -> list[Table]:
    """Return the table of `jammkle info`."""
    topics = Table()
    # names break where a person would break them; the type stands below its topic, so that both fit in 80 columns
    topics.add_column("topic, type", no_wrap=True)
    for heading in ("count", "rate, Hz"):
        topics.add_column(heading, justify="right", no_wrap=True)
    topics.add_column("by", no_wrap=True)
    topics.add_column("offered as")
    for topic in info.topics:
        durability = topic.durability.replace("transient_local", "latched")
        offered = ", ".join(part for part in (topic.reliability, durability) if part)
        name = f"{escape(topic.name)}\n  [dim]{escape(topic.message_type)}[/dim]"
        rate = "" if topic.rate_hz is None else f"{topic.rate_hz:.1f}"
        topics.add_row(name, str(topic.count), rate, topic.rate_by if rate else "", offered)
    return [topics]


def _other_clock(info: BagInfo) -> str:
    """Return a word on data that has another time than its log."""
    if not info.duration_s or abs(info.data_duration_s / info.duration_s - 1.0) < _ALIKE:
        return ""
    return f"; its data span {info.data_duration_s:.3f} s by their own clock"


def recovery_text(done: Recovered) -> str:
    """Return the lines of `jammkle recover`."""
    holds = f"{done.bag}: {done.messages} messages in {done.duration_s:.3f} s"
    lost = f"; of it {', '.join(done.missing)} {'is' if len(done.missing) == 1 else 'are'} lost" if done.missing else ""
    if done.was_whole:
        return f"{holds}; {'' if lost else 'it is whole, '}nothing was to be done{lost}"
    is_whole = "it is whole now" if not (lost or done.lacking) else "what is left of it can be read now"
    torn = f"; {done.torn_bytes} bytes at the end were torn and are cut off" if done.torn_bytes else ""
    given_up = f"; {done.given_up} messages at the end were given up for room" if done.given_up else ""
    lacking = f"; {done.lacking} messages that its metadata counted are not there" if done.lacking else ""
    return f"{holds}; {is_whole}{torn}{given_up}{lost}{lacking}"


def summary_table(summary: RunSummary) -> Table:
    """Return the short table of a landing."""
    table = Table(title="Landing", title_justify="left", show_header=False)
    table.add_column("what")
    table.add_column("value")
    table.add_row("touch-down", _seconds(summary.touch_down_s))
    table.add_row("impact detected", f"{_seconds(summary.detected_s)}{_after(summary.detected_s, summary)}")
    for channel in summary.channels:
        if channel.reached_s is None or channel.commanded_vacuum_pa is None:
            greatest = "" if channel.greatest_vacuum_pa is None else f" (at most {_pa(channel.greatest_vacuum_pa)})"
            table.add_row(channel.channel, f"did not reach its vacuum{greatest}")
            continue
        reached = f"{_pa(channel.commanded_vacuum_pa)} at {_seconds(channel.reached_s)}"
        table.add_row(channel.channel, f"{reached}{_after(channel.reached_s, summary)}")
    peak = summary.peak_deceleration_m_s2
    table.add_row("peak deceleration", "not known" if peak is None else f"{peak:.2f} m/s² (IMU z minus g)")
    table.add_row("bag", escape(summary.bag))
    return table


def _after(time_s: float | None, summary: RunSummary) -> str:
    if time_s is None or summary.touch_down_s is None:
        return ""
    late_ms = round((time_s - summary.touch_down_s) * 1e3, 1) + 0.0  # no -0.0
    return f", {late_ms:+.1f} ms from touch-down"


def _seconds(time_s: float | None) -> str:
    return "not seen" if time_s is None else f"{time_s:.3f} s"


def _pa(pascal: float) -> str:
    return f"{pascal / _PA_PER_KPA:.1f} kPa"


def _kpa(kilopascal: float | None) -> str:
    return "not measured" if kilopascal is None else f"{kilopascal:.1f}"


def _styled(text: str, styles: dict[str, str]) -> str:
    style = styles.get(text)
    return f"[{style}]{text}[/{style}]" if style else text
