"""Which pressure sensors have fallen silent, and what that means for the ankle."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jammkle_driver.core.faults import REMEDIES, Finding, Reason
from jammkle_driver.core.hardware import MANIFOLD
from jammkle_driver.core.watchdog import Watchdog

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jammkle_driver.core.ankle import Ankle
    from jammkle_driver.core.watchdog import Instant


class SensorWatch:
    """Watches when each sensor was last heard; a channel without one is in FAULT, a manifold without one is not."""

    def __init__(self, channels: Sequence[str], timeout_s: float) -> None:
        """Watch the sensors of `channels` and of the manifold; silence of `timeout_s` s counts as not measured."""
        self._names = tuple(channels)
        self._timeout_s = timeout_s
        self._silences = {place: Watchdog(timeout_s) for place in (*self._names, MANIFOLD)}
        # Sensors of one board fall silent within milliseconds, and each may be the first to be noticed.
        self._all_silent = Watchdog(0.5 * timeout_s)

    @property
    def timeout_s(self) -> float:
        """Silence after which a pressure counts as not measured, s."""
        return self._timeout_s

    @property
    def manifold_heard(self) -> bool:
        """Whether the manifold's sensor was ever heard."""
        return self._silences[MANIFOLD].fed

    @property
    def values(self) -> dict[str, str]:
        """What a silent sensor has not kept to, in numbers for people."""
        return {"silence allowed (s)": f"{self._timeout_s:g}"}

    def hear(self, place: str, now: Instant) -> None:
        """Note that a sensor was heard."""
        self._silences[place].feed(now)
        self._all_silent.feed(now)

    def silent(self, place: str, now: Instant) -> bool:
        """Whether a sensor that was heard is silent now."""
        return self._silences[place].expired(now)

    def excuse(self, stood_s: float) -> None:
        """Hold a silence of `stood_s` s against nobody: nobody was there to hear."""
        for silence in (*self._silences.values(), self._all_silent):
            silence.excuse(stood_s)

    def forget(self) -> None:
        """Be as new: nothing was heard yet."""
        for silence in (*self._silences.values(), self._all_silent):
            silence.forget()

    def look(self, ankle: Ankle, now: Instant, *, active: bool) -> None:
        """Let an ankle forget the pressures of silent sensors; where it is active, their channels fail."""
        measured = [name for name, channel in ankle.channels.items() if channel.vacuum_pa is not None]
        silent = [name for name in measured if self._silences[name].expired(now)]
        every = bool(silent) and self._all_silent.expired(now)
        if every:
            silent = measured
        if every or self._silences[MANIFOLD].expired(now):
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
