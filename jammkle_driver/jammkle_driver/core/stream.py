"""Wishes that come as streams: only a change counts, repeating is a sign of life, silence takes them back."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jammkle_driver.core.publishers import Publishers
from jammkle_driver.core.watchdog import Instant, Watchdog

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jammkle_driver.core.publishers import Publication, Publisher
    from jammkle_driver.core.requests import Wish


class WishStream:
    """Remembers what one publisher said last, per channel, and which channels follow it.

    Before its first message, and after it went silent, a stream counts as wishing nothing (0 Pa everywhere),
    so that one that begins with 0 takes nothing away from a channel that a service jammed.
    """

    def __init__(self, timeout_s: float) -> None:
        """Make a stream that has said nothing; it is silent after `timeout_s` s."""
        self._watchdog = Watchdog(timeout_s)
        self._last: dict[str, float] = {}
        self._followers: set[str] = set()

    def changes(self, wishes: Sequence[Wish]) -> tuple[Wish, ...]:
        """Return the wishes that would be new."""
        return tuple(wish for wish in wishes if wish.vacuum_pa != self._last.get(wish.channel, 0.0))

    def hear(self, wishes: Sequence[Wish], now: Instant) -> None:
        """Take one message: a sign of life, and none of its wishes is new any more."""
        self._watchdog.feed(now)
        self._last.update({wish.channel: wish.vacuum_pa for wish in wishes})

    def lead(self, channel: str) -> None:
        """Note that the channel follows the stream."""
        self._followers.add(channel)

    def release(self, channel: str) -> None:
        """Note that the channel follows something else, or nothing."""
        self._followers.discard(channel)

    def fall_silent(self, now: Instant) -> tuple[str, ...]:
        """Return the channels to vent because the stream has just fallen silent; mostly none."""
        if not self._watchdog.expired(now):
            return ()
        followers = tuple(sorted(self._followers))
        self.forget()
        return followers

    @property
    def alive(self) -> bool:
        """Whether it has been accepted, and has not fallen silent since."""
        return self._watchdog.fed

    def excuse(self, stood_s: float) -> None:
        """Leave out a time in which nobody could have been heard; see `Watchdog.excuse`."""
        self._watchdog.excuse(stood_s)

    def forget(self) -> None:
        """Behave as if nothing had been said."""
        self._watchdog.forget()
        self._last.clear()
        self._followers.clear()


class WishStreams:
    """A stream of wishes from each publisher, so that two that contradict one another do not take turns.

    Per channel the latest change wins, whoever it came from; the channel then follows that publisher alone.
    """

    def __init__(self, timeout_s: float) -> None:
        """Know of no publisher; each is silent after `timeout_s` s."""
        self.timeout_s = timeout_s
        self._publishers: Publishers[tuple[Wish, ...]] = Publishers()
        self._streams: dict[int, tuple[Publisher[tuple[Wish, ...]], WishStream]] = {}

    @property
    def values(self) -> dict[str, str]:
        """What a silent stream has not kept to, in numbers for people, with units in the key."""
        return {"silence allowed (s)": f"{self.timeout_s:g}"}

    @property
    def speaking(self) -> int:
        """How many publishers have been accepted and are not silent."""
        return sum(stream.alive for _, stream in self._streams.values())

    def of(self, wishes: Sequence[Wish], publication: Publication, now: Instant) -> WishStream | None:
        """Return the stream that a message is part of; None where it was received before."""
        publisher = self._publishers.take(tuple(wishes), publication, now.graph_s)
        self._publishers.forget_gone()
        if publisher is None:
            return None
        return self._streams.setdefault(id(publisher), (publisher, WishStream(self.timeout_s)))[1]

    def lead(self, stream: WishStream, channel: str) -> None:
        """Note that the channel follows this stream, and no other."""
        self.release(channel)
        stream.lead(channel)

    def release(self, channel: str) -> None:
        """Note that the channel follows no stream."""
        for _, stream in self._streams.values():
            stream.release(channel)

    def fall_silent(self, now: Instant) -> tuple[str, ...]:
        """Return the channels to vent because their stream has just fallen silent; mostly none."""
        vented: list[str] = []
        for key, (_, stream) in tuple(self._streams.items()):
            vented += stream.fall_silent(now)
            if not stream.alive:
                del self._streams[key]
        return tuple(sorted(vented))

    def excuse(self, stood_s: float) -> None:
        """Leave out a time in which nobody could have been heard; see `Watchdog.excuse`."""
        for _, stream in self._streams.values():
            stream.excuse(stood_s)

    def forget(self) -> None:
        """Behave as if nothing had been said."""
        self._streams.clear()
