"""Phases of a recording: what the air does by command and pressure, and what the bodies do by the slide's motion."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np

from jammkle_common import names
from jammkle_gap.core.data import Phase
from jammkle_sim.rigs.replay import Timeline

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_gap.core.data import Signal
    from jammkle_sim.rigs.replay import CommandTrack

_REACHED = 0.95
"""Share of the vacuum of a stretch at which it counts as reached. Assumed."""
_VENTED = 0.05
"""Share of it at which a channel counts as vented. Assumed."""
_MOVING_SHARE = 0.1
"""Share of the slide's fastest steady speed above which it counts as moving. Assumed."""
_REVERSAL_S = 0.2
"""How long after its turn a slide counts as reversing. Assumed: the jamming friction has turned by then."""
_IMPACT_S = 0.06
"""How long a touch-down counts as impact. Assumed: the first peak of a landing lies within."""
_AT_REST_M_S = 0.02
"""Speed below which a slide that fell has come to rest. Assumed."""
FALLING_RIGS = ("drop", "landing")
"""Rigs whose carriage is let go."""


def recording_phases(rig: str, signals: Mapping[str, Signal], commands: CommandTrack) -> tuple[Phase, ...]:
    """Return the phases of every signal: of pressures by what their channel is told, of the others by the motion.

    Args:
        rig: Its name.
        signals: What was measured, by name.
        commands: What was told.

    """
    phases: list[Phase] = []
    air = pressure_signals(signals)
    for where, name in air.items():
        solenoid = commands.solenoids.get(where) if where != "manifold" else _any_of(commands)
        if solenoid is not None:
            phases += air_phases(solenoid, signals[name], (name,))
    others = tuple(name for name in signals if name not in air.values())
    if rig != "pressure":
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
    end_s = float(pressure.time_s[-1])
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
    time_s = carriage.time_s
    speed = _smooth(np.gradient(carriage.values, time_s))
    fastest = float(np.percentile(np.abs(speed), 95))
    if fastest <= 0.0 or float(np.ptp(carriage.values)) < 1e-4:  # noqa: PLR2004 - a tenth of a millimetre is no motion
        return [Phase("still", float(time_s[0]), float(time_s[-1]) + 1.0, signals)]
    state = np.where(np.abs(speed) < _MOVING_SHARE * fastest, 0, np.sign(speed)).astype(int)
    forward = int(state[np.flatnonzero(state)[0]])
    goes_back = bool((state == -forward).any())
    name = {0: "still", forward: "loading" if goes_back else "sliding", -forward: "unloading"}
    phases = _runs(time_s, [name[value] for value in state.tolist()], signals)
    return _with_reversals(phases)


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


def pressure_signals(present: Mapping[str, Signal]) -> dict[str, str]:
    """Return the pressure signals that are there, by channel, and `manifold`."""
    sources = {"manifold": names.MANIFOLD_PRESSURE.name, **{c: t.name for c, t in names.PRESSURES.items()}}
    return {where: name for where, name in sources.items() if name in present}


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
    merged: list[Phase] = []
    for phase in phases:
        short = phase.end_s - phase.start_s < 0.05  # noqa: PLR2004 - what smoothing the speed leaves at a turn
        if merged and (short or merged[-1].name == phase.name):
            merged[-1] = Phase(merged[-1].name, merged[-1].start_s, phase.end_s, signals)
        else:
            merged.append(phase)
    return merged


def _smooth(values: NDArray[np.float64]) -> NDArray[np.float64]:
    width = min(11, len(values))
    kernel = np.full(width, 1.0 / width)
    smoothed: NDArray[np.float64] = np.convolve(np.pad(values, width // 2, mode="edge"), kernel, mode="valid")
    return smoothed[: len(values)]


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
