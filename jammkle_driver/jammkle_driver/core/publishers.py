"""Tells the publishers of a topic apart, where several may command one ankle.

ROS 2 Jazzy says of a message when it was published and which of its publisher's messages it is, counted from 1
(DDSI-RTPS 2.5, 8.3.5.4), but rclpy does not pass on who published it. A publisher's messages are consecutive, so that
each continues the count of the publisher that it came from. A count that begins, or that continues none while the graph
knows of more publishers than have sent anything, is another publisher's.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Generic, NamedTuple, TypeVar

Value = TypeVar("Value")

GONE_AFTER_S = 1.0
"""How long there must have been fewer publishers than have sent before one counts as gone, s.

Assumed; discovery on one machine takes about 0.3 s.
"""
_REMEMBERED = 256
"""Messages whose second delivery, by another subscription, is known: 2 s of six publishers at 20 Hz."""


class Publication(NamedTuple):
    """What the middleware says of a message.

    Attributes:
        number: Which of its publisher's messages it is, from 1; 0 where the middleware does not count, so that all
            publishers are taken for one.
        sent_ns: When it was published, ns since 1970 by the publisher's clock.
        publishers: How many publishers the topic has now.

    """

    number: int = 0
    sent_ns: int = 0
    publishers: int = 1


ONLY_PUBLISHER = Publication()
"""Of messages that all come from one publisher."""


@dataclass
class Publisher(Generic[Value]):
    """One of a topic's publishers.

    Attributes:
        number: Number of its last message.
        sent_ns: When that was published, ns.
        received_s: When that was received, s of the driver's time.
        value: What it said.
        gone: Whether it is no longer in the graph.

    """

    number: int
    sent_ns: int
    received_s: float
    value: Value
    gone: bool = False


class Publishers(Generic[Value]):
    """Those of one topic that have sent something."""

    def __init__(self, keep: Value | None = None) -> None:
        """Know of none.

        Args:
            keep: Whoever said this last is the last to count as gone.

        """
        self._keep = keep
        self.all: list[Publisher[Value]] = []
        self._seen: deque[tuple[int, int]] = deque(maxlen=_REMEMBERED)
        self._too_many_since_s: float | None = None

    def take(self, value: Value, publication: Publication, now_s: float) -> Publisher[Value] | None:
        """Return the publisher of a message, its value and time noted.

        Of several that it may be from, it is the one that has said the same before, and of those the one that has been
        silent the longest: one that says true is never taken back by a false of somebody else.

        Args:
            value: What the message says.
            publication: What the middleware says of it.
            now_s: Time, s.

        Returns:
            Whose it is; None for a message that was received before, or is older than its publisher's last.

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
        publisher.number, publisher.sent_ns, publisher.value = number, sent_ns, value
        publisher.received_s, publisher.gone = now_s, False
        return publisher

    def count(self, publishers: int, now_s: float) -> None:
        """Take how many publishers the graph knows now."""
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
        silent = [each for each in present if each.received_s <= since_s]
        silent.sort(key=lambda each: (each.value == self._keep, each.received_s))
        for each in silent[:too_many]:
            each.gone = True
        self._too_many_since_s = None

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
        return publication.number > 1 and self._knows_all(publication) and any(newer)

    def _knows_all(self, publication: Publication) -> bool:
        return sum(not each.gone for each in self.all) >= publication.publishers
