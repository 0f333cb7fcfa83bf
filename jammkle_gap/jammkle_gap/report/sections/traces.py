"""Signatures beside the data, in the features that the decision was made on, most telling first."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from jammkle_gap.report import words
from jammkle_gap.report.quantities import times
from jammkle_gap.report.rendering import TEXT, embedded, rendered
from jammkle_graph.command.figures import STYLE

if TYPE_CHECKING:
    from markupsafe import Markup
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from jammkle_gap.core.result import Diagnosis, Trace
    from jammkle_gap.report.asked import Asked

SHOWN_AT_ONCE = 3
MOST_TRACES = 36
"""Traces that are drawn at most: the page stays below 5 MB."""
_BYTES = 2.6e6
"""What all curves together may take, before they are written as base64."""
_BYTES_PER_STRETCH = 260.0
"""Of the curves of one trace. Measured."""
_FEWEST_STRETCHES, _MOST_STRETCHES = 60, 300
_MEASURED, _SIMULATED, _SIGNATURE = "#333333", "#d9741a", "#1f5fa8"


def gap_of(trace: Trace) -> float:
    """Return the root mean square of a trace's difference, in healthy scatter."""
    return float(np.sqrt(np.square(trace.difference / trace.scatter).mean()))


def left_of(trace: Trace) -> float:
    """Return the same of what the signature leaves."""
    return float(np.sqrt(np.square((trace.difference - trace.signature) / trace.scatter).mean()))


def most_telling(diagnosis: Diagnosis) -> list[Trace]:
    """Return the traces by their signal's share of the squared whitened difference, then by their own gap."""
    shares: dict[str, float] = {}
    for place in diagnosis.where:
        shares[place.signal] = shares.get(place.signal, 0.0) + place.share
    return sorted(diagnosis.traces, key=lambda each: (-shares.get(each.signal, 0.0), -gap_of(each)))


def section(diagnosis: Diagnosis, asked: Asked) -> Markup:
    """Return the section as HTML."""
    ordered = most_telling(diagnosis)[:MOST_TRACES]
    allowed = int(_BYTES / (_BYTES_PER_STRETCH * max(len(ordered), 1)))
    stretches = min(max(allowed, _FEWEST_STRETCHES), _MOST_STRETCHES)
    several = len({each.setting for each in diagnosis.traces}) > 1
    best = " + ".join(words.label(effect.name) for effect in diagnosis.effects)
    drawn = [
        {
            "title": f"{each.signal} ({each.setting})" if several else each.signal,
            "gap": times(gap_of(each)),
            "left": times(left_of(each)),
            "image": _picture(each, best, stretches),
        }
        for each in ordered
    ]
    return rendered(
        __package__,
        "traces.html.j2",
        first=drawn[:SHOWN_AT_ONCE],
        others=drawn[SHOWN_AT_ONCE:],
        left_out=len(diagnosis.traces) - len(ordered),
        best=best,
        has_references=bool(asked.references),
    )


def _picture(trace: Trace, best: str, stretches: int) -> Markup:
    with mpl.rc_context({**STYLE, **TEXT}):
        figure = Figure(figsize=(10.0, 2.7))
        figure.subplots_adjust(left=0.09, right=0.995, bottom=0.17, top=0.86, wspace=0.17)
        left, right = figure.subplots(1, 2, sharex=True, width_ratios=[1.0, 1.25])
        _draw(
            left, trace.time_s, trace.measured, stretches, color=_MEASURED, label="measured", alpha=0.6, linewidth=1.8
        )
        _draw(
            left, trace.time_s, trace.simulated, stretches, color=_SIMULATED, label="nominal, calibrated", linewidth=1.0
        )
        band = 2.0 * trace.scatter
        right.fill_between(
            *_thinned(trace.time_s, band, stretches), -_thinned(trace.time_s, band, stretches)[1],
            color="#888888", alpha=0.22, linewidth=0, label="healthy scatter, ±2",
        )  # fmt: skip
        _draw(right, trace.time_s, trace.difference, stretches, color=_MEASURED, label="difference", linewidth=1.3)
        if best:
            _draw(right, trace.time_s, trace.signature, stretches, color=_SIGNATURE, label="signature")
        for axes in (left, right):
            axes.set_xlabel("time [s]")
            axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, borderaxespad=0.1)
        left.set_ylabel(f"[{trace.unit}]")
        right.axhline(0.0, color="#999999", linewidth=0.6, zorder=0)
        return embedded(figure)


def _draw(axes: Axes, x: NDArray[np.float64], y: NDArray[np.float64], stretches: int, **style: Any) -> None:
    axes.plot(*_thinned(x, y, stretches), **style)


def _thinned(
    x: NDArray[np.float64], y: NDArray[np.float64], stretches: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Keep the lowest and the highest point of each short stretch, so that no peak is lost."""
    length = max(1, len(x) // stretches)
    if length <= 2:  # noqa: PLR2004 - two points are kept of each
        return x, y
    whole = len(x) // length * length
    table = y[:whole].reshape(-1, length)
    starts = np.arange(0, whole, length)
    ends = (np.array([0]), starts + table.argmin(axis=1), starts + table.argmax(axis=1), np.array([len(x) - 1]))
    kept = np.unique(np.concatenate(ends))
    return x[kept], y[kept]
