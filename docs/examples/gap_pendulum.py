"""Diagnose a pendulum on a servo: the machine rubs, its simulator does not know."""

from __future__ import annotations

import numpy as np

from jammkle_sim.gap.diagnosis import diagnose
from jammkle_sim.gap.effect import Effect, EffectParameter, Library
from jammkle_sim.gap.recording import Recording, Signal

STEP_S, GRAVITY_N_M, INERTIA_KG_M2, STIFFNESS_N_M, DAMPING_N_M_S = 0.01, 0.98, 0.022, 3.0, 0.07


def simulate(recording, values):
    """Play the recording's command into a pendulum that may rub, lag or carry more."""
    rub, load = values.get("rubbing.torque", 0.0), 1.0 + values.get("load.share", 0.0)
    times = recording.signal("angle").time_s
    command = np.interp(times - values.get("delay.time", 0.0), times, recording.inputs)
    angle = rate = 0.0
    angles = np.empty_like(times)
    for k, target in enumerate(command):
        angles[k] = angle
        for _ in range(4):
            torque = STIFFNESS_N_M * (target - angle) - DAMPING_N_M_S * rate - GRAVITY_N_M * load * np.sin(angle)
            rate += STEP_S / 4 * (torque - rub * np.tanh(rate / 0.02)) / (INERTIA_KG_M2 * load)
            angle += STEP_S / 4 * rate
    return {"angle": angles}


LIBRARY = Library(
    (
        Effect("rubbing", "bearing", (EffectParameter("torque", "N m", 0.0, 0.0, 0.4, "assumed"),), "Oil the bearing."),
        Effect("delay", "wiring", (EffectParameter("time", "s", 0.0, 0.0, 0.05, "assumed"),), "Look at the bus load."),
        Effect("load", "arm", (EffectParameter("share", "1", 0.0, 0.0, 0.8, "assumed"),), "Weigh the arm."),
    )
)


def measured(name, command, random):
    """Stand in for the machine: it rubs, and its encoder is noisy."""
    times = STEP_S * np.arange(command.size)
    blank = Recording(name, (Signal("angle", "rad", times, np.zeros_like(times)),), command)
    angles = simulate(blank, {"rubbing.torque": 0.1})["angle"] + random.normal(0.0, 0.004, times.size)
    return Recording(name, (Signal("angle", "rad", times, angles),), command)


if __name__ == "__main__":
    source, times_s = np.random.default_rng(1), STEP_S * np.arange(500)
    runs = [
        measured(f"{hertz} Hz", 0.5 * np.sin(2 * np.pi * hertz * times_s), source) for hertz in (0.3, 0.5, 0.8, 1.2)
    ]
    diagnosis = diagnose(runs, simulate, LIBRARY)
    print(diagnosis.verdict.value, *(effect.name for effect in diagnosis.effects), *diagnosis.reasons, sep="\n")
