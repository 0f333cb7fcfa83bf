"""What parameters make of the whitened features: on the grids, and simulated at the inputs of a run itself."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from jammkle_gap.core.readings import known_features, sensed_difference
from jammkle_gap.core.signatures import grids_of
from jammkle_gap.core.simulate import Made, Task, run_task

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_gap.core.compare import Difference, Setting
    from jammkle_gap.core.signatures import Dictionary
    from jammkle_gap.core.simulate import Problem

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
    ) -> None:
        """Prepare.

        Args:
            problem: Simulator and sensing.
            settings: Runs; the first faulty one of each setting is run again.
            difference: Whitens.
            machine: Calibrated constants, by name.

        """
        self._problem = problem
        self._settings = settings
        self.difference = difference
        self._machine = dict(machine)
        self._known: dict[tuple[int, tuple[tuple[str, float], ...]], NDArray[np.float64]] = {}
        self.made = Made(0, 0.0)

    def __call__(self, values: Mapping[str, float]) -> NDArray[np.float64]:
        """Return the whitened signature of parameters by key; far off where they are infeasible."""
        parts = self.parts(values)
        if parts is None:
            return np.full(sum(self.difference.sizes), _INFEASIBLE)
        return self.difference.whiten(parts)

    def parts(self, values: Mapping[str, float]) -> list[NDArray[np.float64]] | None:
        """Return the signature in the features of each setting; None where the parameters are infeasible."""
        parts = []
        for k, setting in enumerate(self._settings):
            part = sensed_difference(self._problem, setting, values)
            # Of each feature the effects that sensing does not know are simulated; most often these are all or none.
            known = {key: known_features(self._problem, setting.layout, (key.partition(".")[0],)) for key in values}
            for features in _alike(list(known.values())):
                physical = {key: value for key, value in values.items() if not known[key][features].all()}
                if physical:
                    change = self._simulated(k, physical) - self._simulated(k, {})
                    if not np.isfinite(change).any():
                        return None
                    part[features] += np.nan_to_num(change[features])
            parts.append(part)
        return parts

    def _simulated(self, k: int, values: Mapping[str, float]) -> NDArray[np.float64]:
        place = (k, tuple(sorted(values.items())))
        if place not in self._known:
            setting = self._settings[k]
            task = Task(setting.faulty[0], setting.layout, {**self._machine, **values})
            self._known[place] = run_task(self._problem.simulator, self._problem.registrar, task)
            self.made = Made(self.made.runs + 1, self.made.simulated_s + setting.faulty[0].duration_s)
        return self._known[place]


def _alike(known: Sequence[NDArray[np.bool_]]) -> list[NDArray[np.bool_]]:
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
