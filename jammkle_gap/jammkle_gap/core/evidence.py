"""What a diagnosis is concluded from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

    from jammkle_gap.core.calibrate import Calibration
    from jammkle_gap.core.compare import Difference, Residuals, Setting
    from jammkle_gap.core.response import GridFeatures
    from jammkle_gap.core.search import Candidates
    from jammkle_gap.core.simulate import Problem


@dataclass(frozen=True)
class Evidence:
    """All that a diagnosis is concluded from."""

    problem: Problem
    settings: tuple[Setting, ...]
    nominal: tuple[Residuals, ...]
    """Of the machine as drawn."""
    residuals: tuple[Residuals, ...]
    """Of the machine that signatures were simulated with."""
    calibration: Calibration
    machine: Mapping[str, float]
    """Constants that signatures were simulated with: calibrated, or none where the nominal machine explains more."""
    difference: Difference
    """Whitened by scatter alone."""
    noticed: Candidates
    """Fitted to it: whether there is a gap."""
    candidates: Candidates
    """Fitted beside the simulator's own error where references are missing: which effect it is."""
    own: Mapping[tuple[str, ...], float]
    """Log-likelihood of each candidate in the settings without references, and of none of them, ()."""
    classes: tuple[tuple[str, ...], ...]
    grids: GridFeatures
