"""Lines of fitted parameters, as text, for the page and for the terminal."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from jammkle_gap.report.quantities import known, span

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jammkle_gap.core.result import FittedEffect


def parameter_lines(effects: Sequence[FittedEffect]) -> list[dict[str, str]]:
    """Return one line per parameter of each effect."""
    return [
        {
            "effect": effect.name,
            "subsystem": effect.subsystem,
            "sentence": effect.sentence,
            "parameter": each.name,
            "value": known(each.value, each.interval, each.unit),
            "interval": span(each.value, each.interval, each.unit),
            "detectable": known(each.detectable, each.interval, each.unit)
            if math.isfinite(each.detectable)
            else "none within its bounds",
            "remark": "at a bound: the truth may lie beyond" if each.at_bound else "",
        }
        for effect in effects
        for each in effect.parameters
    ]
