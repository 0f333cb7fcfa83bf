"""How large an effect is to an ideal detector: one that knows its signature, and how this very machine scatters.

The true difference is that of twin runs, the same seed with and without the fault. Its gain is the squared length after
whitening by the covariance of a difference between faulty runs and references, taken from healthy runs of this machine.
What bouncing and slipping make of a small change differs from twin to twin: chance is no size, so the gain is the mean
product of different twins, in which chance cancels.
"""

from __future__ import annotations

import itertools
import re
from functools import lru_cache
from typing import TYPE_CHECKING, Final

import numpy as np
from scipy import stats  # type: ignore[import-untyped]  # carries no types

from jammkle_gap.ankle.alignment import AnkleAlignment
from jammkle_gap.ankle.inputs import AnkleInputs
from jammkle_gap.ankle.problem import bin_s
from jammkle_gap.ankle.sensors import RESOLUTION, UNITS, SensorSet, quantity_of, set_of
from jammkle_gap.core.constants import Constants
from jammkle_gap.core.data import Recording, Signal
from jammkle_gap.core.features import features_of, layout_of, measured
from jammkle_gap.core.scatter import Repeats, Whitener, fit_scatter
from jammkle_sim.rigs.replay import CommandTrack, Timeline
from studies.blind.ceiling_machine import DAY, built, with_planned
from studies.blind.reality.faults import Era
from studies.blind.reality.machine import STILL
from studies.blind.reality.record import Plan
from studies.blind.reality.run import RIGS
from studies.blind.sizes import is_command

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from studies.blind.reality.record import Option, RealRun

FALSE_ALARMS, POWER = 0.01, 0.99
NEEDED: Final = float((stats.norm.isf(FALSE_ALARMS) + stats.norm.ppf(POWER)) ** 2)
"""Gain at which a difference of known direction is detected with POWER at FALSE_ALARMS."""
HEALTHY: Final = 12
"""Healthy runs per setting that the covariance is taken from. Chosen: eleven degrees of freedom."""
_COLUMNS: Final = (
    (re.compile(r"linear_acceleration_([xyz])_m_s2"), r"imu/specific_force_\1"),
    (re.compile(r"angular_velocity_([xyz])_rad_s"), r"imu/angular_velocity_\1"),
    (re.compile(r"force_z_n"), "load_cell/force_z"),
    (re.compile(r"(\w+)\.position"), r"\1/position"),
)
"""Columns of a run, and the signals that they are."""


def recording_of_real(run: RealRun, setting: str) -> Recording:
    """Return what a rig's sensors recorded of a run: good for features, but it cannot be simulated again."""
    signals = tuple(each for each in signals_of(run) if set_of(each.name) is not SensorSet.INSTRUMENTED)
    nothing = CommandTrack(Timeline(np.zeros(1), np.zeros(1)), {})
    return Recording(run.plan.rig, signals, AnkleInputs(run.plan.rig, (), nothing), setting=setting)


def signals_of(run: RealRun) -> list[Signal]:
    """Return what all sensors recorded of a run."""
    signals = []
    for topic, track in run.topics.items():
        if is_command(topic):
            continue
        rising = np.concatenate([[True], np.diff(np.maximum.accumulate(track.stamp_s)) > 0.0])
        for i, column in enumerate(track.columns):
            name = _signal(topic, column)
            if name:
                quantity = quantity_of(name)
                values = np.asarray(track.values[rising, i], dtype=float)
                step = RESOLUTION.get(quantity, 0.0)
                signals.append(Signal(name, UNITS[quantity], track.stamp_s[rising], values, resolution=step))
    return signals


def _signal(topic: str, column: str) -> str:
    if column == "fluid_pressure_pa":
        return topic
    for pattern, template in _COLUMNS:
        match = pattern.fullmatch(column)
        if match is not None:
            return match.expand(template)
    return ""


class IdealDetector:
    """Knows how healthy runs of one machine scatter in one setting.

    The covariance is that of the diagnosis, with the reality's own causes of scatter as its columns: twelve runs are
    too few to show all directions in which days differ.
    """

    def __init__(self, healthy: Sequence[RealRun]) -> None:
        """Take the covariance.

        Args:
            healthy: Runs of one setting, six or more.

        """
        runs = [recording_of_real(run, "healthy") for run in healthy]
        self._registrar = AnkleAlignment()
        self._layout = layout_of(runs, bin_s(runs[0]), self._registrar)
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
        """Return the squared length of what twins have in common, in the variance of healthy runs along it, 1 at least.

        Args:
            twins: Whitened differences, two or more.

        """
        products = [one @ other for one, other in itertools.combinations(twins, 2)]
        common = np.mean(twins, axis=0)
        length = float(np.linalg.norm(common))
        if length == 0.0:
            return 0.0
        along = self._deviations @ (common / length)
        spread = float(along @ along) / (len(along) - 1)
        return max(float(np.mean(products)), 0.0) / max(spread, 1.0)

    def _features(self, run: Recording) -> NDArray[np.float64]:
        return np.nan_to_num(features_of(self._layout, run, measured(run), self._registrar))


@lru_cache(maxsize=16)
def _days(rig: str, options: tuple[tuple[str, Option], ...]) -> tuple[RealRun, ...]:
    """Return still runs of the machine as drawn: as told, then with each cause of scatter off by one deviation."""

    def still(values: Mapping[str, float]) -> RealRun:
        told = with_planned(rig, dict(options), values)
        return RIGS[rig](Plan(rig, told), (Era(float("-inf"), built(values)),), STILL)

    return tuple(still(values) for values in ({}, *({each.name: each.sigma} for each in DAY)))


def detectable_size(gains: Sequence[float], runs: int, references: int) -> float:
    """Return a size: 1 is what an ideal detector needs, and a gain is its square.

    Args:
        gains: Of one run, of every setting.
        runs: To be diagnosed, per setting.
        references: Per setting.

    """
    return float(np.sqrt(sum(gains) / (1.0 / runs + 1.0 / references) / NEEDED))
