"""Recordings as November's diagnosis wants them, for as long as that is there."""

from __future__ import annotations

import dataclasses

import numpy as np

from jammkle_gap.ankle.arrivals import with_arrivals
from jammkle_gap.ankle.inputs import nominal_rig
from jammkle_gap.ankle.instruments import SLIDE, UNITS, declared_noise
from jammkle_gap.ankle.predictability import with_replay_scatter
from jammkle_gap.ankle.signals import CARRIAGE
from jammkle_gap.ankle.truth import inputs_of
from jammkle_gap.november.recording import Recording, Signal
from jammkle_sim.rigs.replay import timestep_s

_CONSTANT = 1e-3
"""Share of its noise below which a signal that moves counts as constant: rounding errors of a simulation."""
_COMMAND_JITTER_S = 0.001
"""What is left unknown of when a command of a live graph arrived, standard deviation, s. Assumed: the grid that it is
searched on."""


def for_november(recording: Recording) -> Recording:
    """Return a recording with commands put where pressures answer, the scatter of replays in its noise, and motion.

    Args:
        recording: As loaded.

    """
    inputs, notes = inputs_of(recording), list(recording.notes)
    rig = nominal_rig(inputs)
    signals = {each.name: each for each in recording.signals}
    if not inputs.exact:
        inputs = with_arrivals(inputs, rig, signals, notes)
    kept = {name: each for name, each in signals.items() if np.ptp(each.values) > _CONSTANT * each.noise}
    if len(kept) < len(signals):
        notes.append(f"constant, and left out: {', '.join(sorted(set(signals) - set(kept)))}")
    if inputs.course is not None:
        time_s = max((each.time_s for each in kept.values()), key=len)
        slide = Signal(CARRIAGE, UNITS[SLIDE], time_s, inputs.course.at(time_s))
        kept[CARRIAGE] = dataclasses.replace(slide, noise=declared_noise(rig, timestep_s(rig))[SLIDE])
    found = dataclasses.replace(recording, signals=tuple(kept.values()), inputs=inputs, notes=tuple(notes))
    return with_replay_scatter(found, 0.0 if inputs.exact else _COMMAND_JITTER_S)
