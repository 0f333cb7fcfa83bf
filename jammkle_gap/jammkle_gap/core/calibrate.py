"""The machine's constants as its references show them, before any signature is trusted.

A maximum of the posterior by Gauss-Newton, with the priors of drawings and data sheets, beside model discrepancy.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from jammkle_gap.core.discrepancy import TURNS, blocks_of
from jammkle_gap.core.scatter import residuals_of
from jammkle_gap.core.simulate import Task, UnrunnableError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_gap.core.constants import Constants
    from jammkle_gap.core.effects import Nuisance
    from jammkle_gap.core.scatter import Residuals, Scatter, Setting
    from jammkle_gap.core.simulate import Problem, Runner

_HALVINGS = 3
"""Times that a step which makes things worse is halved."""


@dataclass(frozen=True)
class Calibration:
    """The machine as its references show it."""

    values: Mapping[str, float]
    """Constants by name, those that moved; empty: nominal."""
    deviations: Mapping[str, float]
    """Of every constant from nominal, in standard deviations of its prior."""
    covariance: NDArray[np.float64]
    """Of the constants, in their priors' standard deviations, shape (constants, constants)."""
    before: float
    """What the nominal simulator leaves of the references per feature, in their scatter's variance."""
    after: float
    """What the calibrated one leaves."""


def uncalibrated(problem: Problem) -> Calibration:
    """Return the nominal machine with the priors of its constants."""
    count = len(problem.constants)
    return Calibration({}, {each.name: 0.0 for each in problem.constants}, np.eye(count), np.nan, np.nan)


def calibrate(
    settings: Sequence[Setting],
    scatter: Sequence[Scatter],
    slopes: Sequence[NDArray[np.float64]],
    problem: Problem,
    runner: Runner,
    constants: Constants,
) -> Calibration:
    """Fit the constants to the references of all settings.

    The first step takes the slopes of the nominal machine, which the dictionary has, and those that follow the slopes
    where it came to; a constant that moves nothing at all in a setting is not simulated there again. Within scatter it
    ends: what would move then is noise.

    Args:
        settings: Those with references are used.
        scatter: Of one run of each setting.
        slopes: Differences of the nominal machine for one standard deviation of each constant, shape (n, constants),
            per setting.
        problem: Simulator and constants.
        runner: Makes the runs.
        constants: Of the model.

    """
    every = zip(settings, scatter, slopes, strict=True)
    referenced = [(setting, own, slope) for setting, own, slope in every if setting.references]
    used = [(setting, own) for setting, own, _ in referenced]
    if not used or not problem.constants:
        return uncalibrated(problem)
    # The scatter of single runs, not of their mean: a machine need not be known better than a run tells.
    variance = np.concatenate([each.variance + np.square(each.columns).sum(axis=1) for _, each in used])
    blocks, bins_per_block = blocks_of([setting.layout for setting, _ in used], constants)
    references = _References([setting for setting, _ in used], [slope for _, _, slope in referenced], problem, runner)
    count = len(problem.constants)
    place = np.zeros(count)
    bounds = [((each.minimum - each.null) / each.sigma, (each.maximum - each.null) / each.sigma)
              for each in problem.constants]  # fmt: skip
    lowest, highest = np.array(bounds).T
    nominal = references.left(place)
    current = nominal
    covariance = np.eye(count)
    left = float((np.square(nominal) / variance).mean())
    if left <= 1.0:
        # Within healthy scatter the machine is as drawn: what would move is noise, which contact makes large again.
        return replace(uncalibrated(problem), before=left, after=left)
    jacobian = np.concatenate(references.slopes)
    for turn in range(constants.calibration_steps):
        if turn > 0:
            jacobian = references.slopes_at(place)
        step = np.zeros(count)
        total = variance
        for _ in range(TURNS):
            weighted = jacobian / total[:, np.newaxis]
            covariance = np.linalg.inv(jacobian.T @ weighted + np.eye(count))
            step = covariance @ (weighted.T @ current - place)
            total = variance + bins_per_block * _beyond(current - jacobian @ step, variance, blocks)
        before = _objective(current, total, place)
        for _ in range(_HALVINGS):
            tried = np.clip(place + step, lowest, highest)
            made = references.left(tried)
            if _objective(made, total, tried) < before:
                place, current = tried, made
                break
            step = step / 2.0
        else:
            break
        if float((np.square(current) / variance).mean()) <= 1.0:
            break
    after = float((np.square(current) / variance).mean())
    deviations = {each.name: float(x) for each, x in zip(problem.constants, place, strict=True)}
    return Calibration(_values(problem.constants, place), deviations, covariance, left, after)


def _beyond(left: NDArray[np.float64], variance: NDArray[np.float64], blocks: NDArray[np.intp]) -> NDArray[np.float64]:
    """Return the variance of model discrepancy: what is left beyond scatter, by block, for every feature."""
    counts = np.bincount(blocks)
    mean = np.bincount(blocks, np.square(left) - variance) / counts
    return np.maximum(mean, 0.0)[blocks]


def runnable(
    calibration: Calibration,
    settings: Sequence[Setting],
    nominal: Sequence[Residuals],
    problem: Problem,
    runner: Runner,
) -> tuple[Calibration, Sequence[Residuals]]:
    """Return a calibration and the residuals of all runs with it; the nominal ones where one cannot be run with it.

    It was fitted to one reference of each setting. At the inputs of another run its simulation may blow up.
    """
    if not calibration.values:
        return calibration, nominal
    try:
        return calibration, residuals_of(settings, runner, calibration.values)
    except UnrunnableError:
        return replace(uncalibrated(problem), before=calibration.before, after=calibration.before), nominal


class _References:
    """The references of all settings, and what constants leave of their means."""

    def __init__(
        self,
        settings: Sequence[Setting],
        slopes: Sequence[NDArray[np.float64]],
        problem: Problem,
        runner: Runner,
    ) -> None:
        self.slopes = slopes
        self._settings, self._problem, self._runner = settings, problem, runner
        self._target = np.concatenate([setting.reference_features.mean(axis=0) for setting in settings])
        self._starts = np.cumsum([0, *(setting.layout.size for setting in settings)])

    def left(self, place: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return what a place leaves; what the simulator does not give is 0.

        Where it cannot be run at all, it leaves far too much.
        """
        made = self._runner.features([self._task(setting, place) for setting in self._settings])
        left = self._target - np.concatenate(made)
        return np.nan_to_num(left) if np.isfinite(left).any() else np.full(left.shape, np.inf)

    def slopes_at(self, place: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the slopes at a place as `Problem.coarse` runs it, shape (n, constants); 0 where it cannot be run."""
        constants = self._problem.constants
        here_by = [_value(each, x) for each, x in zip(constants, place.tolist(), strict=True)]
        signs = [each.step_from(value) for each, value in zip(constants, here_by, strict=True)]
        steps = np.diag(signs)
        moving = [(k, i) for k, each in enumerate(self.slopes) for i in np.flatnonzero(each.any(axis=0)).tolist()]
        here = [self._coarse(setting, place) for setting in self._settings]
        tasks = here + [self._coarse(self._settings[k], place + steps[i]) for k, i in moving]
        made = self._runner.features(tasks, "calibrating")
        slopes = np.zeros((len(self._target), len(place)))
        for (k, i), moved in zip(moving, made[len(here) :], strict=True):
            change = moved - made[k]
            step = (_value(constants[i], float(place[i]) + signs[i]) - here_by[i]) / constants[i].sigma
            if np.isfinite(change).any() and step != 0.0:
                slopes[int(self._starts[k]) : int(self._starts[k + 1]), i] = np.nan_to_num(change) / step
        return slopes

    def _coarse(self, setting: Setting, place: NDArray[np.float64]) -> Task:
        task = self._task(setting, place)
        return replace(task, recording=self._problem.coarse(task.recording))

    def _task(self, setting: Setting, place: NDArray[np.float64]) -> Task:
        return Task(setting.references[0], setting.layout, _values(self._problem.constants, place))


def _objective(left: NDArray[np.float64], variance: NDArray[np.float64], place: NDArray[np.float64]) -> float:
    return float((np.square(left) / variance).sum()) + float(np.square(place).sum())


def _values(constants: Sequence[Nuisance], place: NDArray[np.float64]) -> dict[str, float]:
    """Return constants by name from deviations in their priors' standard deviations, within their bounds."""
    return {each.name: _value(each, x) for each, x in zip(constants, place.tolist(), strict=True) if x != 0.0}


def _value(constant: Nuisance, deviations: float) -> float:
    return float(np.clip(constant.null + deviations * constant.sigma, constant.minimum, constant.maximum))
