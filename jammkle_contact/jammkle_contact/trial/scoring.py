"""How well events fit the truth: one to one in time, with recall, precision, delay, and intervals."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jammkle_contact.story import Slide

Z_95 = 1.959964
"""Quantile of the normal distribution for intervals of 95 %."""
_RESAMPLES = 1000

WINDOWS_S = {"impact": (-0.02, 0.06), "lift-off": (-0.06, 0.15), "slip": (-0.005, 0.05)}
"""From how long before to how long after the truth an event counts as it, s. For a slip the
second counts from the slide's end, at most to `LATEST_SLIP_S`. A lift-off counts from the unloading on and for half of
a short swing."""

UNCLEAR_S = WINDOWS_S["impact"]
"""The same for what need not be told, whether a touch or its loss: a foot that rebounds is back after 60 ms, s."""

LATEST_SLIP_S = 0.2
"""So long after a slide's begin its slip must be told, s: as long as slides within a step last. Who slides down a slope
for a second is hit by something, and what tells of that has not felt the slip."""


@dataclass
class Score:
    """Counts of one kind of event, pooled over stories."""

    hits: int = 0
    missed: int = 0
    false: int = 0
    delays_s: list[float] = field(default_factory=list)
    ways_m: list[float] = field(default_factory=list)
    """How far the foot had slid when the slip was told, m."""

    def add(self, other: Score) -> None:
        """Pool another one into this."""
        self.hits += other.hits
        self.missed += other.missed
        self.false += other.false
        self.delays_s += other.delays_s
        self.ways_m += other.ways_m

    @property
    def recall(self) -> tuple[float, float, float]:
        """Share of the true events that were told, with its interval."""
        return wilson(self.hits, self.hits + self.missed)

    @property
    def precision(self) -> tuple[float, float, float]:
        """Share of the told events that are true, with its interval."""
        return wilson(self.hits, self.hits + self.false)


def wilson(hits: int, of: int) -> tuple[float, float, float]:
    """Return a share and its 95 % interval (Wilson, J. Am. Stat. Assoc. 22, 1927); NaN of nothing."""
    if of == 0:
        return (math.nan, math.nan, math.nan)
    share = hits / of
    centre = (share + Z_95**2 / (2 * of)) / (1 + Z_95**2 / of)
    half = Z_95 * math.sqrt(share * (1 - share) / of + Z_95**2 / (4 * of**2)) / (1 + Z_95**2 / of)
    return (share, max(0.0, centre - half), min(1.0, centre + half))


def median_with_interval(values: Sequence[float]) -> tuple[float, float, float]:
    """Return the median and its 95 % bootstrap interval (Efron 1979); NaN of nothing."""
    if not values:
        return (math.nan, math.nan, math.nan)
    array = np.array(values)
    chance = np.random.default_rng(1)
    medians = np.median(chance.choice(array, (_RESAMPLES, len(array))), axis=1)
    low, high = np.percentile(medians, (2.5, 97.5))
    return (float(np.median(array)), float(low), float(high))


def score_times(truth_s: Sequence[float], told_s: Sequence[float], kind: str, unclear_s: Sequence[float] = ()) -> Score:
    """Match told times to true ones in order, each at most once.

    Args:
        truth_s: What must be told, s.
        told_s: What was told, s.
        kind: Of the events: a key of `WINDOWS_S`.
        unclear_s: What may be told and need not: a rebound, or the graze of a foot that swings. Within `UNCLEAR_S` of
            it an event is neither right nor wrong.

    """
    before_s, after_s = WINDOWS_S[kind]
    score = Score()
    free = sorted(told_s)
    for true_s in sorted(truth_s):
        inside = [at_s for at_s in free if true_s + before_s <= at_s <= true_s + after_s]
        if inside:
            score.hits += 1
            score.delays_s.append(inside[0] - true_s)
            free.remove(inside[0])
        else:
            score.missed += 1
    before_s, after_s = UNCLEAR_S
    score.false = sum(not any(at + before_s <= told <= at + after_s for at in unclear_s) for told in free)
    return score


def score_slides(slides: Sequence[Slide], told_s: Sequence[float]) -> Score:
    """Match slips to slides: the first within one counts, if it comes in time; more are neither right nor wrong."""
    before_s, after_s = WINDOWS_S["slip"]
    score = Score()
    free = sorted(told_s)
    for slide in slides:
        inside = [at_s for at_s in free if slide.begin_s + before_s <= at_s <= slide.end_s + after_s]
        free = [at_s for at_s in free if at_s not in inside]
        if not inside or inside[0] > slide.begin_s + LATEST_SLIP_S:
            score.missed += 1
            continue
        score.hits += 1
        score.delays_s.append(inside[0] - slide.begin_s)
        score.ways_m.append(slide.way_at_m(inside[0]))
    score.false = len(free)
    return score
