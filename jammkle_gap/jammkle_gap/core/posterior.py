"""Which effect: a posterior over single effects, pairs, and none of them.

The library's effect is not the machine's: what the true one leaves beyond healthy scatter is model discrepancy,
of unknown size. With an inverse-gamma prior on its variance the likelihood of a candidate is that of a multivariate t
distribution of what it leaves (Gelman et al., Bayesian Data Analysis, 3rd ed., sec. 3.6), in the degrees of freedom
that such an error really has: it hangs together over time, so they are far fewer than the features. The larger a gap,
the larger is that error: its prior scale is a share of healthy scatter and one of the gap.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from jammkle_gap.core.detect import class_of

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from jammkle_gap.core.constants import Constants
    from jammkle_gap.core.fit import Fit

Names = tuple[str, ...]
"""Effects of a candidate; empty: none of them, something that the library does not have."""
NONE_OF_THEM: Names = ()


@dataclass(frozen=True)
class Posterior:
    """Probabilities given that there is a gap."""

    probabilities: Mapping[Names, float]
    """By candidate, largest first; `NONE_OF_THEM` is one. They add up to 1."""
    credible: tuple[Names, ...]
    """Smallest set that holds the stated share of the probability."""

    @property
    def best(self) -> Names:
        """The most probable candidate."""
        return next(iter(self.probabilities))


def posterior_of(
    length: float,
    features: int,
    healthy: float,
    freedom: float,
    fits: Sequence[Fit],
    own: Mapping[Names, float],
    classes: Mapping[str, str],
    constants: Constants,
) -> Posterior:
    """Return the posterior.

    Args:
        length: Squared length of the whitened difference in settings with references.
        features: How many it has.
        healthy: What healthy runs leave per feature.
        freedom: Degrees of freedom of model discrepancy in these recordings.
        fits: Candidates, with what they leave in settings with references.
        own: Log-likelihood of each, and of none of them, in settings without.
        classes: Name of the equivalence class of each effect that is in one: its members count as one candidate.
        constants: Of the model.

    """
    least = min((fit.left for fit in fits), default=length)
    # A fit may leave less than healthy runs do, by chance or by flexibility: then that is the measure of all.
    noise = min(healthy * features, least)
    scale = error_scale(length, noise, constants)
    scores: dict[Names, float] = {}
    for fit in fits:
        score = _score(fit.left - noise, scale, freedom) - constants.pair_penalty * (len(fit.names) - 1)
        score += own.get(fit.names, 0.0) - constants.parameter_penalty * (len(fit.values) - len(fit.names))
        scores[fit.names] = max(score, scores.get(fit.names, -np.inf))
    # A pair contains each of its effects: unless it is more probable than these alone, its other half is idle.
    for names in [names for names in scores if len(names) > 1]:
        if any(scores.get((name,), -np.inf) >= scores[names] for name in names):
            del scores[names]
    unknown = constants.unknown_share * (length - noise)
    scores[NONE_OF_THEM] = _score(unknown, scale, freedom) + own.get(NONE_OF_THEM, 0.0)
    # The same share explained makes it as probable as none of them, however many degrees of freedom there are.
    # Without references its prior is that of model discrepancy.
    scores[NONE_OF_THEM] -= constants.unknown_penalty * freedom / constants.discrepancy_freedom * bool(features)
    highest = max(scores.values())
    weights = {names: float(np.exp(score - highest)) for names, score in scores.items()}
    total = sum(weights.values())
    ranked = dict(sorted(((names, weight / total) for names, weight in weights.items()), key=lambda item: -item[1]))
    return Posterior(ranked, credible_set(ranked, classes, constants.credible))


def error_scale(length: float, noise: float, constants: Constants) -> float:
    """Return the prior scale of model discrepancy, in squared whitened features.

    Args:
        length: Squared length of the difference.
        noise: What healthy runs leave of it.
        constants: Its share of either.

    """
    return constants.discrepancy_share * noise + constants.discrepancy_of_gap * max(length - noise, 0.0)


def credible_set(ranked: Mapping[Names, float], classes: Mapping[str, str], share: float) -> tuple[Names, ...]:
    """Return the smallest set of candidates that holds a share of the probability, one for each class."""
    found: dict[Names, Names] = {}
    held = 0.0
    for names, probability in ranked.items():
        if held >= share:
            break
        found.setdefault(class_of(names, classes), names)
        held += probability
    return tuple(found.values())


def by_class(ranked: Mapping[Names, float], classes: Mapping[str, str]) -> dict[Names, float]:
    """Return the probability of each equivalence class, by its effects as `class_of` has them; largest first.

    Args:
        ranked: Probability of each candidate.
        classes: Name of the class of each effect that is in one.

    """
    sums: dict[Names, float] = {}
    for names, probability in ranked.items():
        own = class_of(names, classes)
        sums[own] = sums.get(own, 0.0) + probability
    return dict(sorted(sums.items(), key=lambda item: -item[1]))


def _score(left: float, scale: float, freedom: float) -> float:
    """Return the log-likelihood of what a candidate leaves beyond healthy scatter, up to a constant."""
    if scale <= 0.0:
        return 0.0
    return -0.5 * freedom * float(np.log1p(max(left, 0.0) / scale))
