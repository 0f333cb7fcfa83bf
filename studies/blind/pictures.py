"""Curves of the page: how large an effect must be to be seen, and whether stated probabilities come true."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
from matplotlib.figure import Figure as Sheet

from jammkle_common.command.results import STYLE
from studies.blind.outcomes import SIZES

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes

    from studies.blind.ways import Way

_COLOURS = ("#1f5fa8", "#7a9cc6", "#d9741a", "#b3261e", "#1b6e2c", "#7b4bab")
_TEXT: dict[Any, Any] = {"svg.fonttype": "none", "font.family": "sans-serif", "svg.hashsalt": "jammkle blind"}
_APART = 1.04
"""Points of the ways stand this far apart, as a factor, so that all intervals are seen."""


def detection_svg(ways: Sequence[Way]) -> str:
    """Return shares of single effects that were seen, and that were named first, by size; Wilson intervals."""
    with mpl.rc_context({**STYLE, **_TEXT}):
        sheet = Sheet(figsize=(10.0, 3.4))
        seen, named = sheet.subplots(1, 2, sharey=True)
        for axes, prefix, title in (
            (seen, "detected_at_", "seen: anything but “no gap”"),
            (named, "top_1_at_", "right name first"),
        ):
            for place, way in enumerate(ways):
                _points(axes, way, prefix, place)
            axes.set(xscale="log", xlabel="size of the effect [what an ideal detector needs]", ylim=(-0.03, 1.03))
            axes.set_xticks(SIZES, [f"{size:g}" for size in SIZES])
            axes.minorticks_off()
            axes.set_title(title, loc="left")
        seen.set_ylabel("share of cases")
        if seen.get_legend_handles_labels()[0]:
            seen.legend(loc="lower right", fontsize="x-small")
        return _svg(sheet)


def calibration_svg(ways: Sequence[Way]) -> str:
    """Return how often answers came true by the probability that was stated for them."""
    with mpl.rc_context({**STYLE, **_TEXT}):
        sheet = Sheet(figsize=(4.8, 4.0))
        axes = sheet.subplots()
        axes.plot([0, 1], [0, 1], color="#999999", linewidth=0.8, linestyle=(0, (4, 2)))
        for place, way in enumerate(ways):
            x = [each.stated for each in way.bins]
            y = [each.true.value for each in way.bins]
            low = [each.true.value - each.true.interval[0] for each in way.bins]
            high = [each.true.interval[1] - each.true.value for each in way.bins]
            axes.errorbar(x, y, [low, high], fmt="o-", markersize=4, color=_COLOURS[place], label=way.name)
        axes.set(
            xlabel="probability that was stated", ylabel="share that came true", xlim=(0, 1.02), ylim=(-0.03, 1.03)
        )
        if axes.get_legend_handles_labels()[0]:
            axes.legend(loc="upper left", fontsize="x-small")
        return _svg(sheet)


def _points(axes: Axes, way: Way, prefix: str, place: int) -> None:
    found = [(size, way.figures[f"{prefix}{size:g}"]) for size in SIZES if f"{prefix}{size:g}" in way.figures]
    if not found:
        return
    ends = [figure.interval or (figure.value, figure.value) for _, figure in found]
    low = [max(figure.value - end[0], 0.0) for (_, figure), end in zip(found, ends, strict=True)]
    high = [max(end[1] - figure.value, 0.0) for (_, figure), end in zip(found, ends, strict=True)]
    axes.errorbar(
        [size * _APART**place for size, _ in found],
        [figure.value for _, figure in found],
        [low, high],
        fmt="o-",
        markersize=4,
        color=_COLOURS[place],
        label=way.name,
    )


def _svg(sheet: Sheet) -> str:
    file = io.StringIO()
    sheet.tight_layout()
    sheet.savefig(file, format="svg", metadata={"Date": None, "Creator": None})
    return file.getvalue()
