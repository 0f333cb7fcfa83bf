"""The verdict in plain words, and what a technician should check."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jammkle_gap.core.result import Verdict
from jammkle_gap.report import words
from jammkle_gap.report.rendering import rendered
from jammkle_gap.report.sections.traces import overview

if TYPE_CHECKING:
    from markupsafe import Markup

    from jammkle_gap.core.result import Diagnosis
    from jammkle_gap.report.asked import Asked

_TONES = {Verdict.NO_GAP: "good", Verdict.EFFECTS: "found", Verdict.AMBIGUOUS: "open", Verdict.UNKNOWN: "bad"}


def section(diagnosis: Diagnosis, asked: Asked) -> Markup:
    """Return the section as HTML."""
    picture = overview(diagnosis)
    return rendered(
        __package__,
        "verdict.html.j2",
        verdict=diagnosis.verdict.value.replace("_", " "),
        tone=_TONES[diagnosis.verdict],
        finished=diagnosis.finished,
        answers=words.answers(diagnosis),
        signal=picture[0] if picture else "",
        picture=picture[1] if picture else "",
        headline=words.headline(diagnosis),
        is_unknown=diagnosis.verdict is Verdict.UNKNOWN,
        checks=words.checks(diagnosis, asked.sentences),
        explanation=words.explanation(diagnosis),
        corrected=words.corrected_note(diagnosis, asked.corrected),
        asked=asked,
    )
