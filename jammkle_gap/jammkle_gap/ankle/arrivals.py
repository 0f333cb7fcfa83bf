"""When commands of a live graph arrived: a recorder logs when it hears them, milliseconds off what the valves do.

Where the hardware has said when it took each command, nothing needs to be searched for. Where it has not, and log times
are not exact, each switching of the solenoids is put to where the pressures answer it. What all of them are late by may
be the way to the recorder, of a few milliseconds: then nothing can be told of valves or of the command's delay within
that. Where it is more, it may be the fault that is looked for, and is left in.
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np

from jammkle_graph import names
from jammkle_sim.rigs import replay
from jammkle_sim.rigs.timeline import Timeline

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from jammkle_gap.ankle.inputs import AnkleInputs
    from jammkle_gap.november.recording import Signal
    from jammkle_sim.rigs.rig import Rig

_SHIFTS_S = np.arange(0.0, 0.0301, 0.00025)
"""Delays that are tried. Assumed: the graph's hop takes 0.2 ms, its callbacks are served every few milliseconds, and
what all switchings are late by leaves room for that."""
_WAY_S = 0.006
"""What all may be late by on the way to a recorder, at most. Assumed: above the 5 ms that development cases showed,
those in good order and one with a kinked line."""
_MOST_S = 0.01
"""Furthest that a switching is put from where it was logged. Assumed: beyond that it is no matter of the graph."""
_TOGETHER_S = 0.02
"""Switchings of several solenoids within this time are one command."""
_BEFORE_S, _AFTER_S = 0.05, 0.15
"""Stretches around a switching in which the pressures are looked at: where they were, and how they answer."""


def with_arrivals(inputs: AnkleInputs, rig: Rig, signals: Mapping[str, Signal], notes: list[str]) -> AnkleInputs:
    """Return the inputs with every switching of the solenoids where the pressures answer it.

    Args:
        inputs: With the times of the log.
        rig: Nominal.
        signals: What was measured.
        notes: What the reader should know is added.

    """
    channels = [each for each in inputs.commands.solenoids if names.PRESSURES[each].name in signals]
    switchings = _switchings(inputs)
    if not channels or not len(switchings):
        return inputs
    answering = _answering(inputs, channels, switchings)
    if not answering.any():
        return inputs
    end_s = max(float(signals[names.PRESSURES[channel].name].time_s[-1]) for channel in channels)
    pressure_pa = replay.air(rig, inputs.commands, int(end_s / replay.timestep_s(rig)) + 1, inputs.start_pa)
    tracks = {each: pressure_pa[:, names.CHANNELS.index(each) + 1] for each in channels}
    step_s = replay.timestep_s(rig)
    errors = np.array([_errors(tracks, step_s, signals, shift_s, switchings) for shift_s in _SHIFTS_S.tolist()])
    telling = answering & (errors.max(axis=0) > errors.min(axis=0))  # not one without samples, or without a change
    if not telling.any():
        return inputs
    late_s = np.where(telling, _SHIFTS_S[np.argmin(errors, axis=0)], np.nan)
    # A line with a fault of its own answers late or slowly: the others tell.
    told_s = np.array([np.nanmedian(each) if np.isfinite(each).any() else np.nan for each in late_s.T])
    usual_s = float(np.nanmedian(told_s))
    way_s = usual_s if usual_s <= _WAY_S else 0.0
    shifts_s = np.clip(np.where(np.isnan(told_s), usual_s, told_s) - usual_s + way_s, -_MOST_S, _MOST_S)
    later = f"up to {1e3 * shifts_s.max():.0f} ms later" if shifts_s.any() else "at once"
    notes.append(f"commands have the time of the log only: by the pressures, solenoids switched {later}")
    if usual_s > _WAY_S:
        notes.append(f"the pressures answer {1e3 * usual_s:.0f} ms late throughout; that is left in")
    solenoids = {}
    for channel, line in inputs.commands.solenoids.items():
        nearest = np.clip(np.searchsorted(switchings, line.time_s + 1e-9, side="right") - 1, 0, None)
        moved = np.where(line.time_s >= switchings[0], shifts_s[nearest], 0.0)
        times_s = np.maximum.accumulate(line.time_s + moved)
        # What was switched before the rig began stays there.
        solenoids[channel] = Timeline(np.where(line.time_s < 0.0, times_s, np.maximum(times_s, 0.0)), line.values)
    return dataclasses.replace(inputs, commands=dataclasses.replace(inputs.commands, solenoids=solenoids))


def _switchings(inputs: AnkleInputs) -> NDArray[np.float64]:
    """Return when solenoids switch, s, rising, those that switch together once."""
    times = []
    for line in inputs.commands.solenoids.values():
        changed = np.diff(np.concatenate(([0.0], line.values))) != 0.0
        times.append(line.time_s[changed])
    every = np.sort(np.concatenate(times)) if times else np.zeros(0)
    first: NDArray[np.float64] = every[np.diff(np.concatenate(([-np.inf], every))) > _TOGETHER_S]
    return first


def _answering(inputs: AnkleInputs, channels: list[str], switchings: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which channels switch at which of the switchings, shape (channels, switchings)."""
    found = np.zeros((len(channels), len(switchings)), dtype=bool)
    for row, channel in zip(found, channels, strict=True):
        line = inputs.commands.solenoids[channel]
        own_s = line.time_s[np.diff(np.concatenate(([0.0], line.values))) != 0.0]
        row[np.searchsorted(switchings, own_s + 1e-9, side="right") - 1] = True
    return found


def _errors(
    tracks: Mapping[str, NDArray[np.float64]],
    step_s: float,
    signals: Mapping[str, Signal],
    shift_s: float,
    switchings: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return how badly pressures answer each switching if all come later, offsets from before it taken out.

    The pump's duty changes slowly: solenoids that switch later make the same pressures later.

    Args:
        tracks: Simulated pressures by channel, from the start on.
        step_s: Time between two of their values.
        signals: What was measured.
        shift_s: How much later solenoids switch.
        switchings: When they do as logged, s.

    Returns:
        Squares, shape (channels, switchings).

    """
    errors = np.zeros((len(tracks), len(switchings)))
    for row, (channel, pressure_pa) in zip(errors, tracks.items(), strict=True):
        signal = signals[names.PRESSURES[channel].name]
        residual = signal.values - np.interp(signal.time_s - shift_s, step_s * np.arange(len(pressure_pa)), pressure_pa)
        edges = np.searchsorted(signal.time_s, [switchings - _BEFORE_S, switchings, switchings + _AFTER_S])
        for i, (first, at, last) in enumerate(edges.T.tolist()):
            offset = float(residual[first:at].mean()) if at > first else 0.0
            row[i] = float(((residual[at:last] - offset) ** 2).sum())
    return errors
