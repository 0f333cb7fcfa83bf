"""Calibration: which constants of the machine its references moved, and how well the simulator then fits them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jammkle_gap.report.machine import constant_lines
from jammkle_gap.report.quantities import times
from jammkle_gap.report.rendering import rendered

if TYPE_CHECKING:
    from markupsafe import Markup

    from jammkle_gap.core.result import Diagnosis
    from jammkle_gap.report.asked import Asked


def section(diagnosis: Diagnosis, asked: Asked) -> Markup:
    """Return the section as HTML."""
    left = diagnosis.references_left
    return rendered(
        __package__,
        "calibration.html.j2",
        has_references=bool(asked.references),
        lines=constant_lines(diagnosis, asked.constants),
        left=times(max(left, 0.0) ** 0.5),
    )
