"""One IMU sample, and the gate that decides which samples of a stream may be used."""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass
from typing import NamedTuple

from jammkle_graph.constants import NANOSECONDS_PER_SECOND

REORDERING_LIMIT_S = 0.1
"""A stamp further back than this is a new time line, not a late sample (assumed: ten times the worst jitter seen)."""

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
    NOT_FINITE = "not finite"
    """It holds NaN or infinity; ignored."""
    REPEATED = "repeated"
    """Its stamp is that of the last sample; ignored."""
    LATE = "late"
    """Its stamp lies a little behind the last one (delivered out of order); ignored."""


IGNORED = frozenset({Admission.NOT_FINITE, Admission.REPEATED, Admission.LATE})
"""Samples that must not reach a detector."""


@dataclass(frozen=True)
class StreamCounts:
    """What has come in so far, in samples."""

    usable: int
    not_finite: int
    repeated: int
    late: int
    gaps: int
    restarts: int

    @property
    def ignored(self) -> int:
        """Samples that were not used."""
        return self.not_finite + self.repeated + self.late


class ImuGate:
    """Admits samples by their stamps and values, and counts what it saw."""

    def __init__(self, max_gap_s: float) -> None:
        """Make a gate that has seen nothing; `last_ns` is then the stamp of the last usable sample, ns.

        Args:
            max_gap_s: Longest interval between two samples that still counts as one stream, s.

        """
        self.max_gap_s = max_gap_s
        self.interval_s = 0.0
        self._mean_interval_s = 0.0
        self.last_ns: int | None = None
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
        if self.last_ns is None:
            self.last_ns = sample.time_ns
            return Admission.AFTER_GAP
        interval_s = (sample.time_ns - self.last_ns) / NANOSECONDS_PER_SECOND
        if interval_s <= 0.0:
            return self._judge_backward(sample.time_ns, interval_s)
        self.last_ns = sample.time_ns
        self.interval_s = interval_s
        if interval_s > self.max_gap_s:
            return Admission.AFTER_GAP
        self._mean_interval_s += (interval_s - self._mean_interval_s) * _RATE_FORGETTING
        return Admission.USABLE

    def _judge_backward(self, time_ns: int, interval_s: float) -> Admission:
        if interval_s == 0.0:
            return Admission.REPEATED
        if interval_s >= -REORDERING_LIMIT_S:
            return Admission.LATE
        self.last_ns = time_ns
        return Admission.RESTARTED

    @property
    def rate_hz(self) -> float:
        """Recent rate of usable samples by their stamps, Hz; 0 before there are two."""
        return 1.0 / self._mean_interval_s if self._mean_interval_s > 0.0 else 0.0

    @property
    def counts(self) -> StreamCounts:
        """What has come in so far."""
        counts = self._counts
        return StreamCounts(
            usable=counts[Admission.USABLE] + counts[Admission.AFTER_GAP] + counts[Admission.RESTARTED],
            not_finite=counts[Admission.NOT_FINITE],
            repeated=counts[Admission.REPEATED],
            late=counts[Admission.LATE],
            gaps=max(0, counts[Admission.AFTER_GAP] - 1),
            restarts=counts[Admission.RESTARTED],
        )
