"""A picture of a run as data: panels below each other. What draws it stands in `panels_png` and `panels_html`."""

from __future__ import annotations

from dataclasses import dataclass

COLOURS = ("#1f77b4", "#ff7f0e", "#2ca02c", "#9467bd", "#7f7f7f", "#8c564b")
"""Of curves, one after the other."""

LEAST_S = 1e-3
"""Shortest time axis, s, of a bag that holds one moment."""


@dataclass(frozen=True)
class Curve:
    """A line. `dotted` is for what was asked for, `steps` for what holds until it changes."""

    name: str
    x: tuple[float, ...]
    y: tuple[float, ...]
    colour: str
    dotted: bool = False
    steps: bool = False
    width: float = 1.0
    """Of the line, points."""


@dataclass(frozen=True)
class Bar:
    """A stretch of time in a row of a timeline."""

    row: str
    begin_s: float
    end_s: float
    name: str
    colour: str


@dataclass(frozen=True)
class Panel:
    """One panel: curves, or bars in rows. `over_time`: its horizontal axis is the time of the run."""

    y_label: str
    curves: tuple[Curve, ...] = ()
    bars: tuple[Bar, ...] = ()
    over_time: bool = True
    x_label: str = "time since the start of the bag [s]"
    with_marks: bool = False
    """Whether the events of the run are marked in it."""

    @property
    def rows(self) -> tuple[str, ...]:
        """Rows of a timeline, from the top."""
        return tuple(dict.fromkeys(bar.row for bar in self.bars))


@dataclass(frozen=True)
class Mark:
    """An event."""

    time_s: float
    name: str
    colour: str


@dataclass(frozen=True)
class RunPicture:
    """All panels of a run, and its events."""

    title: str
    duration_s: float
    panels: tuple[Panel, ...]
    marks: tuple[Mark, ...]
    note: str = ""
    """What is not in it."""
