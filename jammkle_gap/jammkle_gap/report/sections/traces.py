"""Signatures beside the data, in the features that the decision was made on, most telling first."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from jammkle_common.command.results import STYLE
from jammkle_gap.core.result import Verdict
from jammkle_gap.report import words
from jammkle_gap.report.quantities import scale, times
from jammkle_gap.report.rendering import TEXT, embedded, rendered

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
_BYTES_PER_STRETCH = 400.0
"""Of the curves of one trace. Measured."""
_FEWEST_STRETCHES, _MOST_STRETCHES = 60, 300
_MEASURED, _SIMULATED, _CORRECTED = "#333333", "#d9741a", "#1f5fa8"
_OVERVIEW_STRETCHES = 400


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


def overview(diagnosis: Diagnosis) -> tuple[str, Markup] | None:
    """Return signal and picture of the gap that shrinks, where most of it lies; None without a signal over time.

    Above: what was measured, and what the simulator says without and with the effect. Below: what is left of the
    difference, in the band of healthy scatter. No corrected curve is drawn where no effect is named as the cause.
    """
    ordered = most_telling(diagnosis)
    if not ordered:
        return None
    trace = ordered[0]
    named = bool(diagnosis.effects) and diagnosis.verdict in {Verdict.EFFECTS, Verdict.AMBIGUOUS}
    factor, unit = _scale_of(trace)
    x, stretches = trace.time_s, _OVERVIEW_STRETCHES
    with mpl.rc_context({**STYLE, **TEXT}):
        figure = Figure(figsize=(10.0, 3.3))
        figure.subplots_adjust(left=0.075, right=0.995, bottom=0.13, top=0.93, hspace=0.12)
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=[1.6, 1.0])
        _draw(above, x, trace.measured / factor, stretches, color=_MEASURED, label="measured", alpha=0.5, linewidth=3.0)
        nominal = "nominal simulator"
        _draw(above, x, trace.simulated / factor, stretches, color=_SIMULATED, label=nominal, linewidth=1.3)
        _fill(below, trace, factor, stretches)
        difference = trace.difference / factor
        _draw(below, x, difference, stretches, color=_SIMULATED, linewidth=1.3, label="left with the nominal simulator")
        if named:
            corrected = (trace.simulated + trace.signature) / factor
            label = "corrected simulator"
            _draw(above, x, corrected, stretches, color=_CORRECTED, label=label, linewidth=1.3, linestyle=(0, (4, 2)))
            left = (trace.difference - trace.signature) / factor
            _draw(below, x, left, stretches, color=_CORRECTED, linewidth=1.3, label="left with the corrected one")
        below.axhline(0.0, color="#999999", linewidth=0.6, zorder=0)
        above.set_ylabel(f"[{unit}]")
        below.set_ylabel(f"difference [{unit}]")
        below.set_xlabel("time [s]")
        above.legend(loc="lower left", bbox_to_anchor=(0.0, 0.98), ncols=3, borderaxespad=0.1)
        below.legend(loc="best", ncols=3)
        figure.align_ylabels()
        setting = f" ({trace.setting})" if len({each.setting for each in diagnosis.traces}) > 1 else ""
        return f"{trace.signal}{setting}", embedded(figure)


def _scale_of(trace: Trace) -> tuple[float, str]:
    return scale(float(np.abs([trace.measured, trace.simulated]).max()), trace.unit)


def _fill(axes: Axes, trace: Trace, factor: float, stretches: int) -> None:
    time_s, band = _thinned(trace.time_s, 2.0 * trace.scatter / factor, stretches)
    axes.fill_between(time_s, band, -band, color="#888888", alpha=0.22, linewidth=0, label="healthy scatter, ±2")


def _picture(trace: Trace, best: str, stretches: int) -> Markup:
    factor, unit = _scale_of(trace)
    with mpl.rc_context({**STYLE, **TEXT}):
        figure = Figure(figsize=(10.0, 2.7))
        figure.subplots_adjust(left=0.09, right=0.995, bottom=0.17, top=0.86, wspace=0.17)
        left, right = figure.subplots(1, 2, sharex=True, width_ratios=[1.0, 1.25])
        x = trace.time_s
        _draw(left, x, trace.measured / factor, stretches, color=_MEASURED, label="measured", alpha=0.5, linewidth=2.4)
        _draw(left, x, trace.simulated / factor, stretches, color=_SIMULATED, label="nominal", linewidth=1.0)
        _fill(right, trace, factor, stretches)
        difference, signature = trace.difference / factor, trace.signature / factor
        _draw(right, x, difference, stretches, color=_MEASURED, label="difference", linewidth=1.3)
        if best:
            corrected = trace.simulated / factor + signature
            _draw(left, x, corrected, stretches, color=_CORRECTED, label="with effect", linestyle=(0, (4, 2)))
            _draw(right, x, signature, stretches, color=_CORRECTED, label="signature")
        for axes in (left, right):
            axes.set_xlabel("time [s]")
            axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, borderaxespad=0.1)
        left.set_ylabel(f"[{unit}]")
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
