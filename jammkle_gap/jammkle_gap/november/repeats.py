"""Recordings of one and the same run: which they are, and how far they differ."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import helmert  # type: ignore[import-untyped]  # carries no types

from jammkle_gap.november.residual import BIASES, without_bias

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_gap.november.recording import Recording

    Simulated = Sequence[Mapping[str, NDArray[np.float64]]]
    Batch = tuple[Sequence[Recording], Simulated]
    """Recordings, and what the nominal simulator makes of them."""

SAME_RUN = 0.05
"""Two recordings are repeats if half of the signals of their nominal simulations differ by less than this share of
their range (root mean square). Assumed: measured starts scatter by less; single signals part further where a foot
slips, and other settings differ in most."""


LED = 0.5
"""A repeat need not be run again for every effect if no signal of its nominal simulation differs from that of the other
by more than this, root mean square, in noise units. Assumed: then effects change both alike."""


def is_same_run(
    first: Recording,
    first_nominal: Mapping[str, NDArray[np.float64]],
    second: Recording,
    second_nominal: Mapping[str, NDArray[np.float64]],
) -> bool:
    """Whether two recordings are of the same run: as they say, else by what the nominal simulator makes of them."""
    if first.run and second.run:
        return first.run == second.run
    shared = sorted(set(first_nominal) & set(second_nominal))
    if first.regime != second.regime:
        return False
    apart = []
    for name in shared:
        one, two = first.signal(name).time_s, second.signal(name).time_s
        if abs(one[-1] - two[-1]) > SAME_RUN * max(one[-1], two[-1]):
            return False
        span = max(float(np.ptp(first_nominal[name])), float(np.ptp(second_nominal[name])))
        root = _apart(first, first_nominal, second, second_nominal, name)
        apart.append(root / span if span > 0.0 else float(root > 0.0))
    return bool(shared) and float(np.median(apart)) <= SAME_RUN


def _apart(
    first: Recording,
    first_nominal: Mapping[str, NDArray[np.float64]],
    second: Recording,
    second_nominal: Mapping[str, NDArray[np.float64]],
    name: str,
) -> float:
    """Return by how much two nominal simulations of a signal differ, root mean square, in its unit."""
    other = np.interp(first.signal(name).time_s, second.signal(name).time_s, second_nominal[name])
    return float(np.sqrt(np.mean((first_nominal[name] - other) ** 2)))


def repeats(recordings: Sequence[Recording], simulated: Simulated) -> tuple[tuple[int, ...], ...]:
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


def leaders(recordings: Sequence[Recording], simulated: Simulated, noise: Mapping[str, float]) -> tuple[int, ...]:
    """Return by recording which one may be run for it: the first of its repeats, where they hardly differ.

    Args:
        recordings: Measured.
        simulated: Nominal.
        noise: Standard deviation per signal, in its unit; signals without one do not count.

    """
    found = list(range(len(recordings)))
    for first, *others in repeats(recordings, simulated):
        for index in others:
            if set(simulated[first]) != set(simulated[index]):
                continue
            shared = sorted(set(simulated[first]) & set(noise))
            pair = (recordings[first], simulated[first], recordings[index], simulated[index])
            if shared and all(_apart(*pair, name) <= LED * noise[name] for name in shared):
                found[index] = first
    return tuple(found)


def scatters(batches: Sequence[Batch], name: str) -> list[list[NDArray[np.float64]]]:
    """Return how repeats differ from the mean of those of their batch; sensors' own offsets are taken off.

    Args:
        batches: Repeats are looked for in all of them together, and compared within each.
        name: Of the signal.

    Returns:
        Per run, and per batch that holds two or more repeats of it with the signal: in its unit, at the same times for
        all of a run, shape (repeats, samples).

    """
    recordings = [recording for each, _ in batches for recording in each]
    simulated = [signals for _, each in batches for signals in each]
    batch_of = np.repeat(np.arange(len(batches)), [len(each) for each, _ in batches])
    found = []
    for group in repeats(recordings, simulated):
        base = recordings[group[0]].signal(name).time_s if name in simulated[group[0]] else None
        tables = []
        for batch in range(len(batches)):
            held = [i for i in group if batch_of[i] == batch and name in simulated[i]]
            if len(held) > 1:
                base = recordings[held[0]].signal(name).time_s if base is None else base
                tables.append(_scatter([recordings[i] for i in held], [simulated[i] for i in held], name, base))
        if tables:
            found.append(tables)
    return found


def likeness(tables: Sequence[NDArray[np.float64]]) -> tuple[float, float]:
    """Return how alike the ways are in which repeats of one run differ: squared products of contrasts.

    Args:
        tables: As `scatters` gives them for one run.

    Returns:
        Sum of the squared products, and what it would be if all differed by more or less of one and the same curve.

    """
    contrasts = np.concatenate([helmert(len(table)) @ table for table in tables])
    squares = np.triu((contrasts @ contrasts.T) ** 2, 1)
    power = np.sum(contrasts**2, axis=1)
    return float(squares.sum()), float(np.triu(np.outer(power, power), 1).sum())


def _scatter(
    recordings: Sequence[Recording], simulated: Simulated, name: str, base: NDArray[np.float64]
) -> NDArray[np.float64]:
    held = [(recording.signal(name), each[name]) for recording, each in zip(recordings, simulated, strict=True)]
    table = np.array([np.interp(base, signal.time_s, signal.values - nominal) for signal, nominal in held])
    # Off from their common mean: only where runs differ may their sensors' offsets be what makes them differ.
    apart = table - table.mean(axis=0)
    table = np.array([without_bias(row, BIASES * signal.bias) for row, (signal, _) in zip(apart, held, strict=True)])
    result: NDArray[np.float64] = table - table.mean(axis=0)
    return result
