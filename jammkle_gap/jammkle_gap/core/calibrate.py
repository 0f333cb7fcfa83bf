"""Calibration: the machine's own constants, fitted to its references before any signature is trusted.

A maximum of the posterior by Gauss-Newton, constants with the priors of drawings and data sheets. What no constant
explains is the simulator's own error. It has a variance of its own in every signal and block of time, found as in
iteratively reweighted least squares, and hangs together over the block, so it counts once a block and not once a bin
(Kennedy and O'Hagan 2001, J. R. Stat. Soc. B 63:425, on why it must count; Green 1984, J. R. Stat. Soc. B 46:149).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from jammkle_gap.core.simulate import Task

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_gap.core.compare import Setting
    from jammkle_gap.core.constants import Constants
    from jammkle_gap.core.effects import Nuisance
    from jammkle_gap.core.features import Layout
    from jammkle_gap.core.scatter import Scatter
    from jammkle_gap.core.simulate import Problem, Runner

TURNS = 4
"""Times that a step and the variance of what it leaves follow from each other. Chosen: neither moves by more than a
tenth after it."""
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
    where it came to. Within scatter it ends: what would move then is noise.

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
    target = np.concatenate([setting.reference_features.mean(axis=0) for setting, _ in used])
    # The scatter of single runs, not of their mean: a machine need not be known better than a run tells.
    variance = np.concatenate([each.variance + np.square(each.columns).sum(axis=1) for _, each in used])
    blocks, bins_per_block = blocks_of([setting.layout for setting, _ in used], constants)

    def residuals(places: Sequence[NDArray[np.float64]], what: str) -> list[NDArray[np.float64]]:
        """Return what each place leaves of the references; what the simulator does not give is 0.

        Where it cannot be run at all, it leaves far too much.
        """
        tasks = [
            Task(setting.references[0], setting.layout, _values(problem.constants, place))
            for place in places
            for setting, _ in used
        ]
        made = iter(runner.features(tasks, what))
        left = [target - np.concatenate([next(made) for _ in used]) for _ in places]
        return [np.nan_to_num(each) if np.isfinite(each).any() else np.full(each.shape, np.inf) for each in left]

    count = len(problem.constants)
    place = np.zeros(count)
    (nominal,) = residuals([place], "")
    current = nominal
    covariance = np.eye(count)
    left = float((np.square(nominal) / variance).mean())
    if left <= 1.0:
        # Within healthy scatter the machine is as drawn: what would move is noise, which contact makes large again.
        return replace(uncalibrated(problem), before=left, after=left)
    jacobian = np.concatenate([slope for _, _, slope in referenced])
    for turn in range(constants.calibration_steps):
        if turn > 0:
            moved = [place + step for step in np.eye(count)]
            jacobian = np.array([current - each for each in residuals(moved, "calibrating")]).T
            jacobian[~np.isfinite(jacobian)] = 0.0
        step = np.zeros(count)
        total = variance
        for _ in range(TURNS):
            weighted = jacobian / total[:, np.newaxis]
            covariance = np.linalg.inv(jacobian.T @ weighted + np.eye(count))
            step = covariance @ (weighted.T @ current - place)
            total = variance + bins_per_block * beyond(current - jacobian @ step, variance, blocks)
        before = _objective(current, total, place)
        for _ in range(_HALVINGS):
            (made,) = residuals([place + step], "")
            if _objective(made, total, place + step) < before:
                place, current = place + step, made
                break
            step = step / 2.0
        else:
            break
        if float((np.square(current) / variance).mean()) <= 1.0:
            break
    after = float((np.square(current) / variance).mean())
    deviations = {each.name: float(x) for each, x in zip(problem.constants, place, strict=True)}
    return Calibration(_values(problem.constants, place), deviations, covariance, left, after)


def blocks_of(layouts: Sequence[Layout], constants: Constants) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Return the block of every feature, and how many features each block has, for every feature."""
    found, begin = [], 0
    for layout in layouts:
        block = np.arange(layout.bins) * constants.blocks // layout.bins
        table = begin + constants.blocks * np.arange(len(layout.signals))[:, np.newaxis] + block
        begin += constants.blocks * len(layout.signals)
        events = begin + np.arange(len(layout.event_s))
        begin += len(layout.event_s)
        found.append(np.concatenate([table.ravel(), events]))
    blocks = np.concatenate(found)
    return blocks, np.bincount(blocks)[blocks].astype(float)


def beyond(left: NDArray[np.float64], variance: NDArray[np.float64], blocks: NDArray[np.intp]) -> NDArray[np.float64]:
    """Return the variance of the simulator's own error: what is left beyond scatter, by block, for every feature."""
    counts = np.bincount(blocks)
    mean = np.bincount(blocks, np.square(left) - variance) / counts
    return np.maximum(mean, 0.0)[blocks]


def _objective(left: NDArray[np.float64], variance: NDArray[np.float64], place: NDArray[np.float64]) -> float:
    return float((np.square(left) / variance).sum()) + float(np.square(place).sum())


def _values(constants: Sequence[Nuisance], place: NDArray[np.float64]) -> dict[str, float]:
    """Return constants by name from deviations in their priors' standard deviations, within their bounds."""
    return {
        each.name: float(np.clip(each.null + x * each.sigma, each.minimum, each.maximum))
        for each, x in zip(constants, place.tolist(), strict=True)
        if x != 0.0
    }
