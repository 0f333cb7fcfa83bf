"""How runs of one machine scatter, and the whitened difference that is to be explained.

Of every setting the mean residual of the faulty runs less that of the references, so that what the simulator has wrong
anyway cancels to first order. Its covariance is (1 / faulty + 1 / references) times that of one run. A setting without
references keeps the machine's own constants as further columns, the same in all settings.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from jammkle_gap.core.data import BadRecordingError
from jammkle_gap.core.features import features_of, layout_of, measured, refuse_unknown_noise
from jammkle_gap.core.simulate import Task, UnrunnableError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_gap.core.constants import Constants
    from jammkle_gap.core.data import Recording
    from jammkle_gap.core.features import Layout
    from jammkle_gap.core.simulate import Problem, Runner


@dataclass(frozen=True)
class Repeats:
    """What repeats of one setting scatter by."""

    layout: Layout
    deviations: NDArray[np.float64]
    """Residuals of runs less the mean of their group (references, or faulty runs), shape (runs, n)."""
    freedom: int
    """Degrees of freedom of the deviations: runs less groups."""
    columns: NDArray[np.float64]
    """Difference that each nuisance makes for one standard deviation of its prior, shape (n, nuisances)."""


@dataclass(frozen=True)
class Scatter:
    """Covariance of one healthy run: diagonal and columns."""

    variance: NDArray[np.float64]
    """D, shape (n,)."""
    columns: NDArray[np.float64]
    """U, shape (n, columns)."""
    amplitudes: NDArray[np.float64]
    """Standard deviation of each nuisance in units of its prior's, shape (nuisances,)."""


def fit_scatter(settings: Sequence[Repeats], constants: Constants) -> list[Scatter]:
    """Fit the covariance of one run of each setting.

    Amplitudes of nuisances are those of the machine and its rig: the same in all settings.

    Args:
        settings: Repeats of each; one without repeats has its prior.
        constants: Prior degrees of freedom, blocks, iterations.

    Returns:
        One per setting.

    """
    count = settings[0].columns.shape[1]
    amplitude2 = np.ones(count)
    variances = [np.square(each.layout.floor) for each in settings]
    rests = [np.zeros(each.layout.size) for each in settings]
    total = sum(each.freedom for each in settings)
    for _ in range(constants.scatter_iterations):
        gathered = np.zeros(count)
        for k, each in enumerate(settings):
            if each.freedom == 0:
                continue
            second, rests[k] = _expected(each, variances[k], amplitude2)
            gathered += second
            variances[k] = _moderated_variance(each.layout, rests[k], each.freedom, constants)
        prior = constants.nuisance_prior_freedom
        amplitude2 = (prior + gathered) / (prior + total)
    found = []
    for each, variance in zip(settings, variances, strict=True):
        blocks = _blocks(each, variance, amplitude2, constants)
        scaled = each.columns * np.sqrt(amplitude2)
        found.append(Scatter(variance, np.hstack([scaled, blocks]), np.sqrt(amplitude2)))
    return found


def _expected(
    repeats: Repeats, variance: NDArray[np.float64], amplitude2: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return expected sums of squares: of every nuisance, in its prior's variance, and of what is left per feature."""
    columns, scores, posterior = _scores(repeats, variance, amplitude2)
    second = amplitude2 * (np.square(scores).sum(axis=0) + repeats.freedom * np.diag(posterior))
    spread = np.einsum("ij,jk,ik->i", columns, posterior, columns, optimize=True)
    rest = np.square(repeats.deviations - scores @ columns.T).sum(axis=0) + repeats.freedom * spread
    return second, rest


def _scores(
    repeats: Repeats, variance: NDArray[np.float64], amplitude2: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return scaled columns, and the posterior mean, shape (runs, nuisances), and covariance of their scores."""
    columns = repeats.columns * np.sqrt(amplitude2)
    whitened = columns / np.sqrt(variance)[:, np.newaxis]
    posterior = np.linalg.inv(np.eye(columns.shape[1]) + whitened.T @ whitened)
    scores = (repeats.deviations / np.sqrt(variance)) @ whitened @ posterior
    return columns, scores, posterior


def _moderated_variance(
    layout: Layout, rest: NDArray[np.float64], freedom: int, constants: Constants
) -> NDArray[np.float64]:
    """Return the variance of each feature from sums of squares: local in time, moderated by that of its signal."""
    variance = np.empty(layout.size)
    table = layout.by_signal(rest) / freedom
    half = max(int(np.ceil((constants.local_freedom / freedom - 1.0) / 2.0)), 0)
    window = np.ones(2 * half + 1) / (2 * half + 1)
    local_freedom = freedom * len(window)
    out = layout.by_signal(variance)
    for i, row in enumerate(table):
        local = np.convolve(np.pad(row, half, mode="edge"), window, mode="valid")
        prior = constants.local_prior_freedom
        out[i] = (prior * row.mean() + local_freedom * local) / (prior + local_freedom)
    events = slice(len(layout.signals) * layout.bins, layout.size)
    prior = constants.variance_prior_freedom
    variance[events] = (prior * np.square(layout.floor[events]) + rest[events]) / (prior + freedom)
    return np.maximum(variance, np.square(layout.floor))


def _blocks(
    repeats: Repeats, variance: NDArray[np.float64], amplitude2: NDArray[np.float64], constants: Constants
) -> NDArray[np.float64]:
    """Return a column per signal and block of time: what repeats still differ by over many bins, shape (n, blocks)."""
    layout = repeats.layout
    count = min(constants.blocks, layout.bins)
    block = np.arange(layout.bins) * count // layout.bins
    per_block = np.bincount(block, minlength=count)
    columns, scores, _ = _scores(repeats, variance, amplitude2)
    left = repeats.deviations - scores @ columns.T
    table = layout.by_signal(left)
    expected = layout.by_signal(variance)
    floor = layout.by_signal(layout.floor)
    found = []
    for i in range(len(layout.signals)):
        means = np.array([[run[block == b].mean() for b in range(count)] for run in table[:, i]]).reshape(-1, count)
        white = np.array([expected[i][block == b].mean() for b in range(count)]) / per_block
        own = np.square(means).sum(axis=0) / max(repeats.freedom, 1)
        # Without repeats a block may be off by as much as one sample: drift within the sensor's own noise.
        pooled = own.mean() if repeats.freedom else float(np.square(floor[i]).mean())
        prior = constants.variance_prior_freedom
        moderated = (prior * pooled + repeats.freedom * own) / (prior + repeats.freedom)
        amplitude = np.sqrt(np.maximum(moderated - white, constants.block_share * white))
        for b in range(count):
            column = np.zeros(layout.size)
            layout.by_signal(column)[i, block == b] = amplitude[b]
            found.append(column)
    stacked: NDArray[np.float64] = np.array(found).T
    return stacked


class Whitener:
    """Applies the symmetric (D + U U')^(-1/2), by the eigenvectors of the small matrix U' D^-1 U (Woodbury)."""

    def __init__(self, variance: NDArray[np.float64], columns: NDArray[np.float64]) -> None:
        """Prepare.

        Args:
            variance: D, shape (n,), above 0.
            columns: U, shape (n, m); m may be 0.

        """
        self._scale = 1.0 / np.sqrt(variance)
        whitened = columns * self._scale[:, np.newaxis]
        values, vectors = np.linalg.eigh(whitened.T @ whitened)
        kept = values > 1e-9 * max(float(values.max(initial=0.0)), 1.0)  # rounding
        self._basis = (whitened @ vectors[:, kept]) / np.sqrt(values[kept])
        self._shrink = 1.0 - 1.0 / np.sqrt(1.0 + values[kept])

    def __call__(self, features: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return whitened features, shape (..., n)."""
        scaled = features * self._scale
        whitened: NDArray[np.float64] = scaled - ((scaled @ self._basis) * self._shrink) @ self._basis.T
        return whitened


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
        BadRecordingError: runs of a setting do not overlap, or have no signal in common; the noise of one is unknown.

    """
    groups: dict[str, tuple[list[Recording], list[Recording]]] = {}
    given = {each.setting for each in recordings}
    for i, each in enumerate(recordings):
        alone = next(name for k in itertools.count(i + 1) if (name := f"run {k}") not in {*given, *groups})
        groups.setdefault(each.setting or alone, ([], []))[0].append(each)
    for each in references:
        if each.setting in groups:
            groups[each.setting][1].append(each)
    found = []
    for name, (faulty, healthy) in groups.items():
        refuse_unknown_noise([*faulty, *healthy])
        layout = layout_of([*faulty, *healthy], problem.bin_s(faulty[0]), problem.alignment)
        first, second = (
            np.array([features_of(layout, each, measured(each), problem.alignment) for each in runs]).reshape(
                -1, layout.size
            )
            for runs in (faulty, healthy)
        )
        found.append(Setting(name, layout, tuple(faulty), tuple(healthy), first, second))
    return tuple(found)


def refuse_copies(settings: Sequence[Setting]) -> None:
    """Refuse runs of a setting that are the same samples under two names: they would scatter by nothing.

    Raises:
        BadRecordingError: as said, with the names.

    """
    for setting in settings:
        known: dict[bytes, str] = {}
        rows = np.concatenate([setting.faulty_features, setting.reference_features])
        for run, row in zip((*setting.faulty, *setting.references), rows, strict=True):
            other = known.setdefault(row.tobytes(), run.name)
            if other != run.name:
                msg = f"{run.name} is a copy of {other}: repeats show how much a machine scatters, and a copy shows "
                msg += "nothing; leave it out, or give a run of its own"
                raise BadRecordingError(msg)


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
                    msg = f"without any effect the simulator cannot run recording '{run.name}' to a finite end, or "
                    msg += f"gives none of its signals ({', '.join(setting.layout.signals)})"
                    raise UnrunnableError(msg)
            tables.append((np.nan_to_num(features - made), made))
        found.append(Residuals(tables[0][0], tables[1][0], tables[0][1].mean(axis=0)))
    return found


@dataclass(frozen=True)
class SettingScatter:
    """How runs of one setting scatter, and so their difference."""

    factor: float
    """Variance of the difference, in that of one run."""
    freedom: int
    """Degrees of freedom of the deviations."""
    deviations: NDArray[np.float64]
    """Whitened, of single runs from the mean of their group, shape (runs, features)."""
    scatter: Scatter
    columns: NDArray[np.float64]
    """Of the covariance of one run, those of `scatter` first, shape (features, columns)."""
    shared: NDArray[np.float64]
    """Constants of the machine as columns, the same in all settings, shape (features, constants)."""

    @property
    def size(self) -> int:
        """Features of the setting."""
        return len(self.columns)

    @property
    def variance(self) -> NDArray[np.float64]:
        """Of each feature of the difference by the scatter of runs, shape (features,)."""
        scatter = self.scatter
        variance: NDArray[np.float64] = self.factor * (scatter.variance + np.square(scatter.columns).sum(axis=1))
        return variance


@dataclass(frozen=True)
class Difference:
    """The whitened difference of all settings, one after the other, and what whitens it.

    Its covariance is that of scatter, setting by setting, and S S' of the machine's constants, the same in all. It is
    whitened by the first, then by I plus what the second has become: cost grows as the recordings do.
    """

    whitened: NDArray[np.float64]
    """Shape (n of all settings,)."""
    whiteners: tuple[Whitener, ...]
    """By scatter, one per setting."""
    settings: tuple[SettingScatter, ...]
    shared: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 0)), repr=False)
    """S, whitened by scatter, shape (n of all settings, constants)."""

    def whiten(self, parts: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
        """Return features whitened by scatter and the priors of the machine's constants.

        Args:
            parts: Per setting, shape (..., features).

        Returns:
            Shape (..., features of all settings).

        """
        values = self.by_scatter(parts)
        return values if self._over_constants is None else self._over_constants(values)

    def by_scatter(self, parts: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
        """Return features whitened by scatter alone, the constants being as given; shapes as in `whiten`."""
        scaled = [part / np.sqrt(own.factor) for part, own in zip(parts, self.settings, strict=True)]
        each = [whitener(part) for whitener, part in zip(self.whiteners, scaled, strict=True)]
        return np.concatenate(each, axis=-1)

    @cached_property
    def _over_constants(self) -> Whitener | None:
        return Whitener(np.ones(len(self.shared)), self.shared) if self.shared.any() else None

    def split(self, values: NDArray[np.float64]) -> list[NDArray[np.float64]]:
        """Return the rows of each setting of a vector or table of all features."""
        return np.split(values, np.cumsum([each.size for each in self.settings])[:-1])

    @property
    def healthy(self) -> float:
        """What healthy runs leave per feature: 1 if the covariance is right, less where data sheets are cautious."""
        freedom = sum(each.freedom for each in self.settings)
        if freedom == 0:
            return 1.0
        total = sum(float(np.square(each.deviations).sum()) / each.size for each in self.settings)
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
    found = []
    for setting, each, own, more, constant in zip(settings, residuals, scatter, contact, shared, strict=True):
        columns = np.hstack([own.columns, more])
        deviations = Whitener(own.variance, columns)(each.deviations)
        found.append(SettingScatter(setting.factor, setting.freedom, deviations, own, columns, constant))
    return whitened_difference(found, [each.difference for each in residuals])


def whitened_difference(
    settings: Sequence[SettingScatter],
    raw: Sequence[NDArray[np.float64]],
    own: Sequence[NDArray[np.float64]] = (),
    lasting: Sequence[NDArray[np.float64]] = (),
) -> Difference:
    """Return a difference whitened by its scatter together with model discrepancy.

    Args:
        settings: Their scatter.
        raw: The difference, per setting.
        own: Variance of model discrepancy in each feature of one run, per setting; empty: none.
        lasting: Columns of model discrepancy that features share, per setting, shape (features, columns); empty: none.

    """
    whiteners, shared = [], []
    for k, each in enumerate(settings):
        variance = each.scatter.variance + own[k] if own else each.scatter.variance
        columns = np.hstack([each.columns, lasting[k] / np.sqrt(each.factor)]) if lasting else each.columns
        whiteners.append(Whitener(variance, columns))
        shared.append(whiteners[k]((each.shared / np.sqrt(each.factor)).T).T)
    found = Difference(np.zeros(0), tuple(whiteners), tuple(settings), np.concatenate(shared))
    return replace(found, whitened=found.whiten(raw))
