"""When each message of a recording was published: the log time that it gets, whenever its recorder came round to it.

On hardware that is the middleware's source timestamp. In simulation it is simulated time: a message of the node that
makes /clock belongs to the tick that follows it, or to its own stamp; one of any other node to the last tick before it.
Which tick that was is known by source timestamps, which the publishers of one machine take from one clock. In lockstep
this is exact, since a node publishes between a tick and its answer to it.
"""

from __future__ import annotations

import bisect
import enum
from dataclasses import dataclass
from typing import TYPE_CHECKING

from jammkle_common.constants import NANOSECONDS_PER_SECOND

if TYPE_CHECKING:
    from collections.abc import Callable

OTHER_EPOCH_NS = 60 * NANOSECONDS_PER_SECOND
"""Difference of stamp and source timestamp from which on they are of two clocks: no stamp is older than a minute."""

_MOST_TICKS = 100_000
"""Ticks that are remembered: more than a recorder's queues hold messages between."""


class TimeSource(enum.Enum):
    """Which clock gives the log times of a bag."""

    UNDECIDED = "undecided"
    """It is not known yet whether there is a /clock: messages wait."""
    SIMULATED = "simulated"
    """/clock. Messages from before its first tick get their own stamp, or the time of that tick if they have none."""
    SYSTEM = "system"
    """The clock of the machines that publish."""


@dataclass(frozen=True)
class Received:
    """A message as it was received.

    Attributes:
        topic: Full name.
        data: Serialised (CDR).
        source_ns: When it was published, ns of its publisher's system clock.
        stamp_ns: Stamp of its header, ns; 0 where it has none.

    """

    topic: str
    data: bytes
    source_ns: int
    stamp_ns: int = 0


class LogTimes:
    """Gives messages their log times, and holds them until those are known."""

    def __init__(
        self, source: TimeSource, write: Callable[[Received, int], None], is_of_clock_maker: Callable[[str], bool]
    ) -> None:
        """Start.

        Args:
            source: Which clock to use; UNDECIDED goes by the first stamp, or the first tick.
            write: Takes each message with its log time, ns.
            is_of_clock_maker: Whether a topic is published by the node that makes /clock; asked when a message is
                written, as the graph may not know a publisher's node yet when the first message arrives.

        """
        self.source = source
        self._write = write
        self._is_of_clock_maker = is_of_clock_maker
        self._held: list[Received] = []
        self._tick_sources_ns: list[int] = []
        self._tick_stamps_ns: list[int] = []

    @property
    def waiting_since_ns(self) -> int | None:
        """When the first message that waits was published, ns; None: none waits."""
        return self._held[0].source_ns if self._held else None

    def take(self, message: Received) -> None:
        """Take a message that is no tick."""
        if self.source is TimeSource.UNDECIDED and message.stamp_ns:
            other = abs(message.stamp_ns - message.source_ns) > OTHER_EPOCH_NS
            self.decide(TimeSource.SIMULATED if other else TimeSource.SYSTEM)
        if self.source is TimeSource.SYSTEM:
            self._write(message, message.source_ns)
        else:
            self._held.append(message)

    def tick(self, message: Received) -> None:
        """Take a tick of /clock, with its time as stamp."""
        if self.source is TimeSource.UNDECIDED:
            self.decide(TimeSource.SIMULATED)
        if self.source is TimeSource.SYSTEM:
            self._write(message, message.source_ns)
            return
        if not self._tick_stamps_ns or self._tick_stamps_ns[-1] != message.stamp_ns:
            self._tick_sources_ns.append(message.source_ns)
            self._tick_stamps_ns.append(message.stamp_ns)
            if len(self._tick_stamps_ns) > 2 * _MOST_TICKS:
                del self._tick_sources_ns[:_MOST_TICKS], self._tick_stamps_ns[:_MOST_TICKS]
        self._release(message.source_ns)
        self._write(message, message.stamp_ns)

    def end(self) -> None:
        """Give away what still waits: without any tick all of it has time zero, as time never began."""
        if self.source is TimeSource.UNDECIDED:
            self.decide(TimeSource.SYSTEM)
        self._release(None)

    def decide(self, source: TimeSource) -> None:
        """Say which clock gives the log times, if that is not decided yet."""
        if self.source is not TimeSource.UNDECIDED:
            return
        self.source = source
        if source is TimeSource.SYSTEM:
            held, self._held = self._held, []
            for each in held:
                self._write(each, each.source_ns)

    def _release(self, before_ns: int | None) -> None:
        """Write what was published before a tick, by log time; what was later waits for the next one."""
        held, self._held = self._held, []
        due = held if before_ns is None else [each for each in held if each.source_ns < before_ns]
        if before_ns is not None and len(due) < len(held):
            self._held = [each for each in held if each.source_ns >= before_ns]
        for log_ns, each in sorted(((self._log_ns(each), each) for each in due), key=lambda pair: pair[0]):
            self._write(each, log_ns)

    def _log_ns(self, message: Received) -> int:
        of_clock_maker = self._is_of_clock_maker(message.topic)
        if of_clock_maker and message.stamp_ns:
            return message.stamp_ns
        if not self._tick_stamps_ns:
            return 0
        following = bisect.bisect_right(self._tick_sources_ns, message.source_ns)
        if following == 0 and message.stamp_ns:
            return min(message.stamp_ns, self._tick_stamps_ns[0])
        at = following if of_clock_maker else following - 1
        return self._tick_stamps_ns[min(max(at, 0), len(self._tick_stamps_ns) - 1)]
