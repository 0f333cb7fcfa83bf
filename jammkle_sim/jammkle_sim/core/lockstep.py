"""Whom a simulation waits for before it takes its next step. Knows neither ROS nor a clock of its own.

The protocol: the simulation sends what it has to say of a step, then a tick with its stamp. Every participant answers
with its name and that stamp once it is done with all of it. Who has answered once is waited for from then on, at most
`timeout_s` of real time; who stays silent longer is waited for no more until it answers again. A tick is repeated while
an answer is missing, since ticks may be lost on the way.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from jammkle_common.constants import NANOSECONDS_PER_SECOND
from jammkle_common.messages import LOCKSTEP_LINE, Health, Level

if TYPE_CHECKING:
    from collections.abc import Callable

REPEAT_S = 0.2
"""Real time, s, after which a tick is repeated. Assumed: longer than a participant takes for one, as a rule even on a
busy machine; an answer that comes twice costs little."""

MOST_PAST_ANSWERS = 5
"""Answers with an old stamp to one tick, from which a participant is taken to be in another time. One that is merely
slow gives one: ticks replace one another in its queue."""

REMEMBERED_S = 5.0
"""Real time, s, for which an answer that did not fit is reported."""


class Standing(enum.Enum):
    """What is known of a participant."""

    IN_STEP = "in step"
    SILENT = "silent"
    """It did not answer in time."""
    AHEAD = "ahead"
    """It answered with a stamp that was not sent yet, as where another simulation's tick has come to it first; one that
    stays ahead lives in another time."""
    PAST = "in the past"
    """It keeps answering with stamps that are over."""


@dataclass
class _Participant:
    done_ns: int
    standing: Standing = Standing.IN_STEP
    answers: int = 0
    past_answers: int = 0
    stamp_ns: int = 0
    """Of its latest answer."""
    odd_s: float = -math.inf
    """When it last answered more often than it was asked, by real time."""
    ahead_s: float = math.inf
    """Since when it has been ahead, by real time."""


class Lockstep:
    """Keeps the account of ticks and answers."""

    def __init__(self, timeout_s: float, now_s: Callable[[], float]) -> None:
        """Know nobody yet; who is silent for so long, s by a steady clock, is waited for no more, 0: for ever."""
        self.timeout_s = timeout_s
        self._now_s = now_s
        self._known: dict[str, _Participant] = {}
        self._tick_ns: int | None = None
        self._sent_s = 0.0
        self._repeated_s = 0.0
        self._times_sent = 0
        self.changes = 0
        """How often something else has become known of a participant."""

    @property
    def participants(self) -> tuple[str, ...]:
        """Names of those that are waited for, sorted."""
        return tuple(sorted(name for name, each in self._known.items() if each.standing is Standing.IN_STEP))

    @property
    def missing(self) -> tuple[str, ...]:
        """Names of those whose answer to the latest tick is missing, sorted."""
        if self._tick_ns is None:
            return ()
        return tuple(name for name in self.participants if self._known[name].done_ns < self._tick_ns)

    @property
    def waited_s(self) -> float:
        """Real time, s, since the latest tick was first sent."""
        return 0.0 if self._tick_ns is None else self._now_s() - self._sent_s

    def sent(self, tick_ns: int) -> None:
        """Note that a tick was sent, with its stamp, ns."""
        if self._tick_ns is not None and tick_ns < self._tick_ns:  # time was set back, and so are all
            for each in self._known.values():
                each.done_ns = min(each.done_ns, tick_ns - 1)
        if tick_ns != self._tick_ns:
            self._tick_ns = tick_ns
            self._times_sent = 0
            self._sent_s = self._now_s()
            for each in self._known.values():
                each.answers = each.past_answers = 0
                if each.standing is Standing.AHEAD and each.stamp_ns == tick_ns:
                    each.done_ns, each.standing = tick_ns, Standing.IN_STEP
        self._times_sent += 1
        self._repeated_s = self._now_s()

    def answered(self, name: str, stamp_ns: int) -> None:
        """Take the answer of a participant: up to which stamp, ns, it is done."""
        if self._tick_ns is None:
            return
        before = self._known.get(name)
        each = self._known.setdefault(name, _Participant(stamp_ns))
        standing, each.stamp_ns = each.standing, stamp_ns
        if stamp_ns > self._tick_ns:
            each.standing = Standing.AHEAD
            each.ahead_s = each.ahead_s if standing is Standing.AHEAD else self._now_s()
        elif stamp_ns == self._tick_ns:
            each.done_ns, each.standing = stamp_ns, Standing.IN_STEP
            each.answers += 1
            if each.answers > self._times_sent:
                each.odd_s = self._now_s()
        else:
            each.past_answers += 1
            if each.past_answers > MOST_PAST_ANSWERS:
                each.standing = Standing.PAST
        # One that is ahead for a moment is nothing to report.
        self.changes += before is None or (each.standing is not standing and each.standing is not Standing.AHEAD)

    def forget(self, name: str) -> None:
        """Note that a participant has left."""
        self.changes += self._known.pop(name, None) is not None

    def ready(self) -> bool:
        """Return whether the next step may be taken; those that were silent for too long are given up."""
        if self._tick_ns is None:
            return True
        waits = any(each.done_ns < self._tick_ns and each.standing is Standing.IN_STEP for each in self._known.values())
        if waits and self.timeout_s > 0.0 and self.waited_s > self.timeout_s:
            for name in self.missing:
                self._known[name].standing = Standing.SILENT
                self.changes += 1
            return True
        return not waits

    def to_repeat(self) -> bool:
        """Return whether the latest tick is to be sent again."""
        return self._now_s() - self._repeated_s > REPEAT_S

    def health(self) -> Health:
        """Return one line: who is in step, who is not, and why."""
        about, now_s = LOCKSTEP_LINE.removeprefix(": "), self._now_s()
        values = {
            name: f"{each.standing.value}, done with {each.stamp_ns / NANOSECONDS_PER_SECOND:.4f} s"
            for name, each in sorted(self._known.items())
        }
        texts = []
        for name, each in sorted(self._known.items()):
            stamp_s = each.stamp_ns / NANOSECONDS_PER_SECOND
            if each.standing is Standing.SILENT:
                texts.append(f"{name} has not answered for {self.timeout_s:g} s: it is not waited for until it does")
            elif each.standing is Standing.AHEAD and now_s - each.ahead_s > REPEAT_S:
                texts.append(f"{name} says it is done with {stamp_s:.4f} s, which is to come: it is not waited for")
            elif each.standing is Standing.PAST:
                texts.append(f"{name} keeps saying that it is done with {stamp_s:.4f} s: it is not waited for")
            elif now_s - each.odd_s < REMEMBERED_S:
                texts.append(f"{name} answers twice: two nodes have that name")
        if self.missing and self.waited_s > max(self.timeout_s, 1.0):
            texts.append(f"time stands still until {', '.join(self.missing)} answers (lockstep_timeout_s is 0)")
        if texts:
            return Health(about, Level.WARN, "; ".join(texts), values)
        members = ", ".join(self.participants)
        return Health(about, Level.OK, f"in step: {members}" if members else "nobody takes part", values)
