"""`jammkle detect`: detectors and policy over a recording, its events as JSON, and a picture."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from rich.table import Table

from jammkle_common.command.errors import InputError
from jammkle_common.command.results import EVENT_COLOURS, LINE_COLOURS, STYLE, check_writable, console, write_json
from jammkle_common.constants import NANOSECONDS_PER_SECOND
from jammkle_common.parameters import ParameterError, from_mapping, rows
from jammkle_controller.core.events import ContactKind
from jammkle_controller.parameters import ControllerParameters, Mount
from jammkle_controller.recordings import read_bag, read_table, replay

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from jammkle_controller.recordings import Recording, Replay, TableFormat

_KPA = 1e3


def draw(recording: Recording, replay: Replay, path: Path) -> None:
    """Write the picture.

    Raises:
        OSError: it cannot be written.

    """
    rows = np.array(recording.samples, dtype=float)
    time_s = [recording.at_s(sample.time_ns) for sample in recording.samples]
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(11.0, 8.0), layout="constrained")
        force, rate, swing, vacuum = figure.subplots(4, 1, sharex=True, height_ratios=(3, 2, 1.5, 1.5))
        force.plot(time_s, np.linalg.norm(rows[:, 1:4], axis=1), color="#444444", linewidth=0.7)
        force.set_ylabel("|specific force|\n[m/s²]")
        rate.plot(time_s, np.linalg.norm(rows[:, 4:7], axis=1), color="#444444", linewidth=0.7)
        rate.set_ylabel("|angular velocity|\n[rad/s]")
        for kind in ContactKind:
            colour = EVENT_COLOURS[kind.name]
            times = [recording.at_s(event.time_ns) for event in replay.events if event.kind is kind]
            for axes in (force, rate):
                for index, at_s in enumerate(times):
                    axes.axvline(at_s, color=colour, linewidth=0.9, label=None if index else kind.value)
        if force.get_legend_handles_labels()[0]:
            force.legend(loc="upper right", ncols=5)
        times_ns, probability = zip(*replay.swing, strict=True)
        swing.plot([recording.at_s(each) for each in times_ns], probability, color="#1f5fa8")
        swing.set_ylabel("P(off the ground)")
        swing.set_ylim(-0.05, 1.05)
        if recording.reference:
            beside = swing.twinx()
            times_ns, values = zip(*recording.reference, strict=True)
            beside.plot([recording.at_s(each) for each in times_ns], values, color="#888888", linewidth=0.7)
            beside.set_ylabel("reference")
        changes = replay.decisions
        for channel in changes[0].vacuum_pa if changes else ():
            times = [*(recording.at_s(each.time_ns) for each in changes), time_s[-1]]
            wanted = [each.vacuum_pa[channel] / _KPA for each in changes]
            vacuum.step(times, [*wanted, wanted[-1]], where="post", label=channel, color=LINE_COLOURS.get(channel))
        vacuum.set_ylabel("wanted vacuum\n[kPa]")
        vacuum.set_xlabel("time [s]")
        if changes:
            vacuum.legend(loc="upper right", ncols=3)
        for at_ns, reason in replay.troubles:
            if reason:
                vacuum.axvline(recording.at_s(at_ns), color="#c1121f", linestyle=":", linewidth=0.8)
        figure.suptitle(f"{recording.name}: {len(replay.events)} events")
        figure.savefig(path, dpi=130)


_LEAST_USED = 0.1
"""Share of the samples that must be usable. Assumed: a topic that repeats every row nine times is still an IMU."""
_TABLES = (".csv", ".txt", ".tsv")
SHAKEN_M_S2 = 1.0
"""Root mean square of the specific force about its mean over `SHAKEN_WINDOW_S`, m/s^2, from which on a foot moves: one
that stands is shaken by some tenths."""
SHAKEN_WINDOW_S = 0.5
LEAST_SHAKEN_S = 2.0
"""A foot that moves for so long without a step is doubted, s: two strides or more."""


def detect(
    path: Path,
    settings: Sequence[str],
    layout: TableFormat,
    *,
    topic: str,
    namespace: str | None,
    output: Path,
    json: Path | None,
) -> int:
    """Run detectors and policy over a recording, a bag or a table; return the exit code. `settings` are `NAME=VALUE`.

    Raises:
        InputError: the recording cannot be read, or a parameter is none.

    """
    check_writable(json)
    parameters = parameters_from(settings)
    is_table = path.suffix.lower() in _TABLES
    if is_table and not path.exists():
        msg = f"{path} is not there"
        raise InputError(msg)
    if is_table and topic:
        msg = f"--topic {topic} is of bags, and {path} is a table: its columns are --force and --rate"
        raise InputError(msg)
    recording = read_table(path, layout) if is_table else read_bag(path, topic, namespace, parameters, layout)
    if not recording.samples:
        msg = f"{path} holds no sample of an IMU"
        raise InputError(msg)
    made = replay(recording.received, parameters, recording.leg)
    _check_used(path, made)
    content = as_dict(recording, made, parameters)
    events, picture = output / "events.json", output / "detect.png"
    try:
        output.mkdir(parents=True, exist_ok=True)
        draw(recording, made, picture)
    except OSError as error:
        msg = f"-o {output} cannot be written: {error.strerror}"
        raise InputError(msg) from error
    write_json(events, content)
    write_json(json, content)
    _show(recording, made, content["doubt"], events, picture)
    return 0


def _check_used(path: Path, made: Replay) -> None:
    """Refuse a recording most of whose samples say nothing.

    Raises:
        InputError: as said.

    """
    counts = made.counts
    every = counts.usable + counts.held + counts.ignored
    if counts.usable < _LEAST_USED * every:
        msg = (
            f"{path} holds {every} samples of the IMU, of which {counts.usable} can be used: {counts.late} do not come"
        )
        msg += f" later than the one before, {counts.repeated} repeat its values, {counts.not_finite} are no numbers"
        msg += f", {counts.out_of_range} out of range"
        raise InputError(msg)


def parameters_from(settings: Sequence[str]) -> ControllerParameters:
    """Return the controller's parameters from `NAME=VALUE`.

    Raises:
        InputError: there is no such parameter, or the value is out of range.

    """
    known = {row.name: row for row in rows(ControllerParameters)}
    values: dict[str, object] = {}
    for setting in settings:
        name, equals, text = setting.partition("=")
        if not equals:
            msg = f"--set {setting}: it must be NAME=VALUE"
            raise InputError(msg)
        values[name] = _value(known[name].default, text) if name in known else text
    try:
        return from_mapping(ControllerParameters, values)
    except ParameterError as error:
        msg = f"{error} (--set, or --mount)" if "imu_mount" in str(error) else f"--set: {error}"
        raise InputError(msg) from error


def _value(default: object, text: str) -> object:
    if isinstance(default, bool):
        return {"true": True, "false": False}.get(text, text)
    if isinstance(default, float):
        try:
            return float(text)
        except ValueError:
            return text
    return text


def as_dict(recording: Recording, made: Replay, parameters: ControllerParameters) -> dict[str, Any]:
    """Return all that was found for machines: times in s from the first sample, and stamps in ns."""
    counts = made.counts
    return {
        "recording": recording.name,
        "imu_topic": recording.imu_topic,
        "mount": parameters.imu_mount,
        "begin_ns": recording.samples[0].time_ns,
        "samples": {name: getattr(counts, name) for name in ("usable", "held", "ignored", "gaps")},
        "events": [
            {
                "time_s": recording.at_s(event.time_ns),
                "stamp_ns": event.time_ns,
                "kind": event.kind.value,
                "magnitude": event.magnitude,
                "unit": event.unit,
                "detection_delay_s": event.detection_delay_s,
                "probability": event.probability,
                "source": event.source.value,
                "direction": list(event.direction),
            }
            for event in made.events
        ],
        "decisions": [
            {"time_s": recording.at_s(each.time_ns), "state": each.state, "vacuum_pa": each.vacuum_pa}
            for each in made.decisions
        ],
        "unavailable": [{"time_s": recording.at_s(at_ns), "why": why} for at_ns, why in made.troubles],
        "doubt": doubt_of(recording, made, parameters),
    }


def doubt_of(recording: Recording, made: Replay, parameters: ControllerParameters) -> str:
    """Return why events may be missing that nothing else explains; empty: no reason is known.

    Steps of a foot or shank are recognised by how it turns and jerks as it swings. One that is shaken for long without
    a single step either does not step, or steps as none of those did that the detectors learned from.
    """
    steps = any(event.kind in (ContactKind.IMPACT, ContactKind.LIFTOFF) for event in made.events)
    if steps or parameters.imu_mount == Mount.BODY.value:
        return ""
    table = np.array(recording.samples, dtype=float)
    begin = np.floor((table[:, 0] - table[0, 0]) / (SHAKEN_WINDOW_S * NANOSECONDS_PER_SECOND))
    _, window, count = np.unique(begin, return_inverse=True, return_counts=True)  # clocks may be set
    force_m_s2 = np.linalg.norm(table[:, 1:4], axis=1)
    mean = np.bincount(window, force_m_s2) / count
    rms_m_s2 = np.sqrt(np.bincount(window, np.square(force_m_s2 - mean[window])) / count)
    shaken_s = SHAKEN_WINDOW_S * int(np.sum(rms_m_s2 > SHAKEN_M_S2))
    if shaken_s < LEAST_SHAKEN_S:
        return ""
    turning_rad_s = float(np.percentile(np.linalg.norm(table[:, 4:], axis=1), 95.0))
    return (
        f"the IMU was shaken for {shaken_s:g} s and no step was recognised; at 95 % of the samples it turned by less "
        f"than {turning_rad_s:.2g} rad/s, and a {parameters.imu_mount} that hardly turns as it swings is not "
        "recognised: its contact needs a switch, the load, efforts or the gait"
    )


def _show(recording: Recording, made: Replay, doubt: str, events: Path, picture: Path) -> None:
    screen = console()
    counts = Counter(event.kind.value for event in made.events)
    table = Table("event", "count", title=f"{recording.name}: {made.counts.usable} samples used")
    for kind, count in counts.items():
        table.add_row(kind, str(count))
    screen.print(table)
    for _, why in made.troubles[-1:]:
        if why:
            screen.print(f"detection was unavailable at the end: {why}")
    if doubt:
        screen.print(f"doubt: {doubt}")
    screen.print(f"events: {events}\npicture: {picture}")
