"""Draw the picture of a run with matplotlib, as PNG."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import matplotlib as mpl
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from jammkle_bringup.core.panels import LEAST_S
from jammkle_common.command.results import STYLE

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.axes import Axes

    from jammkle_bringup.core.panels import Panel, RunPicture

_WIDTH_IN = 11.0
_HEIGHT_IN = 1.7
_LOOP_HEIGHT_IN = 4.0
_DOTS_PER_INCH = 120
_ROW_HEIGHT = 0.8
_BESIDE: dict[str, Any] = {"loc": "upper left", "bbox_to_anchor": (1.0, 1.0)}
_MOST_LABELS = 25
"""Most events that get their names beside their lines: more would lie over each other."""


def write_png(picture: RunPicture, path: Path) -> None:
    """Write the picture.

    Raises:
        OSError: the file cannot be written.

    """
    with mpl.rc_context(STYLE):
        figure_of(picture).savefig(path, dpi=_DOTS_PER_INCH)


def figure_of(picture: RunPicture) -> Figure:
    """Return the panels below each other; the lowest of those over time has the time axis of all."""
    heights = [_HEIGHT_IN if panel.over_time else _LOOP_HEIGHT_IN for panel in picture.panels]
    figure = Figure(figsize=(_WIDTH_IN, 0.8 + sum(heights)), layout="constrained")
    grid = figure.add_gridspec(len(heights), 1, height_ratios=heights)
    shared: Axes | None = None
    last = max((place for place, panel in enumerate(picture.panels) if panel.over_time), default=0)
    for place, panel in enumerate(picture.panels):
        axes = figure.add_subplot(grid[place], sharex=shared if panel.over_time else None)
        _draw(axes, panel, picture)
        if panel.over_time and place != last:
            axes.tick_params(labelbottom=False)
            axes.set_xlabel("")
        if panel.over_time:
            shared = axes
    figure.suptitle(" · ".join(filter(None, (picture.title, picture.note))), fontsize="medium")
    return figure


def _draw(axes: Axes, panel: Panel, picture: RunPicture) -> None:
    axes.set_ylabel(panel.y_label)
    for curve in panel.curves:
        style: dict[str, Any] = {"color": curve.colour, "linestyle": ":" if curve.dotted else "-"}
        style["drawstyle"] = "steps-post" if curve.steps else "default"
        axes.plot(curve.x, curve.y, label=curve.name, linewidth=0.8 * curve.width, **style)
    for bar in panel.bars:
        axes.barh(bar.row, bar.end_s - bar.begin_s, _ROW_HEIGHT, bar.begin_s, color=bar.colour, linewidth=0)
    if panel.bars:
        axes.set_yticks(range(len(panel.rows)), panel.rows)
        axes.invert_yaxis()
        colours = dict.fromkeys((bar.name, bar.colour) for bar in panel.bars)
        handles = [Patch(facecolor=colour, edgecolor="#bbbbbb", label=name) for name, colour in colours]
        axes.legend(handles=handles, **_BESIDE)
    elif len(panel.curves) > 1 or not panel.over_time:
        axes.legend(**_BESIDE)
    if not panel.over_time:
        axes.set_xlabel(panel.x_label)
        return
    axes.set_xlim(0.0, max(picture.duration_s, LEAST_S))
    axes.set_xlabel(panel.x_label)
    if panel.with_marks:
        for mark in picture.marks:
            axes.axvline(mark.time_s, color=mark.colour, linewidth=0.8, alpha=0.7, zorder=1)
            if len(picture.marks) <= _MOST_LABELS:
                axes.annotate(
                    mark.name,
                    (mark.time_s, 1.0),
                    xycoords=("data", "axes fraction"),
                    xytext=(2, -2),
                    textcoords="offset points",
                    rotation=90,
                    va="top",
                    fontsize=6,
                    color=mark.colour,
                )
