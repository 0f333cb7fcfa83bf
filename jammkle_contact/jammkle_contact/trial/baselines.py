"""Simpler ways to feel contact, on the same samples: a threshold on the magnitude, and a cumulative sum.

ruptures and statsmodels find changes in a whole recording; a cumulative sum that is asked at every sample stands here.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from jammkle_graph.constants import NANOSECONDS_PER_SECOND, STANDARD_GRAVITY_M_S2

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from jammkle_controller.core.imu import ImuSample

REFRACTORY_S = 0.15
"""As of the detectors: after an alarm no other for so long, s."""
_SPREAD_TIME_S = 1.0

THRESHOLDS_M_S2 = (2.0, 4.0, 8.0, 12.0, 20.0, 30.0, 40.0)
LIMITS = (5.0, 10.0, 20.0, 40.0, 80.0, 160.0, 320.0, 640.0, 1280.0)
"""Settings that are tried on the tuning part; the best by the harmonic mean of recall and precision is taken."""


def magnitude(samples: Sequence[ImuSample], threshold_m_s2: float) -> list[float]:
    """Return when | |f| - g | exceeds a threshold, s."""
    told: list[float] = []
    for sample in samples:
        force = math.hypot(sample.force_x, sample.force_y, sample.force_z)
        if abs(force - STANDARD_GRAVITY_M_S2) > threshold_m_s2:
            _tell(told, sample)
    return told


def cusum(samples: Sequence[ImuSample], limit: float) -> list[float]:
    """Return when a cumulative sum of the normalised deviation exceeds a limit, s (Page, Biometrika 41, 1954).

    S <- max(0, S + (d / s)^2 - 2), with d the deviation of |f| from its mean of 20 ms and s its spread over a second:
    a mean square of one is drift, of more is change.
    """
    told: list[float] = []
    mean, spread, total, before = STANDARD_GRAVITY_M_S2, 1.0, 0.0, None
    for sample in samples:
        force = math.hypot(sample.force_x, sample.force_y, sample.force_z)
        elapsed_s = 0.0 if before is None else max(0.0, (sample.time_ns - before) / NANOSECONDS_PER_SECOND)
        before = sample.time_ns
        deviation = force - mean
        mean += deviation * elapsed_s / (elapsed_s + 0.02)
        total = max(0.0, total + deviation * deviation / (spread + 1e-4) - 2.0)
        spread += (min(deviation * deviation, 9.0 * spread + 0.01) - spread) * elapsed_s / (elapsed_s + _SPREAD_TIME_S)
        if total > limit:
            total = 0.0
            _tell(told, sample)
    return told


def always(samples: Sequence[ImuSample], period_s: float) -> list[float]:
    """Return a time every `period_s`, s."""
    told: list[float] = []
    for sample in samples:
        time_s = sample.time_ns / NANOSECONDS_PER_SECOND
        if not told or time_s - told[-1] >= period_s:
            told.append(time_s)
    return told


def _tell(told: list[float], sample: ImuSample) -> None:
    time_s = sample.time_ns / NANOSECONDS_PER_SECOND
    if not told or time_s - told[-1] >= REFRACTORY_S:
        told.append(time_s)


WAYS: dict[str, tuple[Callable[[Sequence[ImuSample], float], list[float]], tuple[float, ...]]] = {
    "magnitude": (magnitude, THRESHOLDS_M_S2),
    "cumulative sum": (cusum, LIMITS),
    "always": (always, (0.1,)),
}
"""By name: the way, and the settings to choose from. Never has a recall of 0."""
