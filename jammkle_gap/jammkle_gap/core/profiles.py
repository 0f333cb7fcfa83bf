"""Profiles of the likelihood on the grids: singles and pairs as algebra with one Gram matrix of all grid points."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import orth  # type: ignore[import-untyped]  # carries no types

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_gap.core.fit import Fit
    from jammkle_gap.core.grids import Grid

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
            name, beside = ((one, other), (other, one))[i % 2]
            own[name], values[name], alone = self._best(name, own[beside])
            given = own[beside]
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
