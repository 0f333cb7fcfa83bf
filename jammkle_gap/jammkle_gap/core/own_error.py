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
        self._share = min(1.0, constants.discrepancy_freedom / len(self._expected))

    def beside(self, features: Features) -> Difference:
        """Return the difference whitened by scatter and the error that a candidate leaves."""
        own = [np.zeros(size) for size in self._sizes]
        total, _ = self._split(self._left(features))
        ends = np.cumsum([self._sizes[k] for k in self._used])
        for k, part in zip(self._used, np.split((total - self._base) / self._factor, ends[:-1]), strict=True):
            own[k] = part
        return beside(self._difference, self._residuals, own)

    def scores(self, fits: Sequence[Fit]) -> list[float]:
        """Return the log-likelihood of none of them, and of each candidate beside its own error, up to a constant.

        That of a t distribution for every signal and block with one degree of freedom, as the posterior has it for all
        of them together, and the prior of the scores of scatter and constants. None of them is taken to leave a share
        of the square of the difference. A candidate that explains many small blocks and leaves the large ones alone
        must stand up to it in all blocks together as well.
        """
        left, priors = [], []
        for rest in (self._left(()) * np.sqrt(self._unknown), *(self._left(fit.features) for fit in fits)):
            _, scores = self._split(rest)
            left.append(np.bincount(self._blocks, np.square(rest - self._columns @ scores) / self._base))
            priors.append(float(scores @ scores))
        # As in the posterior, what the best leaves is the noise of all where it is less than expected.
        noise = np.minimum(np.min(left, axis=0), self._expected)
        terms = np.array(
            [
                (np.log1p((each - noise) / (self._scale * self._expected)).sum(), prior)
                for each, prior in zip(left, priors, strict=True)
            ]
        )
        whole = np.log1p([float((each - noise).sum() / (self._scale * self._expected.sum())) for each in left])
        # Over settings the error repeats itself.
        found = -0.5 * (self._share * terms[:, 0] + terms[:, 1])
        together = -0.5 * (self._share * len(self._expected) * whole + terms[:, 1])
        if len(found) > 1:
            best = 1 + int(np.argmax(found[1:]))
            found[0] = max(found[0], found[best] + together[0] - together[best])
        return [float(each) for each in found]

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
