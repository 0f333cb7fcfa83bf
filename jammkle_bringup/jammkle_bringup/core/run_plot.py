"""The standard picture of a run as a page: vacuum and set points, states, pump, IMU, tension, over time and length.

A bag is taken message by message in constant memory: a signal keeps of each stretch of time the extremes, so that no
peak is lost. There are never more stretches than a fixed number: where a signal goes on, two neighbours become one.
Plotly draws it: one page that needs no network, with zoom and values under the pointer.
"""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import dataclass, field
from html import escape
from typing import TYPE_CHECKING, Any

from plotly import graph_objects as go  # type: ignore[import-untyped]  # carries no types
from plotly.subplots import make_subplots  # type: ignore[import-untyped]  # carries no types

from jammkle_bringup.core.bag_info import constant_name
from jammkle_common.bags.reading import name_of, opened
from jammkle_common.bags.times import BagTimes
from jammkle_common.command.errors import InputError, Interrupted
from jammkle_common.command.results import EVENT_COLOURS, LINE_COLOURS, STATE_COLOURS
from jammkle_common.constants import NANOSECONDS_PER_SECOND, STANDARD_ATMOSPHERE_PA
from jammkle_common.names import (
    CARRIAGE_JOINT,
    CHANNELS,
    CLOCK,
    CONTACT_EVENTS,
    IMU,
    JAM_STATE,
    JOINT_STATES,
    LOAD_CELL,
    MANIFOLD_PRESSURE,
    PRESSURES,
    PUMP_DUTY,
    SOLENOIDS,
    TENDON_STATES,
    relative,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable, Iterator, Sequence
    from pathlib import Path

STRETCHES = 2000
"""Most stretches of one signal: more than a screen has columns. A picture shows every extreme of it."""
MOST_CHANGES = 5000
"""Most changes of a state, and most events, that are kept: more would be no picture any more."""
MANIFOLD = "manifold"
COLOURS = ("#1f77b4", "#ff7f0e", "#2ca02c", "#9467bd", "#7f7f7f", "#8c564b")
"""Of curves, one after the other."""
LEAST_S = 1e-3
"""Shortest time axis, s, of a bag that holds one moment."""

_PA_PER_KPA = 1e3
_MM_PER_M = 1e3
_PROGRESS_MESSAGES = 5_000
_ENERGISED = ("#ffffff", "#6baed6")
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

Point = tuple[float, ...]


@dataclass(frozen=True)
class Panel:
    """One panel: curves, or bars in rows."""

    y_label: str
    traces: Sequence[Any]
    """`go.Scatter` or `go.Bar`."""
    with_marks: bool = False
    """Whether the events of the run are marked in it."""
    x_label: str = "time since the start of the bag [s]"


@dataclass(frozen=True)
class RunPicture:
    """All panels of a run, and its events."""

    title: str
    duration_s: float
    panels: tuple[Panel, ...]
    """Over time."""
    loops: Panel | None
    """Force over length, where both are known."""
    marks: tuple[tuple[float, str], ...]
    """Time, s, and name of each event."""
    note: str
    """What is not in it; may be empty."""


def run_picture(
    path: Path, namespace: str | None, on_progress: Callable[[float], None], stop: Callable[[], bool]
) -> RunPicture:
    """Read a bag once, and return the picture of the ankle in a normalised namespace; None: of the only one.

    The share that was read, 0 to 1, is reported now and then, and it is asked whether to stop.

    Raises:
        InputError: it cannot be read, holds nothing that is drawn, or several ankles and none is chosen.
        Interrupted: it was stopped.

    """
    samples = RunSamples()
    with opened(path) as reader:
        namespace = reader.chosen_namespace(namespace)
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
                take((time_ns - start_ns) / NANOSECONDS_PER_SECOND, reader.deserialize(data, connection.msgtype))
            if number % _PROGRESS_MESSAGES == 0:
                on_progress(number / total)
                if stop():
                    raise Interrupted
    duration_s = ((end_ns or 0) - (start_ns or 0)) / NANOSECONDS_PER_SECOND
    panels = tuple(_panels(samples, duration_s))
    if not panels:
        msg = f"bag {name_of(path)} holds nothing in namespace {namespace} that is drawn, such as {IMU.name}, "
        msg += f"{TENDON_STATES.name} or pressures; `jammkle export` writes what it holds as tables"
        raise InputError(msg)
    return RunPicture(
        title=f"{name_of(path)}, {namespace}: {duration_s:.1f} s",
        duration_s=duration_s,
        panels=panels,
        loops=_loops(samples),
        marks=tuple((time_s, name) for time_s, (name, _) in samples.events.kept),
        note=_cut_note(samples),
    )


def write_html(picture: RunPicture, path: Path) -> None:
    """Write the page.

    Raises:
        OSError: the file cannot be written.

    """
    figures = [_over_time(picture), *([] if picture.loops is None else [_over_length(picture.loops)])]
    parts = [
        figure.to_html(full_html=False, include_plotlyjs=place == 0, config={"displaylogo": False})
        for place, figure in enumerate(figures)
    ]
    page = _PAGE.format(title=escape(picture.title), note=escape(picture.note), figures="\n".join(parts))
    path.write_text(page, encoding="utf-8")


class Envelope:
    """Points of which the extremes of every coordinate but the first, the time, are kept, and the first and last.

    What is not finite is no extreme: a stretch with nothing else is a gap.
    """

    def __init__(self, coordinates: int = 1) -> None:
        """Begin; `coordinates` is how many values a point has beside its time."""
        self._coordinates = coordinates
        self._kept: dict[int, list[Point]] = {}
        self._width_s = 1e-3
        self._first_s = 0.0

    def add(self, time_s: float, *values: float) -> None:
        """Take a point. Times come nearly in order."""
        number = self._number(time_s)
        point = (time_s, *values)
        held = self._kept.get(number)
        if held is None:
            self._kept[number] = [point] * (2 + 2 * self._coordinates)
            return
        held[1] = point
        for axis in range(1, self._coordinates + 1):
            low = 2 * axis
            if _or_inf(point[axis], math.inf) < _or_inf(held[low][axis], math.inf):
                held[low] = point
            if _or_inf(point[axis], -math.inf) > _or_inf(held[low + 1][axis], -math.inf):
                held[low + 1] = point

    def points(self) -> list[Point]:
        """Return what is kept, in order of time."""
        return sorted({point for held in self._kept.values() for point in held})

    def __bool__(self) -> bool:
        """Return whether there is a point."""
        return bool(self._kept)

    def _number(self, time_s: float) -> int:
        """Return the stretch of a time, after making room for it."""
        if not self._kept:
            self._first_s = time_s
        number = int((time_s - self._first_s) // self._width_s)
        while len(self._kept) >= STRETCHES and number not in self._kept:
            old, self._kept, self._width_s = self._kept, {}, 2.0 * self._width_s
            for each, value in old.items():
                half = each // 2
                self._kept[half] = self._merged(self._kept[half], value) if half in self._kept else value
            number //= 2
        return number

    def _merged(self, first: list[Point], second: list[Point]) -> list[Point]:
        """Return first, last, and the extremes of two stretches."""
        found = [min(first[0], second[0]), max(first[1], second[1])]
        for axis in range(1, self._coordinates + 1):
            low = 2 * axis
            lower = _or_inf(second[low][axis], math.inf) < _or_inf(first[low][axis], math.inf)
            higher = _or_inf(second[low + 1][axis], -math.inf) > _or_inf(first[low + 1][axis], -math.inf)
            found += [second[low] if lower else first[low], second[low + 1] if higher else first[low + 1]]
        return found


def _or_inf(value: float, infinite: float) -> float:
    """Return a value, or one that is no extreme in place of a reading that is none."""
    return value if math.isfinite(value) else infinite


@dataclass
class Changes:
    """Values of something that holds until it changes, each with the time from which it holds."""

    kept: list[tuple[float, Any]] = field(default_factory=list)
    is_cut: bool = False

    def add(self, time_s: float, value: Hashable) -> None:
        """Take a value."""
        if self.kept and self.kept[-1][1] == value:
            return
        if len(self.kept) < MOST_CHANGES:
            self.kept.append((time_s, value))
        else:
            self.is_cut = True

    def stretches(self, end_s: float) -> Iterator[tuple[float, float, Any]]:
        """Return begin, end and value of every stretch, the last until an end."""
        ends = [time_s for time_s, _ in self.kept[1:]] + [end_s]
        for (begin_s, value), stop_s in zip(self.kept, ends, strict=True):
            yield max(0.0, begin_s), stop_s, value


@dataclass
class Pressure:
    """Absolute pressure, Pa, and what its sensor reads at ambient pressure: its mean before it is first evacuated."""

    readings: Envelope = field(default_factory=Envelope)
    _commanded: bool = False
    _evacuated: bool = False
    _sum_pa: float = 0.0
    _count: int = 0
    _highest_pa: float = -math.inf

    def command(self, *, evacuate: bool) -> None:
        """Take a command of its valve or pump."""
        self._commanded = True
        self._evacuated |= evacuate

    def add(self, time_s: float, pressure_pa: float) -> None:
        """Take a reading."""
        if not math.isfinite(pressure_pa):
            return
        self.readings.add(time_s, pressure_pa)
        self._highest_pa = max(self._highest_pa, pressure_pa)
        if not self._evacuated:
            self._sum_pa += pressure_pa
            self._count += 1

    @property
    def ambient_pa(self) -> float:
        """Reading at ambient pressure; the standard atmosphere where it was evacuated from the start.

        Of a bag without commands it is the highest reading, as nothing says when it is evacuated.
        """
        if not self._commanded and self._count:
            return self._highest_pa
        return self._sum_pa / self._count if self._count else STANDARD_ATMOSPHERE_PA


@dataclass
class Loop:
    """Force over length, and the work that the force did in all, N m."""

    path: Envelope = field(default_factory=lambda: Envelope(2))
    force: Envelope = field(default_factory=Envelope)
    work_j: float = 0.0
    _last: tuple[float, float] | None = None

    def add(self, time_s: float, length_m: float, force_n: float) -> None:
        """Take a pair; one that is not finite does no work."""
        if math.isfinite(length_m) and math.isfinite(force_n):
            if self._last is not None:
                self.work_j += (length_m - self._last[0]) * (force_n + self._last[1]) / 2.0
            self._last = (length_m, force_n)
        self.path.add(time_s, length_m, force_n)
        self.force.add(time_s, force_n)


class RunSamples:
    """Takes the messages of one ankle. Times are s since the start of the bag."""

    def __init__(self) -> None:
        """Begin with nothing."""
        self.pressures: dict[str, Pressure] = defaultdict(Pressure)
        self.set_points: dict[str, Changes] = defaultdict(Changes)
        self.states: dict[str, Changes] = defaultdict(Changes)
        self.solenoids: dict[str, Changes] = defaultdict(Changes)
        self.duty = Envelope()
        self.force: dict[str, Envelope] = defaultdict(Envelope)
        self.turning: dict[str, Envelope] = defaultdict(Envelope)
        self.tendons: dict[str, Loop] = defaultdict(Loop)
        self.cell = Loop()
        self.events = Changes()
        self._carriage_m: float | None = None
        pressures = {MANIFOLD: MANIFOLD_PRESSURE, **PRESSURES}
        self.takers: dict[str, Callable[[float, Any], None]] = {
            IMU.name: self._take_imu,
            PUMP_DUTY.name: self._take_duty,
            JAM_STATE.name: self._take_jam_state,
            TENDON_STATES.name: self._take_tendons,
            LOAD_CELL.name: self._take_cell,
            JOINT_STATES.name: self._take_joints,
            CONTACT_EVENTS.name: self._take_event,
            **{topic.name: self._pressure_taker(place) for place, topic in pressures.items()},
            **{topic.name: self._solenoid_taker(channel) for channel, topic in SOLENOIDS.items()},
        }
        """By the relative name of the topic."""

    def _take_imu(self, time_s: float, message: Any) -> None:
        for axis in "xyz":
            self.force[axis].add(time_s, getattr(message.linear_acceleration, axis))
            self.turning[axis].add(time_s, getattr(message.angular_velocity, axis))

    def _take_duty(self, time_s: float, message: Any) -> None:
        self.duty.add(time_s, message.data)
        self.pressures[MANIFOLD].command(evacuate=message.data > 0.0)

    def _take_jam_state(self, time_s: float, message: Any) -> None:
        for channel in message.channels:
            self.states[channel.channel].add(time_s, constant_name(channel, channel.state))
            self.set_points[channel.channel].add(time_s, channel.commanded_vacuum_pa)

    def _take_tendons(self, time_s: float, message: Any) -> None:
        for tendon in message.tendons:
            self.tendons[tendon.name].add(time_s, tendon.extension_m, tendon.tension_n)

    def _take_cell(self, time_s: float, message: Any) -> None:
        if self._carriage_m is not None:
            self.cell.add(time_s, self._carriage_m, message.wrench.force.z)

    def _take_joints(self, _time_s: float, message: Any) -> None:
        if CARRIAGE_JOINT in message.name and len(message.position) == len(message.name):
            self._carriage_m = float(message.position[message.name.index(CARRIAGE_JOINT)])

    def _take_event(self, time_s: float, message: Any) -> None:
        self.events.add(time_s, (constant_name(message, message.type), time_s))

    def _pressure_taker(self, place: str) -> Callable[[float, Any], None]:
        return lambda time_s, message: self.pressures[place].add(time_s, message.fluid_pressure)

    def _solenoid_taker(self, channel: str) -> Callable[[float, Any], None]:
        def take(time_s: float, message: Any) -> None:
            self.solenoids[channel].add(time_s, bool(message.data))
            self.pressures[channel].command(evacuate=bool(message.data))

        return take


def _panels(samples: RunSamples, duration_s: float) -> Iterator[Panel]:
    if any(pressure.readings for pressure in samples.pressures.values()):
        yield Panel("vacuum [kPa]", list(_vacuum(samples, duration_s)))
    bars = list(_state_bars(samples, duration_s))
    if bars:
        yield Panel("state", bars)
    if samples.duty:
        points = samples.duty.points()  # it comes on change: the last holds until the end
        points.append((max(duration_s, points[-1][0]), points[-1][1]))
        yield Panel("pump duty", [_curve("pump", points, COLOURS[4], steps=True)])
    for name, signals in (("specific force\n[m/s²]", samples.force), ("angular velocity\n[rad/s]", samples.turning)):
        if signals:
            curves = [
                _curve(axis, signal.points(), LINE_COLOURS[axis], _width(place, len(signals)))
                for place, (axis, signal) in enumerate(signals.items())
            ]
            yield Panel(name, curves, with_marks=True)
    if samples.tendons:
        yield Panel("tension [N]", _forces(samples.tendons), with_marks=True)
    if samples.cell.path:
        yield Panel("load cell [N]", _forces({"load cell": samples.cell}), with_marks=True)


def _vacuum(samples: RunSamples, duration_s: float) -> Iterator[Any]:
    places = (*CHANNELS, MANIFOLD)
    for place, name in enumerate(places):
        pressure, colour, width = samples.pressures.get(name), LINE_COLOURS[name], _width(place, len(places))
        if pressure is not None and pressure.readings:
            points = [(time_s, pressure.ambient_pa - reading_pa) for time_s, reading_pa in pressure.readings.points()]
            yield _curve(name, points, colour, width, unit=_PA_PER_KPA)
        wanted = samples.set_points.get(name)
        if wanted is not None:
            held = [*wanted.kept, (duration_s, wanted.kept[-1][1])]
            yield _curve(f"{name}, set point", held, colour, width, unit=_PA_PER_KPA, steps=True, dotted=True)


def _state_bars(samples: RunSamples, duration_s: float) -> Iterator[Any]:
    """Return the bars of all channels, those of one name and colour together, so that its legend stands once."""
    bars: dict[tuple[str, str], list[tuple[str, float, float]]] = defaultdict(list)
    for channel in CHANNELS:
        if channel in samples.states:
            for begin_s, end_s, state in samples.states[channel].stretches(duration_s):
                key = (state, STATE_COLOURS.get(state, STATE_COLOURS["UNKNOWN"]))
                bars[key].append((channel, begin_s, end_s))
        elif channel in samples.solenoids:
            for begin_s, end_s, is_on in samples.solenoids[channel].stretches(duration_s):
                key = ("energised" if is_on else "released", _ENERGISED[is_on])
                bars[key].append((channel, begin_s, end_s))
    for (name, colour), stretches in bars.items():
        yield go.Bar(
            y=[channel for channel, _, _ in stretches],
            x=[end_s - begin_s for _, begin_s, end_s in stretches],
            base=[begin_s for _, begin_s, _ in stretches],
            name=name,
            orientation="h",
            marker={"color": colour, "line": {"width": 0}},
            hovertext=[f"{name} from {begin_s:.3f} to {end_s:.3f} s" for _, begin_s, end_s in stretches],
            hoverinfo="text+y",
        )


def _forces(loops: dict[str, Loop]) -> list[Any]:
    return [
        _curve(name, loop.force.points(), _colour(name, place), _width(place, len(loops)))
        for place, (name, loop) in enumerate(loops.items())
    ]


def _loops(samples: RunSamples) -> Panel | None:
    loops, labels = dict(samples.tendons), ("tension [N]", "extension [mm]")
    if not loops:
        loops, labels = {"load cell": samples.cell}, ("load cell [N]", "carriage [mm]")
    if not any(loop.path for loop in loops.values()):
        return None
    curves = []
    for place, (name, loop) in enumerate(loops.items()):
        points = [(_MM_PER_M * length_m, force_n) for _, length_m, force_n in loop.path.points()]
        label = f"{name}: {loop.work_j:.3g} J taken up"
        curves.append(_curve(label, points, _colour(name, place), _width(place, len(loops))))
    return Panel(labels[0], curves, x_label=labels[1])


def _curve(
    name: str,
    points: Sequence[Point],
    colour: str,
    width: float = 1.0,
    *,
    unit: float = 1.0,
    steps: bool = False,
    dotted: bool = False,
) -> Any:
    """Return a line. `dotted` is for what was asked for, `steps` for what holds until it changes."""
    line = {"color": colour, "width": width, "dash": "dot" if dotted else "solid", "shape": "hv" if steps else "linear"}
    x, y = tuple(point[0] for point in points), tuple(point[1] / unit for point in points)
    return go.Scatter(x=x, y=y, name=name, line=line, mode="lines")


def _width(place: int, curves: int) -> float:
    """Return the width of a line, points: wider the earlier it is drawn, so that equal ones are all seen."""
    return 1.0 + 1.4 * (curves - 1 - place)


def _colour(name: str, place: int) -> str:
    """Return the colour of a tendon, or of a load cell, which has none of its own."""
    return LINE_COLOURS.get(name, COLOURS[place % len(COLOURS)])


def _cut_note(samples: RunSamples) -> str:
    """Return what to say where a state changed too often to be drawn; empty otherwise."""
    cut = [name for name, each in (*samples.states.items(), *samples.solenoids.items()) if each.is_cut]
    if samples.events.is_cut:
        cut.append("contact events")
    return f"only the first {MOST_CHANGES} changes are drawn of {', '.join(cut)}" if cut else ""


def _over_time(picture: RunPicture) -> go.Figure:
    panels, legends = picture.panels, {}
    figure = make_subplots(rows=len(panels), cols=1, shared_xaxes=True, vertical_spacing=0.02)
    for row, panel in enumerate(panels, start=1):
        legend = "legend" if row == 1 else f"legend{row}"
        for trace in panel.traces:
            figure.add_trace(trace.update(legend=legend), row=row, col=1)
        backwards = {"autorange": "reversed"} if isinstance(panel.traces[0], go.Bar) else {}
        figure.update_yaxes(title_text=panel.y_label.replace("\n", "<br>"), row=row, col=1, **backwards)
        if panel.with_marks:
            _add_marks(figure, picture, row)
        top = figure.layout[f"yaxis{row if row > 1 else ''}"].domain[1]
        legends[legend] = {"y": top, "yanchor": "top", "x": 1.01}
    figure.update_xaxes(title_text=panels[-1].x_label, row=len(panels), col=1)
    figure.update_xaxes(range=[0.0, max(picture.duration_s, LEAST_S)])
    figure.update_layout(
        height=_PANEL_PX * len(panels) + 80,
        margin={"t": 30},
        barmode="overlay",
        template="plotly_white",
        hovermode="x",
        **legends,
    )
    return figure


def _add_marks(figure: go.Figure, picture: RunPicture, row: int) -> None:
    named = len(picture.marks) <= _MOST_LABELS
    for time_s, name in picture.marks:
        colour = EVENT_COLOURS.get(name, EVENT_COLOURS["UNKNOWN"])
        label = {"text": name, "textangle": -90, "font": {"size": 9, "color": colour}}
        line = {"color": colour, "width": 1}
        figure.add_vline(x=time_s, line=line, annotation=label if named else None, row=row, col=1)


def _over_length(panel: Panel) -> go.Figure:
    figure = go.Figure(panel.traces)
    figure.update_layout(
        height=_LOOP_PX,
        template="plotly_white",
        showlegend=True,
        xaxis_title=panel.x_label,
        yaxis_title=panel.y_label,
    )
    return figure
