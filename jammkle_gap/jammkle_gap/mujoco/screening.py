"""Which effects of a long list promise most, and numbers that close as much of the gap as they can.

All effects are screened by one Jacobian per recording, beside the constants of the machine with their priors.
"""

from __future__ import annotations

import copy
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.optimize import least_squares, minimize_scalar  # type: ignore[import-untyped]  # carries no types

from jammkle_gap.core.data import BadRecordingError
from jammkle_gap.core.effects import Library
from jammkle_gap.core.features import features_of, layout_of, measured
from jammkle_gap.core.simulate import Problem, Runner, Task
from jammkle_gap.mujoco.runs import BadRobotError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_gap.core.data import Recording
    from jammkle_gap.core.effects import Effect
    from jammkle_gap.core.simulate import Progress
    from jammkle_gap.mujoco.library import RobotLibrary
    from jammkle_gap.mujoco.simulator import RobotSimulator

    Array = NDArray[np.float64]

BIN_S = 0.05
"""Length of a bin, s. Chosen: jitter of drivers is some milliseconds."""
_OFFERED = 12
"""Effects that are handed on to be fitted: two thirds by themselves, the others beside the best of these."""
_STEPS = (0.15, 0.5, 0.85)
"""Shares of the way to a bound that an effect is tried at; the next where one moves nothing, as a limit far away."""
_MOVES = 0.3
"""Length of a whitened signature, in standard deviations, from which on it is one."""


class _Whitened:
    """Features of recordings in the noise of their sensors, and runs of the simulator in them."""

    def __init__(self, simulator: RobotSimulator, recordings: Sequence[Recording], jobs: int) -> None:
        self._problem, self._jobs = Problem(simulator, Library(())), jobs
        self._runs = [(each, layout_of([each], BIN_S, None)) for each in recordings]
        self.data = self._stacked([features_of(layout, each, measured(each), None) for each, layout in self._runs])

    def _stacked(self, features: Sequence[Array]) -> Array:
        parts = [own / layout.floor for own, (_, layout) in zip(features, self._runs, strict=True)]
        return np.concatenate(parts)

    def made(self, values: Mapping[str, float]) -> Array | None:
        """Return the features with some values; None where it cannot be run."""
        return self.all([values])[0]

    def all(
        self, places: Sequence[Mapping[str, float]], progress: Callable[[float], None] = lambda _share: None
    ) -> list[Array | None]:
        """Return the features at several places, side by side."""
        runner = Runner(self._problem, self._jobs, lambda _what, share: progress(share))
        made = runner.features([Task(*run, place) for place in places for run in self._runs], "screening")
        by_place = [made[k : k + len(self._runs)] for k in range(0, len(made), len(self._runs))]
        return [None if any(np.isnan(each).all() for each in own) else self._stacked(own) for own in by_place]


def promising(
    simulator: RobotSimulator,
    every: RobotLibrary,
    library: Library,
    recordings: Sequence[Recording],
    jobs: int,
    progress: Progress,
) -> Library:
    """Return the effects that explain most of recordings, by themselves and beside the best of them.

    The difference is linear in constants and effects here, with the constants' priors: what is left is whitened by
    (I + A A'), A holding one standard deviation of each constant per column (Woodbury).

    Args:
        simulator: Of the robot.
        every: All effects, which of them are those of single joints together, and the constants.
        library: Effects on offer.
        recordings: What is compared.
        jobs: Processes.
        progress: Takes reports.

    """
    space = _Whitened(simulator, recordings, jobs)
    wanted = {effect.name for effect in library}
    needed = wanted | {member for name in wanted for member in every.members.get(name, ())}
    nominal = space.made({})
    if nominal is None:
        msg = "the nominal model blows up at what was commanded"
        msg += "; look at the gains, the unit of the commands and the time step of the model"
        raise BadRobotError(msg)

    def taken(places: Sequence[Mapping[str, float]], begin: float, end: float) -> list[Array | None]:
        made = space.all(places, lambda share: progress("screening", begin + share * (end - begin)))
        return [None if each is None else each - nominal for each in made]

    columns = taken([{each.name: each.null + each.sigma} for each in every.constants], 0.0, 0.1)
    constants = np.array([np.zeros_like(nominal) if column is None else column for column in columns]).T
    constants = constants.reshape(len(nominal), -1)
    metric = _Metric(constants, space.data - nominal)
    ways = {effect.name: _ways_of(effect) for effect in every.effects
            if effect.name in needed and effect.name not in every.members}  # fmt: skip
    left = [way for own in ways.values() for way in own]
    turns = max((len(way.shares) for way in left), default=0)
    for turn in range(turns):
        left = [way for way in left if turn < len(way.shares)]
        made = taken([way.at(way.shares[turn]) for way in left], *(0.1 + 0.6 * k / turns for k in (turn, turn + 1)))
        left = [way for way, column in zip(left, made, strict=True) if not way.take(way.shares[turn], column)]
    for effect in library:
        if effect.name in every.members:
            singles = [way for member in every.members[effect.name] for way in ways[member]]
            ways[effect.name] = _ways_of(effect)
            for way in ways[effect.name]:
                way.join([each for each in singles if (each.index, each.upper) == (way.index, way.upper)])
    able = [way for name, own in ways.items() for way in own if way.column is not None and name in wanted]
    best = sorted((way for way in able if way.alone), key=lambda way: -metric.gain([way]))[: 3 * _OFFERED]
    _try_further(best, metric, taken)
    names = _ordered(metric, able)
    around = _around_best(space, metric, constants, best, able, lambda share: progress("screening", 0.9 + 0.1 * share))
    names += [name for name in around if name not in names]
    if not names:
        msg = f"none of the {len(library.effects)} effects on offer moves anything in these recordings; offer others"
        raise BadRecordingError(msg)
    return Library(tuple(effect for effect in library if effect.name in names))


def _try_further(
    best: Sequence[_Way],
    metric: _Metric,
    taken: Callable[[Sequence[Mapping[str, float]], float, float], list[Array | None]],
) -> None:
    """Try effects where they would explain most: a small step misleads about a large effect.

    The line of an effect with a threshold depends on where it is tried, and so that counts which explains most.
    """
    shares = [metric.share(way) for way in best]
    made = taken([way.at(share) for way, share in zip(best, shares, strict=True)], 0.7, 0.8)
    for way, share, column in zip(best, shares, made, strict=True):
        way.take(share, column)
    further = [(way, share) for way in best for share in way.shares[1:]]
    made = taken([way.at(share) for way, share in further], 0.8, 0.9)
    for (way, share), column in zip(further, made, strict=True):
        other = copy.copy(way)
        if other.take(share, column) and metric.gain([other]) > metric.gain([way]):
            way.take(share, column)


def _around_best(
    space: _Whitened,
    metric: _Metric,
    constants: Array,
    best: Sequence[_Way],
    able: Sequence[_Way],
    progress: Callable[[float], None],
) -> list[str]:
    """Return the effects that explain most beside the best one, where a straight line leaves much of that one.

    A late command bends what it changes so much that a friction beside it is lost in what the line leaves. The best
    effect is gone to where it explains most, and the others are tried from there.
    """
    if not best:
        return []
    first = max(best, key=lambda way: metric.gain([way]))
    total = float(metric.times(metric.difference, metric.difference))
    if total - metric.gain([first]) < _MUCH * len(metric.difference):
        return []

    def left(share: float) -> float:
        made = space.made(first.at(share))
        rest = None if made is None else space.data - made
        return total if rest is None else float(metric.times(rest, rest))

    found = minimize_scalar(left, bounds=(first.low, first.high), method="bounded", options={"maxiter": _LINE_STEPS})
    place = first.at(float(found.x))
    there = space.made(place)
    if there is None:
        return []
    others = [way for way in able if way.effect.name != first.effect.name]
    made = space.all([{**place, **way.at(way.tried)} for way in others], progress)
    moved = [way.again(column - there) for way, column in zip(others, made, strict=True) if column is not None]
    return _best_names(_Metric(constants, space.data - there), moved, ())[: _OFFERED // 3]


_MUCH = 1.5
"""What the best effect leaves per feature, in the noise of sensors, from which on others are tried around it. Chosen: a
right one leaves 1, with a spread of less than 0.1 over a thousand features."""
_LINE_STEPS = 10
"""Runs that the best effect is looked for with along its way. Chosen: a hundredth of it."""


class _Way:
    """An effect on the way to one bound of one of its numbers, and what it makes of the features per whole way."""

    def __init__(self, effect: Effect, index: int, *, upper: bool) -> None:
        self.effect, self.index, self.upper, self._number = effect, index, upper, effect.parameters[index]
        self._end = self._number.maximum if upper else self._number.minimum
        self.alone = len(effect.parameters) == 1 or _is_stribeck(effect)
        """Whether its other numbers, if any, stay where they are; else all are tried together."""
        self.column: Array | None = None
        self.shares = self._number.shares or _STEPS
        self.tried = self.shares[0]
        """Share at which it was seen to move something last."""
        self.low, self.high = (0.0, 1.0) if self.alone else (-1.0, 1.0)

    def at(self, share: float) -> dict[str, float]:
        """Return the values at a share of the way."""
        value = self._number.null + share * (self._end - self._number.null)
        return {self.effect.key(self._number): value}

    def take(self, share: float, made: Array | None) -> bool:
        """Take what was made at a share of the way; return whether it moves anything."""
        if made is None or share <= 0.0 or float(made @ made) <= _MOVES**2:
            return False
        self.column, self.tried = made / share, share
        return True

    def again(self, column: Array) -> _Way:
        """Return the same way from another place, by what was made there at the share that was tried."""
        other = copy.copy(self)
        other.column = column / self.tried
        return other

    def join(self, members: Sequence[_Way]) -> None:
        """Be what others are together."""
        moving = [each.column for each in members if each.column is not None]
        self.column = np.sum(moving, axis=0) if moving else None


def _ways_of(effect: Effect) -> list[_Way]:
    """Return the ways of an effect: to each bound of its only number, or to one bound of each.

    A number that does nothing by itself, as the speed of a friction that is 0, has none.
    """
    found = []
    for index, each in enumerate(effect.parameters[:1] if _is_stribeck(effect) else effect.parameters):
        ends = [upper for upper, end in ((True, each.maximum), (False, each.minimum)) if end != each.null]
        found += [_Way(effect, index, upper=upper) for upper in (ends if len(effect.parameters) == 1 else ends[:1])]
    return found


def _is_stribeck(effect: Effect) -> bool:
    return effect.name.startswith("stribeck")


class _Metric:
    """The difference and signatures, with the constants of the machine taken out as far as their priors let them."""

    def __init__(self, constants: Array, difference: Array) -> None:
        self._constants = constants
        inner = np.eye(constants.shape[1]) + constants.T @ constants
        self._inner = np.linalg.inv(inner)
        self.difference = difference

    def times(self, left: Array, right: Array) -> Any:
        """Return the product of columns in the metric."""
        return left.T @ right - (left.T @ self._constants) @ (self._inner @ (self._constants.T @ right))

    def gain(self, ways: Sequence[_Way]) -> float:
        """Return how much some ways explain, each gone within its bounds."""
        columns = np.array([way.column for way in ways]).T
        gram, overlap = self.times(columns, columns), self.times(columns, self.difference)
        share = np.linalg.lstsq(gram, overlap, rcond=1e-9)[0]
        share = np.clip(share, [way.low for way in ways], [way.high for way in ways])
        return float(2.0 * share @ overlap - share @ gram @ share)

    def share(self, way: _Way) -> float:
        """Return how much of a way explains most."""
        column = np.array(way.column)
        overlap, squared = self.times(column, self.difference), self.times(column, column)
        return float(np.clip(overlap / squared, way.low, way.high))


def _ordered(metric: _Metric, able: Sequence[_Way]) -> list[str]:
    """Return the names of the most promising effects, by themselves and beside the best of these."""
    names = _best_names(metric, able, ())[: 2 * _OFFERED // 3]
    for best in names[:2]:
        fixed = max(_choices(able)[best], key=metric.gain)
        others = [name for name in _best_names(metric, able, fixed) if name not in names]
        names += others[: _OFFERED // 6]
    return names


def _best_names(metric: _Metric, able: Sequence[_Way], beside: Sequence[_Way]) -> list[str]:
    """Return the names of effects by how much they explain, the most first, beside others."""
    gains = {name: max(metric.gain([*beside, *ways]) for ways in some) for name, some in _choices(able).items()}
    return sorted(gains, key=lambda name: -gains[name])


def _choices(able: Sequence[_Way]) -> dict[str, list[list[_Way]]]:
    """Return by effect which of its ways are gone together: each by itself, or all."""
    found: dict[str, list[list[_Way]]] = {}
    for way in able:
        if way.alone:
            found.setdefault(way.effect.name, []).append([way])
        else:
            found.setdefault(way.effect.name, [[]])[0].append(way)
    return found


def refitted(
    simulator: RobotSimulator,
    every: RobotLibrary,
    recordings: Sequence[Recording],
    start: Mapping[str, float],
    jobs: int,
) -> dict[str, float]:
    """Return effects and constants that leave least of all recordings, from where the diagnosis has them.

    The diagnosis trusts most what agrees already, since it asks for the cause. A corrected model shall leave little
    altogether: least squares in the noise of sensors, with the constants' priors. What the simulator leaves beyond
    noise counts as noise, as a whole: without that, priors would not count at all.

    Args:
        simulator: Of the robot.
        every: Of which effects and constants are.
        recordings: That are fitted.
        start: Effects by `effect.parameter` and constants by name.
        jobs: Processes.

    """
    space = _Whitened(simulator, recordings, jobs)
    known = {effect.key(each): (each.null, 0.02 * (each.maximum - each.minimum), each.minimum, each.maximum, 0.0)
             for effect in every.effects for each in effect.parameters}  # fmt: skip
    known.update({each.name: (each.null, each.sigma, each.minimum, each.maximum, 1.0) for each in every.constants})
    null, steps, low, high, weights = np.array([known[key] for key in start]).T

    def values(shares: Array) -> dict[str, float]:
        return dict(zip(start, (null + shares * steps).tolist(), strict=True))

    def rest(made: Array | None, shares: Array) -> Array:
        left = np.full(len(space.data), _INFEASIBLE) if made is None else space.data - made
        return np.concatenate([left / scale, weights * shares])

    def slopes(shares: Array) -> Array:
        turned = np.where(shares + 1.0 > ends[1], -1.0, 1.0)
        made = space.all([values(shares), *(values(shares + each) for each in np.diag(turned))])
        rows = [rest(each, shares + turn) for each, turn in zip(made[1:], np.diag(turned), strict=True)]
        found: Array = ((np.array(rows) - rest(made[0], shares)) / turned[:, np.newaxis]).T
        return found

    ends = (low - null) / steps, (high - null) / steps
    place = np.clip((np.array(list(start.values())) - null) / steps, ends[0] + 1e-6, ends[1] - 1e-6)
    for _ in range(_WEIGHED):
        first = space.made(values(place))
        if first is None:
            return dict(start)
        scale = max(float(np.sqrt(np.square(space.data - first).mean())), 1.0)
        place = least_squares(
            lambda shares: rest(space.made(values(shares)), shares), place, slopes, ends, max_nfev=_FIT_STEPS, ftol=1e-3
        ).x
    return values(place)


def left_by(simulator: RobotSimulator, recordings: Sequence[Recording], values: Mapping[str, float]) -> float:
    """Return the mean square, in the noise of sensors, that some values leave; infinite where they cannot be run."""
    space = _Whitened(simulator, recordings, 1)
    made = space.made(values)
    return float("inf") if made is None else float(np.square(space.data - made).mean())


_WEIGHED, _FIT_STEPS = 2, 6
"""Times that the noise is taken anew, and steps of each fit. Chosen: servos move by less than a thousandth after it."""
_INFEASIBLE = 1e6
"""Whitened features of what cannot be simulated: far from everything that is measured."""
