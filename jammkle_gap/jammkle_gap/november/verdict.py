"""The verdict: no gap, named effects, a set that cannot be split, or unknown. A wrong name is the worst of answers."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING

from jammkle_gap.november.explanations import at_stake, closed_of, explaining_ones, material, set_around, still_off

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jammkle_gap.november.limits import Limits
    from jammkle_gap.november.residual import Layout
    from jammkle_gap.november.scoring import Score


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
    closed = closed_of(layout, nominal, best, limits)

    def answer(verdict: Verdict, *reasons: str) -> Judgement:
        explaining = explaining_ones(layout, best, scores, criteria)
        return Judgement(verdict, tuple(kept), nominal_ratio, left_ratio, closed, reasons, explaining)

    def leads(*reasons: str) -> Judgement:
        """Return what explains most, though no one part of it is proven: with UNKNOWN nothing is named anyway."""
        top = material(layout, [max(scores, key=lambda score: score.total)], scores, criteria, limits)[0]
        spare = criteria.material_share * at_stake(layout, nominal)
        if layout.gap_above_floor(top.held_out) < layout.gap_above_floor(best.held_out) - spare:
            share = 100.0 * closed_of(layout, nominal, top, limits)
            kept[:] = [top, *(each for each in kept if each.names != top.names)]
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
    utmost = closed_of(layout, nominal, chosen[0], limits)
    wanted = criteria.explained_share_within if left_ratio <= 1.0 else criteria.explained_share
    poor = still_off(layout, nominal, best, criteria, limits)
    if poor:
        still = layout.gaps(best.held_out)[poor[0]]
        return leads(where, f"{share}, but {poor[0]} is still off by {still:.1f} times its noise")
    if not max(closed, utmost) >= wanted:
        return leads(
            where,
            f"{share}; {left_signal} is still off by {left_gap:.1f} times its noise",
            f"what explains a gap must close {100.0 * wanted:.0f} % of it",
        )
    kept = set_around(layout, best, kept, scores, criteria, limits)
    if len(kept) > 1:
        left_ratio, closed = limits.worst(layout, kept[0].held_out)[2], closed_of(layout, nominal, kept[0], limits)
        others = "; ".join(" + ".join(score.names) or "no effect" for score in kept[1:])
        alike = f"not told from it, by scores, by what is left, or by what the simulator may be off: {others}"
        return answer(Verdict.AMBIGUOUS, where, _said(kept[0], closed), alike)
    return answer(Verdict.EFFECTS, where, share, "no other candidate explains it as well")


def _said(candidate: Score, closed: float) -> str:
    names = " + ".join(candidate.names)
    return f"{names} closes {100.0 * closed:.0f} % of the gap of the signals that are off, on held-out data"
