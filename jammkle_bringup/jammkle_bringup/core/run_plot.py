"""The standard picture of a run as panels, and as a page: vacuum and set points, states, pump, IMU, tension.

Plotly draws it: one page that needs no network, with zoom and values under the pointer.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from html import escape
from typing import TYPE_CHECKING, Any

from plotly import graph_objects as go  # type: ignore[import-untyped]  # carries no types
from plotly.subplots import make_subplots  # type: ignore[import-untyped]  # carries no types

from jammkle_bringup.core.run_samples import MANIFOLD, MOST_CHANGES, RunSamples
from jammkle_common.bags.reading import name_of, namespaces_in, opened
from jammkle_common.bags.times import BagTimes
from jammkle_common.command.errors import InputError
from jammkle_common.command.results import EVENT_COLOURS, LINE_COLOURS, STATE_COLOURS
from jammkle_common.constants import NANOSECONDS_PER_SECOND
from jammkle_common.names import CHANNELS, CLOCK, relative

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from jammkle_bringup.core.run_samples import Changes, Envelope, Loop

_PA_PER_KPA = 1e3
_MM_PER_M = 1e3
_PROGRESS_MESSAGES = 5_000
_ENERGISED = ("#ffffff", "#6baed6")


def run_picture(
    path: Path, namespace: str | None, on_progress: Callable[[float], None], stop: Callable[[], bool]
) -> RunPicture | None:
    """Read a bag once, and return its picture; None if it was stopped.

    Args:
        path: The bag.
        namespace: Normalised namespace of the ankle; None: the only one that is there.
        on_progress: Called now and then with the share that was read, 0 to 1.
        stop: Asked now and then.

    Raises:
        InputError: it cannot be read, holds nothing of an ankle, or several ankles and none is chosen.

    """
    samples = RunSamples()
    with opened(path) as reader:
        namespace = chosen_namespace(path, set(reader.topics), namespace)
        times = BagTimes(reader)
        taken = {topic: samples.takers.get(relative(namespace, topic) or "") for topic in reader.topics}
        wanted = reader.on([topic for topic, take in taken.items() if topic == CLOCK.name or take is not None])
        total = sum(each.msgcount for each in wanted)
        start_ns = end_ns = None
        for number, (connection, time_ns, _, data) in enumerate(times.messages(wanted)):
            start_ns = time_ns if start_ns is None else start_ns
            end_ns = time_ns if end_ns is None else max(end_ns, time_ns)
            take = taken[connection.topic]
            if take is not None:
                take(
                    (time_ns - start_ns) / NANOSECONDS_PER_SECOND,
                    reader.deserialize(data, connection.msgtype),
                )
            if number % _PROGRESS_MESSAGES == 0:
                on_progress(number / total)
                if stop():
                    return None
    duration_s = ((end_ns or 0) - (start_ns or 0)) / NANOSECONDS_PER_SECOND
    title = f"{name_of(path)}, {namespace}: {duration_s:.1f} s"
    panels, marks = tuple(_panels(samples, duration_s)), tuple(_marks(samples))
    return RunPicture(title, duration_s, panels, marks, _cut_note(samples))


def chosen_namespace(path: Path, topics: set[str], namespace: str | None) -> str:
    """Return the namespace of the ankle that is drawn.

    Raises:
        InputError: the bag holds nothing of an ankle there, or several ankles and none is chosen.

    """
    found = namespaces_in(topics)
    if namespace is None and len(found) == 1:
        return found[0]
    if namespace is None and found:
        msg = f"bag {path} holds several namespaces ({', '.join(found)}): choose one with --namespace"
        raise InputError(msg)
    if namespace is None or namespace not in found:
        where = "" if namespace is None else f" in namespace {namespace}"
        msg = f"bag {path} holds no topic of an ankle{where}; it has: {', '.join(found) or 'none'}"
        raise InputError(msg)
    return namespace


def _panels(samples: RunSamples, duration_s: float) -> Iterator[Panel]:
    if any(pressure.readings for pressure in samples.pressures.values()):
        yield Panel("vacuum [kPa]", tuple(_vacuum(samples, duration_s)))
    bars = tuple(_state_bars(samples, duration_s))
    if bars:
        yield Panel("state", bars=bars)
    if samples.duty:
        yield Panel("pump duty", (_held("pump", samples.duty, duration_s, COLOURS[4]),))
    for name, signals in (("specific force\n[m/s²]", samples.force), ("angular velocity\n[rad/s]", samples.turning)):
        if signals:
            curves = [
                replace(_curve(axis, each, LINE_COLOURS[axis]), width=_width(place, len(signals)))
                for place, (axis, each) in enumerate(signals.items())
            ]
            yield Panel(name, tuple(curves), with_marks=True)
    if samples.tendons:
        loops = dict(samples.tendons)
        yield Panel("tension [N]", tuple(_forces(loops)), with_marks=True)
    cell = {"load cell": samples.cell}
    if samples.cell.path:
        yield Panel("load cell [N]", tuple(_forces(cell)), with_marks=True)
    if samples.tendons:
        yield Panel("tension [N]", tuple(_loops(samples.tendons)), over_time=False, x_label="extension [mm]")
    elif samples.cell.path:
        yield Panel("load cell [N]", tuple(_loops(cell)), over_time=False, x_label="carriage [mm]")


def _vacuum(samples: RunSamples, duration_s: float) -> Iterator[Curve]:
    places = (*CHANNELS, MANIFOLD)
    for place, name in enumerate(places):
        pressure, colour, width = samples.pressures.get(name), LINE_COLOURS[name], _width(place, len(places))
        if pressure is not None and pressure.readings:
            points = pressure.readings.points()
            vacuum_kpa = tuple((pressure.ambient_pa - pressure_pa) / _PA_PER_KPA for _, pressure_pa in points)
            yield Curve(name, tuple(time_s for time_s, _ in points), vacuum_kpa, colour, width=width)
        wanted = samples.set_points.get(name)
        if wanted is not None:
            times_s, values = _steps(wanted, duration_s)
            vacuum_kpa = tuple(value / _PA_PER_KPA for value in values)
            yield Curve(f"{name}, set point", times_s, vacuum_kpa, colour, dotted=True, steps=True, width=width)


def _state_bars(samples: RunSamples, duration_s: float) -> Iterator[Bar]:
    for channel in CHANNELS:
        if channel in samples.states:
            for begin_s, end_s, state in _stretches(samples.states[channel], duration_s):
                yield Bar(channel, begin_s, end_s, state, STATE_COLOURS.get(state, STATE_COLOURS["UNKNOWN"]))
        elif channel in samples.solenoids:
            for begin_s, end_s, is_on in _stretches(samples.solenoids[channel], duration_s):
                yield Bar(channel, begin_s, end_s, "energised" if is_on else "released", _ENERGISED[is_on])


def _stretches(changes: Changes, end_s: float) -> Iterator[tuple[float, float, Any]]:
    ends = [time_s for time_s, _ in changes.kept[1:]] + [end_s]
    for (begin_s, value), stop_s in zip(changes.kept, ends, strict=True):
        yield max(0.0, begin_s), stop_s, value


def _steps(changes: Changes, end_s: float) -> tuple[tuple[float, ...], tuple[float, ...]]:
    kept = [*changes.kept, (end_s, changes.kept[-1][1])]
    return tuple(time_s for time_s, _ in kept), tuple(value for _, value in kept)


def _curve(name: str, signal: Envelope, colour: str) -> Curve:
    points = signal.points()
    return Curve(name, tuple(point[0] for point in points), tuple(point[1] for point in points), colour)


def _held(name: str, signal: Envelope, end_s: float, colour: str) -> Curve:
    """Return the curve of a topic that comes on change: each value holds until the next, the last until the end."""
    points = signal.points()
    points = [*points, (max(end_s, points[-1][0]), points[-1][1])]
    return Curve(name, tuple(point[0] for point in points), tuple(point[1] for point in points), colour, steps=True)


def _width(place: int, curves: int) -> float:
    """Return the width of a line, points: wider the earlier it is drawn, so that equal ones are all seen."""
    return 1.0 + 1.4 * (curves - 1 - place)


def _colour(name: str, place: int) -> str:
    """Return the colour of a tendon, or of a load cell, which has none of its own."""
    return LINE_COLOURS.get(name, COLOURS[place % len(COLOURS)])


def _forces(loops: dict[str, Loop]) -> Iterator[Curve]:
    for place, (name, loop) in enumerate(loops.items()):
        curve = _curve(name, loop.force, _colour(name, place))
        yield replace(curve, width=_width(place, len(loops)))


def _loops(loops: dict[str, Loop]) -> Iterator[Curve]:
    for place, (name, loop) in enumerate(loops.items()):
        points = loop.path.points()
        length_mm = tuple(_MM_PER_M * length_m for _, length_m, _ in points)
        force_n = tuple(force_n for _, _, force_n in points)
        colour, width = _colour(name, place), _width(place, len(loops))
        yield Curve(f"{name}: {loop.work_j:.3g} J taken up", length_mm, force_n, colour, width=width)


def _marks(samples: RunSamples) -> Iterator[Mark]:
    for time_s, (name, _) in samples.events.kept:
        yield Mark(time_s, name, EVENT_COLOURS.get(name, EVENT_COLOURS["UNKNOWN"]))


def _cut_note(samples: RunSamples) -> str:
    """Return what to say where a state changed too often to be drawn; empty otherwise."""
    cut = [name for name, each in (*samples.states.items(), *samples.solenoids.items()) if each.is_cut]
    if samples.events.is_cut:
        cut.append("contact events")
    return f"only the first {MOST_CHANGES} changes are drawn of {', '.join(cut)}" if cut else ""


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
