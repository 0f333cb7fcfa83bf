"""Lift-off detection: nothing carries the body any more, so the IMU reads free fall."""

from __future__ import annotations

from dataclasses import dataclass

from jammkle_common.constants import NANOSECONDS_PER_SECOND
from jammkle_controller.core.events import M_S2, ContactEvent, ContactKind

MIN_SAMPLES = 3
"""A flight is seen by at least this many samples, so that a gap in the stream does not make one."""

_PROBABILITY = 0.99
"""Nothing but a flight is that light for that long."""


@dataclass(frozen=True)
class LiftoffSettings:
    """|specific force| below which nothing carries the body, m/s^2, and for how long, s."""

    flight_m_s2: float
    flight_confirm_s: float


class LiftoffDetector:
    """Reports free fall once it has lasted `flight_confirm_s`."""

    def __init__(self, settings: LiftoffSettings) -> None:
        """Make a detector that has seen nothing."""
        self.settings = settings
        self._since_ns: int | None = None
        self._samples = 0

    def restart(self) -> None:
        """Forget a flight that has begun."""
        self._since_ns = None

    def on_ground(self, time_ns: int, force_m_s2: float) -> ContactEvent | None:
        """Take the next |specific force| while on the ground; return a lift-off if it is certain now."""
        if force_m_s2 >= self.settings.flight_m_s2:
            self._since_ns = None
            return None
        if self._since_ns is None:
            self._since_ns = time_ns
            self._samples = 0
        self._samples += 1
        lasted_s = (time_ns - self._since_ns) / NANOSECONDS_PER_SECOND
        if self._samples < MIN_SAMPLES or lasted_s < self.settings.flight_confirm_s:
            return None
        self._since_ns = None
        return ContactEvent(ContactKind.LIFTOFF, time_ns, force_m_s2, M_S2, lasted_s, _PROBABILITY)
