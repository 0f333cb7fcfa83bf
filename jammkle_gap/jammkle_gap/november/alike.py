"""What a set of sensors cannot tell apart: effects that move the same alike, candidates that explain a gap alike."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from jammkle_gap.november.residual import DOUBT
from jammkle_gap.november.sensitivity import MOVES

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from jammkle_gap.november.fitting import Fit
    from jammkle_gap.november.residual import Layout
    from jammkle_gap.november.sensitivity import Probe

APART = DOUBT
"""Share of what an effect does that no setting of another may do as well, for the two to be told apart: a simulator is
not trusted to foretell less."""
_RANK = 1e-6


@dataclass(frozen=True)
class Alike:
    """How alike two effects are to the sensors."""

    first: str
    second: str
    apart: float
    """Share of what one of them does that the other cannot do, whichever is less: 0 is the same, 1 nothing alike."""
    same_signals: bool
    """Whether they move the very same signals, so that structure alone does not tell them apart."""

    @property
    def told_apart(self) -> bool:
        """Whether a simulator that is trusted to a tenth tells them apart."""
        return self.apart > APART


def alike(probes: Sequence[Probe], layout: Layout) -> list[Alike]:
    """Compare all effects that move something, by their derivatives in noise units.

    Samples that hang together count as few.

    Args:
        probes: Of the effects, on one set of recordings.
        layout: Of their residuals.

    Returns:
        Every pair, the most alike first.

    """
    weight = 1.0 / np.sqrt(layout.least_factor[layout.signal_of])
    bases = {each.effect.name: _basis(each.jacobian * weight[:, None]) for each in probes if each.alive}
    moved = {each.effect.name: frozenset(name for name, size in each.moves.items() if size > MOVES) for each in probes}
    found = []
    for first, second in combinations(sorted(bases), 2):
        apart = min(_left(bases[first], bases[second]), _left(bases[second], bases[first]))
        found.append(Alike(first, second, apart, moved[first] == moved[second]))
    return sorted(found, key=lambda each: each.apart)


def does_the_same(layout: Layout, nominal: Fit, best: Fit, other: Fit) -> bool:
    """Whether a candidate changes the nominal simulation as the best does, to what references trust it to.

    However sure the scores seem: what they differ by is less than the simulator itself may be off. Samples that hang
    together count as few. Where no reference shows it to be off, nothing does the same.

    Args:
        layout: Of the residuals.
        nominal: Fit of no effect.
        best: What is named.
        other: What is compared with it.

    """
    weight = 1.0 / np.sqrt(layout.least_factor[layout.signal_of])
    trusted = (nominal.residual - best.residual) * layout.off[layout.signal_of]
    return float(np.linalg.norm((other.residual - best.residual) * weight)) < float(np.linalg.norm(trusted * weight))


def _basis(columns: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return orthonormal directions, the strongest first, shape (n, rank)."""
    directions, sizes, _ = np.linalg.svd(columns, full_matrices=False)
    found: NDArray[np.float64] = directions[:, sizes > _RANK * sizes[0]]
    return found


def _left(one: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    """Return the share of one's strongest direction that lies outside the other's span."""
    strongest = one[:, 0]
    return float(np.linalg.norm(strongest - other @ (other.T @ strongest)))
