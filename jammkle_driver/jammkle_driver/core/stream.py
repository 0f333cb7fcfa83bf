"""Wishes that come as a stream: only a change counts, repeating is a sign of life, silence takes them back."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jammkle_driver.core.watchdog import Instant, Watchdog

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jammkle_driver.core.requests import Wish


class WishStream:
    """Remembers what the stream said last, per channel, and which channels follow it.

    Before its first message, and after it went silent, a stream counts as wishing nothing (0 Pa everywhere),
    so that one that begins with 0 takes nothing away from a channel that a service jammed.
    """

    def __init__(self, timeout_s: float) -> None:
        """Make a stream that has said nothing; it is silent after `timeout_s` s."""
        self._watchdog = Watchdog(timeout_s)
        self._last: dict[str, float] = {}
        self._followers: set[str] = set()

    @property
    def timeout_s(self) -> float:
        """Silence allowed, s."""
        return self._watchdog.timeout_s

    @property
    def values(self) -> dict[str, str]:
        """What a silent stream has not kept to, in numbers for people, with units in the key."""
        return {"silence allowed (s)": f"{self.timeout_s:g}"}

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

    def excuse(self, stood_s: float) -> None:
        """Leave out a time in which nobody could have been heard; see `Watchdog.excuse`."""
        self._watchdog.excuse(stood_s)

    def forget(self) -> None:
        """Behave as if nothing had been said."""
        self._watchdog.forget()
        self._last.clear()
        self._followers.clear()
