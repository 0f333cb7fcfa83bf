"""The verdict: no gap, named effects, a set that cannot be split, or unknown. A wrong name is the worst of answers."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING

import numpy as np

from jammkle_sim.gap.alike import does_the_same
from jammkle_sim.gap.closing import closed_share
from jammkle_sim.gap.scoring import difference

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jammkle_sim.gap.limits import Limits
    from jammkle_sim.gap.residual import Layout
    from jammkle_sim.gap.scoring import Score

_EDGE = 1.2
"""A signal that is beyond its limit by less, with an effect and without, speaks neither against an effect that explains
what is far beyond, nor for another one beside it. Assumed: limits are known no better."""


class Verdict(Enum):
    """What a diagnosis says."""

    NO_GAP = "NO_GAP"
    """Simulation and recordings agree within the noise."""
    EFFECTS = "EFFECTS"
    """One set of effects explains the gap, and no other does."""
    AMBIGUOUS = "AMBIGUOUS"
    """Several sets of effects explain it, and this data cannot tell them apart."""
    UNKNOWN = "UNKNOWN"
    """Something real is left that no candidate explains."""


@dataclass(frozen=True)
class Criteria:
    """What a gap has to be before it is named, and what a candidate has to explain. Assumed, and to be calibrated."""

    worth_gap: float = 1.5
    """Largest gap of any signal that counts as none, noise units; also what a named effect may leave. No simulator is
    perfect, and a noise is known to some 10 %."""
    worth_gap_with_references: float = 1.2
    """The same, where references took the simulator's own faults off."""
    explained_share: float = 0.9
    """Share of the gap above the floor that a candidate has to close, held out, over all signals that are off."""
    explained_share_within: float = 0.75
    """The same, where every signal is left with what counts as none: of a small gap much is chance."""
    explained_share_each: float = 0.8
    """The same, of every single signal that is left with a gap."""
    material_share: float = 0.035
    """A further effect has to close at least this share of the gap, or it is not named, not even as a lead."""
    temperature: float = 2.0
    """Of the probabilities: differences of scores are divided by it. Above 1: scores are too sure of themselves."""
    sharpness: float = 10.0
    """How fast the probability of `no gap` and `unknown` falls with the distance from the limits above."""


@dataclass(frozen=True)
class Judgement:
    """A verdict, what it stands on, and why."""

    verdict: Verdict
    chosen: tuple[Score, ...]
    """What explains the gap best, best first; with UNKNOWN: what explains a part, as a lead."""
    nominal: float
    """Gap of the worst signal, in what counts as none."""
    left: float
    """The same with the best candidate, held out."""
    closed: float
    """By the best candidate, held out."""
    reasons: tuple[str, ...]
    explaining: frozenset[tuple[str, ...]]
    """Candidates that leave no more of the gap than an explanation may, beside the best."""


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
        each for each in scores if not each.names or _closed(layout, nominal, each, limits) > criteria.material_share
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
            if not enough and gained > criteria.material_share * _at_stake(layout, by_names[()]):
                break
            if _poor(layout, by_names[()], simpler, criteria, limits) and not _poor(
                layout, by_names[()], current, criteria, limits
            ):
                break
            current = simpler
        if current.names not in [one.names for one in kept]:
            kept.append(current)
    return [each for each in kept if not any(set(other.names) < set(each.names) for other in kept)]


def _set_around(
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
    explaining = _explaining(layout, best, scores, criteria)
    closing = {score.names for score in material_ones(layout, scores, criteria, limits)}

    def is_rival(other: Score) -> bool:
        if not other.names or len(other.names) > len(best.names) or set(other.names) <= set(best.names):
            return False
        if other.names not in explaining or other.names not in closing:
            return False
        if limits.do_not_tell(layout, best.held_out, other.held_out):
            return True
        parts = [by_names[names] for names in (*_parts(other.names), ()) if names in by_names]
        earned = all(difference(other, part).told_apart for part in parts)
        if earned and not difference(best, other).told_apart:
            return True
        return does_the_same(layout, by_names[()].fit, best.fit, other.fit)

    near = [score for score in kept if score is best or score.names in explaining]
    found = {score.names: score for score in (*near, *filter(is_rival, scores))}

    def rank(score: Score) -> tuple[bool, int, float]:
        # Of what foretells as well, the simplest comes first.
        return difference(best, score).told_apart, score.fit.point.size, -score.total

    return sorted(found.values(), key=rank)


def _explaining(layout: Layout, best: Score, scores: Sequence[Score], criteria: Criteria) -> frozenset[tuple[str, ...]]:
    """Return the candidates that leave at most as much more than the best as an explanation may leave of all."""
    nominal = next(score for score in scores if not score.names)
    utmost = layout.gap_above_floor(best.held_out) + (1.0 - criteria.explained_share) * _at_stake(layout, nominal)
    return frozenset(each.names for each in scores if layout.gap_above_floor(each.held_out) <= utmost)


def _at_stake(layout: Layout, nominal: Score) -> float:
    """Return what there is to close: the gap above the floor."""
    return layout.gap_above_floor(nominal.held_out) - 1.0


def _closed(layout: Layout, nominal: Score, candidate: Score, limits: Limits) -> float:
    """Return how much is closed over the signals that are off before or after: what is none need not be explained."""
    before, after = layout.gaps(nominal.held_out), layout.gaps(candidate.held_out)
    off = [name for name in layout.names if max(before[name], after[name]) > limits.of_signal[name]]
    if not off:
        return float("nan")
    first, last = (float(np.sqrt(np.mean([max(gaps[name], 1.0) ** 2 for name in off]))) for gaps in (before, after))
    return closed_share(first, last, len(off))


def _poor(layout: Layout, nominal: Score, candidate: Score, criteria: Criteria, limits: Limits) -> list[str]:
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


def judge(
    layout: Layout, chosen: Sequence[Score], scores: Sequence[Score], criteria: Criteria, limits: Limits
) -> Judgement:
    """Return the verdict.

    Args:
        layout: Of the residuals.
        chosen: The set, best first.
        scores: Of all candidates fitted, the nominal simulator among them.
        criteria: What counts.
        limits: Largest gaps that count as none.

    """
    nominal = next(score for score in scores if not score.names)
    signal, nominal_gap, nominal_ratio = limits.worst(layout, nominal.held_out)
    kept = material(layout, chosen, scores, criteria, limits)
    best = kept[0]
    left_signal, left_gap, left_ratio = limits.worst(layout, best.held_out)
    closed = _closed(layout, nominal, best, limits)

    def answer(verdict: Verdict, *reasons: str) -> Judgement:
        explaining = _explaining(layout, best, scores, criteria)
        return Judgement(verdict, tuple(kept), nominal_ratio, left_ratio, closed, reasons, explaining)

    def leads(*reasons: str) -> Judgement:
        """Return what explains most, though no one part of it is proven: with UNKNOWN nothing is named anyway."""
        top = material(layout, [max(scores, key=lambda score: score.total)], scores, criteria, limits)[0]
        spare = criteria.material_share * _at_stake(layout, nominal)
        if layout.gap_above_floor(top.held_out) < layout.gap_above_floor(best.held_out) - spare:
            share = 100.0 * _closed(layout, nominal, top, limits)
            kept.insert(0, top)
            names = " + ".join(top.names)
            reasons = (*reasons, f"as a lead: {names} would close {share:.0f} %, but is not clearly better")
        return answer(Verdict.UNKNOWN, *reasons)

    if nominal_ratio <= 1.0:
        kept = [nominal]
        left_ratio = nominal_ratio
        return answer(
            Verdict.NO_GAP,
            f"{signal} is off most, by {nominal_gap:.2f} times its noise; up to {limits.of_signal[signal]:.2f} "
            "counts as none there",
        )
    where = f"{signal} is off by {nominal_gap:.1f} times its noise"
    if not best.names:
        return leads(where, "no candidate foretells held-out data clearly better than no effect")
    share = _said(best, closed)
    # Also what a small gap leaves, though it would count as none, must not be much of it.
    utmost = _closed(layout, nominal, chosen[0], limits)
    wanted = criteria.explained_share_within if left_ratio <= 1.0 else criteria.explained_share
    poor = _poor(layout, nominal, best, criteria, limits)
    if poor:
        still = layout.gaps(best.held_out)[poor[0]]
        return leads(where, f"{share}, but {poor[0]} is still off by {still:.1f} times its noise")
    if not max(closed, utmost) >= wanted:
        return leads(
            where,
            f"{share}; {left_signal} is still off by {left_gap:.1f} times its noise",
            f"what explains a gap must close {100.0 * wanted:.0f} % of it",
        )
    kept = _set_around(layout, best, kept, scores, criteria, limits)
    if len(kept) > 1:
        left_ratio, closed = limits.worst(layout, kept[0].held_out)[2], _closed(layout, nominal, kept[0], limits)
        others = "; ".join(" + ".join(score.names) or "no effect" for score in kept[1:])
        alike = f"within two standard errors of the best, or no further off than the simulator may be: {others}"
        return answer(Verdict.AMBIGUOUS, where, _said(kept[0], closed), alike)
    return answer(Verdict.EFFECTS, where, share, "no other candidate is within two standard errors of it")


def _said(candidate: Score, closed: float) -> str:
    names = " + ".join(candidate.names)
    return f"{names} closes {100.0 * closed:.0f} % of the gap of the signals that are off, on held-out data"
