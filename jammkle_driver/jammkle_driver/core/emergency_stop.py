"""The emergency stop, from any number of publishers: one that asks for it suffices, and each must be alive."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from jammkle_driver.core.publishers import Publishers
from jammkle_driver.core.watchdog import Watchdog

if TYPE_CHECKING:
    from jammkle_driver.core.publishers import Publication
    from jammkle_driver.core.watchdog import Instant


class EmergencyStop:
    """Says why everything is to be stopped; the reason stays until it is cleared."""

    def __init__(self, timeout_s: float) -> None:
        """Ask for nothing.

        Args:
            timeout_s: Silence of any publisher that is a stop, s; 0: silence is none.

        """
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
        if self._publishers.take(stop, publication, now.graph_s) is None:
            return
        if stop:
            self.reason = self.reason or "emergency_stop is true"
            return
        for each in self._publishers.all:
            each.value = each.value and not each.gone
        if math.isinf(self._timeout_s):
            self._publishers.forget_gone()

    def tick(self, publishers: int | None, now: Instant) -> None:
        """Look for publishers that have fallen silent or have left.

        Args:
            publishers: How many the topic has in the graph; None where that is not known.
            now: The time.

        """
        if publishers is not None:
            self._publishers.count(publishers, now.graph_s)
        if self.reason:
            return
        silent = self._silent(now)
        if silent:
            of = f" from {silent} of {len(self._publishers.all)} publishers" if len(self._publishers.all) > 1 else ""
            self.reason = f"no emergency_stop{of} for {self._timeout_s:g} s (emergency_stop_timeout_s)"

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
            return f"emergency_stop is still true{of}; publish false on {who} first, then call ~/clear_fault again"
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
