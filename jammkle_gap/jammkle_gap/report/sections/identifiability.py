"""Identifiability: what these recordings cannot tell apart or not see at all, and which run would."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jammkle_gap.core.result import Verdict
from jammkle_gap.report import words
from jammkle_gap.report.rendering import rendered

if TYPE_CHECKING:
    from markupsafe import Markup

    from jammkle_gap.core.result import Diagnosis
    from jammkle_gap.report.asked import Asked


def section(diagnosis: Diagnosis, asked: Asked) -> Markup:
    """Return the section as HTML."""
    named = {name for each in diagnosis.candidates for name in each.names}
    classes = sorted(diagnosis.classes, key=lambda members: not named & set(members))
    return rendered(
        __package__,
        "identifiability.html.j2",
        following=diagnosis.next_experiment,
        following_sentence=words.next_sentence(diagnosis),
        is_unknown=diagnosis.verdict is Verdict.UNKNOWN,
        classes=[
            {"members": ", ".join(map(words.label, members)), "named": bool(named & set(members))}
            for members in classes
        ],
        silent=[words.label(name) for name in diagnosis.silent],
        sensors=asked.sensors,
        rigs=", ".join(asked.rigs),
    )
