"""Probabilities: over the effects, of there being no gap, and of the cause not being among the candidates."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from jammkle_gap.november.scoring import difference
from jammkle_gap.november.verdict import Verdict

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jammkle_gap.november.scoring import Score
    from jammkle_gap.november.verdict import Criteria, Judgement

NO_GAP = "no_gap"
UNKNOWN = "unknown"


def _beyond(ratio: float, sharpness: float) -> float:
    """Return the probability that something lies beyond a limit, given its ratio to it."""
    power = float(min(max(ratio, 1e-6), 1e6) ** sharpness)
    return power / (1.0 + power)


def probabilities(
    judgement: Judgement, scores: Sequence[Score], effects: Sequence[str], criteria: Criteria
) -> dict[str, float]:
    """Return the probability of each effect, of `no_gap` and of `unknown`; they add up to 1.

    Candidates share what is left by their held-out scores, in units of the error that these differ by; a candidate of
    several effects gives each an equal part. Only candidates as short as those of the set take part: a longer one
    holds the truth as well, and would spread it. Where the gap is explained, only explanations do: a better score may
    also be of what counts as none.

    Args:
        judgement: The verdict and what it stands on.
        scores: Of all candidates fitted.
        effects: All that were on offer, also those that move nothing.
        criteria: Temperature and limits.

    """
    result = dict.fromkeys([*effects, NO_GAP, UNKNOWN], 0.0)
    gap = _beyond(judgement.nominal, criteria.sharpness)
    left = judgement.left
    if judgement.closed == judgement.closed:  # not a number where there was nothing to close
        left = min(left, max(1.0 - judgement.closed, 0.0) / (1.0 - criteria.explained_share))
    unknown = _beyond(left, criteria.sharpness)
    if judgement.verdict is Verdict.UNKNOWN:
        unknown = max(unknown, 0.5)
    chosen = {score.names for score in judgement.chosen}
    longest = max(1, *(len(names) for names in chosen))
    rivals = [score for score in scores if score.names and (len(score.names) <= longest or score.names in chosen)]
    if judgement.verdict in {Verdict.EFFECTS, Verdict.AMBIGUOUS}:
        rivals = [score for score in rivals if score.names in judgement.explaining or score.names in chosen]
    if not rivals:
        result[NO_GAP], result[UNKNOWN] = 1.0 - gap, gap
        return result
    best = next((score for score in judgement.chosen if score.names), max(rivals, key=lambda one: one.total))
    weights = []
    for score in rivals:
        apart = difference(best, score)
        weights.append(np.exp(-max(apart.nats, 0.0) / (criteria.temperature * max(apart.error / 2.0, 1.0))))
    total = float(np.sum(weights))
    result[NO_GAP] = 1.0 - gap
    result[UNKNOWN] = gap * unknown
    for score, weight in zip(rivals, weights, strict=True):
        for name in score.names:
            result[name] += gap * (1.0 - unknown) * float(weight) / total / len(score.names)
    return result
