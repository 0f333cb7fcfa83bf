"""How far a run can be foretold at all: a foot that sticks and slips makes another run of the smallest difference."""

from __future__ import annotations

import copy
import dataclasses
from typing import TYPE_CHECKING

import numpy as np

from jammkle_sim.gap.ankle.inputs import nominal_rig
from jammkle_sim.gap.ankle.readings import readings
from jammkle_sim.gap.ankle.truth import inputs_of, truth_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from jammkle_sim.gap.recording import Recording
    from jammkle_sim.rigs.rig import Rig

_FEW_RUNS, _RUNS = 2, 8
"""Runs that differ by nothing that matters: to see whether that does anything, and if so to see how much."""
_NOTHING = 1e-6
"""Relative difference of gravity, and difference of the tendons' lengths in m, that no rig could be set to. It stands
for all that is not known about a run, and is far below every effect."""
_SHARE = 0.1
"""Share of a signal's own noise below which scatter is left out."""


def with_replay_scatter(recording: Recording) -> Recording:
    """Return the recording with the scatter of runs that differ by nothing added to the noise of its signals.

    Without it a stick-slip that nobody can foretell would count as a gap.
    """
    rig = nominal_rig(inputs_of(recording))
    generator = np.random.default_rng(0)
    nudges = generator.standard_normal((_RUNS, 2)).tolist()
    runs = [_readings(recording, rig)]
    runs += [_readings(recording, _nudged(rig, *nudge)) for nudge in nudges[:_FEW_RUNS]]
    if not _noise(recording, runs):
        return recording
    runs += [_readings(recording, _nudged(rig, *nudge)) for nudge in nudges[_FEW_RUNS:]]
    noise = _noise(recording, runs)
    note = f"contact makes the run hard to foretell, which adds to the noise of: {', '.join(noise)}"
    # Two runs that have parted stay apart: what scatters counts once, not sample by sample.
    whole_s = max(float(signal.time_s[-1]) for signal in recording.signals)
    signals = tuple(
        dataclasses.replace(each, noise=noise[each.name], noise_time_s=whole_s) if each.name in noise else each
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


def _readings(recording: Recording, rig: Rig) -> dict[str, NDArray[np.float64]]:
    return readings(recording, rig, truth_of(recording, rig))


def _nudged(rig: Rig, gravity: float, length: float) -> Rig:
    model = copy.copy(rig.model)
    model.opt.gravity[2] *= 1.0 + _NOTHING * gravity
    laws = rig.tendon_laws.copy()
    laws["free_length_m"] += _NOTHING * length
    return dataclasses.replace(rig, model=model, tendon_laws=laws)
