"""What a reader should know beside the answer: notes on the recordings, why this verdict, what it took."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jammkle_gap.report.rendering import rendered

if TYPE_CHECKING:
    from markupsafe import Markup

    from jammkle_gap.core.result import Diagnosis
    from jammkle_gap.report.asked import Asked


def section(diagnosis: Diagnosis, asked: Asked) -> Markup:
    """Return the section as HTML."""
    spent = diagnosis.spent
    return rendered(
        __package__,
        "notes.html.j2",
        notes=diagnosis.notes,
        reasons=diagnosis.reasons,
        rate=f"{100.0 * diagnosis.false_alarm_rate:g} %",
        origin=asked.origin,
        offered=len(asked.sentences),
        wall=f"{spent.wall_s:.0f}",
        runs=spent.runs,
        simulated=f"{spent.simulated_s:.0f}",
    )
