"""Which effects these sensors cannot tell apart at all: declared from simulated signatures, before any data is seen."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_gap.core.constants import Constants
    from jammkle_gap.core.grids import Grid

_TYPICAL = 400.0
"""Squared length at which signatures are compared. Chosen: twenty standard deviations, a clear gap."""


def classes_of(
    grids: Mapping[str, Grid], signatures: Mapping[str, NDArray[np.float64]], constants: Constants
) -> tuple[tuple[str, ...], ...]:
    """Return classes of effects whose signatures can each be had from the others', up to a small share.

    Two effects are equivalent if each, at a typical size, leaves less than `class_distance` of its squared length when
    the other is fitted to it (isolability by the angle between signatures; Basseville 1988, Automatica 24:309).

    Args:
        grids: By effect.
        signatures: Whitened, of the grids' points, shape (points, n), by effect.
        constants: Distance.

    Returns:
        Classes of two or more, in the order of the effects.

    """
    names = list(signatures)
    typical = {name: _typical(signatures[name]) for name in names}
    stacked = {name: signatures[name] for name in names}
    left = np.ones((len(names), len(names)))
    for j, name in enumerate(names):
        gram = stacked[name] @ stacked[name].T
        weights = grids[name].weights
        quadratic = np.einsum("ij,jk,ik->i", weights, gram, weights, optimize=True)
        for i, other in enumerate(names):
            target = typical[other]
            gains = 2.0 * weights @ (stacked[name] @ target) - quadratic
            left[i, j] = 1.0 - float(gains.max()) / float(target @ target)
    near = (left < constants.class_distance) & (constants.class_distance > left.T)
    found: list[list[int]] = []
    for i in range(len(names)):
        for members in found:
            # All of a class are equivalent to each other: a chain of neighbours is none.
            if near[i, members].all():
                members.append(i)
                break
        else:
            found.append([i])
    return tuple(tuple(names[i] for i in members) for members in found if len(members) > 1)


def class_names(classes: Sequence[Sequence[str]]) -> dict[str, str]:
    """Return the name of the class of each effect that is in one: that of its first member."""
    return {name: members[0] for members in classes for name in members}


def class_of(names: Sequence[str], classes: Mapping[str, str]) -> tuple[str, ...]:
    """Return a candidate's effects by the names of their classes, sorted: the same for all that data cannot part.

    Args:
        names: Of its effects.
        classes: Name of the class of each effect that is in one, as `class_names` returns them.

    """
    return tuple(sorted(classes.get(name, name) for name in names))


def _typical(signatures: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the signature of the smallest grid point that makes a clear gap, or of the largest."""
    squared = np.square(signatures).sum(axis=1)
    clear = np.flatnonzero(squared >= _TYPICAL)
    chosen = clear[int(np.argmin(squared[clear]))] if len(clear) else int(np.argmax(squared))
    row: NDArray[np.float64] = signatures[chosen]
    return row
