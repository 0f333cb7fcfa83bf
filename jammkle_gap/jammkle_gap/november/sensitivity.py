"""Does an effect move anything at all? One run per parameter tells, and gives a first derivative for all else."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_gap.november.effect import Effect, Library
    from jammkle_gap.november.residual import Layout
    from jammkle_gap.november.runs import Runs, Signals

PROBE_SHARE = 0.15
"""Step of a probe, as a share of the parameter's range. Assumed: small enough to be nearly linear, large enough to
show through a solver's tolerance."""
MOVES = 0.02
"""An effect whose probe moves no signal by more than this share of its noise (root mean square) is dropped."""


@dataclass(frozen=True)
class Space:
    """Parameters of some effects, each from 0 (minimum) to 1 (maximum)."""

    effects: tuple[Effect, ...]
    """Those of the candidate; parameters of the calibration, fitted along with any candidate, come after theirs."""
    keys: tuple[str, ...]
    minimum: NDArray[np.float64]
    maximum: NDArray[np.float64]
    null: NDArray[np.float64]
    """In shares of the range, as all points."""

    def values(self, point: NDArray[np.float64]) -> dict[str, float]:
        """Return the parameters' values at a point; those at their null value are left out."""
        inside = np.clip(point, 0.0, 1.0)
        values = self.minimum + inside * (self.maximum - self.minimum)
        return {key: float(values[i]) for i, key in enumerate(self.keys) if inside[i] != self.null[i]}

    def all_values(self, point: NDArray[np.float64]) -> dict[str, float]:
        """Return the parameters' values at a point, every one of them."""
        values = self.minimum + np.clip(point, 0.0, 1.0) * (self.maximum - self.minimum)
        return {key: float(values[i]) for i, key in enumerate(self.keys)}


def space_of(effects: Sequence[Effect], calibration: Sequence[Effect] = ()) -> Space:
    """Lay the parameters of effects, and of a calibration after them, side by side."""
    pairs = [(effect, parameter) for effect in (*effects, *calibration) for parameter in effect.parameters]
    low = np.array([parameter.minimum for _, parameter in pairs], dtype=float)
    high = np.array([parameter.maximum for _, parameter in pairs], dtype=float)
    null = np.array([parameter.null for _, parameter in pairs], dtype=float)
    return Space(
        effects=tuple(effects),
        keys=tuple(effect.key(parameter) for effect, parameter in pairs),
        minimum=low,
        maximum=high,
        null=(null - low) / (high - low),
    )


@dataclass(frozen=True)
class Probe:
    """What small steps of one effect do."""

    effect: Effect
    start: NDArray[np.float64]
    """Where a fit starts: at the null value, or where every parameter has a say; shares of the range."""
    residual: NDArray[np.float64]
    """At `start`, shape (n,)."""
    jacobian: NDArray[np.float64]
    """Of the residual by the shares of the range, shape (n, parameters)."""
    alone: NDArray[np.float64]
    """The same at the null value, shape (n, parameters): a second place to start from."""
    moves: Mapping[str, float]
    """Root mean square by which each signal moved, in its noise, at the largest of the steps."""

    @property
    def alive(self) -> bool:
        """Whether it moves anything."""
        return max(self.moves.values()) > MOVES


def _step(null: float, sign: float = 1.0) -> float:
    inwards = 1.0 if null <= 0.5 else -1.0  # noqa: PLR2004  # the middle of the range
    return sign * inwards * PROBE_SHARE


def _ends(null: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """Return the ends of all ranges, shares of them, that are not where the effect is off."""
    ends = [np.full_like(null, share) for share in (0.0, 1.0)]
    return [end for end in ends if not np.array_equal(end, null)]


def _same(one: Signals | None, other: Signals | None) -> bool:
    if one is None or other is None:
        return one is other
    return all(np.array_equal(values, other[name]) for name, values in one.items())


def probe(  # noqa: C901  # three rounds, each a line or two
    library: Library,
    runs: Runs,
    layout: Layout,
    nominal: NDArray[np.float64],
    calibrated: Mapping[str, float] | None = None,
) -> list[Probe]:
    """Step every parameter of every effect once, from its null value towards the far bound.

    A parameter that does nothing alone (a time constant without a strength) is stepped again with the others on; one
    that does nothing on this side of its null value is tried on the other. A recording that an effect leaves as it was,
    to the last digit, also at the ends of its range, is not run again for that effect.

    Args:
        library: Effects offered.
        runs: Of the simulator.
        layout: Of the residual.
        nominal: Residual without any effect.
        calibrated: Values of the calibration to probe at.

    """
    fixed = dict(calibrated or {})
    spaces = [space_of([effect]) for effect in library]
    flat = [(index, k) for index, space in enumerate(spaces) for k in range(len(space.keys))]

    ready = runs.evaluate([fixed])[0]
    heard: list[set[int]] = [set() for _ in spaces]

    def residuals(points: Sequence[tuple[int, NDArray[np.float64]]]) -> list[NDArray[np.float64]]:
        done = runs.evaluate([{**fixed, **spaces[index].values(point)} for index, point in points])
        for (index, _), each in zip(points, done, strict=True):
            heard[index] |= {place for place, signals in enumerate(each) if not _same(signals, ready[place])}
        return [layout.residual(each) for each in done]

    def moved(residual: NDArray[np.float64], base: NDArray[np.float64]) -> dict[str, float]:
        return layout.gaps(residual - base)

    steps = {at: _step(float(spaces[at[0]].null[at[1]])) for at in flat}
    columns: dict[tuple[int, int], NDArray[np.float64]] = {}
    moves: dict[int, dict[str, float]] = {index: dict.fromkeys(layout.names, 0.0) for index in range(len(spaces))}

    def take(at: tuple[int, int], step: float, residual: NDArray[np.float64], base: NDArray[np.float64]) -> None:
        difference = moved(residual, base)
        columns[at] = (residual - base) / step
        moves[at[0]] = {name: max(value, difference[name]) for name, value in moves[at[0]].items()}

    def unit(at: tuple[int, int], step: float) -> NDArray[np.float64]:
        point: NDArray[np.float64] = spaces[at[0]].null.copy()
        point[at[1]] += step
        return point

    def dead(at: tuple[int, int]) -> bool:
        return max(layout.gaps(columns[at] * PROBE_SHARE).values()) <= MOVES

    for at, residual in zip(flat, residuals([(at[0], unit(at, steps[at])) for at in flat]), strict=True):
        take(at, steps[at], residual, nominal)
    others = [at for at in flat if dead(at) and PROBE_SHARE < spaces[at[0]].null[at[1]] < 1.0 - PROBE_SHARE]
    for at, residual in zip(others, residuals([(at[0], unit(at, -steps[at])) for at in others]), strict=True):
        take(at, -steps[at], residual, nominal)
    alone = dict(columns)
    # Effects with a parameter that is silent alone: all on at once, and the silent ones stepped from there.
    joint = sorted({at[0] for at in flat if dead(at) and len(spaces[at[0]].keys) > 1})
    starts = {index: space.null for index, space in enumerate(spaces)}
    at_start = dict.fromkeys(range(len(spaces)), nominal)
    together = {
        index: spaces[index].null + np.array([steps[index, k] for k in range(len(spaces[index].keys))])
        for index in joint
    }
    for index, residual in zip(joint, residuals([(index, together[index]) for index in joint]), strict=True):
        starts[index], at_start[index] = together[index], residual
        difference = moved(residual, nominal)
        moves[index] = {name: max(value, difference[name]) for name, value in moves[index].items()}
    again = [at for at in flat if at[0] in joint]
    points = []
    for at in again:
        point = starts[at[0]].copy()
        point[at[1]] += steps[at]
        points.append((at[0], point))
    for at, residual in zip(again, residuals(points), strict=True):
        take(at, steps[at], residual, at_start[at[0]])
    # What acts beyond a threshold only, as a sensor that saturates, may be silent at a step and not further out.
    every = set(range(len(runs.recordings)))
    residuals([(i, end) for i in moves if heard[i] and heard[i] != every for end in _ends(spaces[i].null)])
    for index, space in enumerate(spaces):
        for place in every - heard[index]:
            runs.silence(place, space.keys)
    found = []
    for index, space in enumerate(spaces):
        count = range(len(space.keys))
        jacobian = np.column_stack([columns[index, k] for k in count])
        null = np.column_stack([alone[index, k] for k in count]) if index in joint else jacobian
        found.append(Probe(space.effects[0], starts[index], at_start[index], jacobian, null, moves[index]))
    return found
