"""Constants and memory of a tendon, as the compiled loop has them."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from studies.blind.reality.machine import Material, TendonMake

SLICES = 16
"""Slices of a fibre, 5 mm each, so that both sections are whole slices. Even: the mirror lies on a node."""
HALF = SLICES // 2
BRANCHES = 12
"""Relaxation branches."""
_LONGEST_S = 200.0
"""Time constant of the slowest branch."""
_CONTACTS = 27
"""Contacts between fibres of the two groups in the hexagon. Declared."""
_DIAMETER_M = 0.002

MODULUS, LIMIT, LENGTH, AREA = range(4)
"""Rows of `TendonLaw.slices`."""
NEW, STRESS, SLOPE, STATIC, CARRIED, INSTANT, LEFT, FORCE, RIGID, MOST, BEND = range(11)
"""Rows of `TendonState.work`."""
TIME, TORN, UNBALANCED, TENSION = range(4)
"""Places in `TendonState.more`."""
(
    STEP, SHARE_PA, ONSET_PA, BRISTLE, STRICTION, STRIBECK, CONFINEMENT, CONFINEMENT_PA, PLATE, PLATE_TRAVEL, MEMBRANE,
    BREAK, DAMAGE, DAMAGE_STRETCH, SHORTER, WARMING, SOFTENING_SOFT, SOFTENING_STIFF, END_SHARE,
) = range(19)  # fmt: skip
"""Places in `TendonLaw.scalars`."""


class TendonLaw(NamedTuple):
    """Constants of a tendon for one time step."""

    scalars: NDArray[np.float64]
    slices: NDArray[np.float64]
    """Shape (4, SLICES)."""
    soft: NDArray[np.float64]
    """1 where a slice is soft, shape (SLICES,)."""
    rub: NDArray[np.float64]
    """Friction per pressing pressure at each node up to the middle, N/Pa, shape (HALF + 1,)."""
    decay: NDArray[np.float64]
    """Shape (BRANCHES,)."""
    gain: NDArray[np.float64]
    """Shape (BRANCHES, SLICES)."""


class TendonState(NamedTuple):
    """Memory of a tendon."""

    node_m: NDArray[np.float64]
    """Place of each node beyond its free place, shape (SLICES + 1,)."""
    speed_m_s: NDArray[np.float64]
    """Of each node in the step before."""
    static_pa: NDArray[np.float64]
    """Stress without relaxation, shape (SLICES,)."""
    branch_pa: NDArray[np.float64]
    """Shape (BRANCHES, SLICES)."""
    bristle_n: NDArray[np.float64]
    """Force of the bristles, shape (HALF + 1,)."""
    stretched: NDArray[np.float64]
    """Stretch done so far by each slice, upward only, shape (SLICES,)."""
    work: NDArray[np.float64]
    """Room to work in, shape (11, SLICES + 1); means nothing between two steps."""
    blocks: NDArray[np.float64]
    """The same, shape (HALF, 3, 2)."""
    more: NDArray[np.float64]
    """Time since the law began, s; 1 when torn; unbalanced force of the last step, N; latest tension, N."""


def tendon_law(make: TendonMake, step_s: float, fibres: str = "multi") -> TendonLaw:
    """Return the constants for one time step.

    Args:
        make: The tendon.
        step_s: Time step, s.
        fibres: `multi`, or `a30` or `a85` where they are of one material all along.

    """
    slice_m = make.length_m / SLICES
    soft_slices = {"multi": round(make.soft_length_m / slice_m), "a30": SLICES, "a85": 0}[fibres]
    soft = (np.arange(SLICES) < soft_slices).astype(np.float64)
    slices = np.zeros((4, SLICES))
    slices[MODULUS] = np.where(
        soft > 0.0, _modulus_pa(make.soft, make.offset_k), _modulus_pa(make.stiff, make.offset_k)
    )
    slices[LIMIT] = np.where(soft > 0.0, make.soft.limit, make.stiff.limit)
    slices[LENGTH] = slice_m
    slices[AREA] = make.area_m2 / 2.0 * make.left
    times_s, gains = _branches(make)
    decay = np.exp(-step_s / times_s)
    ramp = gains * times_s / step_s * (1.0 - decay)
    relaxation = np.where(soft > 0.0, make.soft.relaxation, make.stiff.relaxation)
    scalars = np.zeros(19)
    scalars[STEP] = step_s
    scalars[SHARE_PA] = make.contact_share
    scalars[ONSET_PA] = make.contact_onset_pa
    scalars[BRISTLE] = make.bristle_m
    scalars[STRICTION] = make.striction
    scalars[STRIBECK] = make.stribeck_m_s
    scalars[CONFINEMENT] = make.confinement
    scalars[CONFINEMENT_PA] = make.confinement_pa
    scalars[PLATE] = make.plate_area_m2
    scalars[PLATE_TRAVEL] = make.plate_travel_m
    scalars[MEMBRANE] = make.membrane_n_m
    scalars[BREAK] = make.break_m
    scalars[DAMAGE] = make.damage
    scalars[DAMAGE_STRETCH] = make.damage_stretch
    scalars[SHORTER] = make.shorter_m
    scalars[WARMING] = make.warming_k_s
    scalars[SOFTENING_SOFT] = make.soft.softening_per_k
    scalars[SOFTENING_STIFF] = make.stiff.softening_per_k
    scalars[END_SHARE] = make.end_share
    return TendonLaw(scalars, slices, soft, _rub(make, soft, slice_m), decay, ramp[:, None] * relaxation[None, :])


def fresh_state() -> TendonState:
    """Return the memory of a tendon that was never pulled."""
    return TendonState(
        node_m=np.zeros(SLICES + 1),
        speed_m_s=np.zeros(SLICES + 1),
        static_pa=np.zeros(SLICES),
        branch_pa=np.zeros((BRANCHES, SLICES)),
        bristle_n=np.zeros(HALF + 1),
        stretched=np.zeros(SLICES),
        work=np.zeros((11, SLICES + 1)),
        blocks=np.zeros((HALF, 3, 2)),
        more=np.zeros(4),
    )


def _modulus_pa(material: Material, warmer_k: float) -> float:
    return material.modulus_pa * math.exp(-material.softening_per_k * warmer_k)


def _branches(make: TendonMake) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Time constants and gains that stand for `t^-exponent`, t in s: its relaxation times, cut into bins."""
    edges_s = np.geomspace(make.shortest_s, _LONGEST_S, BRANCHES + 1)
    times_s = np.sqrt(edges_s[1:] * edges_s[:-1])
    low, high = edges_s[:-1] ** -make.exponent, edges_s[1:] ** -make.exponent
    return times_s, (low - high) / (make.exponent * math.gamma(make.exponent))


def _rub(make: TendonMake, soft: NDArray[np.float64], slice_m: float) -> NDArray[np.float64]:
    """Friction force per pressing pressure at each node: none at the plates, half a slice from either side."""
    other = soft[::-1]
    coefficient = np.where((soft + other) > 0.0, make.friction_soft, make.friction_stiff)
    per_slice = coefficient * slice_m * _CONTACTS * _DIAMETER_M / math.sqrt(3.0) * make.left
    nodes = np.zeros(SLICES + 1)
    nodes[:-1] += per_slice / 2.0
    nodes[1:] += per_slice / 2.0
    nodes[0] = 0.0
    found: NDArray[np.float64] = nodes[: HALF + 1].copy()
    return found
