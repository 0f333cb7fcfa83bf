"""One IMU sample, and the gate that decides which samples of a stream may be used."""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass
from typing import NamedTuple

from jammkle_common.constants import NANOSECONDS_PER_SECOND

REORDERING_LIMIT_S = 0.1
"""A stamp further back than this is a new time line, not a late sample (assumed: ten times the worst jitter seen)."""

LARGEST_FORCE_M_S2 = 4000.0
"""A reading beyond it is none, m/s^2: 400 g, the widest range of small accelerometers (H3LIS331DL)."""

LARGEST_RATE_RAD_S = 350.0
"""As above for the gyro, rad/s: 20,000 deg/s (ADXRS649). Readings in deg/s of a gyro of common range pass it often."""

_RATE_FORGETTING = 0.02


class ImuSample(NamedTuple):
    """One sample: when, specific force in m/s^2 and angular velocity in rad/s, both in the IMU's own frame.

    The time is whole nanoseconds of header.stamp, so that a shift of the clock changes no interval.
    """

    time_ns: int
    force_x: float
    force_y: float
    force_z: float
    rate_x: float
    rate_y: float
    rate_z: float


class Admission(enum.Enum):
    """What the gate says of a sample."""

    USABLE = "usable"
    """It follows the last one."""
    AFTER_GAP = "after a gap"
    """It may be used, but what came before is too old to compare it with. The first sample of all is one of these."""
    RESTARTED = "restarted"
    """Its stamp lies far behind the last one: the clock, or the simulation, was restarted."""
    HELD = "held"
    """Its stamp is new and its values are those of the last one, to the last bit: the source repeats a reading until
    the next comes. It tells the time and nothing else."""
    NOT_FINITE = "not finite"
    """It holds NaN or infinity; ignored."""
    OUT_OF_RANGE = "out of range"
    """It holds a value that no sensor gives; ignored."""
    REPEATED = "repeated"
    """Its stamp is that of the last sample; ignored."""
    LATE = "late"
    """Its stamp lies a little behind the last one (delivered out of order); ignored."""


BAD = frozenset({Admission.NOT_FINITE, Admission.OUT_OF_RANGE, Admission.REPEATED, Admission.LATE})
"""Samples that are not what a sensor in order sends."""

IGNORED = BAD | {Admission.HELD}
"""Samples that must not reach a detector."""


@dataclass(frozen=True)
class StreamCounts:
    """What has come in so far, in samples."""

    usable: int
    held: int
    not_finite: int
    out_of_range: int
    repeated: int
    late: int
    gaps: int
    restarts: int

    @property
    def ignored(self) -> int:
        """Samples that were not used."""
        return self.not_finite + self.out_of_range + self.repeated + self.late


class ImuGate:
    """Admits samples by their stamps and values, and counts what it saw."""

    def __init__(self, max_gap_s: float) -> None:
        """Make a gate that has seen nothing; `last_ns` is then the stamp of the last sample that told the time, ns.

        Args:
            max_gap_s: Longest interval between two samples that still counts as one stream, s.

        """
        self.max_gap_s = max_gap_s
        self.interval_s = 0.0
        self._mean_interval_s = self._mean_stamps_s = 0.0
        self.last_ns: int | None = None
        self._used_ns = 0
        self._last_values: tuple[float, ...] = ()
        self._counts = dict.fromkeys(Admission, 0)

    def admit(self, sample: ImuSample) -> Admission:
        """Judge the next sample; `interval_s` is then the time since the usable one before it, in s."""
        admission = self._judge(sample)
        self._counts[admission] += 1
        return admission

    def _judge(self, sample: ImuSample) -> Admission:
        # One NaN or infinity makes the sum NaN or infinite: one test instead of six.
        if not math.isfinite(sum(sample)):
            return Admission.NOT_FINITE
        if not _is_possible(sample):
            return Admission.OUT_OF_RANGE
        return self._judge_time(sample)

    def _judge_time(self, sample: ImuSample) -> Admission:
        time_ns = sample.time_ns
        if self.last_ns is None:
            return self._use(sample, Admission.AFTER_GAP)
        since_last_ns = time_ns - self.last_ns
        if since_last_ns <= 0:
            return self._judge_backward(sample, since_last_ns / NANOSECONDS_PER_SECOND)
        since_last_s = since_last_ns / NANOSECONDS_PER_SECOND
        if since_last_s <= self.max_gap_s:
            self._mean_stamps_s = _mean(self._mean_stamps_s, since_last_s)
        if sample[1:] == self._last_values:
            self.last_ns = time_ns
            return Admission.HELD
        self.interval_s = interval_s = (time_ns - self._used_ns) / NANOSECONDS_PER_SECOND
        if interval_s > self.max_gap_s:
            return self._use(sample, Admission.AFTER_GAP)
        self._mean_interval_s = _mean(self._mean_interval_s, interval_s)
        return self._use(sample, Admission.USABLE)

    def _use(self, sample: ImuSample, admission: Admission) -> Admission:
        self.last_ns = self._used_ns = sample.time_ns
        self._last_values = sample[1:]
        return admission

    def _judge_backward(self, sample: ImuSample, interval_s: float) -> Admission:
        if interval_s == 0.0:
            return Admission.REPEATED
        if interval_s >= -REORDERING_LIMIT_S:
            return Admission.LATE
        return self._use(sample, Admission.RESTARTED)

    def count(self, admission: Admission) -> int:
        """Samples of which the gate said this."""
        return self._counts[admission]

    @property
    def rate_hz(self) -> float:
        """Recent rate of usable samples, without held ones, by their stamps, Hz; 0 before there are two."""
        return 1.0 / self._mean_interval_s if self._mean_interval_s > 0.0 else 0.0

    @property
    def published_hz(self) -> float:
        """Recent rate of new stamps, held readings among them, Hz; 0 before there are two."""
        return 1.0 / self._mean_stamps_s if self._mean_stamps_s > 0.0 else 0.0

    @property
    def counts(self) -> StreamCounts:
        """What has come in so far."""
        counts = self._counts
        return StreamCounts(
            usable=counts[Admission.USABLE] + counts[Admission.AFTER_GAP] + counts[Admission.RESTARTED],
            held=counts[Admission.HELD],
            not_finite=counts[Admission.NOT_FINITE],
            out_of_range=counts[Admission.OUT_OF_RANGE],
            repeated=counts[Admission.REPEATED],
            late=counts[Admission.LATE],
            gaps=max(0, counts[Admission.AFTER_GAP] - 1),
            restarts=counts[Admission.RESTARTED],
        )


def _mean(before_s: float, interval_s: float) -> float:
    """Return the mean with one interval more; the first is the mean itself, or a rate would begin much too high."""
    return interval_s if before_s == 0.0 else before_s + (interval_s - before_s) * _RATE_FORGETTING


def _is_possible(sample: ImuSample) -> bool:
    """Whether there is a sensor that can read this."""
    _, x, y, z, p, q, r = sample
    return max(x, y, z, -x, -y, -z) <= LARGEST_FORCE_M_S2 and max(p, q, r, -p, -q, -r) <= LARGEST_RATE_RAD_S
