"""Plots over time, and marks in them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from jammkle_view.core.ankle import thinned
from jammkle_view.core.figure import EVENT_TINTS, css
from jammkle_view.core.samples import EventKind

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import viser
    from numpy.typing import NDArray

    from jammkle_view.core.ankle import Quantity
    from jammkle_view.core.figure import Rgb

BINS = 300
"""A plot is some 400 pixels wide: with twice as many points nothing that could be seen is lost."""
_MARK_SCALE = "mark"
_MARK_HEIGHT = 1.0
_MARK_FOOT = 0.01
"""Lower end of the scale of marks: above 0, so that the line between two marks lies out of sight."""


@dataclass(frozen=True)
class Line:
    """One signal."""

    label: str
    tint: Rgb
    dashed: bool = False


@dataclass(frozen=True)
class Mark:
    """Upright strokes at some times, with a name in the legend."""

    label: str
    tint: Rgb


class Plot:
    """Lines over a time axis that stands still, with marks."""

    def __init__(
        self,
        gui: viser.GuiApi,
        quantity: Quantity,
        lines: Sequence[Line],
        time_range_s: tuple[float, float],
        marks: Sequence[Mark] = (),
        *,
        height_px: int = 190,
    ) -> None:
        """Draw it empty.

        Args:
            gui: Where.
            quantity: What is drawn; where it moves less than its least, it is drawn flat.
            lines: Its signals, in order.
            time_range_s: Ends of the time axis, s.
            marks: What may be marked.
            height_px: Its height on the page.

        """
        self._lines, self._marks, self._quantity = tuple(lines), tuple(marks), quantity
        empty = np.array(time_range_s)
        series: list[dict[str, object]] = [{"label": "t [s]"}]
        for line in lines:
            dash = {"dash": (5.0, 4.0)} if line.dashed else {}
            series.append({**_stroke(line.label, line.tint), **dash})
        series += [{**_stroke(mark.label, mark.tint), "scale": _MARK_SCALE} for mark in marks]
        self._scales: dict[str, dict[str, object]] = {"x": {"time": False, "range": time_range_s}}
        if marks:
            self._scales[_MARK_SCALE] = {"range": (_MARK_FOOT, _MARK_HEIGHT), "auto": False}
        self._range: tuple[float, float] | None = None
        self._handle = gui.add_uplot(
            tuple(np.full(2, np.nan) if place else empty for place in range(len(series))),
            tuple(series),  # type: ignore[arg-type]  # viser's own table types are plain mappings
            title=quantity.title,
            scales=self._scales,  # type: ignore[arg-type]  # as above
            legend={"show": True, "live": False},
            height=height_px,
            padding=(2, 12, 0, 0),
        )

    def show(
        self,
        time_s: NDArray[np.float64],
        values: NDArray[np.float64],
        marked_s: Mapping[str, Sequence[float]] | None = None,
    ) -> None:
        """Draw samples, SI, shape (n, lines), at times on the plot's axis, s, and marks, by name, at theirs."""
        time_s, values = thinned(time_s, self._quantity.scale * values, BINS)
        if not len(time_s):
            time_s, values = np.zeros(1), np.full((1, len(self._lines)), np.nan)
        wanted = range_of(values, self._quantity.least)
        if wanted != self._range:
            self._range = wanted
            scales = self._scales if wanted is None else {**self._scales, "y": {"range": wanted}}
            self._handle.scales = scales  # type: ignore[assignment]  # viser's own table types are plain mappings
        marks = [_strokes(time_s, (marked_s or {}).get(mark.label, ())) for mark in self._marks]
        self._handle.data = (time_s, *(np.ascontiguousarray(column) for column in values.T), *marks)

    @property
    def visible(self) -> bool:
        """Whether it is on the page."""
        return bool(self._handle.visible)

    def set_visible(self, *, visible: bool) -> None:
        """Show or hide it."""
        self._handle.visible = visible

    def remove(self) -> None:
        """Take it off the page."""
        self._handle.remove()


def _stroke(label: str, tint: Rgb) -> dict[str, object]:
    return {"label": label, "stroke": css(tint), "width": 1.5, "points": {"show": False}}


def range_of(values: NDArray[np.float64], least: float) -> tuple[float, float] | None:
    """Return the ends of a scale for values that differ by less than `least`; None: they choose it by themselves.

    Ends are multiples of half of `least`, so that a signal that drifts slowly moves them seldom.
    """
    known = values[np.isfinite(values)]
    if not len(known):
        return None
    low, high = float(known.min()), float(known.max())
    if high - low >= least:
        return None
    centre = round((low + high) / least) * least / 2.0
    return centre - least, centre + least


def _strokes(time_s: NDArray[np.float64], marked_s: Sequence[float]) -> NDArray[np.float64]:
    """Return a line along the bottom that goes up and down once at the sample nearest each time."""
    line = np.zeros(len(time_s))
    inside = [each for each in marked_s if time_s[0] <= each <= time_s[-1]]
    line[np.minimum(np.searchsorted(time_s, inside), len(time_s) - 1)] = _MARK_HEIGHT
    return line


def event_marks() -> tuple[Mark, ...]:
    """Return a mark for every kind of event."""
    return tuple(Mark(kind.name.lower(), EVENT_TINTS[kind]) for kind in EventKind if kind is not EventKind.UNKNOWN)
