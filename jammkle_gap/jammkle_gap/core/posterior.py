"""Which effect: a posterior over single effects, pairs, and none of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from jammkle_gap.core.detect import class_of

if TYPE_CHECKING:
    from collections.abc import Mapping

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
    likelihoods: Mapping[Names, float], fits: Mapping[Names, Fit], classes: Mapping[str, str], constants: Constants
) -> Posterior:
    """Return the posterior.

    Args:
        likelihoods: Logarithms, of each candidate and of none of them.
        fits: Candidates.
        classes: Name of the equivalence class of each effect that is in one: its members count as one candidate.
        constants: Of the model.

    """
    scores = {
        names: likelihoods[names]
        - constants.pair_penalty * (len(names) - 1)
        - constants.parameter_penalty * (len(fit.values) - len(names))
        for names, fit in fits.items()
    }
    # A pair contains each of its effects: unless it is more probable than these alone, its other half is idle.
    for names in [names for names in scores if len(names) > 1]:
        if any(scores.get((name,), -np.inf) >= scores[names] for name in names):
            del scores[names]
    scores[NONE_OF_THEM] = likelihoods[NONE_OF_THEM]
    highest = max(scores.values())
    weights = {names: float(np.exp(score - highest)) for names, score in scores.items()}
    total = sum(weights.values())
    ranked = dict(sorted(((names, weight / total) for names, weight in weights.items()), key=lambda item: -item[1]))
    return Posterior(ranked, credible_set(ranked, classes, constants.credible))


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
