"""Decisions: is there a gap, which effects can these recordings not distinguish, and which candidate is it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum
from typing import TYPE_CHECKING

import numpy as np
from scipy import stats  # type: ignore[import-untyped]  # carries no types

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_gap.core.constants import Constants
    from jammkle_gap.core.fit import Fit
    from jammkle_gap.core.scatter import Difference
    from jammkle_gap.core.signatures import Grid

Names = tuple[str, ...]
"""Effects of a candidate; empty: none of them, something that the library does not have."""
NONE_OF_THEM: Names = ()


_TYPICAL = 400.0
"""Squared length at which signatures are compared. Chosen: twenty standard deviations, a clear gap."""


def classes_of(
    grids: Mapping[str, Grid], signatures: Mapping[str, NDArray[np.float64]], constants: Constants
) -> tuple[tuple[str, ...], ...]:
    """Return classes of effects whose signatures can each be had from the others', up to a small share.

    Two effects are equivalent if each, at a typical size, leaves less than `class_distance` of its squared length when
    the other is fitted to it (isolability by the angle between signatures; Basseville 1988, Automatica 24:309).

    Args:
        grids: By effect.
        signatures: Whitened, of the grids' points, shape (points, n), by effect.
        constants: Distance.

    Returns:
        Classes of two or more, in the order of the effects.

    """
    names = list(signatures)
    typical = {name: _typical(signatures[name]) for name in names}
    stacked = {name: signatures[name] for name in names}
    left = np.ones((len(names), len(names)))
    for j, name in enumerate(names):
        gram = stacked[name] @ stacked[name].T
        weights = grids[name].weights
        quadratic = np.einsum("ij,jk,ik->i", weights, gram, weights, optimize=True)
        for i, other in enumerate(names):
            target = typical[other]
            gains = 2.0 * weights @ (stacked[name] @ target) - quadratic
            left[i, j] = 1.0 - float(gains.max()) / float(target @ target)
    near = (left < constants.class_distance) & (constants.class_distance > left.T)
    found: list[list[int]] = []
    for i in range(len(names)):
        for members in found:
            # All of a class are equivalent to each other: a chain of neighbours is none.
            if near[i, members].all():
                members.append(i)
                break
        else:
            found.append([i])
    return tuple(tuple(names[i] for i in members) for members in found if len(members) > 1)


def class_names(classes: Sequence[Sequence[str]]) -> dict[str, str]:
    """Return the name of the class of each effect that is in one: that of its first member."""
    return {name: members[0] for members in classes for name in members}


def class_of(names: Sequence[str], classes: Mapping[str, str]) -> tuple[str, ...]:
    """Return a candidate's effects by the names of their classes, sorted: the same for all that data cannot part.

    Args:
        names: Of its effects.
        classes: Name of the class of each effect that is in one, as `class_names` returns them.

    """
    return tuple(sorted(classes.get(name, name) for name in names))


def _typical(signatures: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the signature of the smallest grid point that makes a clear gap, or of the largest."""
    squared = np.square(signatures).sum(axis=1)
    clear = np.flatnonzero(squared >= _TYPICAL)
    chosen = clear[int(np.argmin(squared[clear]))] if len(clear) else int(np.argmax(squared))
    row: NDArray[np.float64] = signatures[chosen]
    return row


class Seen(Enum):
    """What of a difference shows that there is a gap, in words."""

    ALTOGETHER = "altogether"
    ALONG_EFFECT = "along one of the effects"
    IN_CONSTANTS = "in how far its constants moved"


@dataclass(frozen=True)
class Detection:
    """Evidence for a gap."""

    p_value: float
    """Probability of a difference at least as long in a healthy machine."""
    gap: bool
    """Whether it is below the stated rate of false alarms."""
    probability: float
    """Of a gap, with even odds beforehand."""
    ratio: float
    """Squared length of the difference per feature, in what healthy runs leave; 1: no gap."""
    explained: float
    """Probability of a gain as large along any effect in a healthy machine."""
    unexplained: float
    """Probability of a length as large altogether in a healthy machine."""
    likelier: float = 1.0
    """Probability that any effect gains as much likelihood in a healthy machine; 1 where that is not tested."""
    farthest: float = 0.0
    """Root mean square of what is left of the signal that is farthest off in a setting, in scatter and in what others
    leave there; 0 where that is not tested."""

    @property
    def seen(self) -> Seen:
        """Which of the tests has the smallest probability."""
        if self.p_value == min(1.0, 2.0 * self.unexplained):
            return Seen.ALTOGETHER
        along = (self.explained, self.likelier)
        return Seen.ALONG_EFFECT if self.p_value in [min(1.0, 2.0 * each) for each in along] else Seen.IN_CONSTANTS


def detect(
    difference: Difference,
    length: float,
    singles: Sequence[Fit],
    constants: Constants,
    whole: tuple[Difference, float, float] | None = None,
) -> Detection:
    """Test the difference against healthy runs.

    Along an effect with p parameters the gain, over p and over the moderated variance of healthy runs along the same
    signature, is F-distributed with p and that variance's degrees of freedom (Smyth 2004, eq. 6); over effects the
    smallest p-value counts as many times as there are effects (Bonferroni). Altogether, the logarithm of the squared
    length per feature is t-distributed about that of healthy runs, with the spread that these show.

    Args:
        difference: Of all settings.
        length: Its square, less what the constants of the machine explain.
        singles: Single effects as fitted.
        constants: Rate of false alarms, prior degrees of freedom.
        whole: What is tested altogether, its length, and what a healthy machine leaves of it per feature, where that
            is whitened otherwise; None: the same.

    """
    best = 1.0
    for fit in singles:
        count, spread = len(fit.values), spread_along(difference, fit.signature, constants)
        gain = (length - fit.left) / (count * spread.variance)
        best = min(best, float(stats.f.sf(gain, count, spread.freedom)))
    explained = min(1.0, best * max(len(singles), 1, constants.tested_effects))
    tested, left, healthy = whole or (difference, length, max(difference.healthy, constants.least_healthy))
    ratio = left / tested.whitened.size / healthy
    unexplained = _altogether(tested, ratio, constants)
    untested = Detection(1.0, gap=False, probability=0.0, ratio=ratio, explained=explained, unexplained=unexplained)
    return _of_smallest(untested, min(1.0, 2.0 * min(explained, unexplained)), constants)


def _of_smallest(detection: Detection, p_value: float, constants: Constants, **parts: float) -> Detection:
    """Return a test by its probability, with other parts."""
    gap, probability = p_value < constants.false_alarm_rate, probability_of_gap(p_value, constants)
    return replace(detection, p_value=p_value, gap=gap, probability=probability, **parts)


def without_directions(detection: Detection, constants: Constants) -> Detection:
    """Return the test by the length of what is left and by likelihoods, where none of the effects is the best answer.

    A length along an effect is then that of constants that were not fitted to quite. A likelihood is of finished fits.
    """
    p_value = min(1.0, 2.0 * min(detection.likelier, detection.unexplained))
    return _of_smallest(detection, p_value, constants, explained=detection.likelier)


def by_likelihood(detection: Detection, gains: Sequence[tuple[float, int]], constants: Constants) -> Detection:
    """Return the test with another part: whether an effect is so much likelier than the constants alone.

    Twice the gain of an effect with p parameters is chi-squared distributed with p degrees of freedom (Wilks 1938, Ann.
    Math. Stat. 9:60; of a likelihood whose blocks are not independent, Varin, Reid and Firth 2011, Stat. Sinica 21:5).
    Over effects the smallest p-value counts as many times as there are effects, as in `detect`, and of the two parts
    along effects the smaller one twice (Bonferroni).

    Args:
        detection: By lengths along effects, and altogether.
        gains: Log-likelihood that each effect gains, and the number of its parameters.
        constants: Rate of false alarms.

    """
    smallest = min((float(stats.chi2.sf(2.0 * max(gain, 0.0), count)) for gain, count in gains), default=1.0)
    likelier = min(1.0, smallest * max(len(gains), constants.tested_effects))
    explained = min(1.0, 2.0 * min(detection.explained, likelier))
    p_value = min(1.0, 2.0 * min(explained, detection.unexplained))
    return _of_smallest(detection, p_value, constants, explained=explained, likelier=likelier)


def by_signals(detection: Detection, ratio: float, constants: Constants) -> Detection:
    """Return the test altogether with another part: whether one signal of one setting is farther off than ever.

    A simulator that is right in most signals may have one quite wrong, which their mean hides. The logarithm of what is
    left there is t-distributed about that of other machines, and of the two parts the smaller one counts twice.

    Args:
        detection: By lengths along effects, and altogether.
        ratio: Squared length per feature of the signal and setting that is farthest off, in scatter and in
            `signal_accuracy` times the simulator's accuracy.
        constants: Rate of false alarms, and how machines differ.

    """
    statistic = np.log(max(ratio, 1e-12)) / constants.signal_spread
    own = float(stats.t.sf(statistic, constants.length_prior_freedom))
    unexplained = min(1.0, 2.0 * min(detection.unexplained, own))
    p_value = min(1.0, 2.0 * min(detection.explained, unexplained))
    return _of_smallest(detection, p_value, constants, unexplained=unexplained, farthest=float(np.sqrt(ratio)))


def beyond_tolerance(detection: Detection, deviations: Sequence[float], constants: Constants) -> Detection:
    """Return the test with a third part: whether constants have to lie beyond their tolerance to explain the gap.

    A tolerance is the standard deviation of a normal distribution; the largest of all counts (Sidak 1967, J. Am. Stat.
    Assoc. 62:626), and the smallest of the three probabilities three times (Bonferroni).

    Args:
        detection: By what is left beside these constants.
        deviations: Of every constant where none of the effects is there, in standard deviations.
        constants: Rate of false alarms.

    """
    p_value = min(1.0, 3.0 * min(detection.explained, detection.unexplained, _as_drawn(deviations)))
    return detection if p_value >= detection.p_value else _of_smallest(detection, p_value, constants)


def is_as_drawn(deviations: Sequence[float]) -> bool:
    """Return whether constants lie within their tolerances, by their deviations in standard deviations."""
    return _as_drawn(deviations) >= _DRAWN


_DRAWN = 0.05
"""Probability of the largest deviation of all constants from which on a machine is as drawn. Chosen: by custom."""


def _as_drawn(deviations: Sequence[float]) -> float:
    """Return the probability that the largest deviation of a machine from its drawing is as large."""
    largest = max(map(abs, deviations), default=0.0)
    return -float(np.expm1(len(deviations) * np.log1p(-2.0 * stats.norm.sf(largest)))) if largest > 0.0 else 1.0


def probability_of_gap(p_value: float, constants: Constants) -> float:
    """Return the probability of a gap with even odds beforehand.

    p-values of healthy machines are uniform; those of gaps are taken to follow a Beta(a, 1) distribution, whose density
    is a p^(a - 1) (Sellke, Bayarri and Berger 2001, Am. Stat. 55:62).

    Args:
        p_value: Of the test.
        constants: With the exponent a.

    """
    shape = constants.gap_shape
    # The logarithm: p may be as small as a float can be.
    evidence = np.log(shape) + (shape - 1.0) * np.log(max(p_value, 1e-300))
    return float(1.0 / (1.0 + np.exp(-evidence)))


@dataclass(frozen=True)
class Spread:
    """How healthy runs scatter along a signature."""

    variance: float
    """Of the whitened difference along it; 1: as the covariance has it, and never taken to be less."""
    freedom: float
    """Degrees of freedom of the variance, those of the prior among them."""


def spread_along(difference: Difference, signature: NDArray[np.float64], constants: Constants) -> Spread:
    """Return how healthy runs scatter along a signature, moderated towards a variance of 1.

    Each setting's variance counts by its share of what settings with repeats hold of the squared signature. Their
    weighted sum has the degrees of freedom of Satterthwaite 1946 (Biometrics Bulletin 2:110): those of one setting
    where the signature shows in that one alone.
    """
    parts = zip(difference.settings, difference.split(signature), strict=True)
    squared = sum(float(part @ part) for setting, part in parts if setting.freedom)
    total = uncertainty = 0.0
    for setting, part in zip(difference.settings, difference.split(signature), strict=True):
        own = setting.freedom
        length = float(np.linalg.norm(part))
        if length > 0.0 and own:
            weighted = length**2 / squared * float(np.square(setting.deviations @ (part / length)).sum()) / own
            total += weighted
            uncertainty += weighted**2 / own
    freedom = total**2 / uncertainty if uncertainty > 0.0 else 0.0
    prior = constants.direction_prior_freedom
    variance = (prior + freedom * total) / (prior + freedom)
    return Spread(max(1.0, variance), prior + freedom)


def _altogether(difference: Difference, ratio: float, constants: Constants) -> float:
    """Return the probability of such a ratio in a healthy machine."""
    own = [
        np.log(np.maximum(np.square(each.deviations).mean(axis=1), 1e-12))
        for each in difference.settings
        if each.freedom
    ]
    freedom = sum(each.freedom for each in difference.settings)
    prior, expected = constants.length_prior_freedom, constants.length_spread**2
    total = sum(float(np.square(each - each.mean()).sum()) for each in own)
    variance = (prior * expected + total) / (prior + freedom)
    statistic = np.log(max(ratio, 1e-12)) / np.sqrt(variance)
    return float(stats.t.sf(statistic, prior + freedom))


@dataclass(frozen=True)
class Posterior:
    """Probabilities given that there is a gap."""

    probabilities: Mapping[Names, float]
    """By candidate, largest first; `NONE_OF_THEM` is one. They add up to 1."""
    credible: tuple[Names, ...]
    """Smallest set that holds the stated share of the probability."""


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
