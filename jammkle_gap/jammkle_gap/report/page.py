"""The page of a diagnosis: one HTML file that needs no network, read in two minutes and then dug into."""

from __future__ import annotations

import base64
import importlib.resources
import io
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import jinja2
import matplotlib as mpl
import numpy as np
from markupsafe import Markup
from matplotlib.figure import Figure

from jammkle_common.command.results import STYLE
from jammkle_gap.core.decide import by_class, class_names, class_of
from jammkle_gap.core.result import Verdict
from jammkle_gap.report import words
from jammkle_gap.report.words import percent, percents, probability, scale, times

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from jammkle_gap.core.result import Diagnosis, Place, Trace
    from jammkle_gap.report.words import Asked

_TONES = {Verdict.NO_GAP: "good", Verdict.EFFECTS: "found", Verdict.AMBIGUOUS: "open", Verdict.UNKNOWN: "bad"}
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
MOST_BARS = 8
"""Candidates with a bar of their own; the rest is one bar."""
_WORTH = 0.002
"""Probability from which on a candidate has a bar."""
_FRAME_IN = 0.55
"""Height of the chart beside its bars, inches."""
_IN_SET, _OUTSIDE, _NONE = "#1f5fa8", "#b9c4d0", "#a15c00"
PHASES = (
    "event", "evacuating", "holding", "venting", "falling", "loading", "unloading", "reversal", "impact", "rebound",
    "sliding", "still", "other", "whole run",
)  # fmt: skip
"""Columns of the heat map, in the order in which things happen; phases of other names stand before the last two."""
WORTH_SHARE = 0.005
"""Signals below this are put together."""
_TEXT: dict[Any, Any] = {"svg.fonttype": "none", "font.family": "sans-serif", "svg.hashsalt": "jammkle gap"}
"""Style of text in figures: as text, the same bytes for the same picture."""


def page(diagnosis: Diagnosis, asked: Asked) -> str:
    """Return the page as HTML."""
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    for each in (words.label, words.percent, words.percents, words.probability, words.times):
        environment.filters[each.__name__] = each
    source = importlib.resources.files(__package__).joinpath("page.html.j2").read_text(encoding="utf-8")
    named = {name for each in diagnosis.candidates for name in each.names}
    effects = {effect.name: effect for each in diagnosis.candidates for effect in each.effects}
    return environment.from_string(source).render(
        diagnosis=diagnosis,
        asked=asked,
        words=words,
        verdict=diagnosis.verdict.name,
        tone=_TONES[diagnosis.verdict],
        best=words.names_label([effect.name for effect in diagnosis.effects]) if diagnosis.effects else "",
        overview=_overview(diagnosis),
        waterfall=_waterfall(diagnosis) if diagnosis.ledger and math.isfinite(diagnosis.ledger[0].share) else "",
        chart=_chart(bars_of(diagnosis)) if diagnosis.posterior else "",
        **_traces(diagnosis),
        sizes=words.parameter_lines(diagnosis.effects),
        other_sizes=words.parameter_lines([each for each in effects.values() if each not in diagnosis.effects]),
        heat=heat_map(diagnosis.where),
        settings=len({each.setting for each in diagnosis.traces}),
        signals=words.signal_lines(diagnosis),
        classes=sorted(
            ({"members": each, "named": bool(named & set(each))} for each in diagnosis.classes),
            key=lambda each: not each["named"],
        ),
        constants=words.constant_lines(diagnosis, asked.constants),
    )


def _traces(diagnosis: Diagnosis) -> dict[str, Any]:
    """Return signatures beside the data, in the features that the decision was made on, most telling first."""
    ordered = _most_telling(diagnosis)[:MOST_TRACES]
    allowed = int(_BYTES / (_BYTES_PER_STRETCH * max(len(ordered), 1)))
    stretches = min(max(allowed, _FEWEST_STRETCHES), _MOST_STRETCHES)
    drawn = [
        {
            "title": _title(diagnosis, each),
            "gap": _gap_of(each),
            "left": _gap_of(each, corrected=True),
            "image": _picture(each, stretches, with_effect=bool(diagnosis.effects)),
        }
        for each in ordered
    ]
    return {
        "traces": drawn[:SHOWN_AT_ONCE],
        "other_traces": drawn[SHOWN_AT_ONCE:],
        "traces_left_out": len(diagnosis.traces) - len(ordered),
    }


def _title(diagnosis: Diagnosis, trace: Trace) -> str:
    """Return the signal of a trace, and its setting if there are several."""
    several = len({each.setting for each in diagnosis.traces}) > 1
    return f"{trace.signal} ({trace.setting})" if several else trace.signal


@dataclass(frozen=True)
class Bar:
    """One bar of the chart."""

    label: str
    probability: float
    colour: str


def bars_of(diagnosis: Diagnosis) -> list[Bar]:
    """Return the bars, most probable first, one for each equivalence class; none of them always has one."""
    classes = class_names(diagnosis.classes)
    kept = {class_of(each.names, classes) for each in diagnosis.candidates}
    members: dict[tuple[str, ...], list[str]] = {}
    for names in diagnosis.posterior:
        key = class_of(names, classes)
        members.setdefault(key, []).append(words.names_label(names))
    found: list[Bar] = []
    rest, left = 0.0, 0
    for key, value in by_class(diagnosis.posterior, classes).items():
        if key and (len(found) >= MOST_BARS or value < _WORTH):
            rest, left = rest + value, left + 1
            continue
        colour = _NONE if not key else _IN_SET if key in kept else _OUTSIDE
        found.append(Bar(" = ".join(members[key]), value, colour))
    return [*found, Bar(f"the other {left} together", rest, _OUTSIDE)] if left else found


def heat_map(places: Sequence[Place]) -> dict[str, Any]:
    """Return the shares of signals by phases, signals with the largest share first."""
    shares = words.signal_shares(places)
    signals = [name for name in sorted(shares, key=lambda name: -shares[name]) if shares[name] >= WORTH_SHARE]
    found = {place.phase for place in places if place.signal in signals}
    phases = [*(name for name in PHASES[:-2] if name in found), *sorted(found - set(PHASES))]
    phases += [name for name in PHASES[-2:] if name in found]
    cells = {(place.signal, place.phase): place for place in places}
    return {
        "phases": phases,
        "rows": [
            {
                "signal": name,
                "share": percent(shares[name]),
                "cells": [_cell(cells.get((name, phase))) for phase in phases],
            }
            for name in signals
        ],
        "left_out": len(shares) - len(signals),
    }


def _cell(place: Place | None) -> dict[str, Any] | None:
    if place is None:
        return None
    return {
        "share": percent(place.share),
        "interval": percents(place.interval),
        "gap": times(place.gap),
        "strength": round(math.sqrt(min(max(place.share, 0.0), 1.0)), 3),
    }


def _gap_of(trace: Trace, *, corrected: bool = False) -> float:
    """Return the root mean square of a trace's difference, or of what the signature leaves, in healthy scatter."""
    left = trace.difference - trace.signature if corrected else trace.difference
    return float(np.sqrt(np.square(left / trace.scatter).mean()))


def _most_telling(diagnosis: Diagnosis) -> list[Trace]:
    """Return the traces by their signal's share of the squared whitened difference, then by their own gap."""
    shares = words.signal_shares(diagnosis.where)
    return sorted(diagnosis.traces, key=lambda each: (-shares.get(each.signal, 0.0), -_gap_of(each)))


def _overview(diagnosis: Diagnosis) -> dict[str, Any] | None:
    """Return signal and picture of the gap that shrinks, where most of it lies; None without a signal over time.

    Above: what was measured, and what the simulator says without and with the effect. Below: what is left of the
    difference, in the band of healthy scatter. No corrected curve is drawn where no effect is named as the cause.
    """
    ordered = _most_telling(diagnosis)
    if not ordered:
        return None
    trace = ordered[0]
    named = bool(diagnosis.effects) and diagnosis.verdict in {Verdict.EFFECTS, Verdict.AMBIGUOUS}
    named = named or bool(diagnosis.constants)  # the constants of the machine correct it, too
    factor, unit = _scale_of(trace)
    x, stretches = trace.time_s, _OVERVIEW_STRETCHES
    with mpl.rc_context({**STYLE, **_TEXT}):
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
        return {"signal": _title(diagnosis, trace), "image": _embedded(figure)}


def _waterfall(diagnosis: Diagnosis) -> Markup:
    """Return the ledger as bars: from the nominal gap down to what is left."""
    nominal, above = diagnosis.gap.nominal, max(diagnosis.gap.nominal - 1.0, 0.0)
    rows, at = [("nominal simulator", 0.0, nominal, _SIMULATED)], nominal
    for each in diagnosis.ledger[:-1]:
        step = above * each.share
        rows.append((words.label(each.part), min(at, at - step), abs(step), "#1b6e2c" if step >= 0.0 else "#b3261e"))
        at -= step
    rows.append(("corrected simulator", 0.0, at, _CORRECTED))
    with mpl.rc_context({**STYLE, **_TEXT, "axes.grid": False}):
        height = _FRAME_IN + 0.24 * len(rows)
        figure = Figure(figsize=(10.0, height))
        figure.subplots_adjust(left=0.22, right=0.93, top=0.99, bottom=0.4 / height)
        axes = figure.subplots()
        axes.barh([row[0] for row in rows], [row[2] for row in rows], left=[row[1] for row in rows], height=0.66,
                  color=[row[3] for row in rows])  # fmt: skip
        axes.invert_yaxis()
        axes.axvline(1.0, color="#999999", linewidth=0.8)
        axes.set_xlabel("gap [scatter]; 1 is what runs of one machine differ by")
        shares = ["", *(percent(each.share) for each in diagnosis.ledger[:-1]), ""]
        for place, ((_, left, width, _), share) in enumerate(zip(rows, shares, strict=True)):
            text = share or times(left + width)
            axes.text(left + width + 0.01 * nominal, place, text, va="center", fontsize=8)
        return _embedded(figure)


def _scale_of(trace: Trace) -> tuple[float, str]:
    return scale(float(np.abs([trace.measured, trace.simulated]).max()), trace.unit)


def _fill(axes: Axes, trace: Trace, factor: float, stretches: int) -> None:
    time_s, band = _thinned(trace.time_s, 2.0 * trace.scatter / factor, stretches)
    axes.fill_between(time_s, band, -band, color="#888888", alpha=0.22, linewidth=0, label="healthy scatter, ±2")


def _picture(trace: Trace, stretches: int, *, with_effect: bool) -> Markup:
    factor, unit = _scale_of(trace)
    with mpl.rc_context({**STYLE, **_TEXT}):
        figure = Figure(figsize=(10.0, 2.7))
        figure.subplots_adjust(left=0.09, right=0.995, bottom=0.17, top=0.86, wspace=0.17)
        left, right = figure.subplots(1, 2, sharex=True, width_ratios=[1.0, 1.25])
        x = trace.time_s
        _draw(left, x, trace.measured / factor, stretches, color=_MEASURED, label="measured", alpha=0.5, linewidth=2.4)
        _draw(left, x, trace.simulated / factor, stretches, color=_SIMULATED, label="nominal", linewidth=1.0)
        _fill(right, trace, factor, stretches)
        difference, signature = trace.difference / factor, trace.signature / factor
        _draw(right, x, difference, stretches, color=_MEASURED, label="difference", linewidth=1.3)
        if with_effect:
            corrected = trace.simulated / factor + signature
            _draw(left, x, corrected, stretches, color=_CORRECTED, label="with effect", linestyle=(0, (4, 2)))
            _draw(right, x, signature, stretches, color=_CORRECTED, label="signature")
        for axes in (left, right):
            axes.set_xlabel("time [s]")
            axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, borderaxespad=0.1)
        left.set_ylabel(f"[{unit}]")
        right.axhline(0.0, color="#999999", linewidth=0.6, zorder=0)
        return _embedded(figure)


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
    table, starts = y[:whole].reshape(-1, length), np.arange(0, whole, length)
    ends = [np.array([0, len(x) - 1]), starts + table.argmin(axis=1), starts + table.argmax(axis=1)]
    if whole < len(x):
        ends.append(whole + np.array([y[whole:].argmin(), y[whole:].argmax()]))
    kept = np.unique(np.concatenate(ends))
    return x[kept], y[kept]


def _chart(bars: Sequence[Bar]) -> Markup:
    with mpl.rc_context({**STYLE, **_TEXT, "axes.grid": False}):
        figure = Figure(figsize=(7.5, _FRAME_IN + 0.3 * len(bars)))
        figure.subplots_adjust(left=0.46, right=0.86, top=0.99, bottom=0.42 / (_FRAME_IN + 0.3 * len(bars)))
        axes = figure.subplots()
        places = list(range(len(bars)))
        axes.barh(places, [each.probability for each in bars], color=[each.colour for each in bars], height=0.66)
        axes.set_yticks(places, [_cut(each.label) for each in bars])
        axes.invert_yaxis()
        axes.set_xlim(0.0, 1.0)
        axes.set_xlabel("probability, given a gap")
        axes.tick_params(axis="y", length=0)
        for place, each in zip(places, bars, strict=True):
            axes.text(each.probability + 0.01, place, probability(each.probability), va="center", fontsize=8)
        return _embedded(figure)


def _cut(text: str, most: int = 52) -> str:
    return text if len(text) <= most else f"{text[: most - 3]}..."


def _embedded(figure: Figure) -> Markup:
    """Return a figure as an address that holds the whole picture: the page needs no network and no second file."""
    file = io.StringIO()
    figure.savefig(file, format="svg", metadata={"Date": None, "Creator": None})
    data = base64.b64encode(file.getvalue().encode()).decode()
    return Markup("data:image/svg+xml;base64,{}").format(data)
