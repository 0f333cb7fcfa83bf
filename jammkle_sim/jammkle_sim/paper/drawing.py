"""What all figures of the page share: colours, style, curves, the paper's marks."""

from __future__ import annotations

import io
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from jammkle_sim.paper_tables import paper_row

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from jammkle_sim.paper.runs import Curve

SET_NAMES = {"fitted": "fitted", "as_printed": "as printed"}
"""Parameter sets for people."""

WIDTH_IN = 9.0
SET_COLOURS = {"fitted": "#1f5fa8", "as_printed": "#d9741a"}
VACUUM_COLOURS = {0: "#9ec5e8", 10: "#5b9bd5", 30: "#1f5fa8", 50: "#0b2545"}
EXTENSION = "extension [mm]"
FORCE = "force [N]"
_PAPER: dict[str, Any] = {"color": "black", "marker": "o", "markersize": 4, "capsize": 4, "linestyle": "none"}
_FULL_MM = 20.0


@dataclass(frozen=True)
class Picture:
    """One figure of the page."""

    identifier: str
    title: str
    paper: str
    """Which figure of the paper it stands beside; empty for none."""
    caption: str
    svg: str


def finished(identifier: str, figure: Figure, title: str, paper: str, caption: str) -> Picture:
    """Return a figure as SVG text, without a date, so that the same runs give the same bytes."""
    file = io.StringIO()
    figure.savefig(file, format="svg", metadata={"Date": None, "Creator": None})
    return Picture(identifier, title, paper, caption, file.getvalue())


def draw(axes: Axes, curves: Sequence[Curve], colour: str, label: str, style: str = "-") -> None:
    """Draw the repeats of one experiment in one colour, with one entry in the legend."""
    for i, curve in enumerate(curves):
        axes.plot(curve.x, curve.y, style, color=colour, alpha=0.85, linewidth=0.9, label=None if i else label)


def paper_mean(axes: Axes, identifier: str, label: str | None) -> None:
    """Mark the paper's mean peak and its standard error at 20 mm."""
    row = paper_row(identifier)
    axes.errorbar(_FULL_MM, row.mean, yerr=row.standard_error, zorder=5, label=label, **_PAPER)


def label_axes(axes: Axes, x: str, y: str) -> None:
    """Name both axes."""
    axes.set_xlabel(x)
    axes.set_ylabel(y)
