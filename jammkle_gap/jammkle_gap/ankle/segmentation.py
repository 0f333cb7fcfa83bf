"""Where the runs of a bag begin and end, and the phases of each.

There is one run for as long as a machine was driven, jammed and vented, and one per release where it was let go. Times
of a run count from a start that is the same in all its repeats, whenever their recorders were switched on: the release,
the first motion or the first command comes when the rig's own programme has it.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from jammkle_common import names
from jammkle_gap.ankle.alignment import falls_of_imu, falls_of_slide
from jammkle_gap.ankle.bag import CARRIAGE, COMMANDS
from jammkle_gap.ankle.inputs import FALLING_RIGS, course_of, reading_noise_m
from jammkle_gap.ankle.sensors import half_rise_s, pressure_signals
from jammkle_gap.core.data import Phase
from jammkle_sim.rigs.replay import Timeline, timestep_s

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_gap.ankle.bag import Samples
    from jammkle_gap.ankle.shank import ShankMotion
    from jammkle_gap.core.data import Signal
    from jammkle_sim.rigs.replay import CommandTrack
    from jammkle_sim.rigs.rig import Rig

_SIMULATED_START_S = 60.0
"""A simulated rig's stamps begin no later than this, s, unless the simulation was reset."""
_TOLERANCE_S = 0.25
"""How far a simulated run may begin from when its stamps say. Assumed: beyond every delay of the library."""
_LANDED_S = 0.5
"""How long after its touch-down a leg bounces no more as high as half its fall, and nobody has taken it up. Assumed."""
_CALM_S = 1.0
"""The same until its IMU is calm. Assumed: no foot of the catalogue bounces for longer."""
_LIFTED, _LEFT = 0.5, 0.1
"""Shares of the way from rest back to where it was let go: a slide that comes that high is lifted for the next run, and
was left alone while it was below the other. Assumed."""
_HANDLED_M_S2 = 2.5
"""Difference of specific force from rest from which on a leg that has landed is handled. Assumed: a quarter of 1 g."""
_PRESSURE_START_S = 0.2
"""When the first command of a pressure run comes: as in the pressure rig."""
_MOVED_M = 2e-4
"""Way after which a driven slide has certainly moved off, at least. Assumed: ten times the noise of a slide."""
_CLEAR = 6.0
"""The same in standard deviations of its readings."""
_FEWEST = 5


@dataclass(frozen=True)
class Segment:
    """One run, by the clock of the stamps."""

    start_s: float
    """Where its times count from."""
    end_s: float
    release_s: float | None = None
    """When its carriage was let go, where that was seen and is not when the rig's programme has it."""
    seen_by: str = ""
    """Topic of the sensor that saw it."""


def segment_of_simulation(segment: Segment, first_s: float) -> Segment:
    """Return a run on the simulation's own clock where it begins when that says, within what is seen of it.

    Args:
        segment: As its motion or commands show.
        first_s: First stamp.

    """
    if first_s >= _SIMULATED_START_S or abs(segment.start_s) > _TOLERANCE_S:
        return segment
    return dataclasses.replace(segment, start_s=0.0)


def falling_segments(topics: Mapping[str, Samples], rig: Rig) -> tuple[Segment, ...]:
    """Return one run per release that carriage or IMU show.

    Args:
        topics: What was measured.
        rig: Lets its carriage go at its first event.

    """
    lead_s = _programme_s(rig)
    _, last_s = _reach(topics)
    seen, seen_by = _releases(topics, rig)
    found = []
    for place, (release_s, fall_s) in enumerate(seen):
        next_s = seen[place + 1][0] - lead_s if place + 1 < len(seen) else math.inf
        landed_s = release_s + fall_s + _LANDED_S
        end_s = min(last_s, max(next_s, landed_s), _handled_s(topics, release_s, landed_s))
        found.append(Segment(release_s - lead_s, end_s, release_s, seen_by))
    return tuple(found)


def not_before(segment: Segment, first_s: float) -> Segment:
    """Return a run that does not begin before a time: what was evacuated then cannot be followed from earlier."""
    return dataclasses.replace(segment, start_s=max(segment.start_s, first_s))


def seen_release_s(segment: Segment, rig: Rig) -> float | None:
    """Return when the carriage was let go, s since the start; None where it is when the rig does so anyway.

    A rig that describes itself, and keeps its own time, is taken at its word: a sensor that sees it late is late.
    """
    if segment.release_s is None:
        return None
    release_s = segment.release_s - segment.start_s
    return None if segment.start_s == 0.0 and abs(release_s - _programme_s(rig)) <= _TOLERANCE_S else release_s


def driven_segment(topics: Mapping[str, Samples], rig: Rig) -> Segment:
    """Return the run of a driven carriage: from a while before it moves to the end of the bag."""
    first_s, last_s = _reach(topics)
    moved_s = _moved_off_s(*topics[names.JOINT_STATES.name].readings(CARRIAGE))
    return Segment(first_s if moved_s is None else moved_s - _programme_s(rig), last_s)


def commanded_segment(topics: Mapping[str, Samples]) -> Segment:
    """Return the run of an ankle that is only commanded: from a while before its first command to the end of the bag.

    Args:
        topics: With commands among them.

    """
    first_s, last_s = _reach(topics)
    commanded_s = [
        float(samples.log_s[int(np.argmax(samples.columns["data"] > 0.0))])
        for name, samples in topics.items()
        if name in COMMANDS and (samples.columns["data"] > 0.0).any()
    ]
    if not commanded_s or min(commanded_s) < first_s:
        return Segment(first_s, last_s)
    return Segment(min(commanded_s) - _PRESSURE_START_S, last_s)


def exercise_segment(topics: Mapping[str, Samples], first_command_s: float) -> Segment:
    """Return the run of an exercise: its first command comes when the rig's programme has it, if that long is recorded.

    Args:
        topics: With commands among them.
        first_command_s: When a solenoid first draws in the rig's own programme, s since its start.

    """
    first_s, last_s = _reach(topics)
    drawn_s = [
        float(samples.log_s[int(np.argmax(samples.columns["data"] > 0.0))])
        for name, samples in topics.items()
        if name in COMMANDS and name != names.PUMP_DUTY.name and (samples.columns["data"] > 0.0).any()
    ]
    return Segment(max(min(drawn_s, default=first_s) - first_command_s, first_s), last_s)


def whole_segment(topics: Mapping[str, Samples]) -> Segment:
    """Return the whole bag as one run."""
    return Segment(*_reach(topics))


def _programme_s(rig: Rig) -> float:
    """Return when a rig's own programme lets go or moves off, s since its start."""
    return rig.events[0].step * timestep_s(rig) if rig.events else 0.0


def _reach(topics: Mapping[str, Samples]) -> tuple[float, float]:
    """Return first and last stamp of what was measured."""
    stamps = [each.stamp_s for name, each in topics.items() if name not in COMMANDS and len(each.stamp_s)]
    return min(float(each[0]) for each in stamps), max(float(each[-1]) for each in stamps)


def _releases(topics: Mapping[str, Samples], rig: Rig) -> tuple[list[tuple[float, float]], str]:
    """Return every release, when and how long it fell, s, 0 where that was not seen, and the topic that shows them.

    That is the slide, if there is one: it sees a release sharper than an IMU.
    """
    joints, imu = topics.get(names.JOINT_STATES.name), topics.get(names.IMU.name)
    if joints is not None and CARRIAGE in joints.columns:
        falls = falls_of_slide(*joints.readings(CARRIAGE))
        found = [(fall.release_s, fall.lasts_s or 0.0) for fall in falls if fall.release_s is not None]
        if found:
            return found, names.JOINT_STATES.name
    falls = () if imu is None else falls_of_imu(imu.stamp_s, _specific_force(imu))
    late_s = half_rise_s(rig)
    return [
        (fall.release_s - late_s, fall.lasts_s or 0.0) for fall in falls if fall.release_s is not None
    ], names.IMU.name


def _specific_force(imu: Samples) -> NDArray[np.float64]:
    return np.column_stack([imu.columns[f"specific_force_{axis}"] for axis in "xyz"])


def _handled_s(topics: Mapping[str, Samples], release_s: float, landed_s: float) -> float:
    """Return when a leg that has landed is taken up again, s; infinite if it is not."""
    joints, imu = topics.get(names.JOINT_STATES.name), topics.get(names.IMU.name)
    if joints is not None and CARRIAGE in joints.columns:
        stamp_s, height_m = joints.readings(CARRIAGE)
        rest = (stamp_s >= landed_s - 0.2 * _LANDED_S) & (stamp_s < landed_s)
        if not rest.any():
            return math.inf
        rest_m = float(np.median(height_m[rest]))
        share = (height_m - rest_m) / max(float(np.interp(release_s, stamp_s, height_m)) - rest_m, 1e-6)
        lifted = np.flatnonzero((stamp_s >= landed_s) & (share > _LIFTED))
        if not len(lifted):
            return math.inf
        alone = np.flatnonzero(share[: lifted[0]] < _LEFT)
        return float(stamp_s[alone[-1]]) if len(alone) else landed_s
    if imu is not None:
        force = _specific_force(imu)
        apart = np.linalg.norm(force - np.median(force, axis=0), axis=1)
        handled = (imu.stamp_s >= landed_s - _LANDED_S + _CALM_S) & (apart > _HANDLED_M_S2)
        if handled.any():
            return float(imu.stamp_s[int(np.argmax(handled))])
    return math.inf


def _moved_off_s(stamp_s: NDArray[np.float64], position_m: NDArray[np.float64]) -> float | None:
    """Return the stamp, s, at which a driven slide began to move; None where it never did or was moving from the first.

    A line through where it is a little and twice that off its rest leads back to where it left it.
    """
    if len(stamp_s) < 2 * _FEWEST:
        return None
    small_m = max(_MOVED_M, _CLEAR * reading_noise_m(position_m))
    rest_m = float(np.median(position_m[:_FEWEST]))
    way_m = np.abs(position_m - rest_m)
    if way_m.max() < 2.0 * small_m:
        return None
    far = int(np.argmax(way_m >= 2.0 * small_m))
    near = int(np.argmax(way_m >= small_m))
    moved_s = float(2.0 * stamp_s[near] - stamp_s[far])
    return moved_s if moved_s > stamp_s[_FEWEST] else None


_REACHED = 0.95
"""Share of the vacuum of a stretch at which it counts as reached. Assumed."""
_VENTED = 0.05
"""Share of it at which a channel counts as vented. Assumed."""
_SLOW_SHARE = 0.1
"""Share of all its way that a slide makes more slowly than its usual speed. Assumed: turns, and what noise leaves."""
_MOVING_SHARE = 0.1
"""Share of the slide's usual speed above which it counts as moving. Assumed."""
_STEADY_S = 0.04
"""Time before and after over which its speed is taken, s. Chosen: noise of a bend does not count, and a turn does."""
_NO_WAY = 0.01
"""Share of its range that a slide which moves makes at least. Assumed: less is noise of the line of a rest."""
_DIRECTIONS = {0: "still", 1: "up", -1: "down"}
_REVERSAL_S = 0.2
"""How long after its turn a slide counts as reversing. Assumed: the jamming friction has turned by then."""
_ALWAYS = 0.99
"""Share of a recording from which on a shank counts as still throughout. Assumed."""
_IMPACT_S = 0.06
"""How long a touch-down counts as impact. Assumed: the first peak of a landing lies within."""
_AT_REST_M_S = 0.02
"""Speed below which a slide that fell has come to rest. Assumed."""


def recording_phases(
    rig: str, signals: Mapping[str, Signal], commands: CommandTrack, shank: ShankMotion | None = None
) -> tuple[Phase, ...]:
    """Return the phases of every signal: of pressures by the commands of their channel, of the others by the motion.

    Args:
        rig: Its name.
        signals: What was measured, by name.
        commands: Of the run.
        shank: How a guided shank moved; None: it is not guided.

    """
    phases: list[Phase] = []
    air = pressure_signals(signals)
    for where, name in air.items():
        solenoid = commands.solenoids.get(where) if where != "manifold" else _any_of(commands)
        if solenoid is not None:
            phases += air_phases(solenoid, signals[name], (name,))
    others = tuple(name for name in signals if name not in air.values())
    if shank is not None and float(shank.still.mean()) < _ALWAYS:
        labels = ["still" if still > 0.5 else "moving" for still in shank.still.tolist()]  # noqa: PLR2004 - mostly
        return (*phases, *_runs(shank.time_s, labels, others))
    if rig != "pressure" and shank is None:
        return (*phases, *motion_phases(rig, signals.get(f"{names.CARRIAGE_JOINT}/position"), others))
    # Nothing moves but by the vacuum: the phases are those of the manifold, which every channel takes part in.
    if "manifold" in air:
        phases += air_phases(_any_of(commands), signals[air["manifold"]], others)
    return tuple(phases)


def air_phases(solenoid: Timeline, pressure: Signal, signals: tuple[str, ...]) -> list[Phase]:
    """Return evacuating, holding, venting and still for signals that follow one volume.

    Args:
        solenoid: When it draws, 0 or 1.
        pressure: Of the volume, Pa.
        signals: What the phases are for.

    """
    end_s, solenoid = float(pressure.time_s[-1]), solenoid.changes()  # drivers repeat their commands
    changes = [(float(t), v > 0.0) for t, v in zip(solenoid.time_s, solenoid.values, strict=True) if t < end_s]
    if not changes or changes[0][0] > 0.0:
        changes.insert(0, (0.0, False))
    ends = [time_s for time_s, _ in changes[1:]] + [end_s + 1.0]
    phases: list[Phase] = []
    before_pa = float(pressure.values[0])
    for (start_s, drawing), stop_s in zip(changes, ends, strict=True):
        inside = (pressure.time_s >= start_s) & (pressure.time_s <= stop_s)
        if not inside.any() or stop_s <= start_s:
            continue
        values, times = pressure.values[inside], pressure.time_s[inside]
        if drawing:
            low_pa = float(np.percentile(values, 5))
            turn_s = _first(times, values <= before_pa - _REACHED * (before_pa - low_pa), stop_s)
            phases += _two("evacuating", "holding", start_s, turn_s, stop_s, signals)
        else:
            from_pa, high_pa = float(values[0]), float(np.percentile(values, 95))
            was_drawn = bool(phases)
            turn_s = _first(times, values >= high_pa - _VENTED * (high_pa - from_pa), stop_s) if was_drawn else start_s
            phases += _two("venting", "still", start_s, turn_s, stop_s, signals)
            before_pa = high_pa
    return phases


def motion_phases(rig: str, carriage: Signal | None, signals: tuple[str, ...]) -> list[Phase]:
    """Return what the bodies do, for signals that follow them.

    Args:
        rig: Its name.
        carriage: Position of the slide, m; None where it was not measured: there are no phases.
        signals: What the phases are for.

    """
    if carriage is None or len(carriage.time_s) < 3 or not signals:  # noqa: PLR2004 - a slope and a turn
        return []
    phases = _falling(carriage, signals) if rig in FALLING_RIGS else _driven(carriage, signals)
    # Other signals may begin before the slide does.
    return [dataclasses.replace(phases[0], start_s=min(phases[0].start_s, 0.0)), *phases[1:]]


def _driven(carriage: Signal, signals: tuple[str, ...]) -> list[Phase]:
    """Loading away from the start, unloading back; a slide that only goes down pushes and slides."""
    time_s, range_m = carriage.time_s, float(np.ptp(carriage.values))
    if range_m < 1e-4:  # noqa: PLR2004 - a tenth of a millimetre is no motion
        return [Phase("still", float(time_s[0]), float(time_s[-1]) + 1.0, signals)]
    # The lines that readings are laid on have none of their noise, however seldom the slide moves.
    course = course_of(time_s, carriage.values)
    speed = (course.at(time_s + _STEADY_S) - course.at(time_s - _STEADY_S)) / (2.0 * _STEADY_S)
    slowest_first = np.sort(np.abs(speed))
    way = np.cumsum(slowest_first)
    usual = slowest_first[int(np.searchsorted(way, _SLOW_SHARE * way[-1]))]
    state = np.where(np.abs(speed) < _MOVING_SHARE * usual, 0, np.sign(speed)).astype(int)
    runs = _runs(time_s, [_DIRECTIONS[value] for value in state.tolist()], signals)
    ways_m = [float(np.ptp(course.at(np.array([each.start_s, each.end_s])))) for each in runs]
    runs = _merged(
        dataclasses.replace(each, name=each.name if way_m > _NO_WAY * range_m else "still")
        for each, way_m in zip(runs, ways_m, strict=True)
    )
    moving = [each.name for each in runs if each.name != "still"]
    names = {"still": "still"}
    if moving:
        names[moving[0]] = "sliding" if {*moving} == {_DIRECTIONS[-1]} else "loading"
    return _with_reversals([dataclasses.replace(each, name=names.get(each.name, "unloading")) for each in runs])


def _falling(carriage: Signal, signals: tuple[str, ...]) -> list[Phase]:
    time_s, height_m = carriage.time_s, carriage.values
    speed = np.gradient(height_m, time_s)
    start_s, end_s = float(time_s[0]), float(time_s[-1]) + 1.0
    fallen = np.flatnonzero(speed < -0.1)  # noqa: PLR2004 - one centisecond of free fall
    if not len(fallen):
        return [Phase("still", start_s, end_s, signals)]
    fall_s = float(time_s[fallen[0]])
    # The touch-down is where the speed stops to grow: where it is lowest first.
    window = (time_s >= fall_s) & (time_s <= fall_s + 0.5)
    touch_s = float(time_s[window][int(np.argmin(speed[window]))])
    rest_s = _rest(time_s, speed, touch_s + _IMPACT_S, end_s)
    phases = [
        Phase("still", start_s, fall_s, signals),
        Phase("falling", fall_s, touch_s, signals),
        Phase("impact", touch_s, touch_s + _IMPACT_S, signals),
        Phase("rebound", touch_s + _IMPACT_S, rest_s, signals),
        Phase("still", rest_s, end_s, signals),
    ]
    return [phase for phase in phases if phase.end_s > phase.start_s]


def _rest(time_s: NDArray[np.float64], speed: NDArray[np.float64], after_s: float, end_s: float) -> float:
    moving = np.flatnonzero((np.abs(speed) > _AT_REST_M_S) & (time_s > after_s))
    return float(time_s[moving[-1]]) if len(moving) else min(after_s, end_s)


def _with_reversals(phases: Sequence[Phase]) -> list[Phase]:
    """Cut the first part of every motion that follows one in the other direction."""
    found: list[Phase] = []
    last = ""
    for phase in phases:
        if phase.name == "unloading" and last == "loading":
            turn_s = min(phase.start_s + _REVERSAL_S, phase.end_s)
            found.append(Phase("reversal", phase.start_s, turn_s, phase.signals))
            if turn_s < phase.end_s:
                found.append(Phase(phase.name, turn_s, phase.end_s, phase.signals))
        else:
            found.append(phase)
        last = phase.name if phase.name != "still" else last
    return found


def _runs(time_s: NDArray[np.float64], labels: Sequence[str], signals: tuple[str, ...]) -> list[Phase]:
    """Make one phase of each run of equal labels; short ones, as at a turn, go to their neighbour."""
    phases: list[Phase] = []
    begin = 0
    for i in range(1, len(labels) + 1):
        if i == len(labels) or labels[i] != labels[begin]:
            end_s = float(time_s[i]) if i < len(labels) else float(time_s[-1]) + 1.0
            phases.append(Phase(labels[begin], float(time_s[begin]), end_s, signals))
            begin = i
    return _merged(phases)


def _merged(phases: Iterable[Phase]) -> list[Phase]:
    """Return phases of which no two that follow each other have one name; short ones go to the one before."""
    merged: list[Phase] = []
    for phase in phases:
        short = phase.end_s - phase.start_s < 0.05  # noqa: PLR2004 - what smoothing the speed leaves at a turn
        if merged and (short or merged[-1].name == phase.name):
            merged[-1] = Phase(merged[-1].name, merged[-1].start_s, phase.end_s, phase.signals)
        else:
            merged.append(phase)
    return merged


def _two(
    first: str, second: str, start_s: float, turn_s: float, stop_s: float, signals: tuple[str, ...]
) -> list[Phase]:
    turn_s = min(max(turn_s, start_s), stop_s)
    both = (Phase(first, start_s, turn_s, signals), Phase(second, turn_s, stop_s, signals))
    return [phase for phase in both if phase.end_s > phase.start_s]


def _first(times: NDArray[np.float64], happened: NDArray[np.bool_], otherwise_s: float) -> float:
    return float(times[int(np.argmax(happened))]) if happened.any() else otherwise_s


def _any_of(commands: CommandTrack) -> Timeline:
    """Return when any solenoid draws."""
    times = np.unique(np.concatenate([np.zeros(1), *(each.time_s for each in commands.solenoids.values())]))
    drawing = np.zeros(len(times))
    for each in commands.solenoids.values():
        values = np.concatenate(([0.0], each.values))
        drawing = np.maximum(drawing, values[np.searchsorted(each.time_s, times, side="right")])
    return Timeline(times, drawing)
