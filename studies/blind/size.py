"""How large an effect is to an ideal detector: one that knows its signature, and how this very machine scatters.

The true difference is that of twin runs, the same seed with and without the fault. Its gain is the squared length after
whitening by the covariance of a difference between faulty runs and references, taken from healthy runs of this machine.
What bouncing and slipping make of a small change differs from twin to twin: chance is no size, so the gain is the mean
product of different twins, in which chance cancels.
"""

from __future__ import annotations

import itertools
import math
from functools import lru_cache
from typing import TYPE_CHECKING, Final

import numpy as np
from scipy import stats  # type: ignore[import-untyped]  # carries no types

from jammkle_gap import (
    Constants,
    Recording,
    Repeats,
    Whitener,
    ankle_problem,
    features_of,
    fit_scatter,
    layout_of,
    measured,
)
from studies.blind.ceiling import DAY, built, recording_of_real, with_planned
from studies.blind.reality.faults import Era
from studies.blind.reality.machine import STILL
from studies.blind.reality.run import RIGS
from studies.blind.reality.sensors import Plan

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import NDArray

    from studies.blind.reality.sensors import Option, RealRun

FALSE_ALARMS, POWER = 0.01, 0.99
NEEDED: Final = float((stats.norm.isf(FALSE_ALARMS) + stats.norm.ppf(POWER)) ** 2)
"""Gain at which a difference of known direction is detected with POWER at FALSE_ALARMS."""
HEALTHY: Final = 12
"""Healthy runs per setting that the covariance is taken from. Chosen: eleven degrees of freedom."""
_TOLERANCE = 0.05
"""Relative error of a size that is aimed at. Assumed: sizes are a factor of two apart."""
_STEPS = 12
"""Most runs of a search."""
_NOTHING = 1e-9
"""Least size that a logarithm is taken of."""
_SMALLEST = 1e-4
"""Smallest share of a fault's range that is tried."""


class IdealDetector:
    """Knows how healthy runs of one machine scatter in one setting.

    The covariance is that of the diagnosis, with the reality's own causes of scatter as its columns: twelve runs are
    too few to show all directions in which days differ.
    """

    def __init__(self, healthy: Sequence[RealRun]) -> None:
        """Take the covariance."""
        runs = [recording_of_real(run, "healthy") for run in healthy]
        problem = ankle_problem()
        self._alignment = problem.alignment
        self._layout = layout_of(runs, problem.bin_s(runs[0]), self._alignment)
        features = np.array([self._features(run) for run in runs])
        deviations = features - features.mean(axis=0)
        plan = healthy[0].plan
        days = [self._features(recording_of_real(run, "day")) for run in _days(plan.rig, tuple(plan.options.items()))]
        columns = np.array([day - days[0] for day in days[1:]]).T
        (scatter,) = fit_scatter([Repeats(self._layout, deviations, len(runs) - 1, columns)], Constants())
        self._whiten = Whitener(scatter.variance, scatter.columns)
        self._deviations = self._whiten(deviations)

    def difference(self, healthy: RealRun, faulty: RealRun) -> NDArray[np.float64]:
        """Return the whitened difference of twins, in units of one run's scatter, shape (features,)."""
        one, other = (recording_of_real(run, "twin") for run in (healthy, faulty))
        return self._whiten(self._features(other) - self._features(one))

    def gain(self, twins: Sequence[NDArray[np.float64]]) -> float:
        """Return the squared length of what twins have in common, in the variance of healthy runs along it, or 1."""
        products = [one @ other for one, other in itertools.combinations(twins, 2)]
        common = np.mean(twins, axis=0)
        length = float(np.linalg.norm(common))
        if length == 0.0:
            return 0.0
        along = self._deviations @ (common / length)
        spread = float(along @ along) / (len(along) - 1)
        return max(float(np.mean(products)), 0.0) / max(spread, 1.0)

    def _features(self, run: Recording) -> NDArray[np.float64]:
        return np.nan_to_num(features_of(self._layout, run, measured(run), self._alignment))


@lru_cache(maxsize=16)
def _days(rig: str, options: tuple[tuple[str, Option], ...]) -> tuple[RealRun, ...]:
    """Return still runs of the machine as drawn: as planned, then with each cause of scatter off by one deviation."""

    def still(values: Mapping[str, float]) -> RealRun:
        planned = with_planned(rig, dict(options), values)
        return RIGS[rig](Plan(rig, planned), (Era(float("-inf"), built(values)),), STILL)

    return tuple(still(values) for values in ({}, *({each.name: each.sigma} for each in DAY)))


def detectable_size(gains: Sequence[float], runs: int, references: int) -> float:
    """Return a size: 1 is what an ideal detector needs, and a gain is its square."""
    return float(np.sqrt(sum(gains) / (1.0 / runs + 1.0 / references) / NEEDED))


def share_for(size_at: Callable[[float], float], wanted: float) -> tuple[float, float]:
    """Find the share of a fault's range at which it is as large as wanted."""
    size = size_at(1.0)
    if size <= wanted:
        return 1.0, size
    # The secant in logarithms, as most effects grow with some power of their size; halves where it leaves the bracket.
    low, high = math.log(_SMALLEST), 0.0
    aim, last = math.log(wanted), (0.0, _log(size))
    slope, share = 1.0, 1.0
    for _ in range(_STEPS):
        guess = last[0] + (aim - last[1]) / slope if slope > 0.0 else low
        place = guess if low < guess < high else (low + high) / 2.0
        share = math.exp(place)
        size = size_at(share)
        if abs(size - wanted) <= _TOLERANCE * wanted:
            break
        low, high = (low, place) if size > wanted else (place, high)
        before, last = last, (place, _log(size))
        slope = (last[1] - before[1]) / (last[0] - before[0])
    return share, size


def _log(size: float) -> float:
    return math.log(max(size, _NOTHING))
