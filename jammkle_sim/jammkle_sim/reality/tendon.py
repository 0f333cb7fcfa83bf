"""One tendon: fibres in two groups, mirrored about the middle, that slide along each other under the vacuum.

One group is a chain of slices along its length; the other is its mirror image. A slice stretches by Gent's law and
relaxes by a power law of time, stood for by branches from half a millisecond to minutes. Between the groups every slice
carries bristles after LuGre: they bend, slide, and hold more at rest. The membrane presses the groups together, pulls
the end plates toward each other and stiffens what it squeezes. Nodes have no mass: each step finds their balance.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from jammkle_sim.reality.compiled import compiled

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from jammkle_sim.reality.machine import Material, TendonMake

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
_FULL_PA = 50e3
_SMALL_N = 1e-7
"""Balance that counts as reached, N."""
_MOST_ITERATIONS = 12
_LEAST_STRETCH = 0.2
_LARGEST_SHARE = 0.985
"""Share of Gent's limit beyond which the law goes on along its tangent."""

MODULUS, LIMIT, LENGTH, AREA = range(4)
"""Rows of `TendonLaw.slices`."""
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


def tendon_state(law: TendonLaw, extension_m: float) -> TendonState:
    """Return the memory of a tendon that has hung at an extension, vented, until it had relaxed."""
    state = TendonState(
        np.zeros(SLICES + 1), np.zeros(SLICES + 1), np.zeros(SLICES), np.zeros((BRANCHES, SLICES)),
        np.zeros(HALF + 1), np.zeros(SLICES), np.zeros(4),
    )  # fmt: skip
    total_m = max(extension_m + law.scalars[SHORTER], 0.0)
    for share in np.linspace(0.0, 1.0, 41)[1:]:
        tendon_tension_n(law, state, share * total_m - law.scalars[SHORTER], 0.0)
        state.branch_pa[:] = 0.0
        state.speed_m_s[:] = 0.0
        state.stretched[:] = 0.0
    state.bristle_n[:] = 0.0
    state.more[0] = 0.0
    tendon_tension_n(law, state, extension_m, 0.0)
    return state


def _modulus_pa(material: Material, warmer_k: float) -> float:
    return material.modulus_pa * math.exp(-material.softening_per_k * warmer_k)


def _branches(make: TendonMake) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Time constants and gains that stand for `t^-exponent`, t in s: its spectrum of relaxation times, cut into bins."""
    edges_s = np.geomspace(make.shortest_s, _LONGEST_S, BRANCHES + 1)
    times_s = np.sqrt(edges_s[1:] * edges_s[:-1])
    low, high = edges_s[:-1] ** -make.exponent, edges_s[1:] ** -make.exponent
    return times_s, (low - high) / (make.exponent * math.gamma(make.exponent))


def _rub(make: TendonMake, soft: NDArray[np.float64], slice_m: float) -> NDArray[np.float64]:
    """Friction force per pressing pressure at each node: none at the plates, half a slice from either side elsewhere."""
    other = soft[::-1]
    coefficient = np.where((soft + other) > 0.0, make.friction_soft, make.friction_stiff)
    per_slice = coefficient * slice_m * _CONTACTS * _DIAMETER_M / math.sqrt(3.0) * make.left
    nodes = np.zeros(SLICES + 1)
    nodes[:-1] += per_slice / 2.0
    nodes[1:] += per_slice / 2.0
    nodes[0] = 0.0
    return nodes[: HALF + 1].copy()


@compiled
def gent_pa(modulus_pa: float, limit: float, stretch: float) -> tuple[float, float]:
    """Return nominal stress and its slope over stretch of an incompressible Gent solid pulled along one axis."""
    square = stretch * stretch
    strain = stretch - 1.0 / square
    slope = 1.0 + 2.0 / (square * stretch)
    invariant = square + 2.0 / stretch - 3.0
    share = invariant / limit
    if share < _LARGEST_SHARE:
        stiff = modulus_pa / (1.0 - share)
        return stiff * strain, stiff * (slope + 2.0 * strain * strain / (limit * (1.0 - share)))
    stiff = modulus_pa / (1.0 - _LARGEST_SHARE)
    beyond = 1.0 + (share - _LARGEST_SHARE) / (1.0 - _LARGEST_SHARE)
    return stiff * strain * beyond, stiff * (slope * beyond + 2.0 * strain * strain / (limit * (1.0 - _LARGEST_SHARE)))


@compiled
def bristle_n(before_n: float, slip_m: float, most_n: float, stiffness_n_m: float) -> tuple[float, float]:
    """Return force and slope over slip of bent bristles after a slip at even speed (LuGre, solved for the step)."""
    if most_n <= 0.0:
        return 0.0, 0.0
    held = min(max(before_n, -most_n), most_n)
    goal = most_n if slip_m >= 0.0 else -most_n
    left = math.exp(-stiffness_n_m * abs(slip_m) / most_n)
    return goal + (held - goal) * left, stiffness_n_m * left * abs(goal - held) / most_n


@compiled
def tendon_tension_n(law: Any, state: Any, extension_m: float, vacuum_pa: float) -> float:
    """Advance a tendon by a time step to a new extension, and return its tension, N, never negative.

    Args:
        law: TendonLaw.
        state: TendonState, changed in place.
        extension_m: Length beyond the length as drawn, m; negative when slack.
        vacuum_pa: Pressure below ambient in the tendon, Pa.

    """
    scalars, slices = law.scalars, law.slices
    step_s = scalars[STEP]
    state.more[0] += step_s
    total_m = extension_m + scalars[SHORTER]
    if total_m >= scalars[BREAK]:
        state.more[1] = 1.0
    if state.more[1] > 0.0:
        state.more[3] = 0.0
        return 0.0
    slack = total_m <= 0.0
    total_m = max(total_m, 0.0)
    vacuum_pa = max(vacuum_pa, 0.0)

    squeezed = 1.0 + scalars[CONFINEMENT] * (1.0 - math.exp(-vacuum_pa / scalars[CONFINEMENT_PA]))
    warmer_k = scalars[WARMING] * state.more[0]
    soft_factor = squeezed * math.exp(-scalars[SOFTENING_SOFT] * warmer_k)
    stiff_factor = squeezed * math.exp(-scalars[SOFTENING_STIFF] * warmer_k)
    # The membrane takes up the first kilopascals: smooth, as it does not lie flat everywhere at once.
    onset = scalars[ONSET_PA]
    excess = (vacuum_pa - onset) / (0.2 * onset + 1.0)
    pressing_pa = scalars[SHARE_PA] * (0.2 * onset + 1.0) * (math.log1p(math.exp(excess)) if excess < 30.0 else excess)
    if vacuum_pa < 100.0:
        pressing_pa = 0.0

    before_m = state.node_m
    new_m = np.empty(SLICES + 1)
    share = total_m - before_m[SLICES]
    for i in range(SLICES + 1):
        new_m[i] = before_m[i] + share * i / SLICES
    new_m[0] = 0.0
    new_m[SLICES] = total_m
    # A better guess: everything goes on as in the step before, scaled to the new end.
    end = state.speed_m_s[SLICES] * step_s
    if abs(end) > 1e-12 and 0.0 < share / end < 4.0:
        scale = share / end * step_s
        for i in range(1, SLICES):
            new_m[i] = before_m[i] + scale * state.speed_m_s[i]

    stress_pa, slope_pa, static_pa = np.empty(SLICES), np.empty(SLICES), np.empty(SLICES)
    carried_pa, instant = np.empty(SLICES), np.empty(SLICES)
    for i in range(SLICES):
        carried, gain = 0.0, 1.0
        for b in range(BRANCHES):
            carried += law.decay[b] * state.branch_pa[b, i]
            gain += law.gain[b, i]
        carried_pa[i] = carried
        instant[i] = gain
    force_n, rigid_n_m = np.zeros(HALF + 1), np.zeros(HALF + 1)
    most_n, bend_n_m = np.zeros(HALF + 1), np.zeros(HALF + 1)
    for k in range(1, HALF + 1):
        slip_speed = abs(state.speed_m_s[k] + state.speed_m_s[SLICES - k] - state.speed_m_s[SLICES])
        rest = 1.0 + scalars[STRICTION] * math.exp(-((slip_speed / scalars[STRIBECK]) ** 2))
        most_n[k] = law.rub[k] * pressing_pa * rest
        bend_n_m[k] = law.rub[k] * scalars[SHARE_PA] * 42e3 / scalars[BRISTLE]
    left_n, upper = np.empty(SLICES + 1), np.empty((HALF, 2, 2))
    right = np.empty((HALF + 1, 2))
    worst_n = 0.0
    for _ in range(_MOST_ITERATIONS):
        for i in range(SLICES):
            stretch = max(1.0 + (new_m[i + 1] - new_m[i]) / slices[LENGTH, i], _LEAST_STRETCH)
            factor = soft_factor if law.soft[i] > 0.0 else stiff_factor
            if scalars[DAMAGE] > 0.0:
                factor *= 1.0 - scalars[DAMAGE] * (1.0 - math.exp(-state.stretched[i] / scalars[DAMAGE_STRETCH]))
            stress, slope = gent_pa(slices[MODULUS, i] * factor, slices[LIMIT, i], stretch)
            static_pa[i] = stress
            stress_pa[i] = instant[i] * stress - (instant[i] - 1.0) * state.static_pa[i] + carried_pa[i]
            slope_pa[i] = instant[i] * slope * slices[AREA, i] / slices[LENGTH, i]
        for k in range(1, HALF + 1):
            slip = new_m[k] + new_m[SLICES - k] - total_m
            slip -= before_m[k] + before_m[SLICES - k] - before_m[SLICES]
            force_n[k], rigid_n_m[k] = bristle_n(state.bristle_n[k], slip, most_n[k], bend_n_m[k])
        worst_n = 0.0
        for i in range(1, SLICES):
            k = min(i, SLICES - i)
            left_n[i] = slices[AREA, i] * stress_pa[i] - slices[AREA, i - 1] * stress_pa[i - 1] - force_n[k]
            worst_n = max(worst_n, abs(left_n[i]))
        if worst_n < _SMALL_N:
            break
        _solve(slope_pa, rigid_n_m, left_n, upper, right, new_m)
    state.more[2] = worst_n

    for k in range(1, HALF + 1):
        state.bristle_n[k] = force_n[k]
    for i in range(SLICES):
        growth = static_pa[i] - state.static_pa[i]
        state.static_pa[i] = static_pa[i]
        for b in range(BRANCHES):
            state.branch_pa[b, i] = law.decay[b] * state.branch_pa[b, i] + law.gain[b, i] * growth
        longer = (new_m[i + 1] - new_m[i]) - (before_m[i + 1] - before_m[i])
        if longer > 0.0:
            state.stretched[i] += longer / slices[LENGTH, i]
    for i in range(SLICES + 1):
        state.speed_m_s[i] = (new_m[i] - before_m[i]) / step_s
        before_m[i] = new_m[i]
    if slack:
        state.more[3] = 0.0
        return 0.0
    last = SLICES - 1
    fibres_n = slices[AREA, 0] * stress_pa[0] + slices[AREA, last] * stress_pa[last]
    plate_n = scalars[PLATE] * vacuum_pa * (1.0 - math.exp(-total_m / scalars[PLATE_TRAVEL]))
    tension_n: float = max(scalars[END_SHARE] * (fibres_n + plate_n + scalars[MEMBRANE] * total_m), 0.0)
    state.more[3] = tension_n
    return tension_n


@compiled
def _solve(slope: Any, rigid: Any, left: Any, upper: Any, right: Any, node_m: Any) -> None:
    """Take one Newton step: node k and its mirror together, from the plates to the middle and back."""
    # Blocks of two unknowns (k, SLICES - k); the middle node stands twice as one.
    for k in range(1, HALF):
        m = SLICES - k
        a = slope[k] + slope[k - 1] + rigid[k]
        d = slope[m] + slope[m - 1] + rigid[k]
        b = rigid[k]
        c = rigid[k]
        r0, r1 = left[k], left[m]
        if k > 1:
            # Neighbours toward the plates: k - 1 by slice k - 1, m + 1 by slice m.
            a -= slope[k - 1] * upper[k - 1, 0, 0]
            b -= slope[k - 1] * upper[k - 1, 0, 1]
            c -= slope[m] * upper[k - 1, 1, 0]
            d -= slope[m] * upper[k - 1, 1, 1]
            r0 += slope[k - 1] * right[k - 1, 0]
            r1 += slope[m] * right[k - 1, 1]
        determinant = a * d - b * c
        right[k, 0] = (d * r0 - b * r1) / determinant
        right[k, 1] = (a * r1 - c * r0) / determinant
        # Neighbours toward the middle: k + 1 by slice k, m - 1 by slice m - 1.
        upper[k, 0, 0] = d * slope[k] / determinant
        upper[k, 0, 1] = -b * slope[m - 1] / determinant
        upper[k, 1, 0] = -c * slope[k] / determinant
        upper[k, 1, 1] = a * slope[m - 1] / determinant
    k = HALF
    below, above = slope[k - 1], slope[k]
    u00, u01 = upper[k - 1, 0, 0], upper[k - 1, 0, 1]
    u10, u11 = upper[k - 1, 1, 0], upper[k - 1, 1, 1]
    a = below + above + 2.0 * rigid[k] - below * (u00 + u01) - above * (u10 + u11)
    change = (left[k] + below * right[k - 1, 0] + above * right[k - 1, 1]) / a
    node_m[k] += change
    first, second = change, change
    for k in range(HALF - 1, 0, -1):
        one = right[k, 0] + upper[k, 0, 0] * first + upper[k, 0, 1] * second
        two = right[k, 1] + upper[k, 1, 0] * first + upper[k, 1, 1] * second
        node_m[k] += one
        node_m[SLICES - k] += two
        first, second = one, two


@compiled
def tendon_history(law: Any, state: Any, extension_m: Any, vacuum_pa: Any, tension_n: Any) -> None:
    """Take one tendon through a history, one entry per time step; `tension_n` is written."""
    for i in range(extension_m.shape[0]):
        tension_n[i] = tendon_tension_n(law, state, extension_m[i], vacuum_pa[i])
