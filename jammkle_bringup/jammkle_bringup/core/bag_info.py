"""What is in a bag: topics, types, counts, rates, QoS and what its recorder added."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from rosbags.interfaces import ConnectionExtRosbag2

from jammkle_graph.bags.reading import messages, opened
from jammkle_graph.constants import NANOSECONDS_PER_SECOND

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from rosbags.highlevel import AnyReader
    from rosbags.interfaces import Connection, Qos


_PROGRESS_MESSAGES = 10_000


@dataclass(frozen=True)
class TopicInfo:
    """One topic: count, mean rate over the bag's duration (0 for a bag of one instant), and how it was offered."""

    name: str
    message_type: str
    count: int
    rate_hz: float
    reliability: str
    durability: str


@dataclass(frozen=True)
class BagInfo:
    """One bag. Start is ROS time, s; custom data is what the recorder added, as text."""

    bag: str
    start_s: float
    duration_s: float
    messages: int
    topics: tuple[TopicInfo, ...]
    custom_data: dict[str, str]

    def as_json(self) -> dict[str, Any]:
        """Return a mapping for JSON."""
        return asdict(self)


def bag_info(path: Path, on_progress: Callable[[float], None]) -> BagInfo:
    """Read a bag's description, and all its messages once, to see that it is whole.

    Args:
        path: The bag.
        on_progress: Called now and then with the share that was read, 0 to 1.

    Raises:
        InputError: it cannot be read, or is damaged.

    """
    with opened(path) as reader:
        empty = reader.message_count == 0
        for count, _ in enumerate(messages(reader, path)):
            if count % _PROGRESS_MESSAGES == 0:
                on_progress(count / reader.message_count)
        duration_s = 0.0 if empty else reader.duration / NANOSECONDS_PER_SECOND
        return BagInfo(
            bag=str(path),
            start_s=0.0 if empty else reader.start_time / NANOSECONDS_PER_SECOND,
            duration_s=duration_s,
            messages=reader.message_count,
            topics=tuple(
                _topic(connection, duration_s)
                for connection in sorted(reader.connections, key=lambda connection: connection.topic)
            ),
            custom_data=_custom_data(reader),
        )


def _topic(connection: Connection, duration_s: float) -> TopicInfo:
    profiles: list[Qos] = []
    if isinstance(connection.ext, ConnectionExtRosbag2):
        profiles = connection.ext.offered_qos_profiles
    return TopicInfo(
        name=connection.topic,
        message_type=connection.msgtype,
        count=connection.msgcount,
        rate_hz=connection.msgcount / duration_s if duration_s > 0 else 0.0,
        reliability=", ".join(sorted({profile.reliability.name.lower() for profile in profiles})),
        durability=", ".join(sorted({profile.durability.name.lower() for profile in profiles})),
    )


def _custom_data(reader: AnyReader) -> dict[str, str]:
    found: dict[str, str] = {}
    for part in reader.readers:
        metadata = getattr(getattr(part, "storage", None), "metadata", None)  # a single file of a bag has none
        found.update(getattr(metadata, "custom", None) or {})
    return found
