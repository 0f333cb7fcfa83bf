"""Fitting: effects and pairs of them to the whitened difference, on their grids by algebra, then with the simulator."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import orth  # type: ignore[import-untyped]  # carries no types
from scipy.optimize import least_squares  # type: ignore[import-untyped]  # carries no types

from jammkle_gap.core.signatures import grids_of, known_features, sensed_difference
from jammkle_gap.core.simulate import Made, Task, run_task

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_gap.core.constants import Constants
    from jammkle_gap.core.effects import EffectParameter
    from jammkle_gap.core.scatter import Difference, Setting
    from jammkle_gap.core.signatures import Dictionary, Grid
    from jammkle_gap.core.simulate import Problem, Runner

    Signature = Callable[[Mapping[str, float]], NDArray[np.float64]]
    """Whitened signature of parameters by key, shape (n,)."""

STEP_SHARE, LEAST_STEP = 0.15, 0.01
"""Step of a difference quotient: share of the distance from null, and least share of the range. Chosen: contact makes
smaller differences of a simulation uneven."""
_SHORTENINGS = 3
"""Times that a step is tried, each time shortened to what there is to explain."""
_LEAST_REACH = 3.0
"""Change of the whitened signature that is always let pass: three standard deviations."""


@dataclass(frozen=True)
class Fit:
    """One candidate, fitted: one effect, or several."""

    names: tuple[str, ...]
    values: Mapping[str, float]
    """By key `effect.parameter`."""
    signature: NDArray[np.float64]
    """Whitened, shape (n,)."""
    left: float
    """Squared length of what it leaves of the difference."""
    jacobian: NDArray[np.float64]
    """Derivatives of the signature, shape (n, parameters), per unit of each parameter."""
    whitened: NDArray[np.float64]
    """The difference that it was fitted to, shape (n,)."""
    features: tuple[NDArray[np.float64], ...] = ()
    """What it makes of the features of each setting, in their units. Where the constants of the machine were fitted
    beside it, less what `scores` make of them to first order: so that these may be taken as linear about that place."""
    scores: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    """Of the constants where they were fitted beside it: deviations from their prior's mean, along the root of its
    covariance, shape (constants,)."""
    machine: Mapping[str, float] = field(default_factory=dict)
    """Constants that it was simulated with, by name."""
    slopes: tuple[NDArray[np.float64], ...] = field(default=(), repr=False)
    """Where constants were fitted: derivatives of the features of each setting by parameters and then by scores."""


def refine(
    difference: NDArray[np.float64],
    names: tuple[str, ...],
    parameters: Sequence[tuple[str, EffectParameter]],
    start: Mapping[str, float],
    signature: Signature,
    constants: Constants,
) -> Fit:
    """Fit parameters with the simulator: Gauss-Newton in a trust region within their bounds (scipy's `trf`).

    Args:
        difference: Whitened, shape (n,).
        names: Of the effects.
        parameters: Their parameters by key.
        start: Where to begin, by key.
        signature: Simulates and whitens.
        constants: Steps at most, and when it ends.

    """
    low = np.array([each.minimum for _, each in parameters])
    span = np.array([each.maximum - each.minimum for _, each in parameters])
    null = np.array([(each.null - each.minimum) / (each.maximum - each.minimum) for _, each in parameters])
    keys = [key for key, _ in parameters]
    known: dict[bytes, NDArray[np.float64]] = {}

    def signature_at(shares: NDArray[np.float64]) -> NDArray[np.float64]:
        place = shares.tobytes()
        if place not in known:
            known[place] = signature(dict(zip(keys, (low + shares * span).tolist(), strict=True)))
        return known[place]

    def jacobian_at(shares: NDArray[np.float64]) -> NDArray[np.float64]:
        return -quotients(signature_at, shares, null, float(np.linalg.norm(difference - signature_at(shares))))

    begin = np.clip((np.array([start[key] for key in keys]) - low) / span, 1e-6, 1.0 - 1e-6)
    found = least_squares(
        lambda shares: difference - signature_at(shares),
        begin,
        jac=jacobian_at,
        bounds=(0.0, 1.0),
        max_nfev=constants.fit_evaluations,
        xtol=constants.fit_tolerance,
        ftol=constants.fit_tolerance,
    )
    best = min(known.items(), key=lambda item: float(np.square(difference - item[1]).sum()))
    shares = np.frombuffer(best[0])
    left = float(np.square(difference - best[1]).sum())
    values = dict(zip(keys, (low + shares * span).tolist(), strict=True))
    return Fit(names, values, best[1], left, -np.asarray(found.jac) / span, difference)


def quotients(
    function: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    shares: NDArray[np.float64],
    null: NDArray[np.float64],
    reach: float,
    length_of: Callable[[NDArray[np.float64]], float] = lambda change: float(np.linalg.norm(change)),
) -> NDArray[np.float64]:
    """Return difference quotients of a signature, shape (n, parameters).

    Args:
        function: Of shares of each parameter's range.
        shares: Where.
        null: Shares at which the effect is off.
        reach: Length of what there is to explain. A step that changes more is no derivative, and is shortened.
        length_of: Gives the whitened length of a change.

    """
    here, columns = function(shares), []
    for i, share in enumerate(shares):
        step = max(STEP_SHARE * abs(share - null[i]), LEAST_STEP)
        step = -step if share + step > 1.0 else step
        moved, change = shares, np.zeros_like(here)
        for _ in range(_SHORTENINGS):
            moved = shares.copy()
            moved[i] += step
            change = function(moved) - here
            length = length_of(change)
            if length <= max(reach, _LEAST_REACH):
                break
            step *= max(reach, _LEAST_REACH) / length
        columns.append(change / (moved[i] - share))
    slopes: NDArray[np.float64] = np.array(columns).reshape(len(shares), here.size).T
    return slopes


_ALTERNATIONS = 3
"""Times that each half of a pair is profiled anew beside the other."""


@dataclass(frozen=True)
class Place:
    """Where on the meshes a candidate fits best."""

    names: tuple[str, ...]
    values: tuple[NDArray[np.float64], ...]
    """Parameters of each effect, in its order."""
    gain: float
    """By how much it shortens the squared difference; of `seconds`, less its whole length."""


class Profiles:
    """Singles and pairs of effects, fitted on their meshes to one whitened difference."""

    def __init__(
        self,
        grids: Mapping[str, Grid],
        signatures: Mapping[str, NDArray[np.float64]],
        difference: NDArray[np.float64],
    ) -> None:
        """Prepare the Gram matrix.

        Args:
            grids: By effect.
            signatures: Whitened, of each grid's points, shape (points, n), by effect.
            difference: Whitened, shape (n,).

        """
        self._grids = {name: grids[name] for name in signatures}
        width = (0, difference.size)
        stacked = self._stacked = np.vstack([np.zeros(width), *(signatures[name] for name in self._grids)])
        ends = np.cumsum([len(signatures[name]) for name in self._grids])
        self._slices = {
            name: slice(int(end) - len(signatures[name]), int(end)) for name, end in zip(self._grids, ends, strict=True)
        }
        self._gram = stacked @ stacked.T
        self._overlap = stacked @ difference
        self._quadratic = {
            name: np.einsum("ij,jk,ik->i", grid.weights, self._gram[part, part], grid.weights, optimize=True)
            for (name, grid), part in zip(self._grids.items(), self._slices.values(), strict=True)
        }

    @property
    def names(self) -> tuple[str, ...]:
        """Effects, in order."""
        return tuple(self._grids)

    def single(self, name: str) -> Place:
        """Return the best place of one effect."""
        weights, values, gain = self._best(name, np.zeros(len(self._overlap)))
        del weights
        return Place((name,), (values,), gain)

    def pairs(self, first: Sequence[str], most: int) -> list[Place]:
        """Return the best pairs, best first.

        Args:
            first: Effects of which each pair has one.
            most: Pairs that are returned.

        """
        found = []
        for i, one in enumerate(first):
            for other in self._grids:
                if other == one or other in first[:i]:
                    continue
                found.append(self._pair(one, other))
        return sorted(found, key=lambda place: -place.gain)[:most]

    def seconds(self, fit: Fit) -> list[Place]:
        """Return every other effect at its best place beside a fitted one, best first.

        What the first leaves is explained by the grids; its own parameters follow along its Jacobian.

        Args:
            fit: Of one effect, with the simulator.

        """
        first = np.array(list(fit.values.values()))
        basis = orth(fit.jacobian)
        left = fit.whitened - fit.signature
        left = left - basis @ (basis.T @ left)
        found = []
        for name, grid in self._grids.items():
            if name in fit.names:
                continue
            rows = self._stacked[self._slices[name]]
            along = rows @ basis
            gram = self._gram[self._slices[name], self._slices[name]] - along @ along.T
            quadratic = np.einsum("ij,jk,ik->i", grid.weights, gram, grid.weights, optimize=True)
            gains = 2.0 * grid.weights @ (rows @ left) - quadratic
            best = int(np.argmax(gains))
            found.append(Place((*fit.names, name), (first, grid.mesh[best]), float(gains[best]) - fit.left))
        return sorted(found, key=lambda place: -place.gain)

    def _pair(self, one: str, other: str) -> Place:
        empty = np.zeros(len(self._overlap))
        own = dict.fromkeys((one, other), empty)
        values: dict[str, NDArray[np.float64]] = {}
        gain = 0.0
        for i in range(2 * _ALTERNATIONS):
            name, second = ((one, other), (other, one))[i % 2]
            own[name], values[name], alone = self._best(name, own[second])
            given = own[second]
            total = alone + float(2.0 * given @ self._overlap - given @ self._gram @ given)
            if i > 1 and total < gain * (1.0 + 1e-4):
                break
            gain = total
        return Place((one, other), (values[one], values[other]), gain)

    def _best(self, name: str, given: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
        """Return weights of all points, parameters and gain of one effect beside others' weights."""
        grid, part = self._grids[name], self._slices[name]
        overlap = self._overlap[part] - self._gram[part] @ given
        gains = 2.0 * grid.weights @ overlap - self._quadratic[name]
        best = int(np.argmax(gains))
        weights, values, gain = grid.weights[best], grid.mesh[best], float(gains[best])
        if grid.axes is not None:
            straight = grid.straight(self._gram[part, part], overlap)
            if straight is not None and straight[2] > gain:
                weights, values, gain = straight
        everywhere = np.zeros(len(self._overlap))
        everywhere[part] = weights
        return everywhere, values, gain


_INFEASIBLE = 1e6
"""Whitened features of parameters that cannot be simulated: far from everything that is measured."""
SILENT = 1e-6
"""Whitened feature below which nothing moves: rounding."""


class Signatures:
    """Whitened signatures of parameters, with the simulator at the faulty runs' own inputs; remembers its runs."""

    def __init__(
        self,
        problem: Problem,
        settings: Sequence[Setting],
        difference: Difference,
        machine: Mapping[str, float],
        silent: Sequence[frozenset[str]] = (),
    ) -> None:
        """Prepare.

        Args:
            problem: Simulator and sensing.
            settings: Runs; the first faulty one of each setting is run again.
            difference: Whitens.
            machine: Calibrated constants, by name.
            silent: Parameters and constants that move nothing in a setting, and are not simulated there, per setting.

        """
        self._problem = problem
        self._settings = settings
        self.difference = difference
        self._machine = dict(machine)
        self._silent = silent or [frozenset[str]()] * len(settings)
        self._known: dict[tuple[int, tuple[tuple[str, float], ...]], NDArray[np.float64]] = {}
        self.made = Made(0, 0.0)

    def __call__(self, values: Mapping[str, float]) -> NDArray[np.float64]:
        """Return the whitened signature of parameters by key; far off where they are infeasible."""
        parts = self.parts(values)
        if parts is None:
            return np.full(self.difference.whitened.size, _INFEASIBLE)
        return self.difference.whiten(parts)

    def parts(
        self, values: Mapping[str, float], machine: Mapping[str, float] | None = None
    ) -> list[NDArray[np.float64]] | None:
        """Return what parameters and constants change in the features of each setting; None where infeasible.

        Args:
            values: Parameters, by key.
            machine: Constants; None: those prepared with.

        """
        found = []
        for k in range(len(self._settings)):
            part = self.part(k, values, machine)
            if part is None:
                return None
            found.append(part)
        return found

    def part(
        self, k: int, values: Mapping[str, float], machine: Mapping[str, float] | None = None
    ) -> NDArray[np.float64] | None:
        """Return what parameters and constants change in the features of one setting; None where infeasible.

        Args:
            k: Which setting.
            values: Parameters, by key.
            machine: Constants that differ from those prepared with; None: the same. Where there are references these
                differ as well, and only the parameters change anything.

        """
        setting, silent = self._settings[k], self._silent[k]
        machine = {
            key: value
            for key, value in (self._machine if machine is None else machine).items()
            if key not in silent or key in self._machine
        }
        before = machine if setting.references else self._machine
        part = sensed_difference(self._problem, setting, values)
        # Of each feature the effects that sensing does not know are simulated; most often these are all or none.
        known = {key: known_features(self._problem, setting.layout, (key.partition(".")[0],)) for key in values}
        for features in _uniform_parts([np.zeros(setting.layout.size, dtype=bool), *known.values()]):
            physical = {
                key: value for key, value in values.items() if key not in silent and not known[key][features].all()
            }
            if physical or machine != before:
                change = self._simulated(k, physical, machine) - self._simulated(k, {}, before)
                if not np.isfinite(change).any():
                    return None
                part[features] += np.nan_to_num(change[features])
        return part

    def _simulated(self, k: int, values: Mapping[str, float], machine: Mapping[str, float]) -> NDArray[np.float64]:
        asked = {**machine, **values}
        place = (k, tuple(sorted(asked.items())))
        if place not in self._known:
            setting = self._settings[k]
            task = Task(setting.faulty[0], setting.layout, asked)
            self._known[place] = run_task(self._problem.simulator, self._problem.alignment, task)
            self.made = Made(self.made.runs + 1, self.made.simulated_s + setting.faulty[0].duration_s)
        return self._known[place]


def _uniform_parts(known: Sequence[NDArray[np.bool_]]) -> list[NDArray[np.bool_]]:
    """Return the features cut into parts in which every table is all true or all false."""
    parts = [np.ones(known[0].shape, dtype=bool)]
    for table in known:
        parts = [part & each for part in parts for each in (table, ~table) if (part & each).any()]
    return parts


GridFeatures = dict[str, list["NDArray[np.float64]"]]
"""What every effect's grid points make of the features, by effect; per setting, shape (points, n of the setting)."""


def grid_features(problem: Problem, settings: Sequence[Setting], dictionaries: Sequence[Dictionary]) -> GridFeatures:
    """Return what the grid points of every effect make of the features."""
    grids = grids_of(problem)
    found = {}
    for effect in problem.library:
        points = grids[effect.name].points
        keys = [effect.key(each) for each in effect.parameters]
        parts = []
        for setting, dictionary in zip(settings, dictionaries, strict=True):
            rows = np.array(
                [sensed_difference(problem, setting, dict(zip(keys, point.tolist(), strict=True))) for point in points]
            )
            simulated = ~known_features(problem, setting.layout, (effect.name,))
            if simulated.any() and effect.name in dictionary.effects:
                own = dictionary.effects[effect.name]
                rows[:, simulated] = dictionary.laid(setting.layout, own, problem, setting.faulty[0])[:, simulated]
            parts.append(rows)
        found[effect.name] = parts
    return found


def grid_signatures(features: GridFeatures, difference: Difference) -> dict[str, NDArray[np.float64]]:
    """Return whitened signatures of every effect's grid points, shape (points, n), those that move nothing left out."""
    whitened = {name: difference.whiten(parts) for name, parts in features.items()}
    return {name: each for name, each in whitened.items() if np.abs(each).max() > SILENT}


@dataclass(frozen=True)
class Screening:
    """Every effect on its grid, and with one run at the faulty runs' own commands."""

    profiles: Profiles
    places: Mapping[str, Place]
    order: tuple[str, ...]
    """Effects, the most promising first."""
    gains: Mapping[str, float]
    """By how much each shortens the squared difference, at the run's own commands where that was simulated."""
    left: float
    """Squared length of what the most promising one leaves."""


def screen(
    problem: Problem,
    settings: Sequence[Setting],
    signatures: Mapping[str, NDArray[np.float64]],
    difference: Difference,
    machine: Mapping[str, float],
    runner: Runner,
) -> Screening:
    """Look at every effect.

    Args:
        problem: Simulator, library and sensing.
        settings: Runs.
        signatures: Whitened, of every effect's grid points; see `grid_signatures`.
        difference: To be explained.
        machine: Calibrated constants.
        runner: Makes the runs.

    """
    profiles = Profiles(grids_of(problem), signatures, difference.whitened)
    places = {name: profiles.single(name) for name in profiles.names}
    screened = _screened(problem, settings, difference, machine, runner, places)
    gains = {name: max(place.gain, screened.get(name, -np.inf)) for name, place in places.items()}
    # What was simulated at the run's own commands is what counts; sensors' effects need no simulation.
    proven = {name: screened.get(name, place.gain) for name, place in places.items()}
    length = float(difference.whitened @ difference.whitened)
    order = sorted(gains, key=lambda name: -gains[name])
    return Screening(profiles, places, tuple(order), proven, length - max(proven.values(), default=0.0))


def _screened(
    problem: Problem,
    settings: Sequence[Setting],
    difference: Difference,
    machine: Mapping[str, float],
    runner: Runner,
    places: Mapping[str, Place],
) -> dict[str, float]:
    """Return the gain of each effect with one run at the faulty run's own commands, scaled to fit best.

    A regulator answers a fault, so that a grid at healthy commands misleads: a signature is trusted once it was
    simulated at the commands of the run itself.
    """
    known = {name: [known_features(problem, setting.layout, (name,)) for setting in settings] for name in places}
    names = [name for name in places if not all(each.all() for each in known[name])]
    values = {}
    tasks = [Task(setting.faulty[0], setting.layout, dict(machine)) for setting in settings]
    for name in names:
        keys = [key for key, _ in problem.library.parameters((name,))]
        values[name] = dict(zip(keys, places[name].values[0].tolist(), strict=True))
        tasks += [Task(setting.faulty[0], setting.layout, {**machine, **values[name]}) for setting in settings]
    made = runner.features(tasks, "screening")
    count = len(settings)
    found = {}
    for i, name in enumerate(names, 1):
        parts = []
        for k, setting in enumerate(settings):
            change = np.nan_to_num(made[count * i + k] - made[k])
            sensed = sensed_difference(problem, setting, values[name])
            parts.append(np.where(known[name][k], sensed, change))
        signature = difference.whiten(parts)
        squared = float(signature @ signature)
        # Less than the whole of a signature can be had by a smaller effect; more only up to the bounds.
        share = float(np.clip(signature @ difference.whitened / squared, 0.0, 1.5)) if squared > SILENT else 0.0
        found[name] = share * (2.0 * float(signature @ difference.whitened) - share * squared)
    return found
