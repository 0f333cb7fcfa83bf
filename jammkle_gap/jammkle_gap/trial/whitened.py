"""How large an effect is to an ideal detector: one that knows its signature, and how this very machine scatters.

The true difference is that of twin runs, the same seed with and without the fault. Its gain is the squared length after
whitening by the covariance of a difference between faulty runs and references, taken from healthy runs of this machine.
What bouncing and slipping make of a small change differs from twin to twin: chance is no size, so the gain is the mean
product of different twins, in which chance cancels.
"""

from __future__ import annotations

import itertools
import re
from typing import TYPE_CHECKING, Final

import numpy as np
from scipy import stats  # type: ignore[import-untyped]  # carries no types

from jammkle_gap.ankle.inputs import AnkleInputs
from jammkle_gap.ankle.instruments import RESOLUTION, UNITS, quantity_of
from jammkle_gap.ankle.problem import bin_s
from jammkle_gap.ankle.registrar import AnkleRegistrar
from jammkle_gap.ankle.sensor_sets import SensorSet, set_of
from jammkle_gap.core.constants import Constants
from jammkle_gap.core.data import Recording, Signal
from jammkle_gap.core.features import features_of, layout_of, measured
from jammkle_gap.core.scatter import Repeats, Whitener, fit_scatter
from jammkle_gap.trial.sizes import is_command
from jammkle_sim.rigs.replay import CommandTrack
from jammkle_sim.rigs.timeline import Timeline

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from jammkle_reality.record import RealRun

FALSE_ALARMS, POWER = 0.01, 0.99
NEEDED: Final = float((stats.norm.isf(FALSE_ALARMS) + stats.norm.ppf(POWER)) ** 2)
"""Gain at which a difference of known direction is detected with POWER at FALSE_ALARMS."""
HEALTHY: Final = 12
"""Healthy runs per setting that the covariance is taken from. Chosen: eleven degrees of freedom."""
_LEADING: Final = 4
"""Directions of scatter that are taken as they are; the rest is local in time and signal. Chosen: a third of them."""

_COLUMNS: Final = (
    (re.compile(r"linear_acceleration_([xyz])_m_s2"), r"imu/specific_force_\1"),
    (re.compile(r"angular_velocity_([xyz])_rad_s"), r"imu/angular_velocity_\1"),
    (re.compile(r"force_z_n"), "load_cell/force_z"),
    (re.compile(r"(\w+)\.position"), r"\1/position"),
)
"""Columns of a run, and the signals that they are."""


def recording_of_real(run: RealRun, setting: str) -> Recording:
    """Return what a rig's sensors recorded of a run: features can be taken of it, but it cannot be simulated again."""
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
    """Knows how healthy runs of one machine scatter in one setting."""

    def __init__(self, healthy: Sequence[RealRun]) -> None:
        """Take the covariance.

        Args:
            healthy: Runs of one setting, six or more.

        """
        runs = [recording_of_real(run, "healthy") for run in healthy]
        self._registrar = AnkleRegistrar()
        self._layout = layout_of(runs, bin_s(runs[0]), self._registrar)
        features = np.array([self._features(run) for run in runs])
        deviations = features - features.mean(axis=0)
        freedom = len(runs) - 1
        nothing = np.zeros((self._layout.size, 0))
        (first,) = fit_scatter([Repeats(self._layout, deviations, freedom, nothing)], Constants())
        unit = np.sqrt(first.variance)
        _, values, rows = np.linalg.svd(deviations / unit, full_matrices=False)
        leading = rows[:_LEADING] * unit
        rest = deviations - (deviations / unit) @ rows[:_LEADING].T @ leading
        (scatter,) = fit_scatter([Repeats(self._layout, rest, freedom - _LEADING, nothing)], Constants())
        columns = leading.T * values[:_LEADING] / np.sqrt(freedom)
        self._whiten = Whitener(scatter.variance, np.hstack([columns, scatter.columns]))

    def difference(self, healthy: RealRun, faulty: RealRun) -> NDArray[np.float64]:
        """Return the whitened difference of twins, in units of one run's scatter, shape (features,)."""
        one, other = (recording_of_real(run, "twin") for run in (healthy, faulty))
        return self._whiten(self._features(other) - self._features(one))

    def _features(self, run: Recording) -> NDArray[np.float64]:
        return np.nan_to_num(features_of(self._layout, run, measured(run), self._registrar))


def gain_of(differences: Sequence[Sequence[NDArray[np.float64]]], runs: int, references: int) -> float:
    """Return the gain of the true effect in a comparison of so many runs with so many references per setting.

    Args:
        differences: Whitened, of each setting's twins, two or more.
        runs: To be diagnosed, per setting.
        references: Per setting.

    """
    total = 0.0
    for twins in differences:
        total += float(np.mean([one @ other for one, other in itertools.combinations(twins, 2)]))
    return max(total, 0.0) / (1.0 / runs + 1.0 / references)


def detectable_size(gain: float) -> float:
    """Return a size: 1 is what an ideal detector needs, and a gain is its square."""
    return float(np.sqrt(gain / NEEDED))
