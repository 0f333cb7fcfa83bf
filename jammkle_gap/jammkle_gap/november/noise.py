"""How much a signal differs from run to run and from sample to sample when nothing is wrong.

From repeats of the same run where there are any, else from still stretches: never from the signal's own size.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from jammkle_gap.november.recording import BadRecordingError
from jammkle_gap.november.repeats import likeness, scatters
from jammkle_gap.november.residual import correlation_of, independence_factor

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from jammkle_gap.november.recording import Signal
    from jammkle_gap.november.repeats import Batch

STILL_SAMPLES = 24
"""Length of a stretch that is looked at for stillness, samples. Assumed: long enough for a scatter within 15 %."""
STILL_SHARE = 0.2
"""The calmest share of the stretches is taken as still. Assumed: a recording rests, or moves steadily, this long."""
FEWEST_STRETCHES = 3
MOVING = 0.6
"""Correlation of neighbours in the calmest stretches, their curve taken out, above which the signal never rests."""
_SAME_NEIGHBOURS = 0.1
_USUAL_STEP = 0.2
_STAIRS = 1.5
_NEIGHBOURS = 2
"""Lags, in samples, by whose correlation noise that hangs together is told from noise that does not."""
_LEAST_SHARE = 0.05
FEW = 8.0
"""Values that a noise that hangs together is known from, at most, where there are fewer repeats to spare. Chosen so
that none of 106 development cases without a gap is one: feet slip more than their autocorrelation tells."""


@dataclass(frozen=True)
class Hanging:
    """The part of a noise that hangs together over many samples, as runs that drift apart or start late do."""

    share: float = 0.0
    """Of the variance."""
    samples: float = 1.0
    """Over which it hangs together."""
    known_from: float = float("inf")
    """Independent values that it was found from, at most one for each repeat but the first, or `FEW`; endless where the
    noise is declared."""


@dataclass(frozen=True)
class NoiseSource:
    """The noise of one signal, and where it comes from."""

    signal: str
    unit: str
    noise: float
    source: str
    """In words, such as `3 repeats of the same run`."""
    factor: float = 1.0
    """Samples over which it hangs together, and that so count as one."""
    hanging: Hanging = Hanging()
    """What of it hangs together, and how well that is known."""


def still_noise(signal: Signal) -> float:
    """Return the standard deviation of a signal within its still stretches, in its unit.

    The curve of each stretch (a parabola) is taken out, its scatter is corrected for that, and the calmest stretches
    count. A signal of few digits has at least the noise of its rounding, step / sqrt(12).

    Raises:
        BadRecordingError: it is too short, constant, or never rests.

    """
    stretches = signal.values.size // STILL_SAMPLES
    if stretches < FEWEST_STRETCHES:
        msg = f"signal '{signal.name}' has {signal.values.size} samples, too few to tell its noise"
        msg = f"{msg}; record at least {FEWEST_STRETCHES * STILL_SAMPLES}, or repeat the run"
        raise BadRecordingError(msg)
    if np.ptp(signal.values) == 0.0:
        msg = f"signal '{signal.name}' is {signal.values[0]:g} {signal.unit} throughout; record a sensor that moves"
        raise BadRecordingError(msg)
    table = signal.values[: stretches * STILL_SAMPLES].reshape(stretches, STILL_SAMPLES)
    basis = np.polynomial.legendre.legvander(np.linspace(-1.0, 1.0, STILL_SAMPLES), 2)
    q, _ = np.linalg.qr(basis)
    left = table - (table @ q) @ q.T
    spread = np.sqrt((left**2).sum(axis=1) / (STILL_SAMPLES - q.shape[1]))
    rounding = _rounding(signal.values)
    calm = np.argsort(spread)[: max(FEWEST_STRETCHES, round(STILL_SHARE * stretches))]
    # The median of the calmest share is low even among equal stretches; their median over all would see motion.
    noise = float(np.median(spread[calm])) * _calmest_correction()
    if noise <= _STAIRS * rounding:
        return rounding
    calmest = left[calm]
    neighbours = float((calmest[:, 1:] * calmest[:, :-1]).sum() / (calmest**2).sum())
    if neighbours > MOVING:
        msg = f"signal '{signal.name}' never rests, so that its noise cannot be told from its motion"
        msg = f"{msg}; record the same run three times, or a second of standing still"
        raise BadRecordingError(msg)
    return max(noise, rounding)


def _rounding(values: NDArray[np.float64]) -> float:
    """Return the noise of few digits: step / sqrt(12), 0 where neighbours hardly ever are the same."""
    steps = np.abs(np.diff(values))
    moved = steps[steps > 0.0]
    if moved.size == 0 or moved.size > (1.0 - _SAME_NEIGHBOURS) * steps.size:
        return 0.0
    return float(np.quantile(moved, _USUAL_STEP) / np.sqrt(12.0))


def _calmest_correction() -> float:
    """Return by how much the median scatter of the calmest share lies below the true scatter of white noise."""
    # The scatter of m samples is spread by 1 / sqrt(2 m); the middle of the lowest share q lies at quantile q / 2.
    quantile = -1.2816  # of the normal distribution at STILL_SHARE / 2 = 0.1
    return float(1.0 / (1.0 + quantile / np.sqrt(2.0 * (STILL_SAMPLES - 3))))


def find_noise(*batches: Batch) -> tuple[dict[str, NoiseSource], tuple[str, ...]]:
    """Return the noise of every signal that can be compared, and a note on each that has to be left out.

    A noise that a recording brings with it is not gone below, but repeats may show more. The noise is one number per
    signal, the same for all recordings.

    Args:
        batches: Recordings with what the nominal simulator makes of them. What differs from batch to batch, as between
            a machine in good order and one that is not, is no noise.

    Raises:
        BadRecordingError: no signal at all has a noise.

    """
    sources: dict[str, NoiseSource] = {}
    notes: list[str] = []
    for name in sorted({name for _, simulated in batches for each in simulated for name in each}):
        signals = [
            recording.signal(name)
            for recordings, simulated in batches
            for recording, each in zip(recordings, simulated, strict=True)
            if name in each
        ]
        given, repeated = _given(signals), _repeated(scatters(batches, name), signals[0])
        found = [offer for offer in (given, repeated) if offer is not None]
        if found:
            sources[name] = found[0]
            if given is not None and repeated is not None:
                sources[name] = _both(given, repeated)
            continue
        try:
            sources[name] = _still(signals)
        except BadRecordingError as error:
            notes.append(f"left out: {error}")
    if not sources:
        msg = notes[0].removeprefix("left out: ") if notes else "no signal is both measured and simulated"
        raise BadRecordingError(msg)
    return sources, tuple(notes)


def _given(signals: Sequence[Signal]) -> NoiseSource | None:
    known = [signal for signal in signals if signal.noise > 0.0]
    if not known:
        return None
    middle = sorted(known, key=lambda signal: (signal.noise, signal.noise_time_s))[len(known) // 2]
    step_s = float(np.median(np.diff(middle.time_s))) if middle.time_s.size > 1 else 1.0
    factor = max(1.0, middle.noise_time_s / step_s)
    return NoiseSource(middle.name, middle.unit, middle.noise, "given with the recording", factor)


def _repeated(runs: Sequence[Sequence[NDArray[np.float64]]], signal: Signal) -> NoiseSource | None:
    """Return the noise that repeats show, or none where there are none that differ."""
    tables = [table for run in runs for table in run]
    if not tables:
        return None
    free = sum(len(table) - 1 for table in tables)
    noise = float(np.sqrt(sum(float(np.mean(np.sum(table**2, axis=0))) for table in tables) / free))
    if noise == 0.0:
        return None
    correlation = correlation_of([row for table in tables for row in table])
    hanging = _hanging(correlation, runs)
    # What makes one curve of a whole run counts once there, also where its samples look new.
    factor = max(independence_factor(correlation), hanging.share**2 * hanging.samples)
    source = f"{max(map(len, tables))} repeats of the same run"
    return NoiseSource(signal.name, signal.unit, noise, source, factor, hanging)


def _both(given: NoiseSource, repeated: NoiseSource) -> NoiseSource:
    """Return the larger of a noise that is given and one that repeats show, hanging together as these show."""
    if repeated.noise >= given.noise:
        return repeated
    hanging = replace(repeated.hanging, share=repeated.hanging.share * (repeated.noise / given.noise) ** 2)
    return replace(given, hanging=hanging, factor=max(given.factor, repeated.factor))


def _hanging(correlation: NDArray[np.float64], runs: Sequence[Sequence[NDArray[np.float64]]]) -> Hanging:
    """Tell what hangs together from what is new in every sample, and how well its variance is known.

    That goes by the sum of the squared correlation, so that a wave that swings on counts as few samples as a drift;
    and, where there are more than two repeats, by how alike they differ: runs that start a little earlier or later
    differ by one and the same curve, which counts once however short its bumps are.
    """
    tables = [table for run in runs for table in run]
    samples = sum((len(table) - 1) * table.shape[1] for table in tables)
    alike, most = np.sum([likeness(run) for run in runs], axis=0)
    like = float(alike / most) if most > 0.0 else 0.0
    share = float(np.clip(max(np.mean(correlation[1 : 1 + _NEIGHBOURS]), np.sqrt(like)), 0.0, 1.0))
    if share < _LEAST_SHARE:
        return Hanging(0.0, 1.0, float(samples))
    length = float(np.mean([table.shape[1] for table in tables]))
    over = 1.0 + 2.0 * float(np.sum(np.clip(correlation[1:] / share, -1.0, 1.0) ** 2))
    over = float(np.clip(max(over, length * like / share**2), 1.0, length))
    # However short it hangs together: where feet slip, it is a few runs that tell how much.
    spare = float(sum(len(table) - 1 for table in tables))
    return Hanging(share, over, min(samples / over, max(spare, FEW)))


def _still(signals: Sequence[Signal]) -> NoiseSource:
    found, problem = [], BadRecordingError("no recording of this signal")
    for signal in signals:
        try:
            found.append(still_noise(signal))
        except BadRecordingError as error:  # noqa: PERF203  # a few signals
            problem = error
    if not found:
        raise problem
    return NoiseSource(signals[0].name, signals[0].unit, float(np.median(found)), "still stretches")
