"""The simulation that lies over a recording: one run again for every run that the bag holds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from jammkle_common.command.errors import InputError
from jammkle_gap import (
    BadEffectError,
    BadRecordingError,
    InfeasibleError,
    load_recordings,
    rerun,
)
from jammkle_view.playback.recorded import NOTHING, Track

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from jammkle_view.playback.recorded import Recorded

_UNSHOWN_NOTES = 3


@dataclass(frozen=True)
class Gap:
    """How far one signal of the simulation is from the recording."""

    signal: str
    unit: str
    rms: float
    """Root of the mean squared difference over all that was run again, in `unit`."""
    largest: float


@dataclass(frozen=True)
class SimulatedRun:
    """One run again. Times count from the start of the bag."""

    model: Any
    joints: Track
    tensions_n: Track
    readings: Mapping[str, Track]
    """What sensors would have read, by signal; each track has one column of the same name."""
    base: Track = NOTHING
    """Of a robot whose joints do not tell where it is; as `Recorded.base`."""


@dataclass(frozen=True)
class Overlay:
    """All runs again of a bag, and how far they are off."""

    runs: tuple[SimulatedRun, ...]
    gaps: tuple[Gap, ...]
    notes: tuple[str, ...]
    """What was not known of the recording, and taken to be so."""

    def run_at(self, time_s: float) -> SimulatedRun | None:
        """Return the run that a time lies in, s since the start of the bag."""
        return next((run for run in self.runs if run.joints.covers(time_s)), None)


def overlay_of(path: Path, recorded: Recorded, rig: str | None, corrected: Path | None) -> Overlay:
    """Run again what a bag holds.

    Args:
        path: The bag.
        recorded: The same as read for the page.
        rig: What it was recorded on, where the bag does not tell.
        corrected: Effects file that the simulator is corrected by; None: nominal.

    Raises:
        InputError: the effects file cannot be used, or the recording cannot be run again; the message says why.

    """
    try:
        recordings = load_recordings(path, rig, namespace=recorded.namespace)
        runs: list[SimulatedRun] = []
        squares: dict[tuple[str, str], list[NDArray[np.float64]]] = {}
        for recording in recordings:
            again = rerun(recording, corrected)
            offset_s = again.began_s - recorded.start_s
            count = max((len(values) for values in again.joints.values()), default=0)
            time_s = offset_s + again.step_s * np.arange(1.0, count + 1.0)
            readings = {}
            for signal in recording.signals:
                if signal.name not in again.readings:
                    continue
                values = again.readings[signal.name]
                readings[signal.name] = Track(signal.time_s + offset_s, {signal.name: values})
                squares.setdefault((signal.name, signal.unit), []).append((values - signal.values) ** 2)
            runs.append(
                SimulatedRun(again.model, Track(time_s, again.joints), Track(time_s, again.tensions_n), readings)
            )
    except (BadEffectError, BadRecordingError, InfeasibleError) as error:
        raise InputError(str(error)) from error
    return Overlay(tuple(runs), _gaps(squares), recordings[0].notes[:_UNSHOWN_NOTES])


def _gaps(squares: Mapping[tuple[str, str], Sequence[NDArray[np.float64]]]) -> tuple[Gap, ...]:
    gaps = []
    for (signal, unit), parts in squares.items():
        whole = np.concatenate(parts)
        gaps.append(Gap(signal, unit, float(np.sqrt(whole.mean())), float(np.sqrt(whole.max()))))
    return tuple(gaps)
