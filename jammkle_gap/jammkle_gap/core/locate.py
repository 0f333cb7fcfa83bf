"""Where the gap lies, and how far it closes: by signal, by phase, and on runs that the effect was not fitted to."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from jammkle_gap.core.features import aligned_s
from jammkle_gap.core.result import Closing, Place, SignalGap

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from jammkle_gap.core.features import Alignment
    from jammkle_gap.core.result import Trace
    from jammkle_gap.core.scatter import Setting

_RESAMPLES = 400
_INTERVAL = (0.05, 0.95)
_SMALLEST = 0.05
"""Gap above healthy scatter below which there is nothing to close."""
EVENT_PHASE, WHOLE_RUN = "event", "whole run"


def places_of(
    settings: Sequence[Setting],
    left: NDArray[np.float64],
    healthy: float,
    alignment: Alignment | None,
    blocks: int,
) -> tuple[Place, ...]:
    """Return the share of a squared whitened difference by signal and phase, largest first.

    Intervals are from a bootstrap over blocks of time (Kuensch 1989, Ann. Stat. 17:1217).

    Args:
        settings: Runs.
        left: Whitened by scatter, one setting after the other.
        healthy: What healthy runs leave per feature.
        alignment: Tells how far a run was shifted to its events.
        blocks: Of time, per setting.

    """
    table: dict[tuple[str, str], NDArray[np.float64]] = {}
    counts: dict[tuple[str, str], int] = {}
    begin = 0
    for k, setting in enumerate(settings):
        layout = setting.layout
        whitened = left[begin : begin + layout.size]
        begin += layout.size
        block = np.arange(layout.bins) * blocks // layout.bins + k * blocks
        rows = layout.by_signal(whitened)
        for i, signal in enumerate(layout.signals):
            for phase, inside in _phases(setting, signal, alignment).items():
                cell = (signal, phase)
                own = table.setdefault(cell, np.zeros(blocks * len(settings)))
                np.add.at(own, block[inside], np.square(rows[i][inside]))
                counts[cell] = counts.get(cell, 0) + int(inside.sum())
        for i, event in enumerate(layout.event_s):
            cell = (event, EVENT_PHASE)
            own = table.setdefault(cell, np.zeros(blocks * len(settings)))
            own[k * blocks] += whitened[len(layout.signals) * layout.bins + i] ** 2
            counts[cell] = counts.get(cell, 0) + 1
    cells = list(table)
    sums = np.array([table[cell] for cell in cells])
    total = sums.sum(axis=1)
    drawn = np.random.default_rng(0).integers(0, sums.shape[1], (_RESAMPLES, sums.shape[1]))
    again = sums[:, drawn].sum(axis=2)
    again = again / np.maximum(again.sum(axis=0), 1e-30)
    low, high = np.quantile(again, _INTERVAL, axis=1)
    found = [
        Place(
            signal,
            phase,
            float(total[i] / max(total.sum(), 1e-30)),
            (float(low[i]), float(high[i])),
            float(np.sqrt(total[i] / counts[signal, phase] / healthy)),
        )
        for i, (signal, phase) in enumerate(cells)
        if counts[signal, phase]
    ]
    return tuple(sorted(found, key=lambda place: -place.share))


def _phases(setting: Setting, signal: str, alignment: Alignment | None) -> dict[str, NDArray[np.bool_]]:
    """Return which bins of a signal lie in which phase of the first faulty run."""
    run, layout = setting.faulty[0], setting.layout
    asked = alignment.events_of(run, signal) if alignment is not None else ()
    count = len(layout.signals) * layout.bins
    own_s = dict(zip(layout.event_s, setting.faulty_features[0, count:].tolist(), strict=True))
    time_s = aligned_s(layout.time_s, asked, layout.event_s, own_s)
    left = np.ones(layout.bins, dtype=bool)
    found: dict[str, NDArray[np.bool_]] = {}
    for phase in run.phases:
        if phase.signals and signal not in phase.signals:
            continue
        inside = (time_s >= phase.start_s) & (time_s < phase.end_s) & left
        found[phase.name] = found.get(phase.name, np.zeros(layout.bins, dtype=bool)) | inside
        left &= ~inside
    if left.any():
        found[WHOLE_RUN if not found else "other"] = left
    return found


def closing_of(
    nominal_left: NDArray[np.float64],
    left: NDArray[np.float64],
    healthy: float,
    settings: Sequence[Setting],
    blocks: int,
) -> Closing:
    """Return how far the gap closes.

    Args:
        nominal_left: What the nominal simulator leaves, whitened by scatter, one setting after the other.
        left: What the corrected one leaves, predicted by a fit to other runs.
        healthy: What healthy runs leave per feature.
        settings: Runs; those in the difference.
        blocks: Of time, per setting, that intervals are resampled by.

    """
    before: list[NDArray[np.float64]] = []
    after: list[NDArray[np.float64]] = []
    counts: list[NDArray[np.float64]] = []
    begin = 0
    for setting in settings:
        layout = setting.layout
        part = slice(begin, begin + layout.size)
        begin += layout.size
        block = np.arange(layout.bins) * blocks // layout.bins
        for values, table in ((nominal_left[part], before), (left[part], after)):
            squares = np.square(layout.by_signal(values)).sum(axis=0)
            table.append(np.bincount(block, squares, blocks).astype(np.float64))
        counts.append(np.bincount(block, minlength=blocks).astype(np.float64) * len(layout.signals) * healthy)
    tables = [np.concatenate(each) for each in (before, after, counts)]

    def closed(drawn: NDArray[np.intp]) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        sums = [table[drawn].sum(axis=-1) for table in tables]
        nominal, corrected = np.sqrt(sums[0] / sums[2]), np.sqrt(sums[1] / sums[2])
        with np.errstate(divide="ignore", invalid="ignore"):
            share = 1.0 - (np.maximum(corrected, 1.0) - 1.0) / (nominal - 1.0)
        return nominal, corrected, np.where(nominal - 1.0 > _SMALLEST, share, np.nan)

    everything = np.arange(len(tables[0]))
    nominal, corrected, share = closed(everything)
    drawn = np.random.default_rng(0).integers(0, len(everything), (_RESAMPLES, len(everything)))
    shares = closed(drawn)[2]
    known = shares[np.isfinite(shares)]
    low, high = np.quantile(known, _INTERVAL) if known.size else (np.nan, np.nan)
    return Closing(float(nominal), float(corrected), float(share), (float(low), float(high)))


def signal_gaps(traces: Sequence[Trace]) -> tuple[SignalGap, ...]:
    """Return how far each signal is off before and after, over all settings, in healthy scatter and in its own unit."""
    found = []
    for name, unit in dict.fromkeys((each.signal, each.unit) for each in traces):
        own = [each for each in traces if (each.signal, each.unit) == (name, unit)]
        before = np.concatenate([each.difference for each in own])
        after = before - np.concatenate([each.signature for each in own])
        scatter = np.concatenate([each.scatter for each in own])
        rows = (before / scatter, after / scatter, before, after, scatter)
        found.append(SignalGap(name, unit, *(float(np.sqrt(np.square(row).mean())) for row in rows)))
    return tuple(found)
