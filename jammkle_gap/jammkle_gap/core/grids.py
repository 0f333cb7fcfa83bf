"""Grids over the parameters of an effect, and the finer mesh between their points.

Signatures are simulated on the grid alone. Between its points they are interpolated linearly, so that a profile of the
likelihood over the mesh is algebra with the grid's Gram matrix.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from jammkle_gap.core.effects import Effect, EffectParameter

_SHARES = {1: (0.02, 0.06, 0.15, 0.3, 0.5, 0.75, 1.0), 2: (0.03, 0.12, 0.35, 1.0), 3: (0.3, 1.0)}
"""Shares of the way from null to a bound, by the number of parameters. Chosen: about geometric, since effects of use
begin at a few per cent of their range; fewer where there are more axes."""
_FINE = {1: 8, 2: 4, 3: 2}
"""Parts that the mesh cuts an interval of the grid into."""
_MOST_CROSSED = 2
"""Parameters up to which the grid holds every combination; beyond it, only the axes."""


@dataclass(frozen=True)
class Grid:
    """Points at which an effect is simulated, and the mesh between them."""

    points: NDArray[np.float64]
    """Shape (points, parameters), null itself left out."""
    mesh: NDArray[np.float64]
    """Shape (mesh, parameters)."""
    weights: NDArray[np.float64]
    """Of the points' signatures in that of each place of the mesh, shape (mesh, points)."""
    axes: tuple[tuple[int, ...], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]] | None = None
    """Where only axes are simulated: the point nearest to null on each, null, and least and largest parameters."""

    def straight(
        self, gram: NDArray[np.float64], overlap: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], float] | None:
        """Return weights, parameters and gain of the least-squares fit with the points nearest to null, if it has one.

        Args:
            gram: Of the points' signatures, shape (points, points).
            overlap: Of the points' signatures with the difference, shape (points,).

        """
        if self.axes is None:
            return None
        near, null, low, high = self.axes
        step = np.array([self.points[point, i] - null[i] for i, point in enumerate(near)])
        small, right = gram[np.ix_(near, near)], overlap[list(near)]
        shares = np.linalg.lstsq(small, right, rcond=1e-9)[0]
        values = np.clip(null + shares * step, low, high)
        shares = (values - null) / step
        weights = np.zeros(len(self.points))
        weights[list(near)] = shares
        return weights, values, float(2.0 * shares @ right - shares @ small @ shares)


def grid_of(effect: Effect) -> Grid:
    """Return the grid of an effect with one to three parameters."""
    count = len(effect.parameters)
    axes = [_axis(each, count) for each in effect.parameters]
    fine = [_between(nodes, _FINE[count]) for nodes in axes]
    null = np.array([each.null for each in effect.parameters])
    if count <= _MOST_CROSSED:
        points = np.array(list(itertools.product(*axes)))
        products = [np.array([1.0])]
        mesh = np.array(list(itertools.product(*(values for values, _ in fine))))
        for _, weights in fine:
            products = [np.einsum("ai,bj->abij", *map(np.atleast_2d, (products[0], weights)))]
            left, right, first, second = products[0].shape
            products = [products[0].reshape(left * right, first * second)]
        kept = ~(points == null).all(axis=1)
        return Grid(points[kept], mesh, products[0][:, kept])
    rows, columns = [], []
    for i, nodes in enumerate(axes):
        for j, value in enumerate(nodes):
            if value != null[i]:
                rows.append(np.where(np.arange(count) == i, value, null))
                columns.append((i, j))
    mesh_rows, weight_rows = [], []
    for place in itertools.product(*(range(len(values)) for values, _ in fine)):
        mesh_rows.append([fine[i][0][at] for i, at in enumerate(place)])
        weight_rows.append([fine[i][1][place[i], j] for i, j in columns])
    near = tuple(
        min((k for k, (axis, _) in enumerate(columns) if axis == i), key=lambda k: abs(rows[k][i] - null[i]))
        for i in range(count)
    )
    low = np.array([each.minimum for each in effect.parameters])
    high = np.array([each.maximum for each in effect.parameters])
    return Grid(np.array(rows), np.array(mesh_rows), np.array(weight_rows), (near, null, low, high))


def _axis(parameter: EffectParameter, count: int) -> NDArray[np.float64]:
    """Return the nodes of one parameter, null among them, rising."""
    ends = [end for end in (parameter.minimum, parameter.maximum) if end != parameter.null]
    nodes = [parameter.null + share * (end - parameter.null) for end in ends for share in _SHARES[count]]
    return np.array(sorted({parameter.null, *nodes}))


def _between(nodes: NDArray[np.float64], parts: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return a finer axis, and the weights of the nodes at each of its places, shape (fine, nodes)."""
    at = np.arange((len(nodes) - 1) * parts + 1) / parts
    whole = np.arange(len(nodes))
    weights = np.maximum(1.0 - np.abs(at[:, np.newaxis] - whole), 0.0)
    return weights @ nodes, weights
