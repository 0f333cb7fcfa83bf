"""Who asks for what: services, streams of commands, emergency stops, and whether it may be done."""

from __future__ import annotations

import math
import reprlib
from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Generic, NamedTuple, TypeVar

from jammkle_driver.core.watch import Instant, Watchdog

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from jammkle_driver.parameters import DriverParameters


_LONGEST_SHOWN = 60
"""Characters of a name that an answer repeats."""


class RequestError(ValueError):
    """A request that cannot be taken. The message names the value, the limit and the way out, in one line."""


@dataclass(frozen=True)
class SetPoint:
    """What one channel shall do: the vacuum to hold, Pa, gauge, positive; 0 = unjam."""

    channel: str
    vacuum_pa: float


def checked_channels(asked: Sequence[str], known: Sequence[str]) -> tuple[str, ...]:
    """Return the channels asked for, each once, in the driver's order; all of them if none is named.

    Raises:
        RequestError: a name is unknown.

    """
    for name in asked:
        if name not in known:
            msg = f"unknown channel {_shown(name)}; known are: {', '.join(known)}"
            raise RequestError(msg)
    return tuple(name for name in known if name in asked) if asked else tuple(known)


def checked_vacuum(vacuum_pa: float, parameters: DriverParameters) -> float:
    """Return the vacuum to jam with, Pa; 0 stands for the default.

    Raises:
        RequestError: not a number, or out of range.

    """
    least_pa, most_pa, default_pa = parameters.min_vacuum_pa, parameters.max_vacuum_pa, parameters.default_vacuum_pa
    if vacuum_pa == 0.0:
        return default_pa
    if not least_pa <= vacuum_pa <= most_pa:
        msg = (
            f"vacuum_pa is {vacuum_pa:g}; it must be {least_pa:g} to {most_pa:g} Pa "
            f"below ambient, or 0 for the default of {default_pa:g} Pa"
        )
        raise RequestError(msg)
    return vacuum_pa


def checked_set_points(
    set_points: Sequence[SetPoint], known: Sequence[str], parameters: DriverParameters
) -> tuple[SetPoint, ...]:
    """Return the set points unchanged if every one of them can be taken.

    Raises:
        RequestError: a channel is unknown or named twice, a vacuum is neither 0 nor in range, or two vacuums to jam
            with differ.

    """
    named: set[str] = set()
    for set_point in set_points:
        checked_channels([set_point.channel], known)
        if set_point.channel in named:
            msg = f"channel '{set_point.channel}' is named twice; name each channel once"
            raise RequestError(msg)
        named.add(set_point.channel)
        least_pa, most_pa = parameters.min_vacuum_pa, parameters.max_vacuum_pa
        if set_point.vacuum_pa != 0.0 and not least_pa <= set_point.vacuum_pa <= most_pa:
            msg = (
                f"vacuum_pa of '{set_point.channel}' is {set_point.vacuum_pa:g}; "
                f"it must be 0 to unjam, or {least_pa:g} to {most_pa:g} Pa below ambient"
            )
            raise RequestError(msg)
    jams = [set_point for set_point in set_points if set_point.vacuum_pa > 0.0]
    for jam in jams:
        if jam.vacuum_pa != jams[0].vacuum_pa:
            msg = (
                f"vacuum_pa is {jams[0].vacuum_pa:g} for {jams[0].channel}, but {jam.vacuum_pa:g} for {jam.channel}: "
                "channels share one manifold, so name one vacuum for all that shall jam"
            )
            raise RequestError(msg)
    return tuple(set_points)


def check_shared_vacuum(set_points: Sequence[SetPoint], held_pa: Mapping[str, float]) -> None:
    """Check that all channels still share one vacuum once the set points, which jam with one at most, are taken.

    One pump, one manifold and valves that only connect or vent cannot hold two vacuums at once.

    Raises:
        RequestError: a channel that the set points leave alone is jammed to another vacuum.
    """
    named = {set_point.channel for set_point in set_points}
    for vacuum_pa in {set_point.vacuum_pa for set_point in set_points if set_point.vacuum_pa > 0.0}:
        others = {name: pa for name, pa in held_pa.items() if name not in named and pa not in (0.0, vacuum_pa)}
        if others:
            jams = [set_point.channel for set_point in set_points if set_point.vacuum_pa == vacuum_pa]
            msg = (
                f"vacuum_pa is {vacuum_pa:g} for {_listed(jams)}, but {_listed(list(others))} "
                f"{'hold' if len(others) > 1 else 'holds'} {max(others.values()):g} Pa: channels share one manifold, "
                "so jam all of them to one vacuum or unjam those first"
            )
            raise RequestError(msg)


def _shown(name: str) -> str:
    """Return a name in quotes, in one line however long or odd it is."""
    shown = reprlib.Repr()
    shown.maxstring = _LONGEST_SHOWN
    return shown.repr(name)


def _listed(names: Sequence[str]) -> str:
    return " and ".join(filter(None, (", ".join(names[:-1]), names[-1])))


Value = TypeVar("Value")

GONE_AFTER_S = 1.0
"""How long there must have been fewer publishers than have sent before one counts as gone, s.

Assumed; discovery on one machine takes about 0.3 s.
"""
_REMEMBERED = 1024
"""Messages whose second delivery, by another subscription, is known: all that wait, 100 each of ten publishers."""


class Publication(NamedTuple):
    """What the middleware says of a message: which of its publisher's it is, and how many of those the topic has now.

    `number` counts from 1; it is 0 where the middleware does not count, so that all publishers are taken for one.
    `sent_ns` is since 1970 by the publisher's clock.
    """

    number: int = 0
    sent_ns: int = 0
    publishers: int = 1


ONLY_PUBLISHER = Publication()
"""Of messages that all come from one publisher."""


@dataclass
class Publisher(Generic[Value]):
    """One of a topic's publishers: its last message, when that was received in the driver's time, and what it said.

    It is gone where it is no longer in the graph.
    """

    number: int
    sent_ns: int
    received_s: float
    value: Value
    gone: bool = False


class Publishers(Generic[Value]):
    """Those of one topic that have sent something."""

    def __init__(self, keep: Value | None = None) -> None:
        """Know of none; whoever said `keep` last is the last to count as gone."""
        self._keep = keep
        self.all: list[Publisher[Value]] = []
        self._seen: deque[tuple[int, int]] = deque(maxlen=_REMEMBERED)
        self._too_many_since_s: float | None = None

    def take(self, value: Value, publication: Publication, now_s: float) -> Publisher[Value] | None:
        """Return the publisher of a message, its value and time noted; None for one received before, or late.

        Of several that it may be from, it is the one that has said the same before, and of those the one that has been
        silent the longest: one that says true is never taken back by a false of somebody else.
        """
        number, sent_ns, publishers = publication
        self.count(publishers, now_s)
        if number and (number, sent_ns) in self._seen:
            return None
        self._seen.append((number, sent_ns))
        publisher = self._find(value, publication)
        if publisher is None:
            if self._is_late(publication):
                return None
            publisher = Publisher(number, sent_ns, now_s, value)
            self.all.append(publisher)
        was_gone = publisher.gone
        publisher.number, publisher.sent_ns, publisher.value = number, sent_ns, value
        publisher.received_s, publisher.gone = now_s, False
        if was_gone:  # it was another one that has left
            self._part(publishers, [each for each in self.all if not each.gone and each is not publisher])
        return publisher

    def has_seen(self, publication: Publication) -> bool:
        """Return whether a message was taken before, as by another subscription."""
        return publication.number > 0 and publication[:2] in self._seen

    def count(self, publishers: int, now_s: float) -> None:
        """Take how many publishers the graph knows now."""
        for each in self.all:
            each.received_s = min(each.received_s, now_s)  # the clock of a simulation that was started anew
        present = [each for each in self.all if not each.gone]
        too_many = len(present) - publishers
        if too_many <= 0:
            self._too_many_since_s = None
            return
        if self._too_many_since_s is None:
            self._too_many_since_s = now_s
        since_s = self._too_many_since_s = min(self._too_many_since_s, now_s)
        if now_s - since_s < GONE_AFTER_S:
            return
        self._part(publishers, [each for each in present if each.received_s <= since_s])
        self._too_many_since_s = None

    def _part(self, publishers: int, silent: list[Publisher[Value]]) -> None:
        """Count as many of the silent ones as gone as there are too many; see `__init__` for who is the last."""
        too_many = sum(not each.gone for each in self.all) - publishers
        silent.sort(key=lambda each: (each.value == self._keep, each.received_s))
        for each in silent[: max(too_many, 0)]:
            each.gone = True

    def forget_gone(self) -> None:
        """Forget those that are no longer in the graph."""
        self.all = [each for each in self.all if not each.gone]

    def _find(self, value: Value, publication: Publication) -> Publisher[Value] | None:
        number = publication.number
        if number == 0:
            return next((each for each in self.all if each.number == 0), None)
        before = [each for each in self.all if 0 < each.number < number]
        next_of = [each for each in before if each.number == number - 1]
        if not next_of and self._knows_all(publication):  # some were lost
            nearest = max((each.number for each in before), default=0)
            next_of = [each for each in before if each.number == nearest]
        return min(next_of, key=lambda each: (each.value != value, each.sent_ns), default=None)

    def _is_late(self, publication: Publication) -> bool:
        newer = (each.number > publication.number and each.sent_ns > publication.sent_ns for each in self.all)
        return self._knows_all(publication) and any(newer)

    def _knows_all(self, publication: Publication) -> bool:
        return sum(not each.gone for each in self.all) >= publication.publishers


@dataclass(eq=False)
class CommandStream:
    """What one publisher of set points said last, per channel, Pa, and which channels follow it.

    Before its first message, and after it went silent, a stream counts as wishing nothing (0 Pa everywhere),
    so that one that begins with 0 takes nothing away from a channel that a service jammed.
    """

    publisher: Publisher[tuple[SetPoint, ...]]
    life: Watchdog
    last_pa: dict[str, float] = field(default_factory=dict)
    followers: set[str] = field(default_factory=set)

    def changes(self, set_points: Sequence[SetPoint]) -> tuple[SetPoint, ...]:
        """Return the set points that would be new."""
        return tuple(each for each in set_points if each.vacuum_pa != self.last_pa.get(each.channel, 0.0))

    def take(self, set_points: Sequence[SetPoint], now: Instant) -> None:
        """Take one message: a sign of life, and none of its set points is new any more."""
        self.life.feed(now)
        self.last_pa.update({set_point.channel: set_point.vacuum_pa for set_point in set_points})


class CommandStreams:
    """A stream of set points from each publisher, so that two that contradict one another do not take turns.

    Per channel the latest change wins, whoever it came from; the channel then follows that publisher alone.
    """

    def __init__(self, timeout_s: float) -> None:
        """Know of no publisher; each is silent after `timeout_s` s."""
        self.timeout_s = timeout_s
        self._publishers: Publishers[tuple[SetPoint, ...]] = Publishers()
        self._streams: list[CommandStream] = []

    @property
    def speaking(self) -> int:
        """How many publishers have been accepted and are not silent."""
        return sum(stream.life.fed for stream in self._streams)

    def of(self, set_points: Sequence[SetPoint], publication: Publication, now: Instant) -> CommandStream | None:
        """Return the stream that a message is part of; None where it was received before."""
        publisher = self._publishers.take(tuple(set_points), publication, now.graph_s)
        self._publishers.forget_gone()
        if publisher is None:
            return None
        for stream in self._streams:
            if stream.publisher is publisher:
                return stream
        self._streams.append(CommandStream(publisher, Watchdog(self.timeout_s)))
        return self._streams[-1]

    def lead(self, stream: CommandStream, channel: str) -> None:
        """Note that the channel follows this stream, and no other."""
        self.release(channel)
        stream.followers.add(channel)

    def release(self, channel: str) -> None:
        """Note that the channel follows no stream."""
        for stream in self._streams:
            stream.followers.discard(channel)

    def fall_silent(self, now: Instant) -> tuple[str, ...]:
        """Return the channels to vent because their stream has just fallen silent; mostly none."""
        silent = [stream for stream in self._streams if stream.life.expired(now)]
        self._streams = [stream for stream in self._streams if stream.life.fed and stream not in silent]
        return tuple(sorted(channel for stream in silent for channel in stream.followers))

    def excuse(self, stood_s: float) -> None:
        """Leave out a time in which nothing could have come; see `Watchdog.excuse`."""
        for stream in self._streams:
            stream.life.excuse(stood_s)

    def forget(self) -> None:
        """Behave as if nothing had been said."""
        self._streams.clear()


_ASKED, _TAKEN_BACK = "emergency_stop is true", "emergency_stop was true"


class EmergencyStop:
    """Says why everything is to be stopped; the reason stays until it is cleared."""

    def __init__(self, timeout_s: float) -> None:
        """Ask for nothing; silence of any publisher for `timeout_s` is a stop (0: none is)."""
        self._timeout_s = timeout_s or math.inf
        self._silence = Watchdog(self._timeout_s)
        """Of all of them, where there may be none."""
        self._publishers: Publishers[bool] = Publishers(keep=True)
        self.reason = ""
        """Why everything is stopped; empty where it is not."""

    @property
    def asked_by(self) -> int:
        """How many publishers said true last. One that has left the graph counts until another says false."""
        return sum(each.value for each in self._publishers.all)

    @property
    def publishers(self) -> int:
        """How many publishers there are that have said anything."""
        return sum(not each.gone for each in self._publishers.all)

    def begin(self, now: Instant) -> None:
        """Count silence from now on."""
        self._silence.feed(now)

    def take(self, publication: Publication, now: Instant, *, stop: bool) -> None:
        """Take a message."""
        self._silence.feed(now)
        is_new = not self._publishers.has_seen(publication)
        if self._publishers.take(stop, publication, now.graph_s) is None:
            if stop and is_new:  # overtaken by what its publisher has said since: it did ask
                self.reason = self.reason or _TAKEN_BACK
            return
        if stop:
            self.reason = _ASKED if self.reason in {"", _TAKEN_BACK} else self.reason
            return
        for each in self._publishers.all:
            each.value = each.value and not each.gone
        if self.reason == _ASKED and not self.asked_by:
            self.reason = _TAKEN_BACK
        if math.isinf(self._timeout_s):
            self._publishers.forget_gone()

    def tick(self, publishers: int | None, now: Instant) -> None:
        """Look for publishers that have fallen silent or have left; None: their number is not known."""
        if publishers is not None:
            self._publishers.count(publishers, now.graph_s)
        if self.reason:
            return
        silent = self._silent(now)
        if silent:
            of = f" from {silent} of {len(self._publishers.all)} publishers" if len(self._publishers.all) > 1 else ""
            self.reason = f"no emergency_stop{of} for {self._timeout_s:g} s (emergency_stop_timeout_s)"

    @property
    def way_out(self) -> str:
        """What ends the stop, as the end of a sentence."""
        return f"{'release it, then ' if self.asked_by else ''}call ~/clear_fault"

    def excuse(self, stood_s: float) -> None:
        """Leave out a time in which the driver stood still itself; see `Watchdog.excuse`."""
        self._silence.excuse(stood_s)
        for each in self._publishers.all:
            each.received_s += stood_s

    def clear(self, now: Instant) -> str:
        """End the stop, and return why it cannot be ended; empty where it is."""
        if self.asked_by:
            known = len(self._publishers.all)
            of, who = (f" from {self.asked_by} of {known} publishers", "each of them") if known > 1 else ("", "it")
            gone = sum(each.gone and each.value for each in self._publishers.all)
            left = f" ({gone} left the graph while true: a false of any other takes that back)" if gone else ""
            way_out = f"publish false on {who} first, then call ~/clear_fault again"
            return f"emergency_stop is still true{of}{left}; {way_out}"
        self.reason = ""
        self._silence.feed(now)
        self._publishers.forget_gone()
        silent = [each for each in self._publishers.all if now.graph_s - each.received_s > self._timeout_s]
        self._publishers.all = [each for each in self._publishers.all if each not in silent]
        return ""

    def _silent(self, now: Instant) -> int:
        """Return how many publishers are silent, or 1 where none has ever been there."""
        for each in self._publishers.all:
            each.received_s = min(each.received_s, now.graph_s)  # a simulation that was started anew
        silent = sum(now.graph_s - each.received_s > self._timeout_s for each in self._publishers.all)
        return silent or int(self._silence.expired(now))
