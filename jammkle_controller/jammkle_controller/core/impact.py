"""Impact detection: the ground carries again after free fall, or more than the weight while it does."""

from __future__ import annotations

from dataclasses import dataclass

from jammkle_common.constants import NANOSECONDS_PER_SECOND, STANDARD_GRAVITY_M_S2
from jammkle_controller.core.events import M_S2, ContactEvent, ContactKind

FOLLOW_TIME_S = 0.02
"""Time constant with which the level before a hit follows a rise, s. Longer than the rise of a shock (5 to 15 ms for
a soft ankle), shorter than the heave of a walking body (100 ms and more)."""

ONSET_M_S2 = 1.0
"""Rise from which on a sample is said to carry the impact, m/s^2: 30 times the noise of the magnitude
(80 ug/sqrt(Hz) over 225 Hz is 0.015 m/s^2 per axis), so that noise never opens an impact."""

_FLIGHT_PROBABILITY = 0.99
_GROUND_PROBABILITY = 0.7
"""Probability of an impact after free fall, and on the ground, where a blow may also come from another foot."""


@dataclass(frozen=True)
class ImpactSettings:
    """Thresholds on |specific force|, m/s^2, and the refractory time, s."""

    touchdown_m_s2: float
    impact_m_s2: float
    refractory_s: float


class ImpactDetector:
    """Compares |specific force| with thresholds: in flight with nearly nothing, on the ground with the weight.

    A body whose |specific force| stays below g + `impact_m_s2` raises no alarm on the ground, and neither does one that
    is heaved slowly: the force must also rise above its level. That drops at once with the signal and follows a rise
    with `FOLLOW_TIME_S`, so that it is the lowest recent value at any rate; the size of an impact is measured from it.
    """

    def __init__(self, settings: ImpactSettings) -> None:
        """Make a detector that has seen nothing."""
        self.settings = settings
        self._level = 0.0
        self._level_before = 0.0
        self._onset_ns: int | None = None
        self._last_impact_ns: int | None = None

    def restart(self, force_m_s2: float) -> None:
        """Forget the level: the next rise is measured from `force_m_s2`."""
        self._level = force_m_s2
        self._onset_ns = None

    def forget_impacts(self) -> None:
        """Forget when the last impact was: its time belongs to another time line."""
        self._last_impact_ns = None

    def follow(self, time_ns: int, interval_s: float, force_m_s2: float) -> None:
        """Take the next |specific force|. Call it once per sample, before `in_flight` or `on_ground`."""
        level = self._level
        if force_m_s2 <= level:
            self._level = force_m_s2
            self._onset_ns = None
            return
        rise = force_m_s2 - level
        if rise > ONSET_M_S2:
            if self._onset_ns is None:
                self._onset_ns = time_ns
                self._level_before = level
        else:
            self._onset_ns = None
        # Implicit Euler: stable for any interval.
        self._level = level + rise * interval_s / (interval_s + FOLLOW_TIME_S)

    def in_flight(self, time_ns: int, force_m_s2: float) -> ContactEvent | None:
        """Return an impact if the flight ended: the ground carries more than `touchdown_m_s2`."""
        if force_m_s2 <= self.settings.touchdown_m_s2:
            return None
        return self._impact(time_ns, force_m_s2, _FLIGHT_PROBABILITY)

    def on_ground(self, time_ns: int, force_m_s2: float, *, disturbed: bool = False) -> ContactEvent | None:
        """Return an impact if the force is above weight and level by more than `impact_m_s2`, unless one was just told.

        Args:
            time_ns: Of the sample.
            force_m_s2: Its |specific force|.
            disturbed: The ankle itself is jolting the IMU: only twice as much counts.

        """
        carried_m_s2 = max(STANDARD_GRAVITY_M_S2, self._level)
        if force_m_s2 - carried_m_s2 <= self.settings.impact_m_s2 * (2.0 if disturbed else 1.0):
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
