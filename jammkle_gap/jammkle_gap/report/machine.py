"""Constants of the machine as calibrated, as text."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from jammkle_gap.report.quantities import quantity

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jammkle_gap.core.effects import Nuisance
    from jammkle_gap.core.result import Diagnosis


def calibrated(constant: Nuisance, deviations: float) -> float:
    """Return the value of a constant that moved by some standard deviations of its prior, within its bounds."""
    return float(np.clip(constant.null + deviations * constant.sigma, constant.minimum, constant.maximum))


def constant_lines(diagnosis: Diagnosis, constants: Sequence[Nuisance]) -> list[dict[str, str]]:
    """Return one line per constant that references moved, largest move first."""
    known = {each.name: each for each in constants}
    return [
        {
            "name": name,
            "deviations": f"{moved:+.1f}",
            "nominal": quantity(known[name].null, known[name].unit) if name in known else "",
            "value": quantity(calibrated(known[name], moved), known[name].unit) if name in known else "",
            "source": known[name].source if name in known else "",
        }
        for name, moved in diagnosis.calibration.items()
    ]
