"""How large an effect is: what it changes, in units of what differs from run to run when nothing is wrong."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from jammkle_common.names import PUMP_DUTY, SOLENOIDS

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import NDArray

    from studies.blind.reality.record import RealRun

    Columns = Mapping[str, tuple[NDArray[np.float64], NDArray[np.float64]]]
    """By topic and column: times, s, and values, each of shape (n,)."""

_COMMANDS = frozenset({PUMP_DUTY.name, *(topic.name for topic in SOLENOIDS.values())})
_LEFT_OUT = ("rate_m_s", "velocity", "broken", "force_x_n", "force_y_n")
"""Columns that say again what another one does, that the diagnosis does not compare, and the shear of load cells."""
_LEAST = {
    "_pa": 10.0,
    "extension_m": 2e-6,
    "_n": 0.01,
    "position": 1e-6,
    "_rad_s": 1e-4,
    "_m_s2": 1e-3,
}
"""Least scatter by the end of a column's name, SI. Assumed: well below what any sensor scatters. Where a simulator has
no noise, anything would be infinitely large."""
_TOLERANCE = 0.05
"""Relative error of a size that is aimed at. Assumed: sizes are a factor of two apart."""
_STEPS = 12
"""Most runs of a search."""
_NOTHING = 1e-9
"""Least size that a logarithm is taken of."""
_SMALLEST = 1e-4
"""Smallest share of a fault's range that is tried."""


def is_command(topic: str) -> bool:
    """Tell whether a topic holds what was commanded, which is the same whatever is wrong, and never lost."""
    return topic in _COMMANDS


def columns_of(run: RealRun) -> Columns:
    """Return everything that was measured in a run, commands left out."""
    found = {}
    for topic, track in run.topics.items():
        if is_command(topic):
            continue
        for place, name in enumerate(track.columns):
            if not name.endswith(_LEFT_OUT):
                found[f"{topic} {name}"] = (track.stamp_s, track.values[:, place])
    return found


def scatter_of(runs: Sequence[Columns]) -> dict[str, float]:
    """Return the standard deviation from run to run of every column, root mean square over time.

    Args:
        runs: Repeats of one setting on one healthy machine, at least two.

    """
    found = {}
    for name in runs[0]:
        times_s, _ = runs[0][name]
        table = np.array([np.interp(times_s, *run[name]) for run in runs if name in run])
        if len(table) > 1:
            least = max((value for end, value in _LEAST.items() if name.endswith(end)), default=0.0)
            found[name] = max(float(np.sqrt(np.mean(np.var(table, axis=0, ddof=1)))), least)
    return {name: value for name, value in found.items() if value > 0.0}


def size_of(pairs: Sequence[tuple[Columns, Columns]], scatters: Sequence[Mapping[str, float]]) -> float:
    """Return the size of an effect: root mean square over all signals of (faulty - healthy) / scatter.

    Args:
        pairs: Healthy and faulty run, otherwise drawn alike.
        scatters: What differs from run to run, of each pair's setting.

    """
    squares = []
    for (healthy, faulty), scatter in zip(pairs, scatters, strict=True):
        for name, unit in scatter.items():
            if name in healthy and name in faulty:
                times_s, values = healthy[name]
                squares.append(float(np.mean((np.interp(times_s, *faulty[name]) - values) ** 2)) / unit**2)
    return float(np.sqrt(np.mean(squares)))


def share_for(size_at: Callable[[float], float], wanted: float) -> tuple[float, float]:
    """Find the share of a fault's range at which it is as large as wanted.

    Args:
        size_at: Size at a share, 0 to 1; taken to rise.
        wanted: Size.

    Returns:
        Share, and the size there. Where all of the range is not enough, or the smallest share too much, the end of the
        range and what it gives.

    """
    size = size_at(1.0)
    if size <= wanted:
        return 1.0, size
    # The secant in logarithms, as most effects grow with some power of their size; halves where it leaves the bracket.
    low, high = math.log(_SMALLEST), 0.0
    aim, last = math.log(wanted), (0.0, _log(size))
    slope, share = 1.0, 1.0
    for _ in range(_STEPS):
        guess = last[0] + (aim - last[1]) / slope if slope > 0.0 else low
        place = guess if low < guess < high else (low + high) / 2.0
        share = math.exp(place)
        size = size_at(share)
        if abs(size - wanted) <= _TOLERANCE * wanted:
            break
        low, high = (low, place) if size > wanted else (place, high)
        before, last = last, (place, _log(size))
        slope = (last[1] - before[1]) / (last[0] - before[0])
    return share, size


def _log(size: float) -> float:
    return math.log(max(size, _NOTHING))
