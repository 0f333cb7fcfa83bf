"""What combinations of effects promise by derivatives alone, without a run: it decides which are fitted in full."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from jammkle_gap.november.fitting import Loss
from jammkle_gap.november.refining import linear_step
from jammkle_gap.november.sensitivity import space_of

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_gap.november.fitting import Fit
    from jammkle_gap.november.sensitivity import Probe

MOST_SAMPLES = 15_000
"""Samples that are looked at to weigh a combination; every so many of a longer recording stand for all."""
_REWEIGHTINGS = 2


@dataclass(frozen=True)
class _Part:
    """One effect, from null: its columns, thinned."""

    start: NDArray[np.float64]
    columns: NDArray[np.float64]


class Promises:
    """Weighs combinations on a thinned residual."""

    def __init__(
        self, probes: Mapping[str, Probe], fits: Mapping[tuple[str, ...], Fit], nominal: Fit, loss: Loss
    ) -> None:
        """Thin everything once.

        Args:
            probes: By effect.
            fits: Those of single effects among them: their secants look further than the probes.
            nominal: Fit of no effect, with the calibration.
            loss: That is to be made small.

        """
        every = max(1, nominal.residual.size // MOST_SAMPLES)
        self._rows = np.arange(0, nominal.residual.size, every)
        self._loss = Loss(loss.scale[self._rows], loss.factor[self._rows] / every)
        self._probes = probes
        self._nominal = replace(nominal, residual=nominal.residual[self._rows], jacobian=nominal.jacobian[self._rows])
        self._calibration = nominal.calibration
        self._singles = {names[0]: self._secant(fit) for names, fit in fits.items() if len(names) == 1}
        self._fits = {
            names: replace(fit, residual=fit.residual[self._rows], jacobian=fit.jacobian[self._rows])
            for names, fit in fits.items()
            if names
        }

    def least(self) -> float:
        """Return the least cost that any fit has come down to, nats."""
        return min(self._loss.cost(fit.residual) for fit in (self._nominal, *self._fits.values()))

    def of(self, names: tuple[str, ...]) -> float:
        """Return the cost that effects promise to come down to together, nats."""
        return self._of_pair(names) if len(names) == 2 else self._of_one_more(names)  # noqa: PLR2004  # a pair

    def _of_pair(self, names: tuple[str, ...]) -> float:
        """Start from null with both, and from the fit of either."""
        promised = [self._from_part(names, name) for name in names]
        if all(name in self._singles for name in names):
            parts = [self._singles[name] for name in names]
            point = np.concatenate([*(part.start for part in parts), self._nominal.point])
            columns = np.column_stack([*(part.columns for part in parts), self._nominal.jacobian])
            promised.append(self._promise(point, self._nominal.residual, columns))
        return min(promised)

    def _of_one_more(self, names: tuple[str, ...]) -> float:
        """Start from the fits of all effects but one."""
        return min(self._from_part(names, name) for name in names)

    def _from_part(self, names: Sequence[str], extra: str) -> float:
        """Start from the fit of all effects but one, which begins at its null value."""
        rest = self._fits.get(tuple(sorted(set(names) - {extra})))
        probe = self._probes[extra]
        if rest is None:
            return float("inf")
        known = len(rest.point) - len(self._nominal.point)
        columns = [rest.jacobian[:, :known], probe.alone[self._rows], rest.jacobian[:, known:]]
        null = space_of([probe.effect]).null
        point = np.concatenate([rest.point[:known], null, rest.point[known:]])
        return self._promise(point, rest.residual, np.column_stack(columns))

    def _secant(self, fit: Fit) -> _Part:
        """Return one effect from null; what the linear model misses on the way to its own fit is added along that way.

        What the calibration did meanwhile is its own affair.
        """
        nominal, rows = self._nominal, self._rows
        mine = fit.point.size - nominal.point.size
        null = fit.space.null[:mine]
        away = fit.point[:mine] - null
        jacobian, residual = fit.jacobian[rows], fit.residual[rows]
        moved = residual - nominal.residual - jacobian[:, mine:] @ (fit.point[mine:] - nominal.point)
        columns = jacobian[:, :mine]
        length = float(away @ away)
        if length > 0.0:
            columns = columns + np.outer(moved - columns @ away, away) / length
        return _Part(null, columns)

    def _promise(
        self, point: NDArray[np.float64], residual: NDArray[np.float64], jacobian: NDArray[np.float64]
    ) -> float:
        step = linear_step(residual, jacobian, self._loss, -point, 1.0 - point, reweightings=_REWEIGHTINGS)
        return min(self._loss.cost(residual), self._loss.cost(residual + jacobian @ step))
