"""What the simulator has wrong anyway: the machine's constants, and the model discrepancy that no constant explains.

Constants are fitted to references before any signature is trusted: a maximum of the posterior by Gauss-Newton, with the
priors of drawings and data sheets. What no constant explains is model discrepancy. It has a variance of its own in
every signal and block of time, found as in iteratively reweighted least squares, and is correlated over the block, so
it counts once a block and not once a bin (Kennedy and O'Hagan 2001, J. R. Stat. Soc. B 63:425, on why it must count;
Green 1984, J. R. Stat. Soc. B 46:149).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import cho_factor, cho_solve  # type: ignore[import-untyped]  # carries no types

from jammkle_gap.core.scatter import residuals_of, with_discrepancy
from jammkle_gap.core.simulate import Task, UnrunnableError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_gap.core.constants import Constants
    from jammkle_gap.core.effects import Nuisance
    from jammkle_gap.core.features import Layout
    from jammkle_gap.core.fit import Fit
    from jammkle_gap.core.scatter import Difference, Residuals, Scatter, Setting
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
            jacobian = references.slopes_at(place, current)
        step = np.zeros(count)
        total = variance
        for _ in range(TURNS):
            weighted = jacobian / total[:, np.newaxis]
            covariance = np.linalg.inv(jacobian.T @ weighted + np.eye(count))
            step = covariance @ (weighted.T @ current - place)
            total = variance + bins_per_block * beyond(current - jacobian @ step, variance, blocks)
        before = _objective(current, total, place)
        for _ in range(_HALVINGS):
            made = references.left(place + step)
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

    def slopes_at(self, place: NDArray[np.float64], left: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the slopes at a place that leaves so much, shape (n, constants); 0 where it cannot be run."""
        steps = np.eye(len(place))
        moving = [(k, i) for k, each in enumerate(self.slopes) for i in np.flatnonzero(each.any(axis=0)).tolist()]
        tasks = [self._task(self._settings[k], place + steps[i]) for k, i in moving]
        slopes = np.zeros((len(left), len(place)))
        for (k, i), made in zip(moving, self._runner.features(tasks, "calibrating"), strict=True):
            part = slice(int(self._starts[k]), int(self._starts[k + 1]))
            if np.isfinite(made).any():
                slopes[part, i] = left[part] - np.nan_to_num(self._target[part] - made)
        return slopes

    def _task(self, setting: Setting, place: NDArray[np.float64]) -> Task:
        return Task(setting.references[0], setting.layout, _values(self._problem.constants, place))


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


def _signals_of(layouts: Sequence[Layout]) -> NDArray[np.intp]:
    """Return the number of the signal or event of every feature, the same in all settings."""
    numbers: dict[str, int] = {}
    found = []
    for layout in layouts:
        found += [np.full(layout.bins, numbers.setdefault(name, len(numbers))) for name in layout.signals]
        found.append(np.array([numbers.setdefault(name, len(numbers)) for name in layout.event_s], dtype=np.intp))
    return np.concatenate(found)


def _ranges(settings: Sequence[Setting]) -> NDArray[np.float64]:
    """Return for every feature how far its signal goes, at most in one setting; 0 for an event."""
    spans: dict[str, float] = {}
    for setting in settings:
        table = setting.layout.by_signal(setting.faulty_features.mean(axis=0))
        for name, row in zip(setting.layout.signals, table, strict=True):
            spans[name] = max(spans.get(name, 0.0), float(np.ptp(row)))
    found = []
    for layout in (setting.layout for setting in settings):
        found += [np.repeat([spans[name] for name in layout.signals], layout.bins), np.zeros(len(layout.event_s))]
    return np.concatenate(found)


def beyond(left: NDArray[np.float64], variance: NDArray[np.float64], blocks: NDArray[np.intp]) -> NDArray[np.float64]:
    """Return the variance of model discrepancy: what is left beyond scatter, by block, for every feature."""
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


class Discrepancy:
    """What the settings without references leave, split into scatter, constants, and model discrepancy."""

    def __init__(
        self,
        settings: Sequence[Setting],
        residuals: Sequence[Residuals],
        difference: Difference,
        constants: Constants,
    ) -> None:
        """Take the settings without references, of which there is at least one.

        Args:
            settings: Runs.
            residuals: Of each setting.
            difference: With the covariance of scatter and constants.
            constants: Blocks, and what is known of the error beforehand.

        """
        self._residuals, self._difference = tuple(residuals), difference
        self._used = [k for k, setting in enumerate(settings) if not setting.references]
        self._blocks, self._per_block = blocks_of([settings[k].layout for k in self._used], constants)
        self._signals = _signals_of([settings[k].layout for k in self._used])
        self._raw = np.concatenate([residuals[k].difference for k in self._used])
        used = [difference.settings[k] for k in self._used]
        self._factor = np.concatenate([np.full(each.size, each.factor) for each in used])
        self._ends = np.cumsum([each.size for each in used])[:-1]
        smooth, self._columns = [], []
        for each in used:
            named, known = len(each.scatter.amplitudes), each.scatter.columns.shape[1]
            smooth.append(np.square(each.columns[:, named:known]).sum(axis=1))
            self._columns.append(np.delete(each.columns, slice(named, known), axis=1))
        self._shared = np.vstack([each.shared for each in used])
        local = self._factor * np.concatenate([each.scatter.variance for each in used])
        # Smooth scatter lasts for a block as this error does, and so counts once a block too.
        self._healthy = local + np.concatenate(smooth)
        self._base = local + self._per_block * np.concatenate(smooth)
        self._expected = np.bincount(self._blocks, self._healthy / self._base)
        self._range = _ranges([settings[k] for k in self._used])
        self._scale, self._unknown = constants.discrepancy_of_block, constants.unknown_share
        self._pair_penalty, self._of_gap = constants.pair_penalty, constants.discrepancy_of_gap
        self._freedom = min(constants.discrepancy_freedom, float(len(self._expected)))
        # Over settings the error repeats itself, but no more than it hangs together altogether.
        self._share = max(1.0 / len(self._used), self._freedom / len(self._expected))

    def difference_with(self, fit: Fit) -> Difference:
        """Return the difference whitened by scatter and the error that a candidate leaves, block by block."""
        total, _, _ = self._split(self._left(fit), fit.scores)
        return self._whitened(total)

    def evenly_with(self, fit: Fit) -> Difference:
        """Return the difference whitened by scatter and the error that a candidate leaves of each signal on the whole.

        Where a fit has far to go no block is trusted because it happens to agree already (graduated non-convexity;
        Blake and Zisserman 1987, Visual Reconstruction).
        """
        left = self._left(fit)
        rest = left - self._shared @ fit.scores if len(fit.scores) else left
        return self._whitened(self._base + self._per_block * beyond(rest, self._healthy, self._signals))

    def accurate_to(self, accuracy: float) -> tuple[Difference, Difference]:
        """Return the difference whitened by scatter and an error of the simulator as large as its stated accuracy.

        Args:
            accuracy: Share of each signal's range; 0: scatter alone.

        Returns:
            With an error that is another one in every bin, and with one that lasts for a block and resembles an effect.

        """
        error = np.square(accuracy * self._range)
        return self._whitened(self._base + error), self._whitened(self._base + self._per_block * error)

    def _whitened(self, total: NDArray[np.float64]) -> Difference:
        settings = self._difference.settings
        own = [np.zeros(each.size) for each in settings]
        parts = np.split((total - self._base) / self._factor, self._ends)
        for k, part in zip(self._used, parts, strict=True):
            own[k] = part
        return with_discrepancy(self._difference, self._residuals, own)

    def left_per_feature(self, fit: Fit) -> float:
        """Return what a candidate leaves per feature beyond scatter and constants, in the variance of scatter."""
        _, rest, _ = self._split(self._left(fit), fit.scores)
        return float((np.square(rest) / self._base).mean())

    def scores(self, nothing: Fit, fits: Sequence[Fit], effects: int) -> list[float]:
        """Return the log-likelihood of none of them, and of each candidate beside its own error, with their priors.

        That of a t distribution for every signal and block with one degree of freedom, which all settings share since
        the simulator's error repeats itself over them, and the prior of the scores of scatter and constants. The
        best must stand up to none of them by all blocks together as well, as in the posterior, so that many small
        blocks explained do not make up for large ones left alone. The error of a simulator resembles one effect or
        another by chance, the more of them there are: none of them is as likely beforehand as all single effects
        together, and each of these as all pairs that it is in (Scott and Berger 2010, Ann. Stat. 38:2587).

        Args:
            nothing: None of the effects: the constants alone.
            fits: Candidates.
            effects: How many the library has.

        Returns:
            Relative to the simulator's error alone; none of them first, which is that, or a cause unknown to the
            library.

        """
        rests = [self._weighed(fit) for fit in (nothing, *fits)]
        left, priors = np.array([each for each, _ in rests]), np.array([prior for _, prior in rests])
        # As in the posterior, what the best leaves is the noise of all where it is less than expected.
        noise = np.minimum(np.min(left, axis=0), self._expected)
        gap = float((left[0] - noise).sum())
        likelihoods = self._likelihood(left - noise, gap) - self._likelihood(left[0] - noise, gap)
        # Of what a second effect costs, the posterior takes the rest.
        odds, second = np.log(effects), max(np.log(effects) - self._pair_penalty, 0.0)
        chances = np.array([0.0, *(odds + second * (len(fit.names) - 1) for fit in fits)])
        scores = likelihoods[:, 0] - 0.5 * (priors - priors[0]) - chances
        if fits:
            # Of what the best explains, a cause unknown to the library leaves a share.
            best = 1 + int(np.argmax(scores[1:]))
            unknown = left[0] + (1.0 - self._unknown) * np.minimum(left[best] - left[0], 0.0)
            gained = self._likelihood(unknown - noise, gap) - self._likelihood(left[0] - noise, gap)
            none = np.logaddexp(0.0, gained) - np.log(2.0)
            scores[0] = max(none[0], likelihoods[best, 0] + none[1] - likelihoods[best, 1])
        return [float(each) for each in scores]

    def _weighed(self, fit: Fit) -> tuple[NDArray[np.float64], float]:
        """Return what is left of each block beyond scatter and constants, and the square of their scores."""
        _, rest, prior = self._split(self._left(fit), fit.scores)
        return np.bincount(self._blocks, np.square(rest) / self._base).astype(float), prior

    def _likelihood(self, left: NDArray[np.float64], gap: float) -> NDArray[np.float64]:
        """Return log-likelihoods of what is left beyond noise: block by block, and of all together, shape (..., 2).

        Args:
            left: Of each block, shape (..., blocks).
            gap: What is left where nothing is explained, of all together: the larger it is, the more the true effect
                leaves, as in the posterior.

        """
        blocks = self._share * np.log1p(left / (self._scale * self._expected)).sum(axis=-1)
        scale = self._scale * self._expected.sum() + self._of_gap * gap
        together = self._freedom * np.log1p(left.sum(axis=-1) / scale)
        return -0.5 * np.stack([blocks, together], axis=-1)

    def _left(self, fit: Fit) -> NDArray[np.float64]:
        left: NDArray[np.float64] = self._raw - np.concatenate([fit.features[k] for k in self._used])
        return left

    def _split(
        self, left: NDArray[np.float64], constants: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
        """Return the variance of every feature, what scatter and constants leave of it, and their scores' square.

        Variance and scores follow from each other, and start at their priors' mean: what could be explained at any
        price stays the simulator's error.

        Args:
            left: What a candidate leaves, the constants being linear.
            constants: Their scores as they were fitted; empty: they are found here, as far as they are linear.

        """
        fitted = len(constants) > 0
        rest, prior = (left - self._shared @ constants if fitted else left), float(constants @ constants)
        columns = np.zeros((len(left), 0)) if fitted else self._shared
        alone, total = rest, self._base
        for _ in range(TURNS):
            total = self._base + self._per_block * beyond(rest, self._healthy, self._blocks)
            rest, own = self._solved(alone, total, columns)
        return total, rest, prior + own

    def _solved(
        self, left: NDArray[np.float64], total: NDArray[np.float64], shared: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], float]:
        """Return what scatter and shared columns leave, and the square of their scores: setting by setting first."""
        matrix, right = np.eye(shared.shape[1]), np.zeros(shared.shape[1])
        solved = []
        pieces = [np.split(each, self._ends) for each in (left, total, shared)]
        for columns, part, variance, along in zip(self._columns, *pieces, strict=True):
            own, over = columns.T / variance, along.T / variance
            factor = cho_factor(np.eye(columns.shape[1]) + own @ columns)
            by_itself, with_it = cho_solve(factor, own @ part), cho_solve(factor, own @ along)
            matrix += over @ along - (over @ columns) @ with_it
            right += over @ part - (over @ columns) @ by_itself
            solved.append((by_itself, with_it))
        common = np.linalg.solve(matrix, right)
        scores = [by_itself - with_it @ common for by_itself, with_it in solved]
        scatter = np.concatenate([columns @ each for columns, each in zip(self._columns, scores, strict=True)])
        prior = float(common @ common) + sum(float(each @ each) for each in scores)
        return left - scatter - shared @ common, prior
