"""The simulator's own error where no reference shows it: a variance in every signal and block of time.

References cancel what the simulator has wrong anyway. Without them it stays in the difference, and a whitener that
knows the sensor's noise alone takes a seal that turns a little late for more than friction that doubles. So what a
candidate leaves beyond scatter gets a variance of its own in every signal and block, as in calibration. Scatter and
constants of the machine keep their priors: the error of the simulator is none of theirs. Candidates are looked for
beside the error that no effect at all would leave, fitted anew beside what each leaves itself (iteratively reweighted
least squares; Green 1984, J. R. Stat. Soc. B 46:149), and compared by the likelihood that each has beside its own
error. Whether there is a gap is asked of scatter alone.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import block_diag  # type: ignore[import-untyped]  # carries no types

from jammkle_gap.core.calibrate import TURNS, beyond, blocks_of
from jammkle_gap.core.compare import beside

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from jammkle_gap.core.compare import Difference, Residuals, Setting
    from jammkle_gap.core.constants import Constants
    from jammkle_gap.core.fit import Fit

    Features = Sequence[NDArray[np.float64]]
    """What a candidate makes of the features of each setting; empty: nothing."""


class OwnError:
    """What the settings without references leave, split into scatter, constants, and the simulator's own error."""

    def __init__(
        self,
        settings: Sequence[Setting],
        residuals: Sequence[Residuals],
        difference: Difference,
        constants: Constants,
    ) -> None:
        """Stack the settings without references, of which there is at least one.

        Args:
            settings: Runs.
            residuals: Of each setting.
            difference: With the covariance of scatter and constants.
            constants: Blocks, and what is known of the error beforehand.

        """
        self._residuals, self._difference, self._sizes = tuple(residuals), difference, difference.sizes
        self._used = [k for k, setting in enumerate(settings) if not setting.references]
        self._blocks, self._per_block = blocks_of([settings[k].layout for k in self._used], constants)
        self._raw = np.concatenate([residuals[k].difference for k in self._used])
        self._factor = np.concatenate([np.full(self._sizes[k], difference.factors[k]) for k in self._used])
        smooth, columns = [], []
        for k in self._used:
            named, known = len(difference.scatter[k].amplitudes), difference.scatter[k].columns.shape[1]
            smooth.append(np.square(difference.columns[k][:, named:known]).sum(axis=1))
            columns.append(np.delete(difference.columns[k], slice(named, known), axis=1))
        local = self._factor * np.concatenate([difference.scatter[k].variance for k in self._used])
        # Smooth scatter lasts for a block as this error does, and so counts once a block too.
        self._healthy = local + np.concatenate(smooth)
        self._base = local + self._per_block * np.concatenate(smooth)
        self._expected = np.bincount(self._blocks, self._healthy / self._base)
        self._columns = np.hstack([block_diag(*columns), np.vstack([difference.shared[k] for k in self._used])])
        self._scale, self._unknown = constants.own_error_share, constants.unknown_share
        self._pair_penalty, self._of_gap = constants.pair_penalty, constants.discrepancy_of_gap
        self._freedom = min(constants.discrepancy_freedom, float(len(self._expected)))
        # Over settings the error repeats itself, but no more than it hangs together altogether.
        self._share = max(1.0 / len(self._used), self._freedom / len(self._expected))

    def beside(self, features: Features) -> Difference:
        """Return the difference whitened by scatter and the error that a candidate leaves."""
        own = [np.zeros(size) for size in self._sizes]
        total, _ = self._split(self._left(features))
        ends = np.cumsum([self._sizes[k] for k in self._used])
        for k, part in zip(self._used, np.split((total - self._base) / self._factor, ends[:-1]), strict=True):
            own[k] = part
        return beside(self._difference, self._residuals, own)

    def scores(self, fits: Sequence[Fit], effects: int) -> list[float]:
        """Return the log-likelihood of none of them, and of each candidate beside its own error, with their priors.

        That of a t distribution for every signal and block with one degree of freedom, which all settings share since
        the simulator's error repeats itself over them, and the prior of the scores of scatter and constants. The
        best must stand up to none of them by all blocks together as well, as in the posterior, so that many small
        blocks explained do not make up for large ones left alone. The error of a simulator resembles one effect or
        another by chance, the more of them there are: none of them is as likely beforehand as all single effects
        together, and each of these as all pairs that it is in (Scott and Berger 2010, Ann. Stat. 38:2587).

        Args:
            fits: Candidates.
            effects: How many the library has.

        Returns:
            Relative to the simulator's error alone; none of them first, which is that, or a cause unknown to the
            library.

        """
        nothing = self._left(())
        rests = [self._weighed(rest) for rest in (nothing, *(self._left(fit.features) for fit in fits))]
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

    def _weighed(self, rest: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
        """Return what is left of each block beyond scatter and constants, and the square of their scores."""
        _, scores = self._split(rest)
        left = np.bincount(self._blocks, np.square(rest - self._columns @ scores) / self._base)
        return left.astype(float), float(scores @ scores)

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

    def _left(self, features: Features) -> NDArray[np.float64]:
        return self._raw - np.concatenate([features[k] for k in self._used]) if features else self._raw

    def _split(self, left: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the variance of every feature, and the scores of the columns: each follows from the other."""
        # From the scores' prior mean: what scatter could explain at any price stays the simulator's error.
        scores = np.zeros(self._columns.shape[1])
        total = self._base
        for _ in range(TURNS):
            total = self._base + self._per_block * beyond(left - self._columns @ scores, self._healthy, self._blocks)
            weighted = self._columns / total[:, np.newaxis]
            scores = np.linalg.solve(np.eye(len(scores)) + self._columns.T @ weighted, weighted.T @ left)
        return total, scores
