"""How much a signal differs from run to run and from sample to sample when nothing is wrong.

From repeats of the same run where there are any, else from still stretches: never from the signal's own size.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from jammkle_sim.gap.recording import BadRecordingError
from jammkle_sim.gap.residual import BIASES, autocorrelation_factor, without_bias

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_sim.gap.recording import Recording, Signal

STILL_SAMPLES = 24
"""Length of a stretch that is looked at for stillness, samples. Assumed: long enough for a scatter within 15 %."""
STILL_SHARE = 0.2
"""The calmest share of the stretches is taken as still. Assumed: a recording rests, or moves steadily, this long."""
FEWEST_STRETCHES = 3
MOVING = 0.6
"""Correlation of neighbours in the calmest stretches, their curve taken out, above which the signal never rests."""
SAME_RUN = 0.02
"""Two recordings are repeats if their nominal simulations differ by less than this share of their range (root mean
square). Assumed: measured starts scatter by less."""
_SAME_NEIGHBOURS = 0.1
_USUAL_STEP = 0.2
_STAIRS = 1.5


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
    known_from: float = float("inf")
    """Independent samples that it was found from; endless where it is declared, or taken from many."""


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


def repeats(
    recordings: Sequence[Recording], simulated: Sequence[Mapping[str, NDArray[np.float64]]]
) -> tuple[tuple[int, ...], ...]:
    """Group the recordings of one and the same run, told by what the nominal simulator makes of their inputs."""
    groups: list[list[int]] = []
    for index in range(len(recordings)):
        for group in groups:
            if is_same_run(recordings[group[0]], simulated[group[0]], recordings[index], simulated[index]):
                group.append(index)
                break
        else:
            groups.append([index])
    return tuple(tuple(group) for group in groups)


def is_same_run(
    first: Recording,
    first_nominal: Mapping[str, NDArray[np.float64]],
    second: Recording,
    second_nominal: Mapping[str, NDArray[np.float64]],
) -> bool:
    """Whether two recordings are of the same run, told by what the nominal simulator makes of their inputs."""
    shared = sorted(set(first_nominal) & set(second_nominal))
    if first.regime != second.regime:
        return False
    for name in shared:
        one, two = first.signal(name).time_s, second.signal(name).time_s
        if abs(one[-1] - two[-1]) > SAME_RUN * max(one[-1], two[-1]):
            return False
        other = np.interp(one, two, second_nominal[name])
        span = max(float(np.ptp(first_nominal[name])), float(np.ptp(other)))
        if float(np.sqrt(np.mean((first_nominal[name] - other) ** 2))) > SAME_RUN * span:
            return False
    return bool(shared)


def repeat_noise(
    recordings: Sequence[Recording],
    simulated: Sequence[Mapping[str, NDArray[np.float64]]],
    group: Sequence[int],
    name: str,
) -> float:
    """Return the standard deviation of one signal from run to run at the same time, over the repeats of one run."""
    rows = _scatter(recordings, simulated, group, name)
    return float(np.sqrt(np.mean(np.sum(rows**2, axis=0) / (len(group) - 1))))


def _scatter(
    recordings: Sequence[Recording],
    simulated: Sequence[Mapping[str, NDArray[np.float64]]],
    group: Sequence[int],
    name: str,
) -> NDArray[np.float64]:
    """Return how each repeat differs from their mean, shape (repeats, samples); sensors' own offsets are taken off."""
    base = recordings[group[0]].signal(name).time_s
    held = [(recordings[i].signal(name), simulated[i][name]) for i in group]
    table = np.array([np.interp(base, signal.time_s, signal.values - nominal) for signal, nominal in held])
    # Off from their common mean: only where runs differ may their sensors' offsets be what makes them differ.
    apart = table - table.mean(axis=0)
    table = np.array([without_bias(row, BIASES * signal.bias) for row, (signal, _) in zip(apart, held, strict=True)])
    result: NDArray[np.float64] = table - table.mean(axis=0)
    return result


def find_noise(
    recordings: Sequence[Recording], simulated: Sequence[Mapping[str, NDArray[np.float64]]]
) -> tuple[dict[str, NoiseSource], tuple[str, ...]]:
    """Return the noise of every signal that can be compared, and a note on each that has to be left out.

    A noise that a recording brings with it is not gone below, but repeats may show more. The noise is one number per
    signal, the same for all recordings.

    Raises:
        BadRecordingError: no signal at all has a noise.

    """
    groups = repeats(recordings, simulated)
    sources: dict[str, NoiseSource] = {}
    notes: list[str] = []
    for name in sorted({name for each in simulated for name in each}):
        holders = [i for i in range(len(recordings)) if name in simulated[i]]
        held = [[i for i in group if i in holders] for group in groups]
        offers = [
            _given([recordings[i].signal(name) for i in holders]),
            _repeated(recordings, simulated, [group for group in held if len(group) > 1], name),
        ]
        found = [offer for offer in offers if offer is not None]
        if found:
            sources[name] = max(found, key=lambda each: each.noise)
            continue
        try:
            sources[name] = _still([recordings[i].signal(name) for i in holders])
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
    first = known[0]
    step_s = float(np.median(np.diff(first.time_s))) if first.time_s.size > 1 else 1.0
    noise = float(np.median([signal.noise for signal in known]))
    return NoiseSource(first.name, first.unit, noise, "given with the recording", max(1.0, first.noise_time_s / step_s))


def _repeated(
    recordings: Sequence[Recording],
    simulated: Sequence[Mapping[str, NDArray[np.float64]]],
    groups: Sequence[Sequence[int]],
    name: str,
) -> NoiseSource | None:
    if not groups:
        return None
    values = [repeat_noise(recordings, simulated, group, name) for group in groups]
    weights = np.array([len(group) - 1 for group in groups], dtype=float)
    noise = float(np.sqrt(np.average(np.square(values), weights=weights)))
    if noise == 0.0:
        return None
    scatter = [row for group in groups for row in _scatter(recordings, simulated, group, name)]
    factor = float(np.median([autocorrelation_factor(row) for row in scatter]))
    count = max(len(group) for group in groups)
    known_from = sum((len(group) - 1) * recordings[group[0]].signal(name).values.size for group in groups) / factor
    unit = recordings[groups[0][0]].signal(name).unit
    return NoiseSource(name, unit, noise, f"{count} repeats of the same run", factor, known_from)


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
