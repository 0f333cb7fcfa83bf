"""Model discrepancy: what the simulator has wrong that no constant of the machine explains, and how candidates compare.

It has a variance of its own in every signal and block of time, found as in iteratively reweighted least squares, and
is correlated over the block, so it counts once a block and not once a bin (Kennedy and O'Hagan 2001, J. R. Stat. Soc.
B 63:425, on why it must count; Green 1984, J. R. Stat. Soc. B 46:149). How large it may be in one block the others of
the same unit say, since the scale of its variances' prior is fitted (a hierarchical t distribution; Gelman et al.,
Bayesian Data Analysis, 3rd ed., ch. 5 and 17): a channel that is off as three others are speaks for no fault of its
own. Where there are references it cancels to first order, and what the true effect leaves beyond scatter is all that
is left of it.
"""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.optimize import brentq  # type: ignore[import-untyped]  # carries no types

from jammkle_gap.core.scatter import whitened_difference

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from jammkle_gap.core.constants import Constants
    from jammkle_gap.core.features import Layout
    from jammkle_gap.core.fit import Fit
    from jammkle_gap.core.scatter import Difference, Setting

    _Split = tuple[NDArray[np.float64], NDArray[np.float64], float]

TURNS = 4
"""Times that a step and the variance of what it leaves follow from each other. Chosen: neither moves by more than a
tenth after it."""
_KEPT = 4
"""Latest candidates whose split is kept: a fit asks again of where it began, of where it came to and of the best."""


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


def _numbers_of(layouts: Sequence[Layout], labels: Sequence[Sequence[str]]) -> NDArray[np.intp]:
    """Return a number for every feature: of its signal's label, of which each layout has some, or of its event."""
    numbers: dict[str, int] = {}
    found = []
    for layout, own in zip(layouts, labels, strict=True):
        found += [np.full(layout.bins, numbers.setdefault(label, len(numbers))) for label in own]
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


def by_length(
    length: float, healthy: float, left: Sequence[float], freedom: float, constants: Constants
) -> NDArray[np.float64]:
    """Return log-likelihoods of none of them, and of candidates, by what they leave of a whitened difference.

    What the true effect leaves beyond scatter is model discrepancy, of unknown size. With an inverse-gamma prior on its
    variance the likelihood is that of a multivariate t distribution (Gelman et al., Bayesian Data Analysis, 3rd ed.,
    sec. 3.6), in the degrees of freedom that such an error really has: it hangs together over time, so they are far
    fewer than the features. The larger a gap, the larger is that error: its prior scale is a share of scatter and one
    of the gap.

    Args:
        length: Square of the difference.
        healthy: What healthy runs leave of it.
        left: What each candidate leaves.
        freedom: Degrees of freedom of model discrepancy in these recordings.
        constants: Of the model.

    """
    # A fit may leave less than healthy runs do, by chance or by flexibility: then that is the measure of all.
    noise = min(healthy, *(left or [length]))
    scale = constants.discrepancy_share * noise + constants.discrepancy_of_gap * max(length - noise, 0.0)
    if scale <= 0.0:
        return np.zeros(1 + len(left))
    further = np.array([constants.unknown_share * (length - noise), *(each - noise for each in left)])
    found: NDArray[np.float64] = -0.5 * freedom * np.log1p(np.maximum(further, 0.0) / scale)
    # The same share explained makes it as probable as none of them, however many degrees of freedom there are.
    found[0] -= constants.unknown_penalty * freedom / constants.discrepancy_freedom
    return found


class Discrepancy:
    """What candidates leave, split into scatter, constants, and model discrepancy.

    Settings with references have none that weighs their features, and one degree of freedom for a signal and block.
    """

    def __init__(
        self,
        settings: Sequence[Setting],
        raw: Sequence[NDArray[np.float64]],
        difference: Difference,
        constants: Constants,
    ) -> None:
        """Prepare.

        Args:
            settings: Runs.
            raw: Measured less simulated with the constants as known beforehand, per setting.
            difference: With the covariance of scatter and constants.
            constants: Blocks, and what is known of the error beforehand.

        """
        self._every, self.difference, self._constants = tuple(raw), difference, constants
        self._latest: deque[tuple[Fit, _Split]] = deque(maxlen=_KEPT)
        referenced = [bool(setting.references) for setting in settings]
        self._referenced = np.repeat(referenced, [each.size for each in difference.settings])
        self.without_references = not all(referenced)
        """Whether any setting has none, so that the simulator's errors count there."""
        blocks = constants.blocks * sum(len(setting.layout.signals) for setting in settings)
        self.freedom = min(constants.discrepancy_freedom, float(blocks))
        """Degrees of freedom of what the true effect leaves beyond scatter, where there are references."""
        self._used = [k for k, setting in enumerate(settings) if not setting.references]
        if not self._used:
            return
        layouts = [settings[k].layout for k in self._used]
        self._blocks, self._per_block = blocks_of(layouts, constants)
        self._signals = _numbers_of(layouts, [each.signals for each in layouts])
        self._kinds = np.zeros(self._blocks.max() + 1, dtype=np.intp)
        """Number of the unit, or of the event, of every block."""
        self._kinds[self._blocks] = _numbers_of(layouts, [each.units for each in layouts])
        self._raw = np.concatenate([raw[k] for k in self._used])
        used = [difference.settings[k] for k in self._used]
        self._factor = np.concatenate([np.full(each.size, each.factor) for each in used])
        self._ends = np.cumsum([each.size for each in used])[:-1]
        smooth, self._columns = [], []
        for each in used:
            named, known = len(each.scatter.amplitudes), each.scatter.columns.shape[1]
            smooth.append(each.factor * np.square(each.columns[:, named:known]).sum(axis=1))
            self._columns.append(np.sqrt(each.factor) * np.delete(each.columns, slice(named, known), axis=1))
        self._shared = np.vstack([each.shared for each in used])
        local = self._factor * np.concatenate([each.scatter.variance for each in used])
        # Smooth scatter lasts for a block as this error does, and so counts once a block too.
        self._healthy = local + np.concatenate(smooth)
        self._base = local + self._per_block * np.concatenate(smooth)
        self._expected = np.bincount(self._blocks, self._healthy / self._base)
        self._range = _ranges([settings[k] for k in self._used])
        self._of_blocks = min(constants.discrepancy_freedom, float(len(self._expected)))
        # Over settings the error repeats itself, but no more than it hangs together altogether.
        self._share = max(1.0 / len(self._used), min(1.0, constants.independent_blocks / len(self._expected)))

    def __getstate__(self) -> dict[str, Any]:
        """Take no candidates along to another process."""
        return {**self.__dict__, "_latest": deque(maxlen=_KEPT)}

    def difference_with(self, fit: Fit) -> Difference:
        """Return the difference whitened by scatter and the error that a candidate leaves, block by block."""
        if not self._used:
            return self.difference
        total, _, _ = self._split_by(fit)
        return self._whitened(total)

    def evenly_with(self, fit: Fit) -> Difference:
        """Return the difference whitened by scatter and the error that a candidate leaves of each signal on the whole.

        Where a fit has far to go no block is trusted because it happens to agree already (graduated non-convexity;
        Blake and Zisserman 1987, Visual Reconstruction).
        """
        if not self._used:
            return self.difference
        left = self._left(fit)
        rest = left - self._shared @ fit.scores if len(fit.scores) else left
        return self._whitened(self._variance(rest, self._signals))

    def accurate_to(self, accuracy: float) -> tuple[Difference, Difference, float]:
        """Return the difference whitened by scatter and an error of the simulator as large as its stated accuracy.

        Repeats share that error: how little they scatter says nothing of it.

        Args:
            accuracy: Share of each signal's range; 0: scatter alone.

        Returns:
            With an error that is another one in every bin, and with one that lasts for a block as well. What a healthy
            machine leaves per feature in the former: of scatter's share what repeats leave, and all of the error's.

        """
        error = accuracy * self._range
        lasting = [np.zeros((each.size, 0)) for each in self.difference.settings]
        parts = (np.split(values, self._ends) for values in (error, self._blocks))
        for k, size, blocks in zip(self._used, *parts, strict=True):
            lasting[k] = size[:, np.newaxis] * (blocks[:, np.newaxis] == np.unique(blocks))
        by_bin = self._base + np.square(error)
        found = self._whitened(by_bin)
        share = float((np.square(error) / by_bin).sum()) / found.whitened.size
        left = max(found.healthy, self._constants.least_healthy)
        return found, self._whitened(by_bin, lasting), left * (1.0 - share) + share

    def _whitened(self, total: NDArray[np.float64], lasting: Sequence[NDArray[np.float64]] = ()) -> Difference:
        settings = self.difference.settings
        own = [np.zeros(each.size) for each in settings]
        parts = np.split((total - self._base) / self._factor, self._ends)
        for k, part in zip(self._used, parts, strict=True):
            own[k] = part
        return whitened_difference(settings, self._every, own, lasting)

    def left_per_feature(self, fit: Fit) -> float:
        """Return what a candidate leaves per feature beyond scatter and constants, in the variance of scatter."""
        if not self._used:
            left = self.difference.whitened - self.difference.whiten(fit.features)
            return float(np.square(left).mean()) / self.difference.healthy
        _, rest, _ = self._split_by(fit)
        return float((np.square(rest) / self._base).mean())

    def cost(self, fit: Fit) -> float:
        """Return what a fit minimises, in nats: what it leaves, as the likelihood has it, and the priors' scores."""
        rest = (self.difference.whitened - self.difference.whiten(fit.features))[self._referenced]
        total = float(np.square(rest).sum())
        if self._used:
            left, prior = self._weighed(fit)
            total += prior - 2.0 * float(self._by_blocks(np.maximum(left - self._expected, 0.0)))
        return 0.5 * total

    def covariance(self, fit: Fit) -> NDArray[np.float64]:
        """Return the posterior covariance of parameters and scores of the constants beside the error (Laplace)."""
        weights = self.difference_with(fit)
        rows = weights.by_scatter([each.T for each in fit.slopes]).T
        free = rows.shape[1] - len(fit.scores)
        scale = np.concatenate([np.maximum(np.linalg.norm(rows[:, :free], axis=0), 1e-12), np.ones(len(fit.scores))])
        prior = np.concatenate([np.zeros(free), np.ones(len(fit.scores))])
        normal = (rows / scale).T @ (rows / scale) + np.diag(prior)
        covariance: NDArray[np.float64] = np.linalg.pinv(normal, hermitian=True) / np.outer(scale, scale)
        return covariance

    def scores(self, nothing: Fit, fits: Sequence[Fit], effects: int) -> list[float]:
        """Return the log-likelihood of none of them, and of each candidate, up to the same constant.

        Args:
            nothing: None of the effects: the constants alone.
            fits: Candidates.
            effects: How many the library has.

        """
        found = self._beside_references(fits)
        if self._used:
            found = found + self._beside_error(nothing, fits, effects)
        return [float(each) for each in found]

    def _beside_references(self, fits: Sequence[Fit]) -> NDArray[np.float64]:
        """Return log-likelihoods in settings with references; none of them first."""
        inside = self._referenced
        length = float(np.square(self.difference.whitened[inside]).sum())
        left = [float(np.square((fit.whitened - fit.signature)[inside]).sum()) for fit in fits]
        return by_length(length, self.difference.healthy * int(inside.sum()), left, self.freedom, self._constants)

    def _beside_error(self, nothing: Fit, fits: Sequence[Fit], effects: int) -> NDArray[np.float64]:
        """Return log-likelihoods in settings without references, relative to the simulator's error alone.

        None of them first: it is that, or a cause unknown to the library. A candidate's is that of a t distribution
        for every signal and block, of which all settings count as one since the simulator's error repeats itself over
        them, and the prior of the scores of scatter and constants. The best must stand up to none
        of them by all blocks together as well, so that many small blocks explained do not make up for large ones left
        alone. The error of a simulator resembles one effect or another by chance, the more of them there are: none of
        them is as likely beforehand as all single effects together, and each of these as all pairs that it is in
        (Scott and Berger 2010, Ann. Stat. 38:2587).
        """
        rests = [self._weighed(fit) for fit in (nothing, *fits)]
        left, priors = np.array([each for each, _ in rests]), np.array([prior for _, prior in rests])
        # As with references, what the best leaves is the noise of all where it is less than expected.
        noise = np.minimum(np.min(left, axis=0), self._expected)
        gap = float((left[0] - noise).sum())
        likelihoods = self._likelihood(left - noise, gap) - self._likelihood(left[0] - noise, gap)
        # Of what a second effect costs, the posterior takes the rest.
        odds, second = np.log(effects), max(np.log(effects) - self._constants.pair_penalty, 0.0)
        chances = np.array([0.0, *(odds + second * (len(fit.names) - 1) for fit in fits)])
        scores: NDArray[np.float64] = likelihoods[:, 0] - 0.5 * (priors - priors[0]) - chances
        if fits:
            # Of what the best explains, a cause unknown to the library leaves a share.
            best = 1 + int(np.argmax(scores[1:]))
            unknown = left[0] + (1.0 - self._constants.unknown_share) * np.minimum(left[best] - left[0], 0.0)
            gained = self._likelihood(unknown - noise, gap) - self._likelihood(left[0] - noise, gap)
            none = np.logaddexp(0.0, gained) - np.log(2.0)
            scores[0] = max(none[0], likelihoods[best, 0] + none[1] - likelihoods[best, 1])
        return scores

    def _weighed(self, fit: Fit) -> tuple[NDArray[np.float64], float]:
        """Return what is left of each block beyond scatter and constants, and the square of their scores."""
        _, rest, prior = self._split_by(fit)
        return np.bincount(self._blocks, np.square(rest) / self._base).astype(float), prior

    def _likelihood(self, left: NDArray[np.float64], gap: float) -> NDArray[np.float64]:
        """Return log-likelihoods of what is left beyond noise: block by block, and of all together, shape (..., 2).

        Args:
            left: Of each block, shape (..., blocks).
            gap: What is left where nothing is explained, of all together: the larger it is, the more the true effect
                leaves, as in the posterior.

        """
        expected = self._constants.discrepancy_of_block * self._expected
        scale = expected.sum() + self._constants.discrepancy_of_gap * gap
        together = -0.5 * self._of_blocks * np.log1p(left.sum(axis=-1) / scale)
        return np.stack([np.apply_along_axis(self._by_blocks, -1, left), together], axis=-1)

    def _by_blocks(self, further: NDArray[np.float64]) -> np.float64:
        """Return the log-likelihood, of t distributions, of what every block leaves beyond noise, shape (blocks,)."""
        freedom, scales = self._constants.block_freedom, self._scales(further)
        terms = np.log(scales) + (freedom + 1.0) * np.log1p(further / self._expected / (freedom * scales))
        found: np.float64 = -0.5 * self._share * terms.sum()
        return found

    def _scales(self, further: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the likeliest scale of the discrepancy's variance for every block, the same for all of a kind.

        In what is expected of scatter, and no less than `discrepancy_of_block`. With its mean known to be zero the
        likelihood of a t distribution has one maximum over its scale.
        """
        freedom, least = self._constants.block_freedom, self._constants.discrepancy_of_block
        scales = np.full(len(further), least)
        for kind in range(self._kinds.max() + 1):
            own = self._kinds == kind
            sizes = further[own] / self._expected[own]

            def slope(log_scale: float, sizes: NDArray[np.float64] = sizes) -> float:
                return float(((freedom + 1.0) * sizes / (freedom * np.exp(log_scale) + sizes) - 1.0).sum())

            if slope(np.log(least)) > 0.0:
                scales[own] = np.exp(
                    brentq(slope, np.log(least), np.log((1.0 + freedom) * sizes.max()) + 1.0, xtol=1e-6)
                )
        return scales

    def _left(self, fit: Fit) -> NDArray[np.float64]:
        left: NDArray[np.float64] = self._raw - np.concatenate([fit.features[k] for k in self._used])
        return left

    def _split_by(self, fit: Fit) -> _Split:
        """Return `_split` of what a candidate leaves; of the latest ones it is known."""
        for known, split in self._latest:
            if known is fit:
                return split
        split = self._split(self._left(fit), fit.scores)
        self._latest.append((fit, split))
        return split

    def _split(self, left: NDArray[np.float64], constants: NDArray[np.float64]) -> _Split:
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
            total = self._variance(rest, self._blocks)
            rest, own = self._solved(alone, total, columns)
        return total, rest, prior + own

    def _variance(self, rest: NDArray[np.float64], spread_over: NDArray[np.intp]) -> NDArray[np.float64]:
        """Return the variance of every feature under which least squares has the gradient of the likelihood.

        A block's share in it is that of the logarithm of what it leaves (majorisation; Hunter and Lange 2004, Am. Stat.
        58:30), with the likeliest scales. So fits and their scores mean the same.

        Args:
            rest: What scatter and constants leave of every feature.
            spread_over: Number of what that is taken on the average of, for every feature: its block or its signal.

        """
        left = np.square(rest) / self._base
        further, sizes = np.maximum(np.bincount(self._blocks, left) - self._expected, 0.0), self._expected[self._blocks]
        freedom, scales = self._constants.block_freedom, self._scales(further)[self._blocks]
        share = np.bincount(spread_over, further[self._blocks]) / np.bincount(spread_over, sizes)
        total = self._base * sizes * (freedom * scales + share[spread_over]) / (self._share * (freedom + 1.0))
        # Where hardly anything is left the gradient asks for less than scatter, which nothing can be whitened by.
        found: NDArray[np.float64] = np.maximum(total, self._base)
        return found

    def _solved(
        self, left: NDArray[np.float64], total: NDArray[np.float64], shared: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], float]:
        """Return what scatter and shared columns leave, and the square of their scores: setting by setting first."""
        matrix, right = np.eye(shared.shape[1]), np.zeros(shared.shape[1])
        solved = []
        pieces = [np.split(each, self._ends) for each in (left, total, shared)]
        for columns, part, variance, along in zip(self._columns, *pieces, strict=True):
            own, over = columns.T / variance, along.T / variance
            # many small systems: SciPy's checks for cho_factor take longer than these do
            known = np.linalg.solve(np.eye(columns.shape[1]) + own @ columns, own @ np.column_stack((part, along)))
            by_itself, with_it = known[:, 0], known[:, 1:]
            matrix += over @ along - (over @ columns) @ with_it
            right += over @ part - (over @ columns) @ by_itself
            solved.append((by_itself, with_it))
        common = np.linalg.solve(matrix, right)
        scores = [by_itself - with_it @ common for by_itself, with_it in solved]
        scatter = np.concatenate([columns @ each for columns, each in zip(self._columns, scores, strict=True)])
        prior = float(common @ common) + sum(float(each @ each) for each in scores)
        return left - scatter - shared @ common, prior
