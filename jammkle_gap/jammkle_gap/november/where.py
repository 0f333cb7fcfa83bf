"""Where the gap lies: which signal in which phase, which subsystem, and at which horizon it shows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, cast

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_gap.november.compared import Compared
    from jammkle_gap.november.limits import Limits
    from jammkle_gap.november.recording import Recording
    from jammkle_gap.november.residual import Layout
    from jammkle_gap.november.simulator import RestartingSimulator, Simulator

    Fed = Mapping[str, Sequence[Mapping[str, NDArray[np.float64]]]]
    """What each subsystem gives on measured inputs, per recording, by signal."""

HORIZONS_S = (0.0, 0.1, 1.0)
"""Restart after every sample, every 0.1 s, every second; the full run is the fourth."""
RESAMPLES = 400
INTERVAL = (0.025, 0.975)
WHOLE_RUN = "whole run"
_SEED = 20260101


@dataclass(frozen=True)
class Place:
    """A part of the gap."""

    signal: str
    phase: str
    subsystem: str
    """Empty if no subsystem was offered for this signal."""
    share: float
    """Of the squared, noise-scaled residual over all."""
    interval: tuple[float, float]
    gap: float
    """Root mean square there, in noise units."""


@dataclass(frozen=True)
class SubsystemGap:
    """What is left of a subsystem's signals when it is fed with what was measured."""

    name: str
    gaps: Mapping[str, float]
    """Per signal, noise units."""
    gap: float
    to_blame: bool
    """Whether any of its signals lies above the floor on measured inputs."""


@dataclass(frozen=True)
class HorizonGap:
    """The gap when the simulator is set to the measured state again and again."""

    horizon_s: float
    """Infinite: never restarted."""
    gaps: Mapping[str, float]


@dataclass(frozen=True)
class Where:
    """All of it."""

    places: tuple[Place, ...]
    """Largest share first."""
    subsystems: tuple[SubsystemGap, ...]
    horizons: tuple[HorizonGap, ...]


def resampled(blocks: int) -> NDArray[np.intp]:
    """Return block numbers drawn with replacement, always the same ones, shape (RESAMPLES, blocks)."""
    return np.random.default_rng(_SEED).integers(0, blocks, (RESAMPLES, blocks))


def phases_of(layout: Layout, recordings: Sequence[Recording]) -> tuple[tuple[str, ...], NDArray[np.intp]]:
    """Return the names of the phases and the phase of each sample; what lies in none is the rest of the run."""
    names = [WHOLE_RUN, *sorted({phase.name for each in recordings for phase in each.phases})]
    found = np.zeros(layout.measured.size, dtype=np.intp)
    for piece in layout.pieces:
        for phase in recordings[piece.recording].phases:
            if not phase.signals or piece.signal in phase.signals:
                time_s = layout.time_s[piece.where]
                inside = (time_s >= phase.start_s) & (time_s < phase.end_s)
                found[piece.where][inside] = names.index(phase.name)
    if len(names) > 1:
        names[0] = "other"
    return tuple(names), found


def shares(
    layout: Layout, recordings: Sequence[Recording], residual: NDArray[np.float64], subsystem_of: Mapping[str, str]
) -> tuple[Place, ...]:
    """Return the share of each signal and phase, with intervals from resampled blocks."""
    names, phase_of = phases_of(layout, recordings)
    cells = layout.signal_of * len(names) + phase_of
    size, count = len(layout.names) * len(names), len(layout.blocks)
    per_signal = np.bincount(layout.signal_of, minlength=len(layout.names)).astype(float)
    weight = residual**2 / per_signal[layout.signal_of]
    table = np.bincount(layout.block_of * size + cells, weight, count * size).reshape(count, size)
    counts = np.bincount(cells, minlength=size)
    total = table.sum(axis=0)
    drawn = table[resampled(count)].sum(axis=1)
    drawn /= np.maximum(drawn.sum(axis=1, keepdims=True), 1e-30)
    low, high = np.quantile(drawn, INTERVAL, axis=0)
    places = [
        Place(
            signal=layout.names[cell // len(names)],
            phase=names[cell % len(names)],
            subsystem=subsystem_of.get(layout.names[cell // len(names)], ""),
            share=float(total[cell] / max(total.sum(), 1e-30)),
            interval=(float(low[cell]), float(high[cell])),
            gap=float(np.sqrt(total[cell] * per_signal[cell // len(names)] / counts[cell])),
        )
        for cell in range(size)
        if counts[cell]
    ]
    return tuple(sorted(places, key=lambda place: -place.share))


def isolate(layout: Layout, fed: Fed, limits: Limits) -> tuple[SubsystemGap, ...]:
    """Judge each subsystem on its measured inputs; one whose residual is at the floor is not to blame."""
    found = []
    for name, simulated in fed.items():
        gaps = _partial_gaps(layout, simulated)
        overall = float(np.sqrt(np.mean([value**2 for value in gaps.values()]))) if gaps else 0.0
        found.append(SubsystemGap(name, gaps, overall, any(gap > limits.of_signal[each] for each, gap in gaps.items())))
    return tuple(found)


def subsystem_of_signals(fed: Fed) -> dict[str, str]:
    """Return which subsystem gives which signal."""
    return {signal: name for name, simulated in fed.items() for signals in simulated for signal in signals}


def horizons(
    compared: Compared, simulator: Simulator, full: NDArray[np.float64], horizons_s: Sequence[float]
) -> tuple[HorizonGap, ...]:
    """Return the gap at each horizon and over full runs; only the latter if the simulator cannot be restarted."""
    whole = HorizonGap(float("inf"), compared.layout.gaps(full))
    if not hasattr(simulator, "restarted"):
        return (whole,)
    restarting = cast("RestartingSimulator", simulator)

    def gaps(horizon_s: float) -> dict[str, float]:
        made = compared.beside(lambda recording: restarting.restarted(recording, {}, horizon_s))
        return _partial_gaps(compared.layout, made)

    return (*(HorizonGap(horizon_s, gaps(horizon_s)) for horizon_s in horizons_s), whole)


def _partial_gaps(layout: Layout, simulated: Sequence[Mapping[str, NDArray[np.float64]]]) -> dict[str, float]:
    residual = layout.residual(simulated)
    known = np.zeros(residual.size, dtype=bool)
    for piece in layout.pieces:
        known[piece.where] = piece.signal in simulated[piece.recording]
    gaps: dict[str, float] = {}
    for index, name in enumerate(layout.names):
        held = residual[known & (layout.signal_of == index)]
        if held.size:
            gaps[name] = float(np.sqrt(np.mean(held**2)))
    return gaps
