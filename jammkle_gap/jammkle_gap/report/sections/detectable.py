"""What an ideal diagnosis could have seen in these recordings: fitted sizes beside the smallest that are detectable."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jammkle_gap.report import words
from jammkle_gap.report.parameters import parameter_lines
from jammkle_gap.report.rendering import rendered

if TYPE_CHECKING:
    from markupsafe import Markup

    from jammkle_gap.core.result import Diagnosis
    from jammkle_gap.report.asked import Asked


def section(diagnosis: Diagnosis, asked: Asked) -> Markup:
    """Return the section as HTML."""
    del asked
    effects = {effect.name: effect for each in diagnosis.candidates for effect in each.effects}
    return rendered(
        __package__,
        "detectable.html.j2",
        title=words.effects_title(diagnosis),
        lines=parameter_lines(diagnosis.effects),
        others=parameter_lines([effect for effect in effects.values() if effect not in diagnosis.effects]),
    )
