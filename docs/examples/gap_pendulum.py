"""Diagnose a pendulum on a servo: the machine rubs, its simulator does not know."""

import numpy as np

from jammkle_gap import Effect, EffectParameter, Library, Problem, Recording, Signal, diagnose

STEP_S, TIMES_S = 0.01, 0.01 * np.arange(500)


def simulate(recording, values):
    """Play the recording's command into a pendulum that may rub, lag or carry more."""
    rub, load = values.get("rubbing.torque", 0.0), 1.0 + values.get("load.share", 0.0)
    command = np.interp(TIMES_S - values.get("delay.time", 0.0), TIMES_S, recording.inputs)
    angle, rate, angles = 0.0, 0.0, []
    for target in command:
        angles.append(angle)
        for _ in range(4):
            torque = 3.0 * (target - angle) - 0.07 * rate - 0.98 * load * np.sin(angle) - rub * np.tanh(50.0 * rate)
            rate += STEP_S / 4 * torque / (0.022 * load)
            angle += STEP_S / 4 * rate
    return {"angle": np.array(angles)}


def effect(name, part, parameter, unit, most, advice):
    """Return an effect with one parameter that is off at 0."""
    return Effect(name, part, (EffectParameter(parameter, unit, 0.0, 0.0, most, "assumed"),), advice)


rubbing = effect("rubbing", "bearing", "torque", "N m", 0.4, "Oil the bearing.")
delay = effect("delay", "wiring", "time", "s", 0.05, "Look at the bus load.")
load = effect("load", "arm", "share", "1", 0.8, "Weigh the arm.")
random, runs = np.random.default_rng(1), []
for hertz in (0.3, 0.5, 0.8, 1.2):  # stands in for the machine: it rubs, and its encoder is noisy
    run = Recording(f"{hertz} Hz", (), 0.5 * np.sin(2 * np.pi * hertz * TIMES_S))
    angles = simulate(run, {"rubbing.torque": 0.1})["angle"] + random.normal(0.0, 0.004, TIMES_S.size)
    runs.append(Recording(run.name, (Signal("angle", "rad", TIMES_S, angles),), run.inputs))
found = diagnose(runs, Problem(simulate, Library((rubbing, delay, load))), jobs=1)
print(found.verdict.value, *(each.name for each in found.effects), *found.reasons, sep="\n")
