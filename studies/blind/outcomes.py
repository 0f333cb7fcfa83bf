"""One answer beside one truth: what became of it."""

from __future__ import annotations

import enum
from typing import TYPE_CHECKING, Final

from studies.blind.answers import NO_GAP, UNKNOWN, Said
from studies.blind.key import Kind

if TYPE_CHECKING:
    from studies.blind.answers import Answer
    from studies.blind.key import Truth

SIZES: Final = (1.0, 2.0, 4.0, 8.0)
"""Sizes that figures are told apart by, in what an ideal detector needs."""
_NEARLY = 0.9
"""A case counts for a size that it misses by less than a tenth: sizes are a factor of two apart."""


class Outcome(enum.Enum):
    """What became of a case."""

    RIGHT = "right"
    """`EFFECTS` with exactly what is true; `NO_GAP` where nothing is wrong; `UNKNOWN` where the library has no name."""
    IN_SET = "in the set"
    """`AMBIGUOUS`, and the truth is one of the set."""
    PART = "part of it"
    """`EFFECTS` with one of two true ones and nothing else."""
    WRONG_SET = "wrong set"
    """`AMBIGUOUS` without the truth."""
    WRONG_NAME = "wrong name"
    """`EFFECTS` with one that is not true: the worst."""
    NOT_SEEN = "not seen"
    """`NO_GAP` where something is wrong."""
    NOT_EXPLAINED = "not explained"
    """`UNKNOWN` where the library has a name, or where nothing is wrong."""
    REFUSED = "refused"


def outcome(truth: Truth, answer: Answer) -> Outcome:
    """Judge one answer."""
    if answer.said is Said.REFUSED:
        return Outcome.REFUSED
    if answer.said is Said.NO_GAP:
        return Outcome.RIGHT if truth.kind is Kind.NONE else Outcome.NOT_SEEN
    if answer.said is Said.UNKNOWN:
        return Outcome.RIGHT if truth.kind is Kind.OUTSIDE else Outcome.NOT_EXPLAINED
    if answer.said is Said.AMBIGUOUS:
        return Outcome.IN_SET if is_in_set(truth, answer) else Outcome.WRONG_SET
    if is_first(truth, answer):
        return Outcome.RIGHT
    part = any(answer.is_same(answer.names, {name}) for name in truth.names) and truth.kind is Kind.PAIR
    return Outcome.PART if part else Outcome.WRONG_NAME


def is_first(truth: Truth, answer: Answer) -> bool:
    """Whether the truth, or an equivalent of it, is what is named first, alone or before others."""
    return bool(answer.candidates) and bool(truth.names) and answer.is_same(answer.names, truth.names)


def is_ranked_first(truth: Truth, answer: Answer) -> bool:
    """Whether the truth is the most probable candidate, whether or not it was named."""
    return bool(answer.ranking) and bool(truth.names) and answer.is_same(answer.ranking[0], truth.names)


def is_in_set(truth: Truth, answer: Answer, most: int | None = None) -> bool:
    """Whether the truth is one of the set, or of its first members."""
    return bool(truth.names) and any(answer.is_same(each, truth.names) for each in answer.candidates[:most])


def is_exact(truth: Truth, answer: Answer) -> bool:
    """Whether the set is complete and has no false member: the truth is in it, and nothing that is not true."""
    return is_in_set(truth, answer) and all(
        any(answer.is_same({name}, {true}) for true in truth.names) for each in answer.candidates for name in each
    )


def probability(truth: Truth, answer: Answer) -> float:
    """Return the probability that the answer puts on the truth; members of its class count."""
    if truth.kind is Kind.NONE:
        return answer.probabilities.get(NO_GAP, 0.0)
    if truth.kind is Kind.OUTSIDE:
        return answer.probabilities.get(UNKNOWN, 0.0)
    return sum(value for label, value in answer.probabilities.items() if means(label, truth, answer))


def means(label: str, truth: Truth, answer: Answer) -> bool:
    """Whether a label of the answer's probabilities is the truth."""
    if label in {NO_GAP, UNKNOWN}:
        return truth.kind is (Kind.NONE if label == NO_GAP else Kind.OUTSIDE)
    return bool(truth.names) and answer.is_same(label.split(" + "), truth.names)


def likeliest(answer: Answer) -> tuple[str, float]:
    """Return what the answer holds most likely, and how likely; members of a class add up."""
    totals: dict[str, float] = {}
    for label, value in answer.probabilities.items():
        alike = label.split(" + ")
        first = next((each for each in totals if answer.is_same(each.split(" + "), alike)), label)
        totals[first] = totals.get(first, 0.0) + value
    return max(totals.items(), key=lambda one: one[1], default=("", 0.0))


def label(truth: Truth) -> str:
    """Return the truth as a row of the confusion matrix."""
    if truth.kind is Kind.NONE:
        return Said.NO_GAP.value
    if truth.kind is Kind.OUTSIDE:
        return "outside the library"
    name = " + ".join(sorted(truth.names))
    return f"{name}, in mid-run" if truth.kind is Kind.MIDRUN else name


def answer_label(answer: Answer) -> str:
    """Return the answer as a column of the confusion matrix: a set goes by its first candidate."""
    if answer.said not in {Said.EFFECTS, Said.AMBIGUOUS}:
        return str(answer.said.value)
    name = " + ".join(sorted(answer.names)) or "no effect"
    return name if answer.said is Said.EFFECTS else f"{name}, or others"


def level(truth: Truth) -> float | None:
    """Return the largest of SIZES that a case reaches; 0 if none, None if its size is not known."""
    if truth.size is None:
        return None
    return max((size for size in SIZES if truth.size >= _NEARLY * size), default=0.0)


def is_visible(truth: Truth) -> bool:
    """Whether an ideal detector sees it; where its size is not known, it is taken to."""
    reached = level(truth)
    return reached is None or reached > 0.0
