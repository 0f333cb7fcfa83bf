"""What the simulator and machines in good order disagree by: noise, where no reference tells what this machine does.

Printed tendons, pumps and tubes differ from one machine to the next, and no simulator knows their law to the last
digit. Without recordings of the same machine in good order, less than that cannot be told from a fault.
"""

from __future__ import annotations

import dataclasses
from functools import lru_cache
from importlib import resources
from typing import TYPE_CHECKING

import numpy as np
import yaml

from jammkle_gap.ankle.instruments import PRESSURE
from jammkle_gap.ankle.truth import inputs_of
from jammkle_graph.names import CHANNELS

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from jammkle_gap.november.recording import Recording, Signal

FILE_NAME = "disagreement.yaml"
"""By rig and kind of signal: the most that any of some machines in good order was off the simulator in parts, root mean
square over a run, in the signal's unit. Written by `scripts/measure_disagreement.py`, which says from what."""


def kind_of(signal: str) -> str:
    """Return the kind of a signal: left and right are alike, and so are the lines of all channels."""
    source, _, column = signal.rpartition("/")
    if column == PRESSURE and source in CHANNELS:
        return f"line/{column}"
    return f"{source.removesuffix('_left').removesuffix('_right')}/{column}"


def with_disagreement(recordings: Sequence[Recording]) -> list[Recording]:
    """Return recordings of one machine with no less noise than machines in good order disagree by.

    What a machine is off is the same all through its runs, so that all of them together count as one sample of it. A
    rig that the table does not have gets what the worst of those that it has.

    Args:
        recordings: Of an ankle, to be simulated in parts.

    """
    return [_noisier(each, len(recordings)) for each in recordings]


def _noisier(recording: Recording, runs: int) -> Recording:
    table = _table()
    rows = [table[inputs_of(recording).rig]] if inputs_of(recording).rig in table else list(table.values())

    def noisier(signal: Signal) -> Signal:
        off = max((row.get(kind_of(signal.name), 0.0) for row in rows), default=0.0)
        if off <= signal.noise:
            return signal
        return dataclasses.replace(signal, noise=off, noise_time_s=runs * float(np.ptp(signal.time_s)))

    return dataclasses.replace(recording, signals=tuple(map(noisier, recording.signals)))


@lru_cache(maxsize=1)
def _table() -> Mapping[str, Mapping[str, float]]:
    file = resources.files("jammkle_gap.ankle") / FILE_NAME
    found: dict[str, dict[str, float]] = yaml.safe_load(file.read_text(encoding="utf-8"))
    return found
