"""Sampling: noise with and without memory, lag, converter steps, and when samples are taken, stamped and written."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy import signal as filters  # type: ignore[import-untyped]  # carries no types

from studies.blind.reality.machine import stream

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from studies.blind.reality.faults import Era
    from studies.blind.reality.instruments import Sensor


@dataclass(frozen=True)
class Truth:
    """What really happens, on even steps."""

    time_s: NDArray[np.float64]
    """Shape (n,), rising."""
    values: NDArray[np.float64]
    """Shape (n, columns)."""


def coloured(draw: np.random.Generator, sensor: Sensor, period_s: float, count: int) -> NDArray[np.float64]:
    """Return noise, shape (count,): a part with memory and one without."""
    keeps = math.exp(-period_s / sensor.memory_s)
    kicks = draw.standard_normal(count) * sensor.slow * math.sqrt(1.0 - keeps**2)
    kicks[:1] *= 1.0 / math.sqrt(1.0 - keeps**2)
    slow: NDArray[np.float64] = filters.lfilter([1.0], [1.0, -keeps], kicks)
    return slow + sensor.white * draw.standard_normal(count)


def lagged(values: NDArray[np.float64], lag_s: float, step_s: float) -> NDArray[np.float64]:
    """Return values, along the first axis, after a first-order lag that had settled before."""
    if lag_s <= 0.0:
        return values
    keeps = math.exp(-step_s / lag_s)
    start = np.atleast_1d(keeps * values[0])[None, ...] if values.ndim > 1 else np.atleast_1d(keeps * values[0])
    found: NDArray[np.float64]
    found, _ = filters.lfilter([1.0 - keeps], [1.0, -keeps], values, axis=0, zi=start)
    return found


def digitised(values: NDArray[np.float64], sensor: Sensor) -> NDArray[np.float64]:
    """Return values within the range of a sensor, rounded to the steps of its converter."""
    found: NDArray[np.float64] = np.round(np.clip(values, -sensor.limit, sensor.limit) / sensor.step) * sensor.step
    return found


@dataclass(frozen=True)
class Moments:
    """When the samples of one stream were taken, stamped and written, those lost left out."""

    kept: NDArray[np.bool_]
    """Of all samples, shape (count,)."""
    taken_s: NDArray[np.float64]
    """By the recorder's clock, shape (count,)."""
    stamp_s: NDArray[np.float64]
    """Shape (kept,)."""
    log_s: NDArray[np.float64]
    """Shape (kept,)."""


def moments(periods: Sequence[Era], seed: int, name: str, rate_hz: float, duration_s: float) -> Moments:
    """Return the moments of a stream over a run.

    Args:
        periods: The machine over time.
        seed: Of the run.
        name: Of the stream; streams jitter independently.
        rate_hz: Samples per second; the first is taken one period after the start.
        duration_s: Of the run.

    """
    draw = stream(seed, f"moments of {name}")
    count = round(duration_s * rate_hz)
    clock = periods[0].machine.sensors.clock
    even_s = np.arange(1, count + 1, dtype=np.float64) / rate_hz
    taken_s = even_s + np.clip(clock.sample_jitter_s * draw.standard_normal(count), -0.3 / rate_hz, 0.3 / rate_hz)
    stamp_jitter_s = clock.stamp_jitter_s * draw.standard_normal(count)
    late_s = clock.log_s + clock.log_jitter_s * draw.exponential(size=count)
    lost = draw.random(count) < clock.dropped
    lost[0] = False
    stamp_s = np.maximum.accumulate(np.maximum(skewed_s(periods, taken_s) + stamp_jitter_s, 0.0))
    log_s = np.maximum.accumulate(taken_s + late_s)
    log_s += 1e-9 * np.arange(count)
    return Moments(~lost, taken_s, stamp_s[~lost], log_s[~lost])


def skewed_s(periods: Sequence[Era], time_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return what the sensors' clock shows at times of the recorder's."""
    found: NDArray[np.float64] = time_s.copy()
    before = 0.0
    for period in periods:
        skew = period.machine.sensors.clock.skew
        found += (skew - before) * np.maximum(time_s - max(period.start_s, 0.0), 0.0)
        before = skew
    return found
