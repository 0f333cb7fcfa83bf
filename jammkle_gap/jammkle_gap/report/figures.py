"""Curves of the page: measured, nominal and corrected, and what each leaves in units of the noise."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from jammkle_graph.command.figures import STYLE

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from jammkle_gap.november.described import Overlay

MOST_SIGNALS = 12
MOST_RECORDINGS = 3
"""Drawn per signal: those that are off most."""
_BYTES = 2.6e6
"""What all curves together may take. The page stays below 5 MB, as base64 and the axes take the rest."""
_BYTES_PER_STRETCH = 200.0
"""Of the five curves of one recording. Measured."""
_FEWEST_STRETCHES, _MOST_STRETCHES = 60, 300
_COLOURS = {"measured": "#333333", "nominal": "#d9741a", "corrected": "#1f5fa8"}
_STYLES: dict[str, dict[str, Any]] = {
    "measured": {"linewidth": 1.8, "alpha": 0.55},
    "nominal": {"linewidth": 1.0, "linestyle": (0, (4, 2))},
    "corrected": {"linewidth": 1.0},
}
_TEXT: dict[Any, Any] = {"svg.fonttype": "none", "font.family": "sans-serif", "svg.hashsalt": "jammkle gap"}


def stretches_for(curves: int) -> int:
    """Return into how many parts each recording is cut, of which two points are drawn: more cannot be seen."""
    allowed = int(_BYTES / (_BYTES_PER_STRETCH * max(curves, 1)))
    return min(max(allowed, _FEWEST_STRETCHES), _MOST_STRETCHES)


def overlay_svg(overlays: Sequence[Overlay], noise: float, stretches: int) -> str:
    """Return one signal as SVG: a column per recording, curves above, residuals in noise units below.

    Args:
        overlays: Of one signal, one per recording.
        noise: One noise unit, in the signal's unit.
        stretches: Parts of which two points each are drawn.

    """
    with mpl.rc_context({**STYLE, **_TEXT}):
        figure = Figure(figsize=(10.0, 3.9))
        figure.subplots_adjust(left=0.085, right=0.995, bottom=0.12, top=0.87, hspace=0.1, wspace=0.05)
        grid = figure.subplots(2, len(overlays), squeeze=False, sharex="col", sharey="row", height_ratios=[2.2, 1.0])
        for column, overlay in enumerate(overlays):
            _curves(grid[0, column], overlay, stretches)
            _residuals(grid[1, column], overlay, noise, stretches)
            grid[1, column].set_xlabel("time [s]")
            grid[0, column].set_title(overlay.recording, loc="left")
        grid[0, 0].set_ylabel(f"[{overlays[0].unit}]")
        grid[1, 0].set_ylabel("off by\n[noise]")
        figure.align_ylabels(grid[:, 0])
        handles, labels = grid[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="upper right", ncols=3, bbox_to_anchor=(0.995, 1.01))
        file = io.StringIO()
        figure.savefig(file, format="svg", metadata={"Date": None, "Creator": None})
        return file.getvalue()


def _curves(axes: Axes, overlay: Overlay, stretches: int) -> None:
    for name, colour in _COLOURS.items():
        x, y = _thinned(overlay.time_s, getattr(overlay, name), stretches)
        axes.plot(x, y, color=colour, label=name, **_STYLES[name])


def _residuals(axes: Axes, overlay: Overlay, noise: float, stretches: int) -> None:
    axes.axhspan(-2.0, 2.0, color="#888888", alpha=0.15, linewidth=0)
    for name in ("nominal", "corrected"):
        x, y = _thinned(overlay.time_s, (overlay.measured - getattr(overlay, name)) / noise, stretches)
        axes.plot(x, y, color=_COLOURS[name], **{**_STYLES[name], "linewidth": 0.8, "linestyle": "-"})


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
