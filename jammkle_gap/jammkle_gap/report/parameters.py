"""Lines of fitted parameters, as text, for the page and for the terminal."""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING

from jammkle_gap.report.quantities import known, span

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jammkle_gap.core.result import FittedEffect


def _without_unit(name: str, unit: str) -> str:
    """Return a parameter's name without the unit at its end: `conductance` for `conductance_dm3_s_bar`."""
    end = "_".join(re.findall(r"[a-z0-9]+", unit.lower()))
    return name.removesuffix(f"_{end}")


def parameter_lines(effects: Sequence[FittedEffect]) -> list[dict[str, str]]:
    """Return one line per parameter of each effect."""
    return [
        {
            "effect": effect.name,
            "subsystem": effect.subsystem,
            "sentence": effect.sentence,
            "parameter": each.name,
            "quantity": _without_unit(each.name, each.unit),
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
