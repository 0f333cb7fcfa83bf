"""Calibration: the machine's own constants, fitted to its references before any signature is trusted.

A maximum of the posterior by Gauss-Newton: references whitened by their scatter, constants with the priors of drawings
and data sheets. What no constant explains is the simulator's own error and hangs together over blocks of time, so it
counts once a block and not once a bin (Kennedy and O'Hagan 2001, J. R. Stat. Soc. B 63:425, for why it must count).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from jammkle_gap.core.scatter import Whitener
from jammkle_gap.core.simulate import Task

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_gap.core.compare import Setting
    from jammkle_gap.core.constants import Constants
    from jammkle_gap.core.effects import Nuisance
    from jammkle_gap.core.scatter import Scatter
    from jammkle_gap.core.simulate import Problem, Runner

_TURNS = 4
"""Times that step and inflation follow from each other. Chosen: neither moves by more than a tenth after it."""
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
    problem: Problem,
    runner: Runner,
    constants: Constants,
) -> Calibration:
    """Fit the constants to the references of all settings.

    Args:
        settings: Those with references are used.
        scatter: Of one run of each setting.
        problem: Simulator and constants.
        runner: Makes the runs.
        constants: Of the model.

    """
    used = [(setting, each) for setting, each in zip(settings, scatter, strict=True) if setting.references]
    if not used or not problem.constants:
        return uncalibrated(problem)
    whiteners = [Whitener(each.variance, each.columns) for _, each in used]

    def residuals(places: Sequence[NDArray[np.float64]], what: str) -> list[NDArray[np.float64]]:
        """Return what each place leaves of the references, whitened; what the simulator does not give is 0."""
        tasks = [
            Task(setting.references[0], setting.layout, _values(problem.constants, place))
            for place in places
            for setting, _ in used
        ]
        made = iter(runner.features(tasks, what))
        found = []
        for _ in places:
            parts = [
                np.sqrt(len(setting.references))
                * whiten(np.nan_to_num(setting.reference_features.mean(axis=0) - next(made)))
                for (setting, _), whiten in zip(used, whiteners, strict=True)
            ]
            found.append(np.concatenate(parts))
        return found

    count = len(problem.constants)
    place = np.zeros(count)
    (nominal,) = residuals([place], "")
    current = nominal
    size = nominal.size
    blocks = sum(constants.blocks * len(setting.layout.signals) for setting, _ in used)
    covariance = np.eye(count)
    for _ in range(constants.calibration_steps):
        moved = [place + step for step in np.eye(count)]
        jacobian = np.array([current - each for each in residuals(moved, "calibrating")]).T
        step, covariance, inflation = _step(jacobian, current, place, blocks)
        objective = _objective(current, place, inflation)
        for _ in range(_HALVINGS):
            (made,) = residuals([place + step], "")
            if _objective(made, place + step, inflation) < objective:
                place, current = place + step, made
                break
            step = step / 2.0
        else:
            break
    before, after = (float(np.square(each).sum()) / size for each in (nominal, current))
    deviations = {each.name: float(x) for each, x in zip(problem.constants, place, strict=True)}
    return Calibration(_values(problem.constants, place), deviations, covariance, before, after)


def _step(
    jacobian: NDArray[np.float64], current: NDArray[np.float64], place: NDArray[np.float64], blocks: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Return a Gauss-Newton step, the posterior's covariance, and what the residuals' variance is inflated by.

    What the linear fit leaves beyond scatter is the simulator's own error. Its size and the step follow from each
    other, so they are found in turn.
    """
    size, count = jacobian.shape
    inflation = 1.0
    for _ in range(_TURNS):
        covariance = np.linalg.inv(jacobian.T @ jacobian / inflation + np.eye(count))
        step = covariance @ (jacobian.T @ current / inflation - place)
        left = float(np.square(current - jacobian @ step).sum()) / size
        inflation = 1.0 + max(left - 1.0, 0.0) * size / blocks
    return step, covariance, inflation


def _objective(left: NDArray[np.float64], place: NDArray[np.float64], inflation: float) -> float:
    return float(np.square(left).sum()) / inflation + float(np.square(place).sum())


def _values(constants: Sequence[Nuisance], place: NDArray[np.float64]) -> dict[str, float]:
    """Return constants by name from deviations in their priors' standard deviations, within their bounds."""
    return {
        each.name: float(np.clip(each.null + x * each.sigma, each.minimum, each.maximum))
        for each, x in zip(constants, place.tolist(), strict=True)
        if x != 0.0
    }
