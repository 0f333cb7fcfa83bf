"""How far the gap closes with the best candidate: over all, per signal in its unit, in settings held out."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jammkle_gap.report import words
from jammkle_gap.report.quantities import percent, percents, quantities, times
from jammkle_gap.report.rendering import rendered

if TYPE_CHECKING:
    from markupsafe import Markup

    from jammkle_gap.core.result import Closing, Diagnosis
    from jammkle_gap.report.asked import Asked

_CLEAR = 1.5
"""Gap of a signal above which its line stands out. Chosen: healthy runs hardly ever leave so much."""


def signal_lines(diagnosis: Diagnosis) -> list[dict[str, str]]:
    """Return the gap of every signal before and after, largest first."""
    physical = {
        each.signal: quantities((each.scatter_physical, each.nominal_physical, each.corrected_physical), each.unit)
        for each in diagnosis.signals
    }
    return [
        {
            "signal": each.signal,
            **dict(zip(("scatter", "nominal_physical", "corrected_physical"), physical[each.signal], strict=True)),
            "nominal": times(each.nominal),
            "corrected": times(each.corrected),
            "tone": "" if each.nominal > _CLEAR else "quiet",
        }
        for each in sorted(diagnosis.signals, key=lambda one: -one.nominal)
    ]


def closing_line(name: str, closing: Closing) -> dict[str, str]:
    """Return one closing as text."""
    return {
        "name": name,
        "nominal": times(closing.nominal),
        "corrected": times(closing.corrected),
        "closed": percent(closing.closed),
        "interval": percents(closing.interval),
    }


def section(diagnosis: Diagnosis, asked: Asked) -> Markup:
    """Return the section as HTML."""
    del asked
    return rendered(
        __package__,
        "closing.html.j2",
        best=" + ".join(words.label(effect.name) for effect in diagnosis.effects),
        overall=closing_line("all recordings", diagnosis.gap),
        held_out=[closing_line(each.setting, each.closing) for each in diagnosis.held_out],
        settings=len({each.setting for each in diagnosis.traces}),
        signals=signal_lines(diagnosis),
    )
