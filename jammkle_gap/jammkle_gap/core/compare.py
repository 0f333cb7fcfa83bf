"""Runs compared with the simulator: settings, residuals, and the whitened difference that is to be explained.

Of every setting the mean residual of the faulty runs less that of the references, so that what the simulator has wrong
anyway cancels to first order. Its covariance is (1 / faulty + 1 / references) times that of one run. A setting without
references keeps the machine's own constants as further columns, the same in all settings.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from jammkle_gap.core.features import features_of, layout_of, measured
from jammkle_gap.core.scatter import Repeats, Whitener, fit_scatter
from jammkle_gap.core.simulate import Task, UnrunnableError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_gap.core.constants import Constants
    from jammkle_gap.core.data import Recording
    from jammkle_gap.core.features import Layout
    from jammkle_gap.core.scatter import Scatter
    from jammkle_gap.core.simulate import Problem, Runner


@dataclass(frozen=True)
class Setting:
    """Runs that were made to do the same."""

    name: str
    layout: Layout
    faulty: tuple[Recording, ...]
    references: tuple[Recording, ...]
    faulty_features: NDArray[np.float64] = field(repr=False)
    """Measured, shape (runs, n)."""
    reference_features: NDArray[np.float64] = field(repr=False)
    readings: tuple[Mapping[str, NDArray[np.float64]], ...] = field(default=(), repr=False)
    """What healthy sensors would have read in the first faulty run, by signal, at its times; see `readings`."""
    reading_features: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 0)), repr=False)
    """The features of these, shape (readings, n)."""

    @property
    def freedom(self) -> int:
        """Degrees of freedom of its repeats."""
        return max(len(self.faulty) - 1, 0) + max(len(self.references) - 1, 0)

    @property
    def factor(self) -> float:
        """Variance of its difference, in that of one run."""
        return 1.0 / len(self.faulty) + (1.0 / len(self.references) if self.references else 0.0)


def settings_of(
    recordings: Sequence[Recording], references: Sequence[Recording], problem: Problem
) -> tuple[Setting, ...]:
    """Group runs by their setting; those that name none are by themselves.

    Raises:
        BadRecordingError: runs of a setting do not overlap, or have no signal in common.

    """
    groups: dict[str, tuple[list[Recording], list[Recording]]] = {}
    for i, each in enumerate(recordings):
        groups.setdefault(each.setting or f"run {i + 1}", ([], []))[0].append(each)
    for each in references:
        if each.setting in groups:
            groups[each.setting][1].append(each)
    found = []
    for name, (faulty, healthy) in groups.items():
        layout = layout_of([*faulty, *healthy], problem.bin_s(faulty[0]), problem.registrar)
        first, second = (
            np.array([features_of(layout, each, measured(each), problem.registrar) for each in runs]).reshape(
                -1, layout.size
            )
            for runs in (faulty, healthy)
        )
        found.append(Setting(name, layout, tuple(faulty), tuple(healthy), first, second))
    return tuple(found)


@dataclass(frozen=True)
class Residuals:
    """What was measured less what a simulator says, in the features of one setting."""

    faulty: NDArray[np.float64]
    """Shape (runs, n); features that the simulator does not give are 0."""
    references: NDArray[np.float64]
    simulated: NDArray[np.float64]
    """Mean of the faulty runs' simulations, shape (n,)."""

    @property
    def difference(self) -> NDArray[np.float64]:
        """What is to be explained, shape (n,)."""
        difference: NDArray[np.float64] = self.faulty.mean(axis=0)
        if len(self.references):
            difference = difference - self.references.mean(axis=0)
        return difference

    @property
    def deviations(self) -> NDArray[np.float64]:
        """Runs less the mean of their group, shape (runs, n)."""
        groups = [each - each.mean(axis=0) for each in (self.faulty, self.references) if len(each)]
        return np.concatenate(groups)


def residuals_of(settings: Sequence[Setting], runner: Runner, values: Mapping[str, float]) -> list[Residuals]:
    """Simulate every run at its own inputs.

    Args:
        settings: Runs.
        runner: Makes the runs.
        values: Constants of the machine, by name; those not named are nominal.

    Raises:
        UnrunnableError: it gives nothing to compare with.

    """
    tasks = [
        Task(recording, setting.layout, values)
        for setting in settings
        for recording in (*setting.faulty, *setting.references)
    ]
    simulated = iter(runner.features(tasks, "nominal"))
    found = []
    for setting in settings:
        tables = []
        for runs, features in (
            (setting.faulty, setting.faulty_features),
            (setting.references, setting.reference_features),
        ):
            made = np.array([next(simulated) for _ in runs]).reshape(-1, setting.layout.size)
            for run, row in zip(runs, made, strict=True):
                if not np.isfinite(setting.layout.by_signal(row)).any():
                    msg = f"without any effect the simulator cannot run recording '{run.name}', or gives none of its "
                    msg += f"signals ({', '.join(setting.layout.signals)})"
                    raise UnrunnableError(msg)
            tables.append((np.nan_to_num(features - made), made))
        found.append(Residuals(tables[0][0], tables[1][0], tables[0][1].mean(axis=0)))
    return found


@dataclass(frozen=True)
class Difference:
    """The whitened difference of all settings, one after the other, and what whitens it."""

    whitened: NDArray[np.float64]
    """Shape (n of all settings,)."""
    whiteners: tuple[Whitener, ...]
    """One per setting; one for all where they share columns."""
    factors: tuple[float, ...]
    sizes: tuple[int, ...]
    """Features of each setting."""
    deviations: tuple[NDArray[np.float64], ...]
    """Whitened deviations of single runs, shape (runs, features of the setting), per setting."""
    freedom: tuple[int, ...]
    """Degrees of freedom of the deviations."""
    scatter: tuple[Scatter, ...]
    columns: tuple[NDArray[np.float64], ...]
    """Of the covariance of the difference, shape (features, columns), per setting."""
    shared: tuple[NDArray[np.float64], ...]
    """The same columns in all settings: constants of the machine."""

    def whiten(self, parts: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
        """Return whitened features.

        Args:
            parts: Per setting, shape (..., features).

        Returns:
            Shape (..., features of all settings).

        """
        scaled = [part / np.sqrt(factor) for part, factor in zip(parts, self.factors, strict=True)]
        if len(self.whiteners) == len(scaled):
            each = [whitener(part) for whitener, part in zip(self.whiteners, scaled, strict=True)]
            return np.concatenate(each, axis=-1)
        return self.whiteners[0](np.concatenate(scaled, axis=-1))

    @property
    def healthy(self) -> float:
        """What healthy runs leave per feature: 1 if the covariance is right, less where data sheets are cautious."""
        freedom = sum(self.freedom)
        if freedom == 0:
            return 1.0
        total = sum(float(np.square(each).sum()) / each.shape[1] for each in self.deviations if each.size)
        return float(total / freedom)


def difference_of(
    settings: Sequence[Setting],
    residuals: Sequence[Residuals],
    nuisances: Sequence[NDArray[np.float64]],
    contact: Sequence[NDArray[np.float64]],
    shared: Sequence[NDArray[np.float64]],
    constants: Constants,
) -> Difference:
    """Fit the scatter and whiten the difference by it.

    Args:
        settings: Runs.
        residuals: Of each setting.
        nuisances: Differences for one standard deviation each, shape (n, nuisances), per setting.
        contact: Further columns of scatter, shape (n, columns), per setting.
        shared: Columns of the machine's constants, shape (n, constants), per setting, 0 where there are references.
        constants: Of the model.

    """
    repeats = [
        Repeats(setting.layout, each.deviations, setting.freedom, columns)
        for setting, each, columns in zip(settings, residuals, nuisances, strict=True)
    ]
    scatter = fit_scatter(repeats, constants)
    columns = [np.hstack([each.columns, more]) for each, more in zip(scatter, contact, strict=True)]
    single = [Whitener(each.variance, own) for each, own in zip(scatter, columns, strict=True)]
    factors = tuple(setting.factor for setting in settings)
    difference = Difference(
        np.zeros(0),
        tuple(single),
        factors,
        tuple(setting.layout.size for setting in settings),
        tuple(whitener(each.deviations) for whitener, each in zip(single, residuals, strict=True)),
        tuple(setting.freedom for setting in settings),
        tuple(scatter),
        tuple(each * np.sqrt(factor) for each, factor in zip(columns, factors, strict=True)),
        tuple(shared),
    )
    return beside(difference, residuals, [np.zeros(size) for size in difference.sizes])


def beside(difference: Difference, residuals: Sequence[Residuals], own: Sequence[NDArray[np.float64]]) -> Difference:
    """Return the difference whitened by its scatter together with the simulator's own error.

    Args:
        difference: With its scatter.
        residuals: Of each setting.
        own: Variance of the simulator's own error in each feature of one run, per setting.

    """
    variances = [each.variance + more for each, more in zip(difference.scatter, own, strict=True)]
    columns = [each / np.sqrt(factor) for each, factor in zip(difference.columns, difference.factors, strict=True)]
    whiteners = tuple(Whitener(variance, each) for variance, each in zip(variances, columns, strict=True))
    if any(np.abs(each).max(initial=0.0) > 0.0 for each in difference.shared):
        whiteners = (_stacked(variances, columns, difference.shared, difference.factors),)
    found = replace(difference, whiteners=whiteners)
    return replace(found, whitened=found.whiten([each.difference for each in residuals]))


def _stacked(
    variances: Sequence[NDArray[np.float64]],
    columns: Sequence[NDArray[np.float64]],
    shared: Sequence[NDArray[np.float64]],
    factors: Sequence[float],
) -> Whitener:
    """Return the whitener of all settings at once, in units of each setting's own factor."""
    total = sum(map(len, variances))
    width = sum(each.shape[1] for each in columns)
    table = np.zeros((total, width + shared[0].shape[1]))
    row = column = 0
    for own, more, factor in zip(columns, shared, factors, strict=True):
        table[row : row + len(own), column : column + own.shape[1]] = own
        table[row : row + len(own), width:] = more / np.sqrt(factor)
        row, column = row + len(own), column + own.shape[1]
    return Whitener(np.concatenate(variances), table)
