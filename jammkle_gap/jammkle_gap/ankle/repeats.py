"""Which runs are repeats: those whose machine was made to do the same, as far as their bags show.

What counts is what was done: the rig and its known options, when solenoids switched, the vacuum that was held, how a
carriage was driven. The pump's duty does not count: it is the regulator's answer to the machine. Options that nobody
knows make no two runs equal; they only do not tell them apart.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from typing import TYPE_CHECKING, Any

import numpy as np

from jammkle_common import names
from jammkle_common.constants import STANDARD_ATMOSPHERE_PA
from jammkle_gap.ankle.inputs import inputs_of
from jammkle_sim.rigs.catalogue import rig_kind

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jammkle_gap.ankle.inputs import AnkleInputs
    from jammkle_gap.ankle.shank import ShankMotion
    from jammkle_gap.core.data import Recording
    from jammkle_sim.rigs.replay import Course, Timeline

TIME_TOLERANCE_S = 0.25
"""What switchings, releases and turns of repeats may differ by, s. Assumed: the jitter of a person at a switch."""
COURSE_TOLERANCE = 0.05
"""What the courses of repeats may differ by at any time, as a share of their range. Assumed: a drive whose speed is 1 %
off is 2 % off its way back."""
RANGE_TOLERANCE = 0.02
"""The same of the range itself: a pull of 20.4 mm is none of 20 mm. Assumed: what a speed by time makes of a way."""
VACUUM_TOLERANCE_PA = 8e3
"""What the held vacuum of repeats may differ by, Pa. Assumed: a regulator lets the manifold go 2 kPa deeper while a
slow channel follows, and one that is tuned badly overshoots by some more; set points are further apart."""
_SCATTERS = 6.0
"""Difference of options up to which they scatter, in standard deviations of the rig's own scatter: the most that two
repeats of `jammkle rig --repeats` differ by."""
HEIGHT, PITCH = "drop_height_m", "pitch_deg"
PROGRAMME = frozenset(
    {"speed_m_s", "extension_m", "descent_m", "cycles", "jam_time_s", "vent_time_s", "jam", "release_time_s", "seed"}
)
"""Options that only say what a rig does by itself: what was done instead is in the recording."""
_REGULATING = 0.95
"""Duty of the pump below which it holds its set point; at full duty it may not reach it."""
STILL_M = 2e-4
"""Range below which a driven carriage stands still. Assumed: ten times the noise of a slide."""
_DRAWN = ("vented", "drawn")
COMPARED_S = 0.01
"""Time between two places of a course that are compared, s."""
_SWITCHED_S = 0.1
"""Of the times at which solenoids switch, s. Chosen: programmes differ by tenths of a second, their repeats by ms."""
_COARSE_PA = 5e3
"""Of pressures, Pa. Chosen: set points are round numbers, and held to 2 kPa."""
_COARSE_M, _COARSE_DEG = 0.005, 5.0
"""Of a drop height and of a hanging foot's pitch. Chosen: a tenth of what is usual."""
_DIGITS = 2
"""Of way and speed of a carriage that count. Chosen: what a person sets has no more."""
_LEAST_READING = np.array((1.0, 1.0, 1.0, 0.1, 0.1, 0.1))
"""What an IMU reads that counts as a motion, m/s^2 and rad/s. Assumed: above offsets."""
_MOVED = 1.2
"""Ratio of neighbouring sizes of a motion. Chosen: a signature that is a tenth larger or smaller counts as the same."""
_LENGTH = math.sqrt(2.0)
"""Ratio of neighbouring lengths of a recording. Chosen: beyond its end a signature is taken to stay as it is."""


def difference(one: Recording, other: Recording) -> str:
    """Say what two runs differ in, first found; empty if they are repeats."""
    first, second = inputs_of(one), inputs_of(other)
    if first.rig != second.rig:
        return f"rig {first.rig}, not {second.rig}"
    lengths_s = length_s(one), length_s(other)
    return (
        _options_differ(first, second)
        or _commands_differ(first, second, lengths_s)
        or _start_differs(first, second)
        or _vacuum_differs(one, other)
        or _courses_differ(first.course, second.course, min(lengths_s))
        or _shanks_differ(first.shank, second.shank, min(lengths_s))
        or _releases_differ(first, second)
    )


def held_vacuum(recording: Recording) -> tuple[float | None, bool]:
    """Return the vacuum that was held, Pa, and whether the pump regulated it: without, it may not have been reached.

    It is the median of the channels that are drawn and the manifold, in the last third of the longest stretch in which
    any is: one that leaks, is slow to follow or has a bad sensor does not count. None where nothing is drawn, or none
    of their pressures was measured.
    """
    inputs = inputs_of(recording)
    end_s = length_s(recording)
    best: tuple[float, float, list[str]] = (0.0, 0.0, [])
    for channel, line in inputs.commands.solenoids.items():
        for begin_s, finish_s in _drawn(line, end_s):
            if finish_s - begin_s > best[1] - best[0] + COMPARED_S:
                best = (begin_s, finish_s, [channel])
            elif abs(begin_s - best[0]) + abs(finish_s - best[1]) < COMPARED_S:
                best[2].append(channel)
    begin_s, finish_s, channels = best
    from_s = finish_s - (finish_s - begin_s) / 3.0
    ambient_pa = STANDARD_ATMOSPHERE_PA if inputs.ambient_pa is None else inputs.ambient_pa
    drawn = {names.MANIFOLD_PRESSURE.name, *(names.PRESSURES[channel].name for channel in channels)}
    levels_pa = []
    for signal in recording.signals:
        if channels and signal.name in drawn:
            late = signal.values[(signal.time_s >= from_s) & (signal.time_s <= finish_s)]
            levels_pa += [ambient_pa - float(np.median(late))] if len(late) else []
    if not levels_pa:
        return None, False
    duty = inputs.commands.duty
    at = np.searchsorted(duty.time_s, np.linspace(from_s, finish_s, 50), side="right")
    duties = np.concatenate(([0.0], duty.values))[at]
    return float(np.median(levels_pa)), bool(np.median(duties) < _REGULATING)


def length_s(recording: Recording) -> float:
    """Return when the last sample of a recording was taken, s since its start."""
    return max(float(signal.time_s[-1]) for signal in recording.signals)


def driven(course: Course, length_s: float) -> tuple[float, float]:
    """Return how far a carriage was driven, m, and how fast for most of the way, m/s; 0 where it stands still."""
    range_m = float(np.ptp(course.position_m))
    speeds_m_s = np.abs(np.diff(course.at(np.arange(0.0, length_s, COMPARED_S)))) / COMPARED_S
    moves = range_m > STILL_M and len(speeds_m_s) > 0
    return range_m, float(np.median(speeds_m_s[speeds_m_s > 0.5 * speeds_m_s.max()])) if moves else 0.0


def short(value: Any) -> str:
    """Return an option's value as a text."""
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def scatter_of(inputs: AnkleInputs) -> dict[str, float]:
    """Return the standard deviation over repeats of the options that a rig cannot set exactly."""
    kind = rig_kind(inputs.rig)
    options = kind.options(**dict(inputs.options))
    found: dict[str, float] = {}
    for numbers in ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)):
        changed = kind.scatter(options, numbers)
        for name, value in inputs.options:
            apart = getattr(changed, name)
            if apart != value:
                found[name] = max(found.get(name, 0.0), abs(apart - value))
    return found


def _options_differ(first: AnkleInputs, second: AnkleInputs) -> str:
    scatter = scatter_of(first)
    one, other = dict(first.options), dict(second.options)
    for name, value in one.items():
        if name in PROGRAMME or (name == "channel" and first.rig != "tensile"):
            continue
        if (name in first.known) != (name in second.known):
            if name == "vacuum_pa":  # what was held is compared
                continue
            return f"{name} is known of one alone"
        tolerance = _SCATTERS * scatter.get(name, 0.0)
        wanted = other[name]
        if value != wanted and (isinstance(value, str) or abs(value - wanted) > tolerance):
            return f"{name} {short(value)}, not {short(wanted)}"
    return ""


def switchings(line: Timeline | None, length_s: float) -> list[tuple[float, float]]:
    """Return when a solenoid changes and to what, from a little before the start to a time."""
    if line is None:
        return []
    changes = line.changes()
    return [
        (time_s, value)
        for time_s, value in zip(changes.time_s.tolist(), changes.values.tolist(), strict=True)
        if -TIME_TOLERANCE_S <= time_s <= length_s
    ]


def _drawn(line: Timeline, end_s: float) -> list[tuple[float, float]]:
    """Return begin and end of every stretch in which a solenoid draws, within the run."""
    changes = line.changes()
    ends_s = np.append(changes.time_s, np.inf)[1:]
    rows = zip(changes.time_s.tolist(), ends_s.tolist(), changes.values.tolist(), strict=True)
    return [
        (max(begin_s, 0.0), min(finish_s, end_s))
        for begin_s, finish_s, value in rows
        if value > 0.0 and finish_s > 0.0 and begin_s < end_s
    ]


def _commands_differ(first: AnkleInputs, second: AnkleInputs, lengths_s: tuple[float, float]) -> str:
    for channel in names.CHANNELS:
        lines = [each.commands.solenoids.get(channel) for each in (first, second)]
        one, other = (switchings(line, each_s) for line, each_s in zip(lines, lengths_s, strict=True))
        # What comes before the start may be longer ago in the other, and what comes as the shorter ends missing there.
        while len(one) > len(other) and one[0][0] < 0.0:
            one.pop(0)
        while len(other) > len(one) and other[0][0] < 0.0:
            other.pop(0)
        while len(one) > len(other) and abs(one[-1][0] - lengths_s[1]) < TIME_TOLERANCE_S:
            one.pop()
        while len(other) > len(one) and abs(other[-1][0] - lengths_s[0]) < TIME_TOLERANCE_S:
            other.pop()
        if len(one) != len(other):
            return f"{channel} switches {len(one)} times, not {len(other)}"
        states = [0.0 if line is None else line.at(0.0) for line in lines]
        if not one and states[0] != states[1]:
            return f"{channel} is {_DRAWN[states[0] > 0.0]} from before the start on, not {_DRAWN[states[1] > 0.0]}"
        for (one_s, value), (other_s, wanted) in zip(one, other, strict=True):
            if value != wanted or abs(one_s - other_s) > TIME_TOLERANCE_S:
                return f"{channel} switches at {one_s:.2f} s, not {other_s:.2f} s"
    return ""


def _start_differs(first: AnkleInputs, second: AnkleInputs) -> str:
    lines = (*first.commands.solenoids.values(), *second.commands.solenoids.values())
    if any((np.abs(line.changes().time_s) < TIME_TOLERANCE_S).any() for line in lines):
        return ""  # one begins in the midst of what the other begins with
    if (first.start_pa is None) != (second.start_pa is None):
        return "one begins evacuated, the other vented"
    if first.start_pa is not None and second.start_pa is not None:
        apart_pa = float(np.abs(first.start_pa - second.start_pa).max())
        if apart_pa > VACUUM_TOLERANCE_PA:
            return f"pressures at the start differ by {1e-3 * apart_pa:.1f} kPa"
    return ""


def _vacuum_differs(one: Recording, other: Recording) -> str:
    (first_pa, first_holds), (second_pa, second_holds) = held_vacuum(one), held_vacuum(other)
    if first_pa is None or second_pa is None:
        return ""  # no channel is drawn in either, or its pressure was not measured
    is_same = (not second_holds or first_pa - second_pa <= VACUUM_TOLERANCE_PA) and (
        not first_holds or second_pa - first_pa <= VACUUM_TOLERANCE_PA
    )
    return "" if is_same else f"{1e-3 * first_pa:.1f} kPa held, not {1e-3 * second_pa:.1f}"


def _courses_differ(first: Course | None, second: Course | None, length_s: float) -> str:
    if first is None or second is None:
        return "" if first is second else "the carriage was driven in one alone"
    time_s = np.arange(0.0, length_s, COMPARED_S)
    one_m, other_m = first.at(time_s), second.at(time_s)
    ranges_m = [float(np.ptp(each.position_m)) for each in (first, second)]
    range_m = max(ranges_m)
    if abs(ranges_m[0] - ranges_m[1]) > max(RANGE_TOLERANCE * range_m, STILL_M):
        return f"the carriage goes {1e3 * ranges_m[0]:.1f} mm, not {1e3 * ranges_m[1]:.1f}"
    # Where a clamp sits is scatter, and so is when a drive moves off; how far it then goes is not.
    one_m, other_m = one_m - one_m[0], other_m - other_m[0]
    late = min(int(TIME_TOLERANCE_S / COMPARED_S), len(time_s) // 2)
    shifts = [np.abs(one_m[max(-k, 0) : len(one_m) - max(k, 0)] - other_m[max(k, 0) : len(other_m) - max(-k, 0)])
              for k in range(-late, late + 1)]  # fmt: skip
    apart_m = min(shifts, key=lambda each: float(each.max()))
    if apart_m.max() > max(COURSE_TOLERANCE * range_m, STILL_M):
        at_s = float(time_s[int(np.argmax(apart_m))])
        return f"the carriage is {1e3 * apart_m.max():.1f} mm elsewhere at {at_s:.2f} s"
    return ""


def _shanks_differ(first: ShankMotion | None, second: ShankMotion | None, length_s: float) -> str:
    """Compare how fast shanks turned, however late: an IMU that is mounted a little askew reads nearly the same."""
    if first is None or second is None:
        return "" if first is second else "the motion of the shank was measured in one alone"
    time_s = np.arange(0.0, length_s, _TURNED_S)
    one, other = (
        np.column_stack([np.interp(time_s, each.time_s, axis) for axis in each.readings[:, 3:].T])
        for each in (first, second)
    )
    late = min(int(TIME_TOLERANCE_S / _TURNED_S), len(time_s) // 2)
    apart = min(
        float(np.square(one[max(-k, 0) : len(one) - max(k, 0)] - other[max(k, 0) : len(one) - max(-k, 0)]).mean())
        for k in range(-late, late + 1)
    )
    apart_rad_s, most_rad_s = np.sqrt(apart), np.sqrt(max(np.square(one).mean(), np.square(other).mean()))
    if apart_rad_s <= max(_TURNED_SHARE * most_rad_s, _LEAST_READING[3]):
        return ""
    return f"the shank turns otherwise, by {apart_rad_s:.2g} of {most_rad_s:.2g} rad/s (root mean square)"


_TURNED_S = 0.005
"""Time between two rates of turning that are compared, s. Chosen: a thirtieth of a turn and back at 6 Hz."""
_TURNED_SHARE = 0.5
"""What rates of turning of repeats may differ by, as a share of them. Assumed: servos repeat a motion to some per cent,
hands that do it again differ by all of it."""


def _releases_differ(first: AnkleInputs, second: AnkleInputs) -> str:
    if first.release_s is None or second.release_s is None:
        return ""
    if abs(first.release_s - second.release_s) <= TIME_TOLERANCE_S:
        return ""
    return f"released at {first.release_s:.2f} s, not {second.release_s:.2f} s"


def with_settings(recordings: Sequence[Recording]) -> tuple[Recording, ...]:
    """Return recordings with their settings: the same text for those that are repeats of the first of their kind."""
    groups: list[list[int]] = []
    for i, recording in enumerate(recordings):
        own = next((group for group in groups if not difference(recordings[group[0]], recording)), None)
        if own is None:
            groups.append([i])
        else:
            own.append(i)
    found = list(recordings)
    texts: list[str] = []
    for group in groups:
        plain = setting_text(recordings[group[0]])
        numbered = (f"{plain} ({number})" for number in itertools.count(2))
        texts.append(next(text for text in itertools.chain([plain], numbered) if text not in texts))
        for i in group:
            found[i] = dataclasses.replace(recordings[i], setting=texts[-1])
    return tuple(found)


def setting_text(recording: Recording) -> str:
    """Return a short text of what a machine was made to do."""
    inputs = inputs_of(recording)
    kind = rig_kind(inputs.rig)
    defaults: dict[str, Any] = dataclasses.asdict(kind.options())
    hidden = PROGRAMME | set(scatter_of(inputs)) | {"vacuum_pa", HEIGHT, "timestep_s", "parameter_set"}
    parts = [inputs.rig]
    for name, value in inputs.options:
        if name not in hidden and value != defaults[name]:
            is_word = isinstance(value, str) and value not in {"yes", "no"}
            parts.append(str(value) if is_word else f"{name} {short(value)}")
    held_pa, _ = held_vacuum(recording)
    parts.append("not jammed" if held_pa is None else f"{1e-3 * held_pa:.0f} kPa")
    if inputs.course is not None:
        range_m, fast_m_s = driven(inputs.course, length_s(recording))
        parts.append(f"{1e3 * range_m:.1f} mm at {1e3 * fast_m_s:.3g} mm/s")
    if HEIGHT in defaults:
        parts.append(f"{1e3 * float(dict(inputs.options)[HEIGHT]):.0f} mm")
    return ", ".join(parts)


def group_of(recording: Recording) -> str:
    """Return text that is the same for recordings that share signatures: coarsely the same was done.

    Signatures are simulated once for a group of recordings and kept on disk. Exactly taken, every recording would have
    signatures of its own. So what was measured is rounded, by what moves a signature by no more than a bin of time or a
    tenth of its size. Where a setting lies on the edge between two places of the rounding, its recordings fall into two
    groups.
    """
    inputs, end_s = inputs_of(recording), length_s(recording)
    held_pa, _ = held_vacuum(recording)
    parts = (
        inputs.rig,
        _coarse_options(inputs),
        inputs.ankle,
        [(channel, _switched(inputs, channel, end_s)) for channel in names.CHANNELS],
        None if held_pa is None else round(held_pa / _COARSE_PA),
        None if inputs.start_pa is None else [round(each / _COARSE_PA) for each in inputs.start_pa.tolist()],
        None if inputs.ambient_pa is None else round(inputs.ambient_pa / _COARSE_PA),
        None if inputs.course is None else [f"{each:.{_DIGITS}g}" for each in driven(inputs.course, end_s)],
        None if inputs.shank is None else _moved(inputs.shank),
        round(math.log(end_s) / math.log(_LENGTH)),
        (inputs.release_seen_by, inputs.exact),
    )
    return repr(parts)


def _coarse_options(inputs: AnkleInputs) -> list[tuple[str, object]]:
    """Return the rig's options, but for its programme, of which the recording has what was done, and for scatter."""
    coarse = {HEIGHT: _COARSE_M, PITCH: _COARSE_DEG}
    hidden = (PROGRAMME | {"vacuum_pa"} | set(scatter_of(inputs))) - set(coarse)
    return [
        (name, round(float(value) / coarse[name]) if name in coarse else value)
        for name, value in inputs.options
        if name not in hidden
    ]


def _moved(shank: ShankMotion) -> list[int]:
    """Return how much an IMU read about each of its axes, coarsely."""
    sizes = np.sqrt(np.square(shank.readings).mean(axis=0)) / _LEAST_READING
    return [round(math.log(max(size, 1.0)) / math.log(_MOVED)) for size in sizes.tolist()]


def _switched(inputs: AnkleInputs, channel: str, end_s: float) -> list[tuple[int, float]]:
    """Return when a solenoid switches, in tenths of a second, and to what; before the start, how it is then."""
    line = inputs.commands.solenoids.get(channel)
    if line is None:
        return []
    within = [(round(max(time_s, 0.0) / _SWITCHED_S), value) for time_s, value in switchings(line, end_s)]
    return [(0, line.at(0.0)), *within]
