"""The page of a diagnosis: one HTML file that needs no network, read in two minutes and then dug into."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jammkle_gap.report.rendering import rendered
from jammkle_gap.report.sections import (
    calibration,
    closing,
    detectable,
    identifiability,
    notes,
    posterior,
    traces,
    verdict,
    where,
)

if TYPE_CHECKING:
    from jammkle_gap.core.result import Diagnosis
    from jammkle_gap.report.asked import Asked

_SECTIONS = (verdict, posterior, traces, detectable, where, closing, identifiability, calibration, notes)
"""In the order of the page."""


def page(diagnosis: Diagnosis, asked: Asked) -> str:
    """Return the page as HTML."""
    return str(
        rendered(
            __package__,
            "page.html.j2",
            title=f"{diagnosis.verdict.value.replace('_', ' ')}: {', '.join(asked.bags)}",
            sections=[each.section(diagnosis, asked) for each in _SECTIONS],
        )
    )
