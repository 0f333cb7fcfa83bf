"""Where recordings are cut: into blocks that are held out in turn, and segments over which scores are compared."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_gap.november.recording import Recording, Signal

ENOUGH_RECORDINGS = 4
"""From here on each recording that was repeated is one block; others are cut into long stretches."""
MANY_RECORDINGS = 8
"""From here on each recording is one block, repeated or not."""
FEWEST_BLOCKS = 6
STRETCHES = 3
"""Of a recording of a regime that no other has: what shows in it alone can be held out in parts only. Assumed."""
EVEN_SHARE = 0.5
"""Stretches are cut so that each holds the same part of the time, by this share, and of the squared residual of the
nominal simulator, by the rest: else one stretch holds an impact, and nothing is left to foretell it from. Assumed."""
FEWEST_SEGMENTS = 24
"""Blocks are what parameters are held out from; differences of scores are paired over segments of them."""
FEWEST_SAMPLES = 20
"""Per block, over all signals: with fewer there is nothing to hold out."""
_SPREAD = 1001


def own_samples(
    recordings: Sequence[Recording],
    simulated: Sequence[Mapping[str, NDArray[np.float64]]],
    factors: Mapping[str, float],
    names: Sequence[str],
) -> list[float]:
    """Return how many samples each recording has that do not stand for each other, over all signals."""
    return [
        sum(recording.signal(name).values.size / factors.get(name, 1.0) for name in names if name in signals)
        for recording, signals in zip(recordings, simulated, strict=True)
    ]


def blocks_of(recordings: Sequence[Recording], own: Sequence[float]) -> list[int]:
    """Return how many blocks each recording is cut into."""
    if len(recordings) < ENOUGH_RECORDINGS:
        return [-(-FEWEST_BLOCKS // len(recordings))] * len(recordings)
    if len(recordings) >= MANY_RECORDINGS:
        return [1] * len(recordings)
    regimes = [recording.regime for recording in recordings]
    return [
        STRETCHES if regime and regimes.count(regime) == 1 and samples >= STRETCHES * FEWEST_SAMPLES else 1
        for regime, samples in zip(regimes, own, strict=True)
    ]


def segments_of(per: Sequence[int], own: Sequence[float]) -> int:
    """Return into how many segments each block is cut: no more than it has samples of its own."""
    wanted = max(2, -(-FEWEST_SEGMENTS // sum(per)))
    fewest = min((samples / blocks for samples, blocks in zip(own, per, strict=True)), default=1.0)
    return int(np.clip(fewest, 1, wanted))


def spread(
    used: Sequence[Signal], simulated: Mapping[str, NDArray[np.float64]], noise: Mapping[str, float]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return times of a recording, and the share of it that lies before each: by time, and by squared residual."""
    first = min(float(signal.time_s[0]) for signal in used)
    span = max(max(float(signal.time_s[-1]) for signal in used) - first, 1e-12)
    time_s = first + span * np.linspace(0.0, 1.0, _SPREAD)
    before = np.zeros(_SPREAD)
    for signal in used:
        square = ((signal.values - simulated[signal.name]) / noise[signal.name]) ** 2
        total = float(square.sum())
        held = np.interp(time_s, signal.time_s, np.cumsum(square) / total) if total else np.linspace(0.0, 1.0, _SPREAD)
        before += held / len(used)
    return time_s, EVEN_SHARE * np.linspace(0.0, 1.0, _SPREAD) + (1.0 - EVEN_SHARE) * before
