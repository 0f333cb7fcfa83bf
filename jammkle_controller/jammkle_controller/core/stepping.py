"""What an IMU on the foot or the shank tells of its steps: the foot has left, swings, is down, slides."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jammkle_common.constants import NANOSECONDS_PER_SECOND
from jammkle_controller.core.density_ratio import learned
from jammkle_controller.core.events import M_S, M_S2, ContactEvent, ContactKind
from jammkle_controller.core.sole import SoleFilter
from jammkle_controller.core.swing import SwingFilter
from jammkle_controller.core.touchdown import TouchdownDetector

if TYPE_CHECKING:
    from jammkle_controller.core.density_ratio import StepRatios
    from jammkle_controller.core.detector_settings import DetectorSettings
    from jammkle_controller.core.imu import ImuSample
    from jammkle_controller.core.motion import Motion

REBOUND_S = 0.08
"""After a touch-down a foot does not leave again so soon, s: what shakes it is the touch-down."""
AS_LIKELY = 0.5
SURE_SWING = 0.95
SURE_SWING_S = 0.06
"""Probability and time of a swing from which on it is told: twice the longest window of the features."""


class SteppingFoot:
    """The detectors of one foot that steps, on one IMU that moves with it."""

    def __init__(self, settings: DetectorSettings, ratios: StepRatios | None = None) -> None:
        """Start on the ground, with density ratios of one's own or those of `learned.json`."""
        self.settings = settings
        ratios = ratios or learned(settings.mount.value)
        self.swing = SwingFilter(ratios.swing)
        self.sole = SoleFilter(ratios.slide, settings.slip.lever_m)
        self._touchdown = TouchdownDetector(ratios.touchdown, settings.touchdown_probability)
        self._interval_s = 0.0
        self._rising_since_ns: int | None = None
        self._swing_since_ns = 0
        self._swing_told = False
        self._sliding = False
        self._slide_since_ns = 0

    def restart(self) -> None:
        """Forget what cannot be compared with the next sample."""
        self.swing.restart()
        self._interval_s = 0.0

    def suspend(self) -> None:
        """Forget a lift-off that has begun."""
        self._rising_since_ns = None

    def update(self, motion: Motion, interval_s: float) -> None:
        """Take the motion at the next sample, `interval_s` after the one before."""
        self._interval_s = interval_s
        self.swing.update(motion.features(), interval_s)

    def leaving(self, time_ns: int, landed_ns: int | None, motion: Motion) -> ContactEvent | None:
        """Return a lift-off when a swing becomes probable.

        Args:
            time_ns: Of the sample.
            landed_ns: When the foot hit the ground last; None: never.
            motion: Of the sample.

        """
        swing = self.swing.probability
        if swing < AS_LIKELY:
            self._rising_since_ns = None
        elif self._rising_since_ns is None:
            self._rising_since_ns = time_ns
        rebounds = landed_ns is not None and _since_s(landed_ns, time_ns) < REBOUND_S
        if swing < self.settings.swing.swing_probability or rebounds:
            return None
        rising_s = self._rising_s(time_ns)
        return ContactEvent(ContactKind.LIFTOFF, time_ns, motion.force_m_s2, M_S2, rising_s, swing)

    def leave(self, time_ns: int) -> None:
        """Take that the foot has left the ground."""
        self._swing_since_ns = time_ns
        self._swing_told = False
        self._rising_since_ns = None
        self.swing.lift()
        self._touchdown.restart()

    def blow(self, time_ns: int, motion: Motion) -> ContactEvent | None:
        """Return the touch-down of a foot that swings when it is hit."""
        return self._touchdown.in_swing(time_ns, motion, _since_s(self._swing_since_ns, time_ns))

    def stands(self, time_ns: int, motion: Motion) -> ContactEvent | None:
        """Return the touch-down of a foot that swung, reported late: it stands, though nothing hit it."""
        swing = self.swing.probability
        if swing >= self.settings.swing.stance_probability:
            return None
        return ContactEvent(ContactKind.IMPACT, time_ns, motion.sharp_m_s2, M_S2, 0.0, 1.0 - swing, is_felt=False)

    def swinging(self, time_ns: int, motion: Motion) -> ContactEvent | None:
        """Return once per swing that the foot swings freely."""
        swing, swung_s = self.swing.probability, _since_s(self._swing_since_ns, time_ns)
        if self._swing_told or swing < SURE_SWING or swung_s < SURE_SWING_S:
            return None
        self._swing_told = True
        return ContactEvent(ContactKind.SWING, time_ns, motion.force_m_s2, M_S2, swung_s, swing)

    def land(self, time_ns: int) -> None:
        """Take that the foot has hit the ground."""
        self._rising_since_ns = None
        self._sliding = False
        self.sole.land(time_ns)
        self.swing.land()

    def sliding(self, sample: ImuSample, motion: Motion) -> ContactEvent | None:
        """Return a slip of a foot on the ground when it becomes probable; another only after it was improbable."""
        time_ns, sole, least = sample.time_ns, self.sole, self.settings.slip.probability
        sole.follow(sample, self._interval_s, motion)
        before = sole.probability
        probability = sole.update(time_ns, self._interval_s, motion, self.swing.probability)
        if before < AS_LIKELY <= probability:
            self._slide_since_ns = time_ns
        # Outside of what it was learned from, such as at perfect rest, the posterior may say anything.
        creeps = sole.speed_m_s < self.settings.slip.speed_m_s
        if self._sliding or creeps or sole.is_lifted or probability < least:
            self._sliding &= probability > 1.0 - least
            return None
        self._sliding = True
        since_s = _since_s(self._slide_since_ns, time_ns)
        return ContactEvent(
            ContactKind.SLIP, time_ns, sole.speed_m_s, M_S, since_s, probability, direction=sole.direction
        )

    def _rising_s(self, time_ns: int) -> float:
        return 0.0 if self._rising_since_ns is None else _since_s(self._rising_since_ns, time_ns)


def _since_s(begin_ns: int, time_ns: int) -> float:
    return (time_ns - begin_ns) / NANOSECONDS_PER_SECOND
