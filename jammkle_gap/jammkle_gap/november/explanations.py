"""Which candidates explain a gap: what they close of what is off, which effects are needed, and what does as well."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from jammkle_gap.november.alike import does_the_same
from jammkle_gap.november.closing import closed_share
from jammkle_gap.november.scoring import difference

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jammkle_gap.november.limits import Limits
    from jammkle_gap.november.residual import Layout
    from jammkle_gap.november.scoring import Score
    from jammkle_gap.november.verdict import Criteria

_EDGE = 1.2
"""A signal that is beyond its limit by less, with an effect and without, speaks neither against an effect that explains
what is far beyond, nor for another one beside it. Assumed: limits are known no better."""
_ALIKE = 2
"""Decimals of a gap, in noise units, beyond which two are alike."""


def material_ones(layout: Layout, scores: Sequence[Score], criteria: Criteria, limits: Limits) -> list[Score]:
    """Return no effect, and the candidates that close some of what is off: a better score may be of what is none.

    Args:
        layout: Of the residuals.
        scores: Of all candidates fitted, the nominal simulator among them.
        criteria: What counts.
        limits: Largest gaps that count as none.

    """
    nominal = next(score for score in scores if not score.names)
    return [
        each for each in scores if not each.names or closed_of(layout, nominal, each, limits) > criteria.material_share
    ]


def material(
    layout: Layout, chosen: Sequence[Score], scores: Sequence[Score], criteria: Criteria, limits: Limits
) -> list[Score]:
    """Take effects off that close next to nothing of the gap, or are not needed to bring it to where it counts as none.

    The simulator's own small faults are no finding.
    """
    by_names = {score.names: score for score in scores}
    kept: list[Score] = []
    for each in chosen:
        current = each
        while current.names:
            parts = [by_names[names] for names in _parts(current.names) if names in by_names]
            if not parts:
                break
            simpler = min(parts, key=lambda part: layout.gap_above_floor(part.held_out))
            gained = layout.gap_above_floor(simpler.held_out) - layout.gap_above_floor(current.held_out)
            enough = limits.worst(layout, simpler.held_out)[2] <= (_EDGE if simpler.names else 1.0)
            if not enough and gained > criteria.material_share * at_stake(layout, by_names[()]):
                break
            if still_off(layout, by_names[()], simpler, criteria, limits) and not still_off(
                layout, by_names[()], current, criteria, limits
            ):
                break
            current = simpler
        if current.names not in [one.names for one in kept]:
            kept.append(current)
    # One that came down to no effect speaks against none that did not.
    named = [each for each in kept if each.names] or kept
    return [each for each in named if not any(set(other.names) < set(each.names) for other in named)]


def set_around(
    layout: Layout, best: Score, kept: Sequence[Score], scores: Sequence[Score], criteria: Criteria, limits: Limits
) -> list[Score]:
    """Return the set once more: taking effects off may have brought the best within reach of what it had left behind.

    Args:
        layout: Of the residuals.
        best: What is named.
        kept: What could not be told apart from it as it was.
        scores: Of all candidates fitted.
        criteria: What counts.
        limits: Largest gaps that count as none.

    """
    by_names = {score.names: score for score in scores}
    explaining = explaining_ones(layout, best, scores, criteria)
    closing = {score.names for score in material_ones(layout, scores, criteria, limits)}

    def is_rival(other: Score) -> bool:
        if not other.names or len(other.names) > len(best.names) or set(other.names) <= set(best.names):
            return False
        if other.names not in explaining or other.names not in closing:
            return False
        if limits.do_not_tell(layout, best.held_out, other.held_out):
            return True
        if layout.gap_above_floor(other.held_out) < layout.gap_above_floor(best.held_out):
            # A better score does not make up for leaving more.
            return True
        parts = [by_names[names] for names in (*_parts(other.names), ()) if names in by_names]
        earned = all(difference(other, part).told_apart for part in parts)
        if earned and not difference(best, other).told_apart:
            return True
        return does_the_same(layout, by_names[()].fit, best.fit, other.fit)

    near = [score for score in kept if score is best or score.names in explaining]
    found = {score.names: score for score in (*near, *filter(is_rival, scores))}

    def rank(score: Score) -> tuple[float, int, float]:
        # Scores do not tell them apart: what closes most comes first, and of what closes alike the simplest.
        return round(layout.gap_above_floor(score.held_out), _ALIKE), score.fit.point.size, -score.total

    return sorted(found.values(), key=rank)


def explaining_ones(
    layout: Layout, best: Score, scores: Sequence[Score], criteria: Criteria
) -> frozenset[tuple[str, ...]]:
    """Return the candidates that leave at most as much more than the best as an explanation may leave of all."""
    nominal = next(score for score in scores if not score.names)
    utmost = layout.gap_above_floor(best.held_out) + (1.0 - criteria.explained_share) * at_stake(layout, nominal)
    return frozenset(each.names for each in scores if layout.gap_above_floor(each.held_out) <= utmost)


def at_stake(layout: Layout, nominal: Score) -> float:
    """Return what there is to close: the gap above the floor."""
    return layout.gap_above_floor(nominal.held_out) - 1.0


def closed_of(layout: Layout, nominal: Score, candidate: Score, limits: Limits) -> float:
    """Return how much is closed over the signals that are off before or after: what is none need not be explained."""
    before, after = layout.gaps(nominal.held_out), layout.gaps(candidate.held_out)
    off = [name for name in layout.names if max(before[name], after[name]) > limits.of_signal[name]]
    if not off:
        return float("nan")
    first, last = (float(np.sqrt(np.mean([max(gaps[name], 1.0) ** 2 for name in off]))) for gaps in (before, after))
    return closed_share(first, last, len(off))


def still_off(layout: Layout, nominal: Score, candidate: Score, criteria: Criteria, limits: Limits) -> list[str]:
    """Return the signals that are still off with a candidate, and of which it closes too little."""
    before, after = layout.gaps(nominal.held_out), layout.gaps(candidate.held_out)
    # What an effect does besides is foretold no better than the share that may be left of all.
    spared = (1.0 - criteria.explained_share) * limits.worst(layout, nominal.held_out)[1]
    return [
        name
        for name in layout.names
        if after[name] > max(limits.of_signal[name], spared)
        and max(before[name], after[name]) > _EDGE * limits.of_signal[name]
        and not closed_share(before[name], after[name]) >= criteria.explained_share_each
    ]


def _parts(names: tuple[str, ...]) -> list[tuple[str, ...]]:
    return [tuple(other for other in names if other != name) for name in names]
