"""Whether two bags of one simulated graph agree: every message of all that steers, its log time and its bytes."""

from __future__ import annotations

from collections import defaultdict
from typing import TYPE_CHECKING

from rosbags.highlevel import AnyReader

from jammkle_common.names import CLOCK

if TYPE_CHECKING:
    from pathlib import Path

REAL_TIME = ("/diagnostics",)
"""Topics that report on real time as well, and so differ: real-time factors, how long nodes took."""


def recorded(bag: Path, until_ns: int) -> dict[str, list[tuple[int, bytes]]]:
    """Return log time and bytes of every message after the start of time and up to `until_ns`, by topic.

    A tick of /clock that is repeated while time stands still counts once.
    """
    found: dict[str, list[tuple[int, bytes]]] = defaultdict(list)
    with AnyReader([bag]) as reader:
        for connection, log_ns, data in reader.messages():
            if connection.topic in REAL_TIME or not 0 < log_ns <= until_ns:
                continue
            message = (log_ns, bytes(data))
            if connection.topic != CLOCK.name or message not in found[CLOCK.name][-1:]:
                found[connection.topic].append(message)
    return found


def differences(first: Path, second: Path, until_ns: int) -> list[str]:
    """Return a line for each topic in which two bags differ up to a simulated time, ns; none where they agree."""
    one, other = recorded(first, until_ns), recorded(second, until_ns)
    lines = []
    for topic in sorted({*one, *other}):
        pairs = zip(one[topic], other[topic], strict=False)
        odd = next((index for index, (mine, yours) in enumerate(pairs) if mine != yours), None)
        if odd is None and len(one[topic]) == len(other[topic]):
            continue
        index = min(len(one[topic]), len(other[topic])) if odd is None else odd
        at_s = [each[topic][index][0] / 1e9 if index < len(each[topic]) else None for each in (one, other)]
        lines.append(f"{topic}: {len(one[topic])} and {len(other[topic])} messages, apart from {index} on, at {at_s} s")
    return lines
