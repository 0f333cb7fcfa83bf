"""Equivalence classes that the diagnosis declared, and what would split them."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from studies.blind.answers import Answer
    from studies.blind.scoring import Case


@dataclass(frozen=True)
class NotApart:
    """Two effects that the sensors of at least one rig cannot tell apart."""

    first: str
    second: str
    declared: Mapping[str, tuple[int, int]]
    """By rig: in how many cases they were declared equivalent, and of how many."""
    instrumented_splits: tuple[str, ...]
    """Rigs on which tension and extension of every tendon would tell them apart."""
    told_on: tuple[str, ...]
    """Rigs whose own sensors tell them apart: the experiment to make."""

    @property
    def way_out(self) -> str:
        """What would split them."""
        ways = [f"rig {rig}" for rig in self.told_on]
        ways += [f"instrumented tendons on rig {rig}" for rig in self.instrumented_splits]
        return ", ".join(ways) or "a sensor that no rig of the trial has, such as a flow meter in each line"


def not_apart(headline: Sequence[Case], instrumented: Sequence[Case]) -> list[NotApart]:
    """Return every pair of effects that is in a class of some case; those that no rig tells apart first.

    Args:
        headline: Cases diagnosed with the sensors of their rigs.
        instrumented: The same with instrumented tendons, as far as that was asked.

    """
    own, better = _by_rig(headline), _by_rig(instrumented)
    pairs = sorted({pair for answers in own.values() for answer in answers for pair in _pairs(answer)})
    found = []
    for pair in pairs:
        counts = {rig: (sum(pair in _pairs(each) for each in answers), len(answers)) for rig, answers in own.items()}
        told = tuple(
            rig
            for rig, (count, _) in counts.items()
            if count == 0 and not all(set(pair) <= each.silent for each in own[rig])
        )
        splits = tuple(
            rig
            for rig, answers in better.items()
            if counts.get(rig, (0, 0))[0] and not any(pair in _pairs(each) for each in answers)
        )
        declared = {rig: count for rig, count in counts.items() if count[0]}
        found.append(NotApart(*pair, declared, splits, told))
    return sorted(found, key=lambda each: (bool(each.told_on), each.first, each.second))


def as_rows(pairs: Sequence[NotApart]) -> list[dict[str, Any]]:
    """Return what JSON can hold."""
    return [
        {
            "effects": [each.first, each.second],
            "declared": {rig: list(count) for rig, count in each.declared.items()},
            "split_by": each.way_out,
        }
        for each in pairs
    ]


def _by_rig(cases: Sequence[Case]) -> dict[str, list[Answer]]:
    found: dict[str, list[Answer]] = {}
    for case in cases:
        if case.truth.rigs and case.answer.probabilities:
            found.setdefault(", ".join(case.truth.rigs), []).append(case.answer)
    return dict(sorted(found.items()))


def _pairs(answer: Answer) -> set[tuple[str, str]]:
    return {pair for members in answer.classes for pair in itertools.combinations(sorted(members), 2)}
