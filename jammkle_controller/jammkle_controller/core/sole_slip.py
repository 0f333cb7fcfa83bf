"""A slip of a foot that stands, from the speed of its sole: a cumulative sum of the way that noise does not explain."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

from jammkle_common.constants import NANOSECONDS_PER_SECOND
from jammkle_controller.core.events import M_S, ContactEvent, ContactKind, Source
from jammkle_controller.core.sole_speed import BodyTwist, LegPose, sole_velocity_m_s

if TYPE_CHECKING:
    from jammkle_controller.core.sole_speed import LegGeometry, Vector

LEAST_SPREAD_M_S = 0.012
"""However sure an odometry is: rates of joints that are known to 0.02 rad/s, on a leg of 0.3 m and its body's turning,
leave as much."""
SLOW_SPREADS = math.sqrt(2.0 * math.log(10.0))
"""Below so many spreads a speed along the ground is no way: one in ten of a Rayleigh distribution is more."""
UP_SPREADS = 3.29
"""Above so many spreads, up or down, the foot is put down or lifted, whatever it bears: one in a thousand of noise."""
LEAST_WAY_M = 0.002
"""Way beyond what noise explains that is a slip: half of what counts as one in the trial. Chosen, with the two shares
above, on development runs of the quadruped (docs/controller.md)."""
FALSE_ALARM_S = 60.0
"""Mean time of stance between two false alarms of white noise alone."""
QUIET_S = 0.03
"""A foot that was slow for so long has stopped, and may slip anew; as slides are told apart in the trial."""
LONGEST_S = 0.06
"""Readings further apart than this are not compared, s: a foot slides by 10 mm in it at 0.17 m/s."""
RESTART_S = 1.0
"""A stamp that is earlier by so much is of a clock that was set back; by less, it comes late."""
PROBABILITY = 0.84
"""That a slip which is told is one: the share on development runs of the quadruped."""
_KEPT = 64
"""Poses that wait for an odometry that comes late: 0.13 s at 500 Hz, 0.64 s at 100 Hz."""
_HIGHEST = 1e3
"""Speeds and rates beyond it are none, m/s and rad/s."""


@dataclass(frozen=True)
class SoleSettings:
    """Where the leg is, and how well the body's speed is known where the odometry does not say so."""

    leg: LegGeometry
    spread_m_s: float
    """Standard deviation per axis: noise and drift."""
    frozen_s: float
    """An odometry that repeats one reading for longer is frozen, s."""


@dataclass
class OdometryCounts:
    """What came of the odometry."""

    used: int = 0
    not_finite: int = 0
    late: int = 0
    """Stamps that are not after the one before."""
    frozen: int = 0
    unmatched: int = 0
    """Without a pose of the leg just before and after."""


class SoleSlip:
    """Pairs odometry and leg by their stamps, and tells when a foot that stands has gone a way.

    Multivariate cumulative sum (Crosier, Technometrics 30, 1988): with v the velocity of the sole along the body's x
    and y, and k the speed that noise may have,

        c = s + v dt,    s <- c max(0, 1 - k dt / |c|),    told at |s| > max(LEAST_WAY_M, h)

    h is such that white noise alone makes one false alarm in FALSE_ALARM_S: from k and h it takes one reading of
    probability exp(-(k + h / dt)^2 / (2 spread^2)) to alarm. The sum begins anew where the foot does not stand, and
    where its sole goes up or down. The body is taken to be along the ground.
    """

    def __init__(self, settings: SoleSettings) -> None:
        """Have heard nothing."""
        self.settings = settings
        self.counts = OdometryCounts()
        self._poses: deque[tuple[int, LegPose, bool | None]] = deque(maxlen=_KEPT)
        self._waiting: BodyTwist | None = None
        self._twist: BodyTwist | None = None
        self._changed_ns = 0
        self._paired_ns: int | None = None
        self._rest()

    def _rest(self) -> None:
        self._way_m = (0.0, 0.0)
        self._gone_m = (0.0, 0.0)
        self._since_ns = 0
        self._slides = False
        self._quiet_s = 0.0

    @property
    def paired_ns(self) -> int | None:
        """Stamp of the latest speed of the sole that could be told; None: none yet."""
        return self._paired_ns

    def hear_pose(self, pose: LegPose, time_ns: int, *, stands: bool | None) -> ContactEvent | None:
        """Take the leg at a time, and whether its foot stands then; None: that is not known."""
        if not all(abs(value) < _HIGHEST for value in (*pose[:3], *pose[6:9])):  # a NaN is not less than anything
            return None
        if self._poses and time_ns <= self._poses[-1][0]:
            if self._poses[-1][0] - time_ns < RESTART_S * NANOSECONDS_PER_SECOND:
                return None
            self._poses.clear()
        self._poses.append((time_ns, pose, stands))
        waiting, self._waiting = self._waiting, None
        return None if waiting is None else self._match(waiting, time_ns)

    def hear_twist(self, twist: BodyTwist, time_ns: int) -> ContactEvent | None:
        """Take an odometry that comes at a time; its own stamp is earlier by its latency."""
        if not all(abs(value) < _HIGHEST for value in (*twist.linear_m_s, *twist.angular_rad_s)):
            self.counts.not_finite += 1
            return None
        before = self._twist
        if before is not None and 0 <= before.time_ns - twist.time_ns < RESTART_S * NANOSECONDS_PER_SECOND:
            self.counts.late += 1
            return None
        self._twist = twist
        if before is None or before[1:3] != twist[1:3] or twist.time_ns < before.time_ns:
            self._changed_ns = twist.time_ns
        if twist.time_ns - self._changed_ns > self.settings.frozen_s * NANOSECONDS_PER_SECOND:
            self.counts.frozen += 1
            return None
        if not self._poses or twist.time_ns > self._poses[-1][0]:
            self._waiting = twist
            return None
        return self._match(twist, max(time_ns, self._poses[-1][0]))

    def _match(self, twist: BodyTwist, time_ns: int) -> ContactEvent | None:
        """Follow the sole at the stamp of an odometry, with the leg in between two of its poses."""
        after = len(self._poses) - 1
        while after and self._poses[after - 1][0] >= twist.time_ns:
            after -= 1
        end_ns, end, stands = self._poses[after]
        pose = end
        if end_ns > twist.time_ns:
            begin_ns, begin, stood = self._poses[after - 1] if after else (0, end, stands)
            if not after or end_ns - begin_ns > LONGEST_S * NANOSECONDS_PER_SECOND:
                self.counts.unmatched += 1
                return None
            share = (twist.time_ns - begin_ns) / (end_ns - begin_ns)
            pose = LegPose(*(a + (b - a) * share for a, b in zip(begin, end, strict=True)))
            stands = stands if stands is None or stood is None else stands and stood
        if stands is None:
            return None
        before_ns, self._paired_ns = self._paired_ns, twist.time_ns
        self.counts.used += 1
        elapsed_s = 0.0 if before_ns is None else (twist.time_ns - before_ns) / NANOSECONDS_PER_SECOND
        if not stands or not 0.0 < elapsed_s <= LONGEST_S:
            self._rest()
            return None
        spread_m_s = max(LEAST_SPREAD_M_S, twist.spread_m_s or self.settings.spread_m_s)
        velocity = sole_velocity_m_s(self.settings.leg, pose, twist)
        return self._follow(velocity, spread_m_s, elapsed_s, twist.time_ns, time_ns)

    def _follow(
        self, velocity: Vector, spread_m_s: float, elapsed_s: float, stamp_ns: int, time_ns: int
    ) -> ContactEvent | None:
        """Sum the way of a foot that stands."""
        forward_m_s, left_m_s, up_m_s = velocity
        if abs(up_m_s) > UP_SPREADS * spread_m_s:
            self._rest()
            return None
        slow_m_s = SLOW_SPREADS * spread_m_s
        if self._slides:
            is_slow = math.hypot(forward_m_s, left_m_s) < slow_m_s
            self._quiet_s = self._quiet_s + elapsed_s if is_slow else 0.0
            if self._quiet_s >= QUIET_S:
                self._rest()
            return None
        step_m = forward_m_s * elapsed_s, left_m_s * elapsed_s
        way_m = self._way_m[0] + step_m[0], self._way_m[1] + step_m[1]
        size_m = math.hypot(*way_m)
        share = 0.0 if size_m == 0.0 else max(0.0, 1.0 - slow_m_s * elapsed_s / size_m)
        if self._way_m == (0.0, 0.0):
            self._gone_m = (0.0, 0.0)
            self._since_ns = stamp_ns - round(elapsed_s * NANOSECONDS_PER_SECOND)
        self._way_m = way_m[0] * share, way_m[1] * share
        self._gone_m = self._gone_m[0] + step_m[0], self._gone_m[1] + step_m[1]
        if size_m * share <= max(LEAST_WAY_M, noise_way_m(spread_m_s, elapsed_s)):
            return None
        self._slides = True
        gone_s = (stamp_ns - self._since_ns) / NANOSECONDS_PER_SECOND
        gone_m = math.hypot(*self._gone_m)
        delay_s = (time_ns - self._since_ns) / NANOSECONDS_PER_SECOND
        direction = (way_m[0] / size_m, way_m[1] / size_m, 0.0)
        return ContactEvent(
            ContactKind.SLIP, time_ns, gone_m / gone_s, M_S, delay_s, PROBABILITY, Source.ODOMETRY, direction
        )


def noise_way_m(spread_m_s: float, elapsed_s: float) -> float:
    """Return the way, m, that white noise of readings so far apart goes once in FALSE_ALARM_S."""
    highest = math.sqrt(2.0 * math.log(FALSE_ALARM_S / elapsed_s))
    return elapsed_s * spread_m_s * max(0.0, highest - SLOW_SPREADS)
