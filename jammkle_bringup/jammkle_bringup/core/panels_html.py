"""Draw the picture of a run with plotly: one page that needs no network, with zoom and values under the pointer."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING

from plotly import graph_objects as go  # type: ignore[import-untyped]  # carries no types
from plotly.subplots import make_subplots  # type: ignore[import-untyped]  # carries no types

from jammkle_bringup.core.panels import LEAST_S

if TYPE_CHECKING:
    from pathlib import Path

    from jammkle_bringup.core.panels import Panel, RunPicture

_PANEL_PX, _LOOP_PX = 190, 520
_MOST_LABELS = 40
_PAGE = """<!doctype html>
<html lang="en">
<head><meta charset="utf-8"><title>{title}</title>
<style>body {{ font-family: sans-serif; margin: 1em 2em; }} h1 {{ font-size: 1.2em; }} p {{ color: #555; }}</style>
</head>
<body>
<h1>{title}</h1>
<p>Of each stretch of time the extremes are drawn, so that no peak is lost. {note}</p>
{figures}
</body>
</html>
"""


def write_html(picture: RunPicture, path: Path) -> None:
    """Write the page.

    Raises:
        OSError: the file cannot be written.

    """
    figures = [_over_time(picture), *(_loop(panel) for panel in picture.panels if not panel.over_time)]
    parts = [
        figure.to_html(full_html=False, include_plotlyjs=place == 0, config={"displaylogo": False})
        for place, figure in enumerate(figures)
    ]
    page = _PAGE.format(title=escape(picture.title), note=escape(picture.note), figures="\n".join(parts))
    path.write_text(page, encoding="utf-8")


def _over_time(picture: RunPicture) -> go.Figure:
    panels = [panel for panel in picture.panels if panel.over_time]
    figure = make_subplots(rows=max(1, len(panels)), cols=1, shared_xaxes=True, vertical_spacing=0.02)
    for row, panel in enumerate(panels, start=1):
        for curve in panel.curves:
            line = {"color": curve.colour, "width": curve.width, "dash": "dot" if curve.dotted else "solid"}
            line["shape"] = "hv" if curve.steps else "linear"
            figure.add_trace(
                go.Scatter(x=curve.x, y=curve.y, name=curve.name, line=line, mode="lines", legend=_legend(row)),
                row=row,
                col=1,
            )
        _add_bars(figure, panel, row)
        figure.update_yaxes(title_text=panel.y_label.replace("\n", "<br>"), row=row, col=1)
        if panel.with_marks:
            _add_marks(figure, picture, row)
        if panel.bars:
            figure.update_yaxes(autorange="reversed", row=row, col=1)
    if panels:
        figure.update_xaxes(title_text=panels[-1].x_label, row=len(panels), col=1)
        figure.update_xaxes(range=[0.0, max(picture.duration_s, LEAST_S)])
    tops = [figure.layout[f"yaxis{row if row > 1 else ''}"].domain[1] for row in range(1, len(panels) + 1)]
    legends = {_legend(row): {"y": top, "yanchor": "top", "x": 1.01} for row, top in enumerate(tops, start=1)}
    figure.update_layout(
        height=_PANEL_PX * max(1, len(panels)) + 80,
        margin={"t": 30},
        barmode="overlay",
        template="plotly_white",
        hovermode="x",
        **legends,
    )
    return figure


def _legend(row: int) -> str:
    return "legend" if row == 1 else f"legend{row}"


def _add_bars(figure: go.Figure, panel: Panel, row: int) -> None:
    for name, colour in dict.fromkeys((bar.name, bar.colour) for bar in panel.bars):
        bars = [bar for bar in panel.bars if bar.name == name]
        figure.add_trace(
            go.Bar(
                y=[bar.row for bar in bars],
                x=[bar.end_s - bar.begin_s for bar in bars],
                base=[bar.begin_s for bar in bars],
                name=name,
                orientation="h",
                marker={"color": colour, "line": {"width": 0}},
                hovertext=[f"{name} from {bar.begin_s:.3f} to {bar.end_s:.3f} s" for bar in bars],
                hoverinfo="text+y",
                legend=_legend(row),
            ),
            row=row,
            col=1,
        )


def _add_marks(figure: go.Figure, picture: RunPicture, row: int) -> None:
    named = len(picture.marks) <= _MOST_LABELS
    for mark in picture.marks:
        figure.add_vline(
            x=mark.time_s,
            line={"color": mark.colour, "width": 1},
            annotation={"text": mark.name, "textangle": -90, "font": {"size": 9, "color": mark.colour}}
            if named
            else None,
            row=row,
            col=1,
        )


def _loop(panel: Panel) -> go.Figure:
    figure = go.Figure()
    for curve in panel.curves:
        line = {"color": curve.colour, "width": curve.width}
        figure.add_trace(go.Scatter(x=curve.x, y=curve.y, name=curve.name, line=line, mode="lines"))
    figure.update_layout(
        height=_LOOP_PX,
        template="plotly_white",
        showlegend=True,
        xaxis_title=panel.x_label,
        yaxis_title=panel.y_label,
    )
    return figure
