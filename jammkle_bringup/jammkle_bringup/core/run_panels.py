"""The standard picture of a run: vacuum and set points, states, pump, IMU with events, tension against extension."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from jammkle_bringup.core.panels import COLOURS, Bar, Curve, Mark, Panel, RunPicture
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

    from jammkle_bringup.core.envelope import Envelope
    from jammkle_bringup.core.run_samples import Changes, Loop

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
