"""What recordings of the same machine in good order say: how far the simulator is off anyway."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import uniform_filter1d  # type: ignore[import-untyped]  # carries no types

from jammkle_gap.november.noise import NoiseSource, find_noise
from jammkle_gap.november.recording import BadRecordingError
from jammkle_gap.november.repeats import is_same_run

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_gap.november.recording import Recording, Signal

_SMALLEST_FLOOR = 1.0
MOST_OFF = 0.4
"""Share of a change that a simulator is doubted by at most, however far references show it to be off. Assumed."""
_AROUND = 0.02
"""Share of a run over which such a doubt is the same. Assumed: what is late by so much is as doubtful."""

_NOTHING = 1e-9
"""Square of a difference, in noise, that is none."""


@dataclass(frozen=True)
class Baseline:
    """What is taken off before anything is judged, and what counts as noise after that."""

    corrections: tuple[Mapping[str, NDArray[np.float64]], ...]
    """Per recording and signal, in the signal's unit, at the signal's times."""
    added: tuple[Mapping[str, NDArray[np.float64]], ...]
    """Per recording and signal: standard deviation of what a correction may be off, in the signal's unit."""
    noise: Mapping[str, NoiseSource]
    notes: tuple[str, ...]
    same: tuple[tuple[int, ...], ...]
    """Per recording: which references are of the same run."""
    off: Mapping[str, float]
    """By signal: share of what it foretells that the simulator is off, and so of a change that it may be wrong by."""


def without_references(
    recordings: Sequence[Recording], nominal: Sequence[Mapping[str, NDArray[np.float64]]]
) -> Baseline:
    """Return the baseline where there are no references: nothing is taken off."""
    noise, notes = find_noise((recordings, nominal))
    nothing: tuple[dict[str, NDArray[np.float64]], ...] = tuple({} for _ in recordings)
    return Baseline(nothing, nothing, noise, notes, tuple(() for _ in recordings), {})


def with_references(
    recordings: Sequence[Recording],
    nominal: Sequence[Mapping[str, NDArray[np.float64]]],
    references: Sequence[Recording],
    reference_nominal: Sequence[Mapping[str, NDArray[np.float64]]],
) -> Baseline:
    """Return the baseline by references, so that the question becomes what has changed.

    Where a reference is of the same run, the whole curve of its residual is taken off. Elsewhere its mean is, and what
    then is left of the references counts as noise.

    Raises:
        BadRecordingError: a reference is one of the recordings.

    """
    _refuse_the_same(recordings, references)
    noise, notes = find_noise((recordings, nominal), (references, reference_nominal))
    same = tuple(
        tuple(k for k, each in enumerate(references) if is_same_run(recording, made, each, reference_nominal[k]))
        for recording, made in zip(recordings, nominal, strict=True)
    )
    corrections: list[dict[str, NDArray[np.float64]]] = [{} for _ in recordings]
    beside: list[dict[str, _Beside]] = [{} for _ in recordings]
    grown = dict.fromkeys(noise, _SMALLEST_FLOOR)
    for index, recording in enumerate(recordings):
        for name in (name for name in nominal[index] if name in noise):
            time_s = recording.signal(name).time_s
            correction = _correction(time_s, name, same[index], references, reference_nominal)
            if correction is None:
                continue
            corrections[index][name] = correction
            holders = [k for k in same[index] if name in reference_nominal[k]]
            if holders:
                there = [_at(time_s, references[k].signal(name), reference_nominal[k][name]) for k in holders]
                seen = [_at(time_s, references[k].signal(name), references[k].signal(name).values) for k in holders]
                beside[index][name] = _Beside(
                    corrections[index][name],
                    np.mean(there, axis=0),
                    nominal[index][name],
                    _astray(np.array(seen), np.array(there), noise[name].noise),
                    noise[name].noise / float(np.sqrt(len(holders))),
                )
                grown[name] = max(grown[name], float(np.sqrt(1.0 + 1.0 / len(holders))))
                continue
            every = _all_off(name, references, reference_nominal)
            grown[name] = max(grown[name], float(every.std()) / noise[name].noise)
    for name, factor in grown.items():
        source = noise[name]
        words = f"{source.source}, and what differs in the references" if factor > _SMALLEST_FLOOR else source.source
        noise[name] = replace(source, noise=source.noise * factor, source=words)
    shares = {name: _share_off([each[name] for each in beside if name in each]) for name in noise}
    added = tuple({name: _elsewhere(each, shares[name]) for name, each in found.items()} for found in beside)
    return Baseline(tuple(corrections), added, noise, notes, same, shares)


def beside_references(
    recordings: Sequence[Recording],
    simulated: Sequence[Mapping[str, NDArray[np.float64]]],
    references: Sequence[Recording],
    of_references: Sequence[Mapping[str, NDArray[np.float64]]],
    baseline: Baseline,
) -> list[dict[str, NDArray[np.float64]]]:
    """Return what another simulator makes of recordings, as if what it is off of the references were the baseline's.

    Residuals have the baseline's correction taken off, which is that of the simulator under diagnosis; one of a part,
    or one that is restarted, is off by something else.

    Args:
        recordings: To be diagnosed.
        simulated: What it makes of them.
        references: Of the same machine in good order.
        of_references: What it makes of these.
        baseline: By the references.

    """
    found: list[dict[str, NDArray[np.float64]]] = []
    for index, (recording, signals) in enumerate(zip(recordings, simulated, strict=True)):
        found.append(dict(signals))
        for name, taken in baseline.corrections[index].items():
            if name in signals:
                time_s = recording.signal(name).time_s
                own = _correction(time_s, name, baseline.same[index], references, of_references)
                found[index][name] = signals[name] - taken + (0.0 if own is None else own)
    return found


def _correction(
    time_s: NDArray[np.float64],
    name: str,
    same: Sequence[int],
    references: Sequence[Recording],
    simulated: Sequence[Mapping[str, NDArray[np.float64]]],
) -> NDArray[np.float64] | None:
    """Return what references are off a simulator: the curve of the same run, else the mean; None if none has it."""
    holders = [k for k in same if name in simulated[k]]
    if holders:
        curves = [_at(time_s, references[k].signal(name), _off(references[k], simulated[k], name)) for k in holders]
        mean: NDArray[np.float64] = np.mean(curves, axis=0)
        return mean
    every = _all_off(name, references, simulated)
    return np.full(time_s.shape, every.mean()) if every.size else None


def _all_off(
    name: str, references: Sequence[Recording], simulated: Sequence[Mapping[str, NDArray[np.float64]]]
) -> NDArray[np.float64]:
    held = [_off(one, made, name) for one, made in zip(references, simulated, strict=True) if name in made]
    return np.concatenate(held) if held else np.zeros(0)


@dataclass(frozen=True)
class _Beside:
    """One signal of one recording beside its references, at the times of the recording, in its unit."""

    off: NDArray[np.float64]
    """What the references are off the simulator."""
    there: NDArray[np.float64]
    """What the simulator makes of the references."""
    here: NDArray[np.float64]
    """What it makes of the recording: something else only if it is fed with what was measured."""
    astray: NDArray[np.float64]
    """Share of the differences that it makes between references that is not there, 0 to 1."""
    noise: float
    """Standard deviation of `off`, a mean over references."""


def _share_off(runs: Sequence[_Beside]) -> float:
    """Return which share of all that the simulator makes a signal move it is off in the references.

    What it says of a change is no better.
    """
    moved = sum(run.there.size * float(np.var(run.there)) for run in runs)
    missed = sum(run.off.size * max(float(np.var(run.off)) - run.noise**2, 0.0) for run in runs)
    return min(float(np.sqrt(missed / moved)), MOST_OFF) if moved > 0.0 else 0.0


def _astray(seen: NDArray[np.float64], made: NDArray[np.float64], noise: float) -> NDArray[np.float64]:
    """Return which share of the differences that the simulator makes between references of one run is not there.

    A part that is fed with measured inputs makes something else of every run. If it is right, what is left of the
    references differs by less than they do; if not, by more. Differences within the noise tell nothing: inputs have
    their own.

    Args:
        seen: The references, shape (runs, n), in the signal's unit.
        made: What the simulator makes of them, shape (runs, n).
        noise: In the same unit.

    Returns:
        Around each sample, shape (n,), 0 to 1.

    """
    differs, apart, left = (each - each.mean(axis=0) for each in (made, seen, seen - made))
    large = np.abs(differs) > noise
    simulated = _around(np.sum(large * differs**2, axis=0))
    unexplained = _around(np.sum(large * (left**2 - apart**2), axis=0))
    share = np.divide(unexplained, simulated, out=np.zeros_like(simulated), where=simulated > _NOTHING * noise**2)
    found: NDArray[np.float64] = np.sqrt(np.clip(share, 0.0, 1.0))
    return found


def _around(values: NDArray[np.float64]) -> NDArray[np.float64]:
    found: NDArray[np.float64] = uniform_filter1d(values, max(round(_AROUND * values.size), 1), mode="nearest")
    return found


def _elsewhere(run: _Beside, share: float) -> NDArray[np.float64]:
    """Return what the correction may be off where the references went through other states, sample by sample.

    It belongs to them, and is off by a share of what the simulator makes of the difference, root mean square around
    each sample: the share that it is off by anyway, or that it goes astray by between them.
    """
    square = np.maximum(_around((run.here - run.there) ** 2), 0.0)
    found: NDArray[np.float64] = np.maximum(share, run.astray) * np.sqrt(square)
    return found


def _at(time_s: NDArray[np.float64], signal: Signal, values: NDArray[np.float64]) -> NDArray[np.float64]:
    found: NDArray[np.float64] = np.interp(time_s, signal.time_s, values)
    return found


def _off(recording: Recording, nominal: Mapping[str, NDArray[np.float64]], name: str) -> NDArray[np.float64]:
    return recording.signal(name).values - nominal[name]


def _refuse_the_same(recordings: Sequence[Recording], references: Sequence[Recording]) -> None:
    for one in recordings:
        for other in references:
            if _identical(one, other):
                msg = f"recording '{one.name}' is also given as reference '{other.name}'"
                msg = f"{msg}; a reference must be a run of its own"
                raise BadRecordingError(msg)


def _identical(one: Recording, other: Recording) -> bool:
    names = {signal.name for signal in one.signals} & {signal.name for signal in other.signals}
    return bool(names) and all(np.array_equal(one.signal(name).values, other.signal(name).values) for name in names)
