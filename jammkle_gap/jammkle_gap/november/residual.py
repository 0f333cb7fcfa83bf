"""Measured minus simulated, in units of the noise: laid out flat, cut into blocks, counted for what it is worth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from jammkle_gap.november.recording import BadRecordingError
from jammkle_gap.november.stretches import FEWEST_SAMPLES, blocks_of, own_samples, segments_of, spread

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_gap.november.recording import Recording

DOUBT = 0.1
"""Share of a change that no simulator foretells better: by so much the samples that an effect moves count as noisier.
What explains a gap must close nine tenths of it, for the same reason. Assumed."""
LARGEST = 1e6
"""A residual is cut off here, in noise units, so that a diverging run stays a number."""
BIASES = 3.0
"""A constant offset of up to so many times what a sensor's data sheet allows is taken off, of every run by itself."""
_TAILS = 4.0
_WINDOW = 5.0


@dataclass(frozen=True)
class Piece:
    """One signal of one recording, as a stretch of the flat residual."""

    recording: int
    signal: str
    unit: str
    noise: float
    where: slice
    tolerance: float = 0.0
    """Constant offset that is taken off, at most, before anything is judged; noise units. Of this run alone."""


@dataclass(frozen=True)
class Layout:
    """How the residuals of all recordings and signals lie in one vector, and what belongs together."""

    pieces: tuple[Piece, ...]
    names: tuple[str, ...]
    """Signals, sorted."""
    measured: NDArray[np.float64]
    """Shape (n,), each in its own unit; a correction from reference recordings is already taken off."""
    noise: NDArray[np.float64]
    """Shape (n,), each in its own unit; more than its signal's where a correction is not trusted."""
    time_s: NDArray[np.float64]
    signal_of: NDArray[np.intp]
    """Index into `names`, shape (n,)."""
    block_of: NDArray[np.intp]
    segment_of: NDArray[np.intp]
    blocks: tuple[str, ...]
    block_of_segment: NDArray[np.intp]
    least_factor: NDArray[np.float64]
    """Per signal: samples that count as one at least, as the noise itself hangs together."""
    off: NDArray[np.float64]
    """Per signal: share of what it foretells that references show the simulator to be off; 0 where nothing shows it."""

    def residual(self, simulated: Sequence[Mapping[str, NDArray[np.float64]] | None]) -> NDArray[np.float64]:
        """Return (measured - simulated) / noise, shape (n,); a failed run counts as the largest residual."""
        flat = np.full(self.measured.shape, np.inf)
        for piece in self.pieces:
            signals = simulated[piece.recording]
            if signals is not None and piece.signal in signals:
                flat[piece.where] = signals[piece.signal]
        with np.errstate(invalid="ignore", over="ignore"):
            scaled = (self.measured - flat) / self.noise
        found: NDArray[np.float64] = np.clip(
            np.nan_to_num(scaled, nan=LARGEST, posinf=LARGEST, neginf=-LARGEST), -LARGEST, LARGEST
        )
        for piece in self.pieces:
            if piece.tolerance:
                weight = piece.noise / self.noise[piece.where]
                found[piece.where] = without_bias(found[piece.where], piece.tolerance, weight)
        return found

    def gap(self, residual: NDArray[np.float64]) -> float:
        """Return the root mean square over all signals, each signal counting the same; 1 is the noise floor."""
        return float(np.sqrt(np.mean([value**2 for value in self.gaps(residual).values()])))

    def gap_above_floor(self, residual: NDArray[np.float64]) -> float:
        """As `gap`, but signals below their noise count as at it: quiet ones hide nothing of what others are off."""
        return float(np.sqrt(np.mean([max(value, 1.0) ** 2 for value in self.gaps(residual).values()])))

    def gaps(self, residual: NDArray[np.float64]) -> dict[str, float]:
        """Return the root mean square of each signal, in its noise."""
        squares = np.bincount(self.signal_of, residual**2, len(self.names))
        counts = np.bincount(self.signal_of, minlength=len(self.names))
        return {name: float(np.sqrt(squares[i] / counts[i])) for i, name in enumerate(self.names)}


def without_bias(
    residual: NDArray[np.float64], tolerance: float, weight: NDArray[np.float64] | float = 1.0
) -> NDArray[np.float64]:
    """Take off the mean of one signal of one run, as far as its sensor may be off.

    Args:
        residual: Of one signal of one recording, shape (n,), in any unit; already times the weight.
        tolerance: Largest offset that is taken off, same unit.
        weight: By which each sample counts, shape (n,); 1 where all count alike.

    """
    weights = weight * np.ones(residual.size)
    mean = float(np.sum(weights * residual) / np.sum(weights**2))
    return residual - float(np.clip(mean, -tolerance, tolerance)) * weights


def lay_out(
    recordings: Sequence[Recording],
    simulated: Sequence[Mapping[str, NDArray[np.float64]]],
    noise: Mapping[str, float],
    *,
    corrections: Sequence[Mapping[str, NDArray[np.float64]]] | None = None,
    added: Sequence[Mapping[str, NDArray[np.float64]]] | None = None,
    factors: Mapping[str, float] | None = None,
    off: Mapping[str, float] | None = None,
) -> Layout:
    """Lay out what can be compared.

    Args:
        recordings: Measured.
        simulated: Nominal, per recording; only its signals with a noise are compared.
        noise: Standard deviation per signal, in its unit.
        corrections: What reference recordings say the simulator is off by anyway, per recording and signal.
        added: Standard deviation of what such a correction may be off, per recording and signal, in its unit.
        factors: Samples of a signal over which its noise hangs together.
        off: Share of what it foretells that references show the simulator to be off, per signal.

    Raises:
        BadRecordingError: there is nothing to compare, or too little to hold anything out.

    """
    names = tuple(sorted({name for each in simulated for name in each if name in noise}))
    own = own_samples(recordings, simulated, factors or {}, names)
    per = blocks_of(recordings, own)
    segments = segments_of(per, own)
    first_block = np.concatenate([[0], np.cumsum(per)])
    count = int(first_block[-1])
    pieces: list[Piece] = []
    columns: list[tuple[NDArray[Any], ...]] = []
    place = 0
    for index, (recording, signals) in enumerate(zip(recordings, simulated, strict=True)):
        used = [recording.signal(name) for name in names if name in signals]
        if not used:
            msg = f"recording '{recording.name}' has no signal that the simulator gives"
            msg = f"{msg}; record one of: {', '.join(names) or 'those that it gives'}"
            raise BadRecordingError(msg)
        along = spread(used, signals, noise)
        for signal in used:
            correction = corrections[index].get(signal.name) if corrections else None
            # What references say has the offset of their own sensor in it.
            sensors = 1 if correction is None else 2
            taken = 0.0 if correction is None else correction
            pieces_here = per[index] * segments
            place_here = np.clip(np.interp(signal.time_s, *along) * pieces_here, 0, pieces_here - 1).astype(np.intp)
            fine = place_here + first_block[index] * segments
            size = signal.time_s.size
            unit = noise[signal.name]
            stretch = slice(place, place + size)
            tolerance = BIASES * signal.bias * float(np.sqrt(sensors)) / unit
            pieces.append(Piece(index, signal.name, signal.unit, unit, stretch, tolerance))
            columns.append(
                (
                    signal.values - taken,
                    np.hypot(unit, added[index].get(signal.name, 0.0) if added else 0.0) * np.ones(size),
                    signal.time_s,
                    np.full(size, names.index(signal.name)),
                    fine,
                )
            )
            place += size
    measured, scale, time_s, signal_of, segment_of = (np.concatenate(each) for each in zip(*columns, strict=True))
    block_of = segment_of // segments
    held = np.bincount(block_of, minlength=count)
    if held.min() < FEWEST_SAMPLES:
        index = int(np.searchsorted(first_block, int(np.argmin(held)), side="right")) - 1
        recording = recordings[index]
        msg = f"recording '{recording.name}' is too short to hold anything out ({held.min()} samples in a stretch)"
        msg = f"{msg}; record at least {FEWEST_SAMPLES} samples in each of {per[index]} stretches"
        raise BadRecordingError(msg)
    labels = [
        recording.name if number == 1 else f"{recording.name}/{k + 1}"
        for recording, number in zip(recordings, per, strict=True)
        for k in range(number)
    ]
    return Layout(
        pieces=tuple(pieces),
        names=names,
        measured=measured,
        noise=scale,
        time_s=time_s,
        signal_of=signal_of.astype(np.intp),
        block_of=block_of.astype(np.intp),
        segment_of=segment_of.astype(np.intp),
        blocks=tuple(labels),
        block_of_segment=np.arange(count * segments) // segments,
        least_factor=np.array([(factors or {}).get(name, 1.0) for name in names]),
        off=np.array([(off or {}).get(name, 0.0) for name in names]),
    )


def correlation_of(residuals: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Return the autocorrelation by lag, 1 at first, up to half of the longest; zero where all are nothing.

    Moments are taken about zero, so that a constant offset stays.

    Args:
        residuals: Evenly sampled or nearly so, shape (n,) each; of several, the larger counts more.

    """
    size = max(each.size for each in residuals)
    spectrum = np.sum([np.abs(np.fft.rfft(each, 2 * size)) ** 2 for each in residuals], axis=0)
    correlation = np.fft.irfft(spectrum, 2 * size)[: size // 2 + 1]
    found: NDArray[np.float64] = correlation / correlation[0] if correlation[0] > 0.0 else 0.0 * correlation
    return found


def independence_factor(correlation: NDArray[np.float64]) -> float:
    """Return how many neighbouring samples count as one: 1 + 2 sum of the autocorrelation, at least 1.

    The sum ends where the lag exceeds five times it (Sokal's window).
    """
    size = 2 * (correlation.size - 1)
    if size < 2:  # noqa: PLR2004  # one sample has no neighbour
        return 1.0
    running = 1.0 + 2.0 * np.cumsum(correlation[1:])
    enough = np.arange(1, running.size + 1) >= _WINDOW * running
    factor = float(running[np.argmax(enough)]) if enough.any() else float(size)
    return float(np.clip(factor, 1.0, size))


def autocorrelation_factor(residual: NDArray[np.float64]) -> float:
    """Return how many neighbouring samples of a residual count as one; a constant offset is one single sample."""
    return independence_factor(correlation_of([residual]))


@dataclass(frozen=True)
class Weighting:
    """What each signal's residual is worth."""

    scale: NDArray[np.float64]
    """Per signal: what the best candidate leaves, in noise units, at least 1."""
    factor: NDArray[np.float64]
    """Per signal: samples that count as one."""
    doubt: NDArray[np.float64] | float = 0.0
    """Per sample: what the simulator may be off where the best candidate changes it, noise units."""

    def scale_of(self, layout: Layout) -> NDArray[np.float64]:
        """Return the scale of every sample, shape (n,), noise units."""
        scale: NDArray[np.float64] = np.hypot(self.scale[layout.signal_of], self.doubt)
        return scale


def doubt_of(layout: Layout, change: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return what a simulator may be off where it is changed, from the root mean square of each signal and segment.

    Args:
        layout: Of the residual.
        change: Made by the effects of a candidate, shape (n,), noise units.

    """
    cell = layout.segment_of * len(layout.names) + layout.signal_of
    squares, counts = np.bincount(cell, change**2), np.bincount(cell)
    root: NDArray[np.float64] = np.sqrt(squares / np.maximum(counts, 1))[cell]
    return root * np.maximum(layout.off, DOUBT)[layout.signal_of]


def weigh(layout: Layout, residual: NDArray[np.float64]) -> Weighting:
    """Judge the signals by a residual: the scale it has (robust) and how its samples hang together."""
    scale, factor = np.ones(len(layout.names)), np.ones(len(layout.names))
    for index, name in enumerate(layout.names):
        held = residual[layout.signal_of == index]
        scale[index] = max(1.0, 1.4826 * float(np.median(np.abs(held))))
        pieces = [piece for piece in layout.pieces if piece.signal == name]
        factors = [
            autocorrelation_factor(np.clip(residual[piece.where] / scale[index], -_TAILS, _TAILS)) for piece in pieces
        ]
        sizes = [piece.where.stop - piece.where.start for piece in pieces]
        factor[index] = max(float(np.average(factors, weights=sizes)), float(layout.least_factor[index]))
    return Weighting(scale, factor)
