"""Write the table of what simulator and machines in good order disagree by anew: `.venv/bin/python` with this file.

The machines are specimens of the reality that blind trials are made with, at the settings for development; none of them
is in a trial. Takes some minutes.
"""

import tempfile
from importlib import resources
from pathlib import Path

import joblib
import numpy as np
import yaml

from jammkle_gap.ankle.disagreement import FILE_NAME, kind_of
from jammkle_gap.ankle.effects import ankle_library
from jammkle_gap.ankle.loading import load_recording
from jammkle_gap.ankle.parts import PartsSimulator
from jammkle_gap.november.residual import BIASES, without_bias
from jammkle_gap.trial.bags import RunWriter
from jammkle_gap.trial.regimes import rigs, settings_of
from jammkle_gap.trial.sources import Reality
from jammkle_graph.bags.definitions import MessageDefinitions, share_folders
from jammkle_reality.record import Plan

SEED = 500
"""Of development: says which settings, and which machines."""
MACHINES = 12

HEADER = f"""\
# The most that any of {MACHINES} machines in good order was off the simulator in parts, by rig and kind of signal: root
# mean square over a run, in the signal's unit, less a constant offset that its sensor may have. Measured on the
# reality of the blind trial, seed {SEED} (development), by jammkle_gap/scripts/measure_disagreement.py.
"""


def disagreements(rig: str, machine: int) -> dict[str, float]:
    """Return what the runs of one machine are off at most, by kind of signal."""
    simulator, writer = PartsSimulator(ankle_library()), RunWriter(MessageDefinitions(share_folders()))
    off: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as folder:
        for number, settings in enumerate(settings_of(SEED, rig)):
            seed = machine * 10 + number
            writer.write(Reality().run(Plan(rig, dict(settings)), machine, (), seed), Path(folder) / str(number))
            recording = load_recording(Path(folder) / str(number))
            for name, simulated in simulator(recording, {}).items():
                signal = recording.signal(name)
                left = without_bias(signal.values - simulated, BIASES * signal.bias)
                off[kind_of(name)] = max(off.get(kind_of(name), 0.0), float(np.sqrt(np.mean(left**2))))
    return off


if __name__ == "__main__":
    asked = [(rig, machine) for rig in rigs() for machine in range(SEED + 1, SEED + 1 + MACHINES)]
    found = joblib.Parallel(n_jobs=-1)(joblib.delayed(disagreements)(*each) for each in asked)
    table: dict[str, dict[str, float]] = {rig: {} for rig in rigs()}
    for (rig, _), each in zip(asked, found, strict=True):
        for kind, value in each.items():
            table[rig][kind] = max(table[rig].get(kind, 0.0), float(f"{value:.3g}"))
    target = Path(str(resources.files("jammkle_gap.ankle"))) / FILE_NAME
    target.write_text(HEADER + yaml.safe_dump(table), encoding="utf-8")
