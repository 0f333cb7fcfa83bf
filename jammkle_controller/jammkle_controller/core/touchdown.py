"""Touch-down of a foot that swings: a blow that the swing itself does not explain."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jammkle_common.constants import NANOSECONDS_PER_SECOND
from jammkle_controller.core.density_ratio import DensityRatio, probability_of
from jammkle_controller.core.events import M_S2, ContactEvent, ContactKind

if TYPE_CHECKING:
    from jammkle_controller.core.motion import Motion

LEAST_BLOW_M_S2 = 1.0
"""Sharp part from which on a sample is looked at, m/s^2: well above the noise, so that most of a swing is cheap."""
LEAST_RATIO = 1.5
ONSET_M_S2 = 0.5


class TouchdownDetector:
    """Judges every sharp sample of a swing by a learned density ratio of touch-downs over the swing's own jerks."""

    def __init__(self, ratio: DensityRatio, probability: float) -> None:
        """Make a detector.

        Args:
            ratio: Of the densities of `Motion.blow_features` at touch-downs and in swings.
            probability: From which on a blow is a touch-down.

        """
        self._ratio = ratio
        self._probability = probability
        self._onset_ns: int | None = None

    def restart(self) -> None:
        """Forget a blow that has begun."""
        self._onset_ns = None

    def in_swing(self, time_ns: int, motion: Motion, swung_s: float) -> ContactEvent | None:
        """Take the next sample of a swing that has lasted `swung_s`, s; return the touch-down if it is one."""
        if motion.sharp_m_s2 < ONSET_M_S2:
            self._onset_ns = None
        elif self._onset_ns is None:
            self._onset_ns = time_ns
        if motion.sharp_m_s2 < LEAST_BLOW_M_S2 or motion.sharp_ratio < LEAST_RATIO:
            return None
        probability = probability_of(self._ratio.log_odds(motion.blow_features(swung_s)))
        if probability < self._probability:
            return None
        onset_ns = time_ns if self._onset_ns is None else self._onset_ns
        size = motion.sharp_m_s2
        return ContactEvent(
            ContactKind.IMPACT,
            time_ns,
            size,
            M_S2,
            (time_ns - onset_ns) / NANOSECONDS_PER_SECOND,
            probability,
            direction=(motion.sharp[0] / size, motion.sharp[1] / size, motion.sharp[2] / size),
        )
