"""How far a run can be foretold at all: a foot that sticks and slips makes another run of the smallest difference."""

from __future__ import annotations

import copy
import dataclasses
from typing import TYPE_CHECKING

import numpy as np

from jammkle_gap.ankle.inputs import nominal_rig
from jammkle_gap.ankle.readings import readings
from jammkle_gap.ankle.truth import inputs_of, truth_of
from jammkle_sim.rigs import replay
from jammkle_sim.rigs.timeline import Timeline

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from jammkle_gap.november.recording import Recording, Signal
    from jammkle_sim.rigs.rig import Rig

_FEW_RUNS, _RUNS = 2, 8
"""Runs that differ by nothing that matters: to see whether that does anything, and if so to see how much."""
_NOTHING = 1e-6
"""Relative difference of gravity, and difference of the tendons' lengths in m, that no rig could be set to. It stands
for all that is not known about a run, and is far below every effect."""
_SHARE = 0.1
"""Share of a signal's own noise below which scatter is left out."""


def with_replay_scatter(recording: Recording, command_jitter_s: float = 0.0) -> Recording:
    """Return the recording with the scatter of runs that differ by nothing added to the noise of its signals.

    Without it a stick-slip that nobody can foretell would count as a gap.

    Args:
        recording: To be run again.
        command_jitter_s: Standard deviation of what is not known of when commands arrived, s.

    """
    rig = nominal_rig(inputs_of(recording))
    generator = np.random.default_rng(0)
    nudges = generator.standard_normal((_RUNS, 2)).tolist()
    runs = [_readings(recording, rig)]
    shaken = [_shaken(recording, command_jitter_s, generator) for _ in range(_RUNS)]
    runs += [_readings(shaken[i], _nudged(rig, *nudges[i])) for i in range(_FEW_RUNS)]
    if not _noise(recording, runs):
        return recording
    runs += [_readings(shaken[i], _nudged(rig, *nudges[i])) for i in range(_FEW_RUNS, _RUNS)]
    noise = _noise(recording, runs)
    why = "contact makes the run hard to foretell"
    if command_jitter_s:
        why = f"commands may have arrived {1e3 * command_jitter_s:.0f} ms earlier or later, or {why}"
    note = f"{why}, which adds to the noise of: {', '.join(noise)}"
    signals = tuple(
        dataclasses.replace(each, noise=noise[each.name], noise_time_s=_hangs_together_s(each, runs))
        if each.name in noise
        else each
        for each in recording.signals
    )
    return dataclasses.replace(recording, signals=signals, notes=(*recording.notes, note))


def _noise(recording: Recording, runs: list[dict[str, NDArray[np.float64]]]) -> dict[str, float]:
    """Return the noise of the signals that scatter. Measurement and simulation both do, hence the scatter twice."""
    noise: dict[str, float] = {}
    for signal in recording.signals:
        if signal.name in runs[0]:
            scatter = float(np.sqrt(2.0 * np.mean(np.var([run[signal.name] for run in runs], axis=0, ddof=1))))
            if scatter > _SHARE * signal.noise:
                noise[signal.name] = float(np.hypot(signal.noise, scatter))
    return noise


def _hangs_together_s(signal: Signal, runs: list[dict[str, NDArray[np.float64]]]) -> float:
    """Return the time over which two runs that have parted stay apart: it counts once, not sample by sample."""
    table = np.array([run[signal.name] for run in runs])
    apart = table - table.mean(axis=0)
    power = np.abs(np.fft.rfft(apart, 2 * table.shape[1], axis=1)) ** 2
    correlation = np.fft.irfft(power.mean(axis=0))[: table.shape[1]]
    correlation = correlation / correlation[0]
    end = int(np.argmax(correlation <= 0.0)) or len(correlation)
    period_s = float(np.median(np.diff(signal.time_s)))
    return period_s * float(2.0 * correlation[:end].sum() - 1.0)


def _shaken(recording: Recording, jitter_s: float, generator: np.random.Generator) -> Recording:
    """Return the recording with every command, pump and solenoids each on their own, a little earlier or later."""
    if jitter_s == 0.0:
        return recording
    inputs = inputs_of(recording)
    commands = replay.CommandTrack(
        _moved(inputs.commands.duty, jitter_s, generator),
        {channel: _moved(line, jitter_s, generator) for channel, line in inputs.commands.solenoids.items()},
    )
    return dataclasses.replace(recording, inputs=dataclasses.replace(inputs, commands=commands))


def _moved(line: Timeline, jitter_s: float, generator: np.random.Generator) -> Timeline:
    times_s = line.time_s + jitter_s * generator.standard_normal(len(line.time_s))
    return Timeline(np.maximum.accumulate(times_s), line.values)


def _readings(recording: Recording, rig: Rig) -> dict[str, NDArray[np.float64]]:
    return readings(recording, rig, truth_of(recording, rig))


def _nudged(rig: Rig, gravity: float, length: float) -> Rig:
    model = copy.copy(rig.model)
    model.opt.gravity[2] *= 1.0 + _NOTHING * gravity
    laws = rig.tendon_laws.copy()
    laws["free_length_m"] += _NOTHING * length
    return dataclasses.replace(rig, model=model, tendon_laws=laws)
