"""Impact detection: the specific force jumps, from free fall or on the ground."""

from __future__ import annotations

from dataclasses import dataclass

from jammkle_controller.core.events import M_S2, ContactEvent, ContactKind
from jammkle_graph.constants import NANOSECONDS_PER_SECOND

FOLLOW_TIME_S = 0.02
"""Time constant with which the level before a hit follows a rise, s. Longer than the rise of a shock (5 to 15 ms for
a soft ankle), shorter than the heave of a walking body (100 ms and more)."""

ONSET_M_S2 = 1.0
"""Rise from which on a sample is said to carry the impact, m/s^2: 30 times the noise of the magnitude
(80 ug/sqrt(Hz) over 225 Hz is 0.015 m/s^2 per axis), so that noise never opens an impact."""

_FLIGHT_PROBABILITY = 0.99
_UNLOADED_PROBABILITY = 0.8
_GROUND_PROBABILITY = 0.7
"""Probability of an impact after free fall, after unloading, and on the ground, where a blow may also come from another
foot."""


@dataclass(frozen=True)
class ImpactSettings:
    """Thresholds on |specific force|, m/s^2, and the refractory time, s."""

    touchdown_m_s2: float
    impact_jump_m_s2: float
    refractory_s: float


class ImpactDetector:
    """Follows the level of |specific force| and reports rises above it.

    The level drops at once with the signal and follows a rise with `FOLLOW_TIME_S`, so a rise is measured from the
    lowest recent value, at any sample rate. A body whose |specific force| stays within g +- a can never make a rise
    of more than 2 a: half of `impact_jump_m_s2` is the vibration that is guaranteed to raise no alarm on the ground.
    """

    def __init__(self, settings: ImpactSettings) -> None:
        """Make a detector that has seen nothing."""
        self.settings = settings
        self._level = 0.0
        self._rise = 0.0
        self._level_before = 0.0
        self._onset_ns: int | None = None
        self._last_impact_ns: int | None = None

    def restart(self, force_m_s2: float) -> None:
        """Forget the level: the next rise is measured from `force_m_s2`."""
        self._level = force_m_s2
        self._rise = 0.0
        self._onset_ns = None

    def forget_impacts(self) -> None:
        """Forget when the last impact was: its time belongs to another time line."""
        self._last_impact_ns = None

    def follow(self, time_ns: int, interval_s: float, force_m_s2: float) -> None:
        """Take the next |specific force|. Call it once per sample, before `in_flight` or `on_ground`."""
        level = self._level
        if force_m_s2 <= level:
            self._level = force_m_s2
            self._rise = 0.0
            self._onset_ns = None
            return
        self._rise = rise = force_m_s2 - level
        if rise > ONSET_M_S2:
            if self._onset_ns is None:
                self._onset_ns = time_ns
                self._level_before = level
        else:
            self._onset_ns = None
        # Implicit Euler: stable for any interval.
        self._level = level + rise * interval_s / (interval_s + FOLLOW_TIME_S)

    def unloaded(self, time_ns: int, force_m_s2: float, rise_m_s2: float) -> ContactEvent | None:
        """Return an impact if the force on an unloaded body jumped by more than `rise_m_s2`, m/s^2."""
        return self._impact(time_ns, force_m_s2, _UNLOADED_PROBABILITY) if self._rise > rise_m_s2 else None

    def in_flight(self, time_ns: int, force_m_s2: float) -> ContactEvent | None:
        """Return an impact if the flight ended: the ground carries more than `touchdown_m_s2`."""
        if force_m_s2 <= self.settings.touchdown_m_s2:
            return None
        return self._impact(time_ns, force_m_s2, _FLIGHT_PROBABILITY)

    def on_ground(self, time_ns: int, force_m_s2: float) -> ContactEvent | None:
        """Return an impact if the force jumped by more than `impact_jump_m_s2`, unless one was just reported."""
        if self._rise <= self.settings.impact_jump_m_s2:
            return None
        last_ns = self._last_impact_ns
        if last_ns is not None and (time_ns - last_ns) / NANOSECONDS_PER_SECOND < self.settings.refractory_s:
            return None
        return self._impact(time_ns, force_m_s2, _GROUND_PROBABILITY)

    @property
    def last_ns(self) -> int | None:
        """Stamp of the last impact, ns."""
        return self._last_impact_ns

    def note(self, time_ns: int) -> None:
        """Take an impact that was found elsewhere."""
        self._last_impact_ns = time_ns

    def _impact(self, time_ns: int, force_m_s2: float, probability: float) -> ContactEvent:
        onset_ns = time_ns if self._onset_ns is None else self._onset_ns
        level = self._level if self._onset_ns is None else self._level_before
        self._last_impact_ns = time_ns
        return ContactEvent(
            ContactKind.IMPACT,
            time_ns,
            force_m_s2 - level,
            M_S2,
            (time_ns - onset_ns) / NANOSECONDS_PER_SECOND,
            probability,
        )
