"""What is in a bag: topics, types, counts, rates, QoS and what its recorder added."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from rich.markup import escape
from rich.table import Table

from jammkle_common.bags.contents import profiles
from jammkle_common.bags.reading import opened
from jammkle_common.bags.run_sheet import read_sheet
from jammkle_common.bags.times import BagTimes, Span, other_clock
from jammkle_common.constants import NANOSECONDS_PER_SECOND
from jammkle_common.names import SIM_PARAMETERS

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from jammkle_common.bags.storage import Connection

_PROGRESS_MESSAGES = 10_000


@dataclass(frozen=True)
class TopicInfo:
    """One topic."""

    name: str
    """Absolute name."""
    message_type: str
    """`package/msg/Name`."""
    count: int
    rate_hz: float | None
    """Mean rate between its first and its last message; None for fewer than two moments."""
    rate_by: str
    """Whose time that is: `stamp`, `/clock` or `log`."""
    reliability: str
    durability: str


@dataclass(frozen=True)
class BagInfo:
    """One bag. Start is ROS time, s; custom data is what the recorder added, as text.

    `duration_s` is that of the log, `data_duration_s` that of stamps and /clock, which differs where a simulation did
    not run in real time and the log has the time of the machine.
    """

    bag: str
    start_s: float
    duration_s: float
    data_duration_s: float
    messages: int
    topics: tuple[TopicInfo, ...]
    custom_data: dict[str, str]
    has_run_sheet: bool
    """Whether the bag, or a file in it or beside it, says what was done to the machine."""


def bag_info(path: Path, on_progress: Callable[[float], None]) -> BagInfo:
    """Read a bag's description, and all its messages once, to see that it is whole; tell the share that was read.

    Raises:
        InputError: it cannot be read, or is damaged.

    """
    with opened(path) as reader:
        empty = reader.message_count == 0
        times, whole = BagTimes(reader), Span()
        spans = {connection.topic: Span() for connection in reader.connections}
        for number, message in enumerate(times.messages(reader.connections)):
            spans[message.connection.topic].take(message.time_ns)
            whole.take(message.time_ns)
            if number % _PROGRESS_MESSAGES == 0:
                on_progress(number / reader.message_count)
        is_described = any(each.topic.rpartition("/")[2] == SIM_PARAMETERS.name for each in reader.connections)
        return BagInfo(
            bag=str(path),
            start_s=0.0 if empty else reader.start_time / NANOSECONDS_PER_SECOND,
            duration_s=0.0 if empty else (reader.end_time - reader.start_time) / NANOSECONDS_PER_SECOND,
            data_duration_s=whole.duration_s,
            messages=reader.message_count,
            topics=tuple(
                _topic(connection, spans[connection.topic], times)
                for connection in sorted(reader.connections, key=lambda connection: connection.topic)
            ),
            custom_data=reader.custom_data,
            has_run_sheet=is_described or bool(read_sheet(path, None).rig),
        )


def _topic(connection: Connection, span: Span, times: BagTimes) -> TopicInfo:
    offered = profiles(connection.offered)
    return TopicInfo(
        name=connection.topic,
        message_type=connection.msgtype,
        count=connection.msgcount,
        rate_hz=span.rate_hz,
        rate_by=times.source(connection).value,
        reliability=", ".join(sorted({profile.reliability.name.lower() for profile in offered})),
        durability=", ".join(sorted({profile.durability.name.lower() for profile in offered})),
    )


def constant_name(message: Any, value: int) -> str:
    """Return the constant that has a value in the definition of a message, which may be the bag's own."""
    kind = type(message)
    return next((name for name in dir(kind) if name.isupper() and getattr(kind, name) == value), str(value))


def info_line(info: BagInfo) -> str:
    """Return all of a bag in one line: what it holds, over which time, and by whose clock."""
    topics = f"{len(info.topics)} topic{'' if len(info.topics) == 1 else 's'}"
    return (
        f"{info.bag}: {info.messages} messages on {topics} in {info.duration_s:.3f} s from "
        f"ROS time {info.start_s:.3f} s{other_clock(info.duration_s, info.data_duration_s)}"
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


def info_table(info: BagInfo) -> Table:
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
    return topics
