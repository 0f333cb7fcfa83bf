"""Candidates: effects and pairs of them on their grids, by algebra, and what the simulator makes of them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.linalg import orth  # type: ignore[import-untyped]  # carries no types

from jammkle_gap.core.features import features_of, measured
from jammkle_gap.core.signatures import grids_of, known_features, sensed_difference
from jammkle_gap.core.simulate import InfeasibleError, Made, simulated

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_gap.core.scatter import Difference, Setting
    from jammkle_gap.core.signatures import Dictionary, Grid
    from jammkle_gap.core.simulate import Problem


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

    def changes(self, difference: Difference) -> list[NDArray[np.float64]]:
        """Return what it and its constants change in the features of each setting, in their units."""
        if not len(self.scores):
            return list(self.features)
        return [part + each.shared @ self.scores for part, each in zip(self.features, difference.settings, strict=True)]


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
    weights: Mapping[str, NDArray[np.float64]]
    """Of the grid points in its signature, by effect; effects that were fitted already are not in it."""


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
        return Place((name,), (values,), gain, self._by_effect(weights, (name,)))

    def pairs(self, first: Sequence[str], most: int) -> list[Place]:
        """Return the best pairs, best first.

        Args:
            first: Effects of which each pair has one.
            most: Pairs that are returned.

        """
        found = [
            self._pair(one, other)
            for i, one in enumerate(first)
            for other in self._grids
            if other != one and other not in first[:i]
        ]
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
            names, gain = (*fit.names, name), float(gains[best]) - fit.left
            found.append(Place(names, (first, grid.mesh[best]), gain, {name: grid.weights[best]}))
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
        weights = self._by_effect(own[one] + own[other], (one, other))
        return Place((one, other), (values[one], values[other]), gain, weights)

    def _by_effect(self, weights: NDArray[np.float64], names: Sequence[str]) -> dict[str, NDArray[np.float64]]:
        return {name: weights[self._slices[name]] for name in names}

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


SILENT = 1e-6
"""Whitened feature below which nothing moves: rounding."""


class Signatures:
    """What parameters make of the features, with the simulator at the faulty runs' own inputs; remembers its runs."""

    def __init__(
        self,
        problem: Problem,
        settings: Sequence[Setting],
        machine: Mapping[str, float],
        silent: Sequence[frozenset[str]] = (),
        nominal: Sequence[NDArray[np.float64]] = (),
    ) -> None:
        """Prepare.

        Args:
            problem: Simulator and sensing.
            settings: Runs; the first faulty one of each setting is run again.
            machine: Calibrated constants, by name.
            silent: Parameters and constants that move nothing in a setting, and are not simulated there, per setting.
            nominal: Features with the calibrated constants alone, per setting; empty: simulated when needed.

        """
        self._problem = problem
        self._settings = settings
        self._machine = dict(machine)
        self._silent = silent or [frozenset[str]()] * len(settings)
        place = tuple(sorted(self._machine.items()))
        self._known: dict[tuple[Any, ...], NDArray[np.float64]] = {
            (k, place, ()): features for k, features in enumerate(nominal)
        }
        self._latest: dict[int, tuple[Mapping[str, float], Mapping[str, NDArray[np.float64]] | None]] = {}
        self.made = Made(0, 0.0)

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
        # Where there are none, a sensor reads what this machine does, and not what the nominal one does.
        part = np.zeros(setting.layout.size)
        if setting.references:
            part = sensed_difference(self._problem, setting, values)
        # Of each feature the effects that sensing does not know are simulated; most often these are all or none.
        known = {key: known_features(self._problem, setting.layout, (key.partition(".")[0],)) for key in values}
        for features in _uniform_parts([np.zeros(setting.layout.size, dtype=bool), *known.values()]):
            physical = {
                key: value for key, value in values.items() if key not in silent and not known[key][features].all()
            }
            sensed = {} if setting.references else {key: values[key] for key in values if known[key][features].all()}
            if physical or sensed or machine != before:
                nominal = self._simulated(k, {}, before, {})
                change = self._simulated(k, physical, machine, sensed) - nominal
                if not np.isfinite(change).any():
                    return None
                part[features] += np.nan_to_num(change[features])
        return part

    def nominal(self) -> tuple[NDArray[np.float64], ...]:
        """Return the features with the calibrated constants alone, per setting."""
        return tuple(self._simulated(k, {}, self._machine, {}) for k in range(len(self._settings)))

    def _simulated(
        self, k: int, values: Mapping[str, float], machine: Mapping[str, float], sensed: Mapping[str, float]
    ) -> NDArray[np.float64]:
        """Return the features of a machine with effects, some of which act on what its sensors read."""
        place = (k, tuple(sorted({**machine, **values}.items())), tuple(sorted(sensed.items())))
        if place not in self._known:
            setting, sensing = self._settings[k], self._problem.sensing
            run, features = setting.faulty[0], np.full(setting.layout.size, np.nan)
            read = self._read(k, {**machine, **values})
            if read is not None and sensed and sensing is not None:
                read = {**read, **sensing(run, {**measured(run), **read}, sensed)}
            if read is not None:
                features = features_of(setting.layout, run, read, self._problem.alignment)
            self._known[place] = features
        return self._known[place]

    def _read(self, k: int, values: Mapping[str, float]) -> Mapping[str, NDArray[np.float64]] | None:
        """Return what is read in a setting, by signal; None where it cannot be simulated. The latest is kept."""
        if self._latest.get(k, (None, None))[0] != values:
            run = self._settings[k].faulty[0]
            try:
                self._latest[k] = values, simulated(self._problem.simulator, run, values)
            except InfeasibleError:
                self._latest[k] = values, None
            self.made = Made(self.made.runs + 1, self.made.simulated_s + run.duration_s)
        return self._latest[k][1]


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
                rows[:, simulated] = dictionary.effects[effect.name][:, simulated]
            parts.append(rows)
        found[effect.name] = parts
    return found


def grid_signatures(features: GridFeatures, difference: Difference) -> dict[str, NDArray[np.float64]]:
    """Return whitened signatures of every effect's grid points, shape (points, n), those that move nothing left out."""
    whitened = {name: difference.whiten(parts) for name, parts in features.items()}
    return {name: each for name, each in whitened.items() if np.abs(each).max() > SILENT}
