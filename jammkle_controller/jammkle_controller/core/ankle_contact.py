"""Contact felt with the ankle itself: its angles against how a foot moves that swings.

A foot that hangs toe-down is a sensor: the ground turns it. What a foot does that swings is known but for noise: it
hangs as the tendons let it, lags behind a shank that is turned, and creeps back to where it hung. So the likelihood of
angle and rates in a swing is compared with that in a stance at every reading, by a learned ratio, and a filter adds up
what looks in a row say.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from jammkle_common.constants import NANOSECONDS_PER_SECOND
from jammkle_controller.core.stepping import SwingFilter

if TYPE_CHECKING:
    from jammkle_controller.core.stepping import DensityRatio

RATE_TIME_S = 0.1
"""Time over which the usual rate is a mean, s: a foot creeps back for a tenth of a second and more after a lift-off."""
SHORT_S, LONG_S = 0.01, 0.02
"""Over which a change of rate is looked at, s: a touch-down stops a toe in 10 ms, what a swing's own inertia does takes
50. On readings that come less often the change is that since the one before."""
_ROUNDING_S = 0.001
LEAST_TURN_RAD = 0.02
"""By which the ground must have turned a foot from where it came closest to its hanging in this swing, rad: one that
hangs still a few degrees off, as friction leaves it, does not stand for that. A tenth of what a stance turns it by."""
LONGEST_S = 0.1
"""After readings were missing for so long rates of before say nothing."""
EVIDENCE_TIME_S = 0.01
"""Looks closer than this count once: rates are those of encoders, and hardly filtered."""
LEFT_PROBABILITY, STANDS_PROBABILITY = 0.9, 0.1
"""Probability of swing above and below which a foot has left and stands (Schmitt's trigger). As likely as not is 0.5;
the rates of errors were the same at 0.97 and 0.03."""
_MORE_LIKELY = 0.5
CONFIRM_S = 0.02
"""So long a foot must have left before that is reported, s: a toe that is unloaded for a moment is not to be vented."""


class AnkleReading(NamedTuple):
    """Angles, rad, and rates, rad/s, of the ankle, as in joint_states, and how fast the shank turns above it."""

    pitch_rad: float
    roll_rad: float
    pitch_rad_s: float
    roll_rad_s: float
    shank_rad_s: float
    """Sum of the rates of hip and knee, toe-down positive: of a body that does not turn, the shank's pitch rate."""


class AnkleMotion:
    """What is looked at of the ankle's readings, one after the other."""

    NAMES = (
        "angle from where it hangs",
        "pitch rate",
        "usual pitch rate",
        "its change in 10 ms",
        "its change in 20 ms",
        "rate of the foot",
        "change of the shank's rate in 20 ms",
        "size of the change of the roll rate in 20 ms",
    )

    def __init__(self, hang_pitch_rad: float) -> None:
        """Have read nothing, and know where the soft foot hangs."""
        self._hang_pitch_rad = hang_pitch_rad
        self._before: deque[tuple[int, AnkleReading]] = deque()
        self._usual_rad_s = 0.0

    def follow(self, reading: AnkleReading, time_ns: int) -> tuple[tuple[float, ...], float] | None:
        """Take the next reading; return what is looked at, by NAMES, and the time since the reading before, s.

        Returns:
            None: it is the first, or cannot be compared with the one before.

        """
        before = self._before
        interval_s = (time_ns - before[-1][0]) / NANOSECONDS_PER_SECOND if before else 0.0
        if not 0.0 < interval_s <= LONGEST_S:
            if before and interval_s == 0.0:
                return None
            before.clear()
            before.append((time_ns, reading))
            self._usual_rad_s = reading.pitch_rad_s
            return None
        self._usual_rad_s += (reading.pitch_rad_s - self._usual_rad_s) * interval_s / (interval_s + RATE_TIME_S)
        short, long = self._ago(SHORT_S, time_ns), self._ago(LONG_S, time_ns)
        before.append((time_ns, reading))
        while (time_ns - before[1][0]) / NANOSECONDS_PER_SECOND > LONG_S - _ROUNDING_S:
            before.popleft()
            if len(before) == 1:
                break
        return (
            self._hang_pitch_rad - reading.pitch_rad,
            reading.pitch_rad_s,
            self._usual_rad_s,
            reading.pitch_rad_s - short.pitch_rad_s,
            reading.pitch_rad_s - long.pitch_rad_s,
            reading.pitch_rad_s + reading.shank_rad_s,
            reading.shank_rad_s - long.shank_rad_s,
            abs(reading.roll_rad_s - long.roll_rad_s),
        ), interval_s

    def _ago(self, ago_s: float, time_ns: int) -> AnkleReading:
        """Return the youngest reading that is so old, or the oldest that is kept."""
        for at_ns, reading in reversed(self._before):
            if (time_ns - at_ns) / NANOSECONDS_PER_SECOND > ago_s - _ROUNDING_S:
                return reading
        return self._before[0][1]


@dataclass(frozen=True)
class AnkleChange:
    """A foot has begun or ceased to stand."""

    stands: bool
    angle_rad: float
    """From where the soft foot hangs."""
    delay_s: float
    """Since the angles first said so, more likely than not."""
    probability: float
    """That it is so."""


class AnkleContact:
    """Decides from each reading whether the foot stands, by the forward filter of `SwingFilter`."""

    def __init__(self, ratio: DensityRatio, hang_pitch_rad: float) -> None:
        """Have felt nothing: whether it stands is not known before the angles say so.

        Args:
            ratio: Of the densities in a swing and in a stance of `AnkleMotion.NAMES`.
            hang_pitch_rad: Where the soft foot hangs.

        """
        self.stands: bool | None = None
        self._motion = AnkleMotion(hang_pitch_rad)
        self._swing = SwingFilter(ratio, EVIDENCE_TIME_S)
        self._swing.restart()
        self._least_rad = math.inf
        self._left_ns: int | None = None
        self._side = True
        self._side_ns = 0

    def lift(self) -> None:
        """Take that the foot does not stand: the body falls."""
        self.stands = False
        self._swing.lift()

    def update(self, reading: AnkleReading, time_ns: int) -> AnkleChange | None:
        """Take a reading; return whether the foot stands, if that has changed since it was first known."""
        looked = self._motion.follow(reading, time_ns) if math.isfinite(sum(reading)) else None
        if looked is None:
            return None
        (angle_rad, *_), interval_s = looked
        swing = self._swing.update(looked[0], interval_s)
        if (swing < _MORE_LIKELY) is not self._side:
            self._side, self._side_ns = not self._side, time_ns
        stands, before = self._decided(swing, angle_rad, time_ns), self.stands
        if stands is None or stands is before:
            return None
        self.stands = stands
        if before is None:
            return None
        delay_s = (time_ns - self._side_ns) / NANOSECONDS_PER_SECOND if self._side is stands else 0.0
        return AnkleChange(stands, abs(angle_rad), delay_s, 1.0 - swing if stands else swing)

    def _decided(self, swing: float, angle_rad: float, time_ns: int) -> bool | None:
        """Return whether the foot stands, by the probability that it swings; None: that is not said now."""
        self._least_rad = min(self._least_rad, angle_rad) if self.stands is False else angle_rad
        if swing < LEFT_PROBABILITY:
            self._left_ns = None
            turned = self.stands is not False or angle_rad - self._least_rad >= LEAST_TURN_RAD
            return True if swing <= STANDS_PROBABILITY and turned else None
        if self._left_ns is None:
            self._left_ns = time_ns
        left_s = (time_ns - self._left_ns) / NANOSECONDS_PER_SECOND
        return None if self.stands and left_s < CONFIRM_S - _ROUNDING_S else False
