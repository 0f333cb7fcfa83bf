"""Which pressure sensors have fallen silent, and what that means for the ankle."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jammkle_driver.core.faults import REMEDIES, Finding, Reason
from jammkle_driver.core.hardware import MANIFOLD

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jammkle_driver.core.ankle import Ankle


class SensorWatch:
    """Counts for how long each sensor has given no pressure; a channel without one fails, a manifold does not.

    A silent sensor ends in a latched fault, which needs evidence that a pause of the host cannot make. So silence is
    counted in ticks of the driver, each by two periods at the most, however late it comes; and where hardware is asked
    and answers, by those ticks alone in which an answer was taken. Whether it answers at all, its link tells.
    """

    def __init__(self, channels: Sequence[str], timeout_s: float, period_s: float) -> None:
        """Watch the sensors of `channels` and of the manifold.

        Args:
            channels: Names of the channels.
            timeout_s: Silence that counts as not measured, s.
            period_s: Time between two ticks, s.

        """
        self._names = tuple(channels)
        self._timeout_s = timeout_s
        self._period_s = period_s
        self.forget()

    def forget(self) -> None:
        """Be as new: no pressure was taken yet."""
        self._silent_s: dict[str, float] = {}
        self._all_silent_s = self._unanswered_s = 0.0
        self._measured: set[str] = set()
        self._answered = False

    @property
    def timeout_s(self) -> float:
        """Silence after which a pressure counts as not measured, s."""
        return self._timeout_s

    @property
    def manifold_measured(self) -> bool:
        """Whether the manifold's sensor ever gave a pressure."""
        return MANIFOLD in self._silent_s

    @property
    def values(self) -> dict[str, str]:
        """What a silent sensor has not kept to, in numbers for people."""
        return {"silence allowed (s)": f"{self._timeout_s:g}"}

    @property
    def unanswered(self) -> bool:
        """Whether hardware that is asked has not answered for the time-out: every pressure is an old one."""
        return self._unanswered_s > self._timeout_s

    def take(self, place: str, *, valid: bool) -> None:
        """Note an answer of the hardware, and whether a sensor's pressure was in it."""
        self._answered = True
        self._unanswered_s = 0.0
        if valid:
            self._measured.add(place)
            self._silent_s[place] = self._all_silent_s = 0.0

    def silent(self, place: str) -> bool:
        """Whether a sensor that gave a pressure once gives none now."""
        return self._silent_s.get(place, 0.0) > self._timeout_s

    def tick(self, passed_s: float, *, asked: bool) -> None:
        """Count the time since the last tick.

        Args:
            passed_s: That time, s; 0 where nothing could be measured in it.
            asked: Whether the hardware is asked, and answers each time; else it speaks by itself.

        """
        counted_s = min(max(passed_s, 0.0), 2.0 * self._period_s)
        if asked and not self._answered:
            self._unanswered_s += counted_s
        else:
            for place in self._silent_s.keys() - self._measured:
                self._silent_s[place] += counted_s
            self._all_silent_s += 0.0 if self._measured else counted_s
        self._measured.clear()
        self._answered = False

    def look(self, ankle: Ankle, *, active: bool) -> None:
        """Let an ankle forget the pressures of silent sensors; where it is active, their channels fail."""
        measured = [name for name, channel in ankle.channels.items() if channel.vacuum_pa is not None]
        silent = [name for name in measured if self.silent(name)]
        # Sensors of one board fall silent within milliseconds, and each may be the first to be noticed.
        every = bool(silent) and self._all_silent_s > 0.5 * self._timeout_s
        if every:
            silent = measured
        if every or self.silent(MANIFOLD):
            ankle.manifold_vacuum_pa = None
        for name in silent:
            ankle.channels[name].forget_pressure()
        if not silent or not active:
            return
        reason = Reason.BOARD_UNPLUGGED if every else Reason.SENSOR_DEAD
        place = ", ".join(silent)
        whose = "no sensor gives" if every else f"{place} sensor gives no"
        remedy = "look at hardware or simulation" if every else REMEDIES[reason]
        text = f"{whose} valid pressure for {self._timeout_s:g} s (pressure_timeout_s): {remedy}"
        ankle.fail(silent, Finding(reason, place, text, self.values).to_clear())
