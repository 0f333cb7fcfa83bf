"""Tables of outcomes: short by kind and size, and the whole confusion matrix."""

from __future__ import annotations

import collections
from typing import TYPE_CHECKING

from studies.blind.answers import Said
from studies.blind.key import Kind
from studies.blind.outcomes import Outcome, answer_label, label, level

if TYPE_CHECKING:
    from collections.abc import Sequence

    from studies.blind.scoring import Case


def kind_label(case: Case) -> str:
    """Return the row of the short confusion matrix."""
    reached = level(case.truth)
    if case.truth.kind is Kind.OUTSIDE:
        return "outside the library, below 1" if reached == 0.0 else "outside the library"
    if case.truth.kind is not Kind.SINGLE:
        return {Kind.NONE: "healthy", Kind.PAIR: "pair", Kind.MIDRUN: "change in mid-run"}[case.truth.kind]
    return "single effect" if reached is None else f"single, size {reached:g}" if reached else "single, below 1"


def outcomes_by_kind(cases: Sequence[Case]) -> dict[str, collections.Counter[str]]:
    """Count outcomes by what was true."""
    table: dict[str, collections.Counter[str]] = {}
    for case in sorted(cases, key=lambda each: (list(Kind).index(each.truth.kind), level(each.truth) or 0.0)):
        table.setdefault(kind_label(case), collections.Counter())[case.outcome.value] += 1
    return table


def outcome_names() -> tuple[str, ...]:
    """Return the columns of the short confusion matrix."""
    return tuple(each.value for each in Outcome)


def confusion(cases: Sequence[Case]) -> tuple[list[str], list[str], dict[tuple[str, str], int]]:
    """Return rows (what is true), columns (what was said) and counts of the whole confusion matrix."""
    counts = collections.Counter((label(case.truth), answer_label(case.answer)) for case in cases)
    rows = sorted({row for row, _ in counts})
    columns = sorted({column for _, column in counts})
    last = [each.value for each in (Said.NO_GAP, Said.UNKNOWN, Said.REFUSED) if each.value in columns]
    return rows, [each for each in columns if each not in last] + last, dict(counts)
