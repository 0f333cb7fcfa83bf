"""When a message of a bag was made: by its own stamp, else by /clock, else by its log time. The rule of all verbs.

A bag of a simulation that ran four times as fast as real time, logged by the clock of the machine, holds a second of
data in every quarter of a second of log. Its stamps and /clock know that.

Stamps are believed as far as they go with the rest. Those that are zero or stand still count as none, and a topic whose
stamps are of another clock is shifted onto that of the rest; both are said. So is a single stamp, or a log time, that
lies apart. A trajectory without a stamp begins when it comes, and nothing is said. What is latched from before the bag
has the time of its start, as it tells what held then.
"""

from __future__ import annotations

import enum
import itertools
import statistics
import struct
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

from rosbags.interfaces import Nodetype, QosDurability

from jammkle_common.bags.contents import profiles
from jammkle_common.bags.reading import messages
from jammkle_common.command.results import note
from jammkle_common.constants import NANOSECONDS_PER_SECOND
from jammkle_common.names import CLOCK, DIAGNOSTICS

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator

    from rosbags.interfaces import Qos

    from jammkle_common.bags.reading import BagReader
    from jammkle_common.bags.storage import Connection

_BEGINS_WITH_TIME = ("std_msgs/msg/Header", "builtin_interfaces/msg/Time")
_WITHOUT_STAMP_NOW = "trajectory_msgs/msg/JointTrajectory"
"""Type of messages whose stamp is when they shall begin; zero: when they come, whatever else is near zero."""
_LITTLE, _BIG = struct.Struct("<iI"), struct.Struct(">iI")
_AT = 4  # after the four bytes that say how the message is serialised (CDR)
_SECONDS = 2**31  # that a stamp holds
_APART_NS = 60 * NANOSECONDS_PER_SECOND
"""Difference of log and stamp from which on they are taken for two clocks: no message is under way for a minute."""
_HOLE_NS = 24 * 3600 * NANOSECONDS_PER_SECOND
"""Step of the log from which on it is said. Assumed: no landing or walk pauses for a day."""
_REWOUND_NS = 2 * NANOSECONDS_PER_SECOND
"""Step back of a topic from which on it is said. Assumed: a recorder's queues hold two seconds."""
_SET_BACK_NS = NANOSECONDS_PER_SECOND // 10
"""Step back of the log from which on it is said: ntpd sets a clock that is off by 0.128 s, and slews it below."""
_SAME_SPAN = 0.02
"""Part by which the spans of log and data may differ without a word. Assumed: a second in a minute is worth none."""
_FEW = 3
"""Fewest stamps from which a topic's clock is judged. Assumed: two may both be odd."""
_FIRST = 20
"""Stamps of a topic by which its clock is judged. Assumed; a few may be odd, as at the start of a recorder."""


class TimeOf(enum.Enum):
    """Where the times of a topic come from."""

    STAMP = "stamp"
    """Stamps in the messages."""
    CLOCK = "/clock"
    """The last tick of /clock before each message."""
    LOG = "log"
    """When the recorder took them."""


class TimedMessage(NamedTuple):
    """A message, when it was made and logged, ns. Its stamp is when it was made, where its type has one."""

    connection: Connection
    time_ns: int
    log_ns: int
    data: bytes


@dataclass
class Span:
    """Messages so far, and their first and last time, ns."""

    count: int = 0
    first_ns: int = 0
    last_ns: int = 0

    def take(self, time_ns: int) -> None:
        """Count a message of a time."""
        self.first_ns = min(self.first_ns, time_ns) if self.count else time_ns
        self.last_ns = max(self.last_ns, time_ns) if self.count else time_ns
        self.count += 1

    @property
    def duration_s(self) -> float:
        """From the first to the last."""
        return (self.last_ns - self.first_ns) / NANOSECONDS_PER_SECOND

    @property
    def rate_hz(self) -> float | None:
        """Messages per second; None where they have no duration."""
        return (self.count - 1) / self.duration_s if self.duration_s > 0 else None


def other_clock(log_duration_s: float, data_duration_s: float) -> str:
    """Return a word on data that span another time than their log; empty where both are the same."""
    if not log_duration_s or abs(data_duration_s / log_duration_s - 1.0) < _SAME_SPAN:
        return ""
    return f"; its data span {data_duration_s:.3f} s by their own clock"


@dataclass
class _Stamps:
    """The first stamps of a topic, when they were known to have come, and what is found of them."""

    stamps_ns: list[int] = field(default_factory=list)
    known_ns: list[int] = field(default_factory=list)
    """By /clock, else by the log."""
    why_none: str = ""
    """Why they count as none; empty where they do not."""
    shift_ns: int = 0
    odd: int = 0
    """How many that followed lay apart."""

    def judge(self, begin_ns: int) -> None:
        """See whether they are any, in a bag that begins at a time by /clock or log."""
        self.known_ns = [max(each, begin_ns) for each in self.known_ns]
        moved_ns = max(self.known_ns, default=0) - min(self.known_ns, default=0)
        still = len(set(self.stamps_ns)) == 1 and len(self.stamps_ns) >= _FEW
        zero = sum(not each for each in self.stamps_ns)
        if 2 * zero > len(self.stamps_ns) and (still or self.lag_ns > _APART_NS):
            self.why_none = "are zero"
        elif still and (moved_ns > NANOSECONDS_PER_SECOND or len(self.stamps_ns) == _FIRST):
            self.why_none = "stand still"

    @property
    def lag_ns(self) -> int:
        """Half of them lag more, half less."""
        return statistics.median_low(
            [known - stamp for known, stamp in zip(self.known_ns, self.stamps_ns, strict=True)] or [0]
        )


@dataclass
class _LogPart:
    """A part of a log between two steps of a day or more, and how it lies to the stamps of its messages."""

    start_ns: int
    lags_ns: dict[int, list[int]] = field(default_factory=dict)
    """Log time minus stamp, of the first messages of each topic."""
    count: int = 0
    shift_ns: int = 0
    """What its log times are ahead of the rest, by the stamps."""

    def take(self, connection: Connection, log_ns: int, stamp_ns: int) -> None:
        """Count a message; its stamp is zero where it has none."""
        self.count += 1
        lags_ns = self.lags_ns.setdefault(connection.id, [])
        if stamp_ns and len(lags_ns) < _FIRST:
            lags_ns.append(log_ns - stamp_ns)

    def off_ns(self, rest: _LogPart) -> int | None:
        """Return how far its log is ahead of the rest, by topics of both: zero where any agrees, None without any."""
        offs_ns = [
            statistics.median_low(lags_ns) - statistics.median_low(rest.lags_ns[topic])
            for topic, lags_ns in self.lags_ns.items()
            if lags_ns and rest.lags_ns.get(topic)
        ]
        if any(abs(each) <= _APART_NS for each in offs_ns):
            return 0
        return statistics.median_low(offs_ns) if offs_ns else None

    @property
    def limit_ns(self) -> int:
        """Difference of log and stamp from which on a stamp is odd; a log that stands still may do so for long."""
        return _HOLE_NS if self.shift_ns else _APART_NS


class BagTimes:
    """Tells the time of each message of a bag that is read in the order of its log.

    Attributes:
        start_ns: When the bag begins, on the clock of its messages.
        doubts: Topics whose stamps are not taken as they are, and why.
        rewound: Why the same times come twice; empty as long as they were not seen to. Of a clock that was set back
            while the bag was recorded it is known from the start, of the rest once it was read.

    """

    def __init__(self, reader: BagReader) -> None:
        """Look at the first messages of each topic of an open bag; at all, where its log spans more than a day."""
        self._reader = reader
        self._stamped = {
            name: _begins_with_time(reader.typestore.fielddefs, name)
            for name in {each.msgtype for each in reader.connections}
        }
        self._tick_ns = self._start_tick_ns = _first_tick_ns(reader)
        stamped = [each for each in reader.connections if self._stamped[each.msgtype] and not _is_clock(each)]
        self._parts = self._log_parts()
        self._begin_ns = min(each.start_ns - each.shift_ns for each in self._parts)
        self._stamps: dict[int, _Stamps] = {each.id: _Stamps() for each in stamped}
        self._look_at_first(stamped)
        self.doubts: dict[str, str] = {}
        self._last_ns: dict[int, int] = {}
        offered = {each.id: profiles(each.offered) for each in reader.connections}
        self._time_bases = {each.id for each in reader.connections if _is_time_base(each, offered[each.id])}
        self.rewound = self._find_set_back()
        self._latched = {number for number, by_each in offered.items() if _is_latched(by_each)}
        self._from_before: set[int] = set()
        self._start_ahead_ns = self._ahead_ns = self._find_apart()
        self.start_ns = self._begin_ns - self._ahead_ns if self._start_tick_ns is None else self._start_tick_ns
        for what in filter(None, (*self.doubts.values(), self.rewound)):
            self._say(what)

    def source(self, connection: Connection) -> TimeOf:
        """Return where the times of a topic come from."""
        stamps = self._stamps.get(connection.id)
        if _is_clock(connection) or (stamps is not None and not stamps.why_none):
            return TimeOf.STAMP
        return TimeOf.LOG if self._start_tick_ns is None else TimeOf.CLOCK

    def messages(self, connections: Collection[Connection]) -> Iterator[TimedMessage]:
        """Read messages of some topics in the order of their log times, with the times when they were made.

        What is worth a word of the times is said on stderr.

        Raises:
            InputError: the bag is damaged.

        """
        chosen = {each.id for each in connections}
        clocks = [each for each in self._reader.connections if _is_clock(each) and each.id not in chosen]
        if not chosen:
            return
        self._tick_ns, self._ahead_ns, before_ns = self._start_tick_ns, self._start_ahead_ns, self._begin_ns
        self._last_ns.clear()
        self._from_before = self._latched & chosen
        for stamps in self._stamps.values():
            stamps.odd = 0
        for connection, logged_ns, data in messages(self._reader, self._reader.path, [*connections, *clocks]):
            part = self._part(logged_ns)
            log_ns = logged_ns - part.shift_ns
            time_ns = self._time_ns(connection, log_ns, data, part.limit_ns)
            if log_ns - before_ns > _HOLE_NS:
                step_d = (log_ns - before_ns) / _HOLE_NS
                self._say(f"its log makes a step of {step_d:.1f} days: the clock was set, or two bags were joined")
            before_ns = max(log_ns, before_ns)
            self._watch_for_rewinding(connection, time_ns)
            if connection.id in chosen:
                yield TimedMessage(connection, time_ns, log_ns, self._stamped_with(time_ns, connection, data))
        odd = {each.topic: self._stamps[each.id].odd for each in connections if each.id in self._stamps}
        if any(odd.values()):
            which = ", ".join(topic for topic, count in odd.items() if count)
            what = f"stamps that are zero, or lie more than a minute from the rest: {sum(odd.values())} of {which}"
            self._say(f"{what}; these messages have the times of {self._next_best()}")

    def _watch_for_rewinding(self, connection: Connection, time_ns: int) -> None:
        if connection.id not in self._time_bases:
            return
        back_ns = self._last_ns.get(connection.id, time_ns) - time_ns
        self._last_ns[connection.id] = time_ns
        if back_ns > _REWOUND_NS and not self.rewound:
            back_s = back_ns / NANOSECONDS_PER_SECOND
            self.rewound = f"the time of {connection.topic} goes back by {back_s:.3f} s: two runs have the same times"
            self._say(self.rewound)

    def _find_set_back(self) -> str:
        """See whether the log goes back in topics that hold most of the messages: one alone may have two clocks."""
        if any(each.shift_ns for each in self._parts):
            return ""
        back_ns = self._reader.set_back_ns()
        judged = [each for each in self._reader.connections if each.id in self._time_bases]
        most = sum(each.msgcount for each in judged) / 2
        found = [each for each in judged if back_ns[each.id] > _SET_BACK_NS]
        if not found or sum(each.msgcount for each in found) < most:
            return ""
        topic = max(found, key=lambda each: each.msgcount)
        back_s = back_ns[topic.id] / NANOSECONDS_PER_SECOND
        why = f"the log of {topic.topic} goes back by {back_s:.3f} s in the order in which it was written"
        return f"{why}: the clock was set back, or two recordings of one time were put into one bag, and they are mixed"

    def _say(self, what: str) -> None:
        note(f"bag {self._reader.path}: {what}")

    def _next_best(self) -> str:
        return "the log" if self._start_tick_ns is None else CLOCK.name

    def _log_parts(self) -> list[_LogPart]:
        """Find parts of the log that have a clock of their own, as before a clock was set; one part as a rule.

        The part with most messages is the rest that the others are compared with, topic by topic. What has no stamps,
        and was logged at zero, is of the start of the rest.
        """
        reader = self._reader
        parts, before_ns = [_LogPart(reader.start_time)], reader.start_time
        if reader.end_time - reader.start_time <= _HOLE_NS:
            return parts
        for connection, log_ns, data in messages(reader, reader.path, reader.connections):
            if log_ns - before_ns > _HOLE_NS:
                parts.append(_LogPart(log_ns))
            before_ns = log_ns
            is_stamped = self._stamped[connection.msgtype] and not _is_clock(connection)
            parts[-1].take(connection, log_ns, _stamp_ns(data) if is_stamped else 0)
        rest = max(parts, key=lambda each: each.count)
        for place, part in enumerate(parts):
            off_ns = part.off_ns(rest)
            if off_ns is None and part is not rest and part.start_ns < _HOLE_NS:
                off_ns = part.start_ns - rest.start_ns
            part.shift_ns = off_ns or 0
            if part.shift_ns:
                where = "at its start" if place == 0 else f"after its step {place}"
                how_far = (
                    f"{abs(part.shift_ns) / _HOLE_NS:.1f} days {'after' if part.shift_ns > 0 else 'before'} the rest"
                )
                self._say(f"log times {where} lie {how_far}: they are shifted onto it")
        return parts

    def _part(self, logged_ns: int) -> _LogPart:
        return next((each for each in reversed(self._parts) if each.start_ns <= logged_ns), self._parts[0])

    def _look_at_first(self, stamped: Collection[Connection]) -> None:
        """Take the first stamps of every topic that has any."""
        missing = {each.id for each in stamped if each.msgcount >= _FIRST}
        clocks = [each for each in self._reader.connections if _is_clock(each)]
        for connection, log_ns, data in (
            messages(self._reader, self._reader.path, [*stamped, *clocks]) if missing else ()
        ):
            if _is_clock(connection):
                self._tick_ns = _stamp_ns(data)
                continue
            stamps, stamp_ns = self._stamps[connection.id], _stamp_ns(data)
            if self._tick_ns == stamp_ns == self._start_tick_ns:
                continue  # the clock itself stands, as before a simulation's first step
            if _is_now(connection, stamp_ns):
                missing.discard(connection.id)
                continue
            if len(stamps.stamps_ns) < _FIRST and not self._part(log_ns).shift_ns:
                stamps.stamps_ns.append(stamp_ns)
                stamps.known_ns.append(log_ns if self._tick_ns is None else self._tick_ns)
                if len(stamps.stamps_ns) == _FIRST:
                    missing.discard(connection.id)
            if not missing:
                break
        for stamps in self._stamps.values():
            stamps.judge(self._begin_ns if self._start_tick_ns is None else self._start_tick_ns)

    def _find_apart(self) -> int:
        """Shift topics whose stamps are of another clock onto the rest; return how far the log is ahead of that."""
        judged = {key: each for key, each in self._stamps.items() if each.stamps_ns and not each.why_none}
        lags_ns = [each.lag_ns for each in judged.values()]
        near = [lag for lag in lags_ns if abs(lag) <= _APART_NS]
        # The log is right where any topic agrees with it, as what has no stamp is of its clock.
        rest_ns = statistics.median_low(near or lags_ns or [0])
        for each in self._reader.connections:
            stamps = self._stamps.get(each.id)
            if stamps is None:
                continue
            if stamps.why_none:
                why = f"the stamps of {each.topic} {stamps.why_none}: it has the times of {self._next_best()}"
                self.doubts[each.topic] = why
            elif len(stamps.stamps_ns) >= _FEW and abs(stamps.lag_ns - rest_ns) > _APART_NS:
                stamps.shift_ns = stamps.lag_ns - rest_ns
                apart_s = -stamps.shift_ns / NANOSECONDS_PER_SECOND
                where = f"{abs(apart_s):.3f} s {'after' if apart_s > 0 else 'before'} the rest"
                why = f"the stamps of {each.topic} lie {where}, as those of another clock: they are shifted onto it"
                self.doubts[each.topic] = why
        return 0 if near or self._start_tick_ns is not None else rest_ns

    def _time_ns(self, connection: Connection, log_ns: int, data: bytes, limit_ns: int) -> int:
        stamps = self._stamps.get(connection.id)
        if _is_clock(connection):
            self._tick_ns = _stamp_ns(data)
            return self._tick_ns
        known_ns = log_ns - self._ahead_ns if self._tick_ns is None else self._tick_ns
        if stamps is None or stamps.why_none or _is_now(connection, _stamp_ns(data)):
            return known_ns
        time_ns = _stamp_ns(data) + stamps.shift_ns
        if connection.id in self._from_before:
            if time_ns < self.start_ns <= known_ns:
                return self.start_ns
            self._from_before.discard(connection.id)
        if abs(time_ns - known_ns) > limit_ns:
            stamps.odd += 1
            return known_ns
        if self._ahead_ns:  # a log of another clock may go at another pace, as beside a simulation
            self._ahead_ns = log_ns - time_ns
        return time_ns

    def _stamped_with(self, time_ns: int, connection: Connection, data: bytes) -> bytes:
        seconds, nanoseconds = divmod(time_ns, NANOSECONDS_PER_SECOND)
        is_as_said = connection.id not in self._stamps or time_ns == _stamp_ns(data)
        if is_as_said or len(data) < _AT + _LITTLE.size or abs(seconds) >= _SECONDS:
            return data
        form = _LITTLE if data[1] & 1 else _BIG
        stamp = form.pack(seconds, nanoseconds)
        return data[:_AT] + stamp + data[_AT + len(stamp) :]


def _is_clock(connection: Connection) -> bool:
    return connection.topic == CLOCK.name and connection.msgtype == CLOCK.message_type


def _is_time_base(connection: Connection, offered: Collection[Qos]) -> bool:
    """Return whether times that go back mean a second run: where several nodes publish, one may only be late."""
    if _is_clock(connection):
        return True
    return connection.msgtype != DIAGNOSTICS.message_type and len(offered) <= 1


def _is_latched(offered: Collection[Qos]) -> bool:
    return any(profile.durability is QosDurability.TRANSIENT_LOCAL for profile in offered)


def _is_now(connection: Connection, stamp_ns: int) -> bool:
    return stamp_ns == 0 and connection.msgtype == _WITHOUT_STAMP_NOW


def _first_tick_ns(reader: BagReader) -> int | None:
    """Return the time that holds until the second tick of /clock; None without /clock."""
    clocks = [each for each in reader.connections if _is_clock(each) and each.msgcount]
    found = itertools.islice(messages(reader, reader.path, clocks), 1) if clocks else ()
    return next((_stamp_ns(data) for _, _, data in found), None)


def _stamp_ns(data: bytes) -> int:
    """Return the stamp of a message; zero of one that is too short for any."""
    if len(data) < _AT + _LITTLE.size:
        return 0
    seconds, nanoseconds = (_LITTLE if data[1] & 1 else _BIG).unpack_from(data, _AT)
    return int(seconds) * NANOSECONDS_PER_SECOND + int(nanoseconds)


def _begins_with_time(definitions: Any, message_type: str) -> bool:
    """Return whether messages of a type begin with a header, or with a time as /clock does."""
    _, fields = definitions[message_type]
    if not fields:
        return False
    kind, inner = fields[0][1]
    return kind is Nodetype.NAME and inner in _BEGINS_WITH_TIME
