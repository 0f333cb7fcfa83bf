"""What was said of recordings of real machines, beside what is known of them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Sequence


@dataclass(frozen=True)
class RealCase:
    """One set of recordings."""

    name: str
    known: str
    """What was found out beforehand, by other means."""
    verdict: str
    said: str
    """Candidates; with UNKNOWN: leads."""
    closed: float
    """Share of the gap, held out; not a number where there was nothing to close."""
    as_known: bool
    """Whether what was said is what is known."""


def as_rows(cases: Sequence[RealCase]) -> list[dict[str, Any]]:
    """Return what JSON can hold."""
    return [
        {
            "recordings": each.name,
            "known": each.known,
            "verdict": each.verdict,
            "said": each.said,
            "closed": None if math.isnan(each.closed) else each.closed,
            "as_known": each.as_known,
        }
        for each in cases
    ]
