"""Where the gap lies: signals by phases, and subsystems."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from jammkle_gap.report.quantities import percent, percents, times
from jammkle_gap.report.rendering import rendered

if TYPE_CHECKING:
    from collections.abc import Sequence

    from markupsafe import Markup

    from jammkle_gap.core.result import Diagnosis, Place
    from jammkle_gap.report.asked import Asked

PHASES = (
    "event", "evacuating", "holding", "venting", "falling", "loading", "unloading", "reversal", "impact", "rebound",
    "sliding", "still", "other", "whole run",
)  # fmt: skip
"""Columns of the heat map, in the order in which things happen; phases of other names stand before the last two."""
WORTH_SHARE = 0.005
"""Signals below this are put together."""


def section(diagnosis: Diagnosis, asked: Asked) -> Markup:
    """Return the section as HTML."""
    del asked
    return rendered(
        __package__,
        "where.html.j2",
        heat=heat_map(diagnosis.where),
        subsystems=[
            {"name": name, "percent": percent(value), "width": f"{220.0 * value:.1f}"}
            for name, value in diagnosis.subsystems.items()
        ],
    )


def heat_map(places: Sequence[Place]) -> dict[str, Any]:
    """Return the shares of signals by phases, signals with the largest share first."""
    shares: dict[str, float] = {}
    for place in places:
        shares[place.signal] = shares.get(place.signal, 0.0) + place.share
    signals = [name for name in sorted(shares, key=lambda name: -shares[name]) if shares[name] >= WORTH_SHARE]
    found = {place.phase for place in places if place.signal in signals}
    phases = [*(name for name in PHASES[:-2] if name in found), *sorted(found - set(PHASES))]
    phases += [name for name in PHASES[-2:] if name in found]
    cells = {(place.signal, place.phase): place for place in places}
    return {
        "phases": phases,
        "rows": [
            {
                "signal": name,
                "share": percent(shares[name]),
                "cells": [_cell(cells.get((name, phase))) for phase in phases],
            }
            for name in signals
        ],
        "left_out": len(shares) - len(signals),
    }


def _cell(place: Place | None) -> dict[str, Any] | None:
    if place is None:
        return None
    return {
        "share": percent(place.share),
        "interval": percents(place.interval),
        "gap": times(place.gap),
        "strength": round(math.sqrt(min(max(place.share, 0.0), 1.0)), 3),
    }
