"""Where fits of effects begin: at what probes found, at what parts of them came to, or at what a scan came upon.

Contact and stiction make valleys that no derivative leads out of; a fit from one place alone may end in a wrong one.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from jammkle_gap.november.fitting import Fit, Loss, jacobians_at
from jammkle_gap.november.refining import linear_step
from jammkle_gap.november.sensitivity import space_of

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_gap.november.residual import Layout
    from jammkle_gap.november.runs import Runs
    from jammkle_gap.november.sensitivity import Probe

SCAN = (0.08, 0.3, 0.5, 0.7, 0.92)
"""Values that a scan tries, in shares of a parameter's range."""

Fits = dict[tuple[str, ...], Fit]


def promise(start: Fit, loss: Loss) -> float:
    """Return the cost after a linear step from a start, or at the start where that is less."""
    step = linear_step(start.residual, start.jacobian, loss, -start.point, 1.0 - start.point)
    return min(start.cost, loss.cost(start.residual + start.jacobian @ step))


class Starts:
    """Starts of fits, from the probes of a library."""

    def __init__(self, layout: Layout, runs: Runs, probes: Mapping[str, Probe], nominal: Fit) -> None:
        """Prepare.

        Args:
            layout: Of the residual.
            runs: Of the simulator.
            probes: Of the effects that move something, by their names.
            nominal: Fit of the calibration alone, or the nominal simulator as it is.

        """
        self._layout = layout
        self._runs = runs
        self._probes = probes
        self._nominal = nominal

    def of(self, names: Sequence[str], fits: Fits, loss: Loss) -> Fit:
        """Return a start from the probes, from a fit of all effects but one, or from one of all: the best of them."""
        calibration = self._nominal.calibration
        space = space_of([self._probes[name].effect for name in names], calibration)
        probes = [self._probes[name] for name in names]
        jacobian = np.column_stack([*(probe.jacobian for probe in probes), self._nominal.jacobian])
        point = np.concatenate([*(probe.start for probe in probes), self._nominal.point])
        residual = self._nominal.residual + sum(
            (probe.residual - self._nominal.residual for probe in probes), np.zeros_like(self._nominal.residual)
        )
        moved = [probe for probe in probes if probe.residual is not self._nominal.residual]
        # Where several probes start away from null, their sum is only a guess and has to be run.
        if len(moved) > 1:
            residual = self._run([(space.values(point))])[0]
        starts = [Fit(space, point, residual, jacobian, loss.cost(residual), calibration=calibration)]
        for name in names if len(names) > 1 else ():
            rest = fits.get(tuple(sorted(set(names) - {name})))
            if rest is None or self._probes[name].residual is not self._nominal.residual:
                continue
            columns = {key: rest.jacobian[:, k] for k, key in enumerate(rest.space.keys)}
            places = {key: rest.point[k] for k, key in enumerate(rest.space.keys)}
            matrix = np.column_stack([columns.get(key, jacobian[:, k]) for k, key in enumerate(space.keys)])
            place = np.array([places.get(key, point[k]) for k, key in enumerate(space.keys)])
            cost = loss.cost(rest.residual)
            starts.append(replace(starts[0], point=place, residual=rest.residual, jacobian=matrix, cost=cost))
        fitted = fits.get(tuple(sorted(names)))
        if fitted is not None:
            starts.append(replace(fitted, cost=loss.cost(fitted.residual), polished=False))
        return min(starts, key=lambda each: each.cost)

    def at_null(self, name: str, fits: Fits, loss: Loss) -> Fit:
        """Return the start of one effect at its null value, whose probe began elsewhere."""
        probe = self._probes[name]
        point = np.concatenate([space_of([probe.effect]).null, self._nominal.point])
        jacobian = np.column_stack([probe.alone, self._nominal.jacobian])
        residual = self._nominal.residual
        start = self.of([name], fits, loss)
        return replace(start, point=point, residual=residual, jacobian=jacobian, cost=loss.cost(residual))

    def over_range(self, singles: Sequence[Fit], loss: Loss) -> list[Fit]:
        """Return, of fits of one parameter, those that another value of its range improves, there."""
        asked = [replace(fit, point=np.array([share]), polished=False) for fit in singles for share in SCAN]
        better = self._better(asked, {fit.names: fit for fit in singles}, loss)
        fresh = jacobians_at(better, self._runs, self._layout)
        return [replace(start, jacobian=jacobian) for start, jacobian in zip(better, fresh, strict=True)]

    def of_parts(self, wholes: Sequence[Fit], fits: Fits, loss: Loss) -> list[Fit]:
        """Return, of all that is left when one effect is taken out of fits, what is better there than where it was."""
        parts = [self._part(whole, name) for whole in wholes for name in whole.names if len(whole.names) > 1]
        return self._better(parts, fits, loss)

    def _part(self, whole: Fit, left_out: str) -> Fit:
        effects = [self._probes[name].effect for name in whole.names if name != left_out]
        space = space_of(effects, self._nominal.calibration)
        places = [whole.space.keys.index(key) for key in space.keys]
        point, jacobian = whole.point[places], whole.jacobian[:, places]
        return replace(whole, space=space, point=point, jacobian=jacobian, polished=False)

    def _better(self, asked: Sequence[Fit], known: Fits, loss: Loss) -> list[Fit]:
        """Run points and return the best of each candidate's, where it is better than what is known."""
        better: Fits = {}
        residuals = self._run([start.space.values(start.point) for start in asked])
        for start, residual in zip(asked, residuals, strict=True):
            cost = loss.cost(residual)
            best = better.get(start.names) or known.get(start.names)
            if best is None or cost < loss.cost(best.residual):
                better[start.names] = replace(start, residual=residual, cost=cost)
        return list(better.values())

    def _run(self, points: Sequence[Mapping[str, float]]) -> list[NDArray[np.float64]]:
        return [self._layout.residual(results) for results in self._runs.evaluate(points)]
