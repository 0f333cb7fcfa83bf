"""Touch-down of a foot that swings: a blow that the swing so far does not explain, and the calm after it."""

from __future__ import annotations

import math
from collections import deque
from typing import TYPE_CHECKING

from jammkle_controller.core.density_ratio import DensityRatio, probability_of
from jammkle_controller.core.events import M_S2, ContactEvent, ContactKind

if TYPE_CHECKING:
    from jammkle_controller.core.motion import Motion, Vector
    from jammkle_controller.core.scales import Scales

BEHIND_S = 0.02
"""What a swing is usually like is known up to this time ago, s: a blow shall not be measured against itself."""
PEAK_S = 0.04
"""Time constant with which the sharpest moment is forgotten, s: a foot that slaps down is flat after 20 to 40 ms."""
LONGEST_SWING_S = 0.6
LEAST_SWING_S = 0.03
"""No touch-down comes so soon after a lift-off, s: what shakes then is the push-off."""
_OLDEST_PEAK_S = 0.1
_FLOOR = 1e-4


class _Peak:
    """The sharpest moment of late: its size and age."""

    __slots__ = ("age_s", "size")

    def __init__(self) -> None:
        self.size = 0.0
        self.age_s = _OLDEST_PEAK_S

    def update(self, size: float, interval_s: float) -> bool:
        """Take the next size; return whether it is the largest of late."""
        self.size *= math.exp(-interval_s / PEAK_S)
        self.age_s = min(_OLDEST_PEAK_S, self.age_s + interval_s)
        if size < self.size:
            return False
        self.size, self.age_s = size, 0.0
        return True


class SwingSoFar:
    """What a swing was like since it began, up to `BEHIND_S` ago, and its sharpest moment of late."""

    def __init__(self) -> None:
        """Begin a swing."""
        self.lasted_s = 0.0
        self.sharp, self.turning_sharp = _Peak(), _Peak()
        self.blow: Vector = (0.0, 0.0, 0.0)
        self._sums = (0.0, 0.0, 0.0, 0.0, 0.0)
        self._behind = self._sums
        self._waiting: deque[tuple[float, float, float, float, float]] = deque()

    def update(self, scales: Scales, interval_s: float) -> None:
        """Take the next sample."""
        self.lasted_s += interval_s
        now = (scales.turning.short, scales.sharp.mean, scales.turning_sharp.mean, scales.unrest.short)
        turning, sharp, turning_sharp, unrest, _ = self._sums
        self._sums = (
            turning + now[0] * interval_s,
            sharp + now[1] * interval_s,
            turning_sharp + now[2] * interval_s,
            unrest + now[3] * interval_s,
            self.lasted_s,
        )
        self._waiting.append(self._sums)
        while self._waiting and self._waiting[0][-1] <= self.lasted_s - BEHIND_S:
            self._behind = self._waiting.popleft()
        if self.sharp.update(now[1], interval_s):
            self.blow = scales.sharp.vector
        self.turning_sharp.update(now[2], interval_s)

    def features(self, scales: Scales, motion: Motion) -> tuple[float, ...]:
        """Return what the probability of a touch-down is made of.

        How sharp it was of late, how sharp it is, and how it was until then: a touch-down is a blow beyond the swing's
        own jerks, after which the foot turns less.
        """
        *sums, over_s = self._behind
        means = [math.log10(_FLOOR + each / over_s) if over_s > 0.0 else 0.0 for each in sums]
        return (
            math.log10(_FLOOR + self.sharp.size),
            math.log10(_FLOOR + self.turning_sharp.size),
            self.sharp.age_s,
            self.turning_sharp.age_s,
            math.log10(_FLOOR + scales.sharp.mean),
            math.log10(_FLOOR + scales.turning_sharp.mean),
            math.log10(_FLOOR + scales.turning.short),
            math.log10(_FLOOR + scales.unrest.short),
            math.log10(_FLOOR + scales.turning.middle),
            math.log10(_FLOOR + scales.unrest.middle),
            *means,
            min(LONGEST_SWING_S, self.lasted_s),
            motion.load,
        )


class TouchdownDetector:
    """Says of every sample of a swing how probable it is that the foot has touched down.

    The posterior of a change that happens once, learned as a density ratio of samples up to 40 ms after touch-downs
    over those of the swings before (both as likely beforehand). A clear blow is told at once; a doubtful one when the
    foot is calm after it. That is a sequential test (Wald, "Sequential Analysis", 1947), whose memory is the features.
    """

    def __init__(self, ratio: DensityRatio, probability: float) -> None:
        """Make a detector.

        Args:
            ratio: Of the densities of `SwingSoFar.features` after touch-downs and in swings.
            probability: From which on the foot has touched down.

        """
        self.probability = probability
        self._ratio = ratio
        self._swing = SwingSoFar()

    def restart(self) -> None:
        """Begin a swing."""
        self._swing = SwingSoFar()

    def in_swing(self, time_ns: int, scales: Scales, motion: Motion, interval_s: float) -> ContactEvent | None:
        """Take the next sample of a swing; return the touch-down if it is one."""
        swing = self._swing
        swing.update(scales, interval_s)
        if swing.lasted_s < LEAST_SWING_S:
            return None
        probability = probability_of(self._ratio.log_odds(swing.features(scales, motion)))
        if probability < self.probability:
            return None
        return self.event(time_ns, probability)

    def event(self, time_ns: int, probability: float) -> ContactEvent:
        """Return a touch-down that is told now, with its sharpest moment as its size and direction."""
        swing = self._swing
        size = math.hypot(*swing.blow)
        scale = 1.0 / (size or 1.0)
        x, y, z = swing.blow
        return ContactEvent(
            ContactKind.IMPACT,
            time_ns,
            size,
            M_S2,
            swing.sharp.age_s,
            probability,
            direction=(x * scale, y * scale, z * scale),
        )
