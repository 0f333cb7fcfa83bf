"""What recordings of the same machine in good order say: how far the simulator is off anyway."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from jammkle_sim.gap.noise import NoiseSource, find_noise
from jammkle_sim.gap.recording import BadRecordingError
from jammkle_sim.gap.repeats import is_same_run

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_sim.gap.recording import Recording

_SMALLEST_FLOOR = 1.0


@dataclass(frozen=True)
class Baseline:
    """What is taken off before anything is judged, and what counts as noise after that."""

    corrections: tuple[Mapping[str, NDArray[np.float64]], ...]
    """Per recording and signal, in the signal's unit, at the signal's times."""
    noise: Mapping[str, NoiseSource]
    notes: tuple[str, ...]


def without_references(
    recordings: Sequence[Recording], nominal: Sequence[Mapping[str, NDArray[np.float64]]]
) -> Baseline:
    """Return the baseline where there are no references: nothing is taken off."""
    noise, notes = find_noise((recordings, nominal))
    return Baseline(tuple({} for _ in recordings), noise, notes)


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
    corrections: list[dict[str, NDArray[np.float64]]] = [{} for _ in recordings]
    grown = dict.fromkeys(noise, _SMALLEST_FLOOR)
    for index, recording in enumerate(recordings):
        same = [
            k
            for k, reference in enumerate(references)
            if is_same_run(recording, nominal[index], reference, reference_nominal[k])
        ]
        for name in (name for name in nominal[index] if name in noise):
            time_s = recording.signal(name).time_s
            holders = [k for k in same if name in reference_nominal[k]]
            if holders:
                curves = [
                    np.interp(
                        time_s, references[k].signal(name).time_s, _off(references[k], reference_nominal[k], name)
                    )
                    for k in holders
                ]
                corrections[index][name] = np.mean(curves, axis=0)
                grown[name] = max(grown[name], float(np.sqrt(1.0 + 1.0 / len(holders))))
                continue
            others = [k for k in range(len(references)) if name in reference_nominal[k]]
            if others:
                every = np.concatenate([_off(references[k], reference_nominal[k], name) for k in others])
                corrections[index][name] = np.full(time_s.shape, every.mean())
                grown[name] = max(grown[name], float(every.std()) / noise[name].noise)
    for name, factor in grown.items():
        source = noise[name]
        words = f"{source.source}, and what differs in the references" if factor > _SMALLEST_FLOOR else source.source
        noise[name] = replace(source, noise=source.noise * factor, source=words)
    return Baseline(tuple(corrections), noise, notes)


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
