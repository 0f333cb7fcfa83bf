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

from studies.blind.reality.bodies import compiled

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from studies.blind.reality.machine import Material, TendonMake

_LARGEST_SHARE = 0.985
"""Share of Gent's limit beyond which the law goes on along its tangent."""


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


__all__ = [
    "TendonLaw",
    "TendonState",
    "bristle_n",
    "gent_pa",
    "tendon_history",
    "tendon_law",
    "tendon_state",
    "tendon_tension_n",
]

_SMALL_N = 1e-7
"""Balance that counts as reached, N."""
_MOST_ITERATIONS = 12
_LEAST_STRETCH = 0.2
_BRISTLE_PA = 42e3
"""Pressing vacuum at which the give of the bristles is stated."""
_NO_VACUUM_PA = 100.0
"""Vacuum below which nothing presses at all."""
_STRAIGHT = 30.0
"""Argument from which on a soft corner is its straight line."""
_STANDING_M = 1e-12
"""Travel of the end in a step below which there is no motion to carry on."""
_FASTEST = 4.0
"""Growth of the end's travel from step to step beyond which the motion is not carried on."""


def tendon_state(law: TendonLaw, extension_m: float) -> TendonState:
    """Return the memory of a tendon that has hung at an extension, vented, until it had relaxed."""
    state = fresh_state()
    total_m = max(extension_m + law.scalars[SHORTER], 0.0)
    for share in np.linspace(0.0, 1.0, 41)[1:]:
        tendon_tension_n(law, state, share * total_m - law.scalars[SHORTER], 0.0)
        state.branch_pa[:] = 0.0
        state.speed_m_s[:] = 0.0
        state.stretched[:] = 0.0
    state.bristle_n[:] = 0.0
    state.more[TIME] = 0.0
    tendon_tension_n(law, state, extension_m, 0.0)
    return state


@compiled
def tendon_tension_n(law: Any, state: Any, extension_m: float, vacuum_pa: float) -> float:
    """Advance a tendon by a time step to a new extension, and return its tension, N, never negative.

    Args:
        law: TendonLaw.
        state: TendonState, changed in place.
        extension_m: Length beyond the length as drawn, m; negative when slack.
        vacuum_pa: Pressure below ambient in the tendon, Pa.

    """
    scalars = law.scalars
    state.more[TIME] += scalars[STEP]
    total_m = extension_m + scalars[SHORTER]
    if total_m >= scalars[BREAK]:
        state.more[TORN] = 1.0
    if state.more[TORN] > 0.0:
        state.more[TENSION] = 0.0
        return 0.0
    stretched_m = max(total_m, 0.0)
    vacuum_pa = max(vacuum_pa, 0.0)
    _guess(state, stretched_m, scalars[STEP])
    _carry(law, state)
    _rub_tendon(law, state, _pressing_pa(scalars, vacuum_pa))
    squeezed = 1.0 + scalars[CONFINEMENT] * (1.0 - math.exp(-vacuum_pa / scalars[CONFINEMENT_PA]))
    warmer_k = scalars[WARMING] * state.more[TIME]
    soft = squeezed * math.exp(-scalars[SOFTENING_SOFT] * warmer_k)
    stiff = squeezed * math.exp(-scalars[SOFTENING_STIFF] * warmer_k)
    for _ in range(_MOST_ITERATIONS):
        _stress(law, state, soft, stiff)
        _slip(state, stretched_m)
        if _balance(law, state) < _SMALL_N:
            break
        _solve(state)
    _keep(law, state)
    work, last = state.work, SLICES - 1
    fibres_n = law.slices[AREA, 0] * work[STRESS, 0] + law.slices[AREA, last] * work[STRESS, last]
    plate_n = scalars[PLATE] * vacuum_pa * (1.0 - math.exp(-stretched_m / scalars[PLATE_TRAVEL]))
    tension_n: float = max(scalars[END_SHARE] * (fibres_n + plate_n + scalars[MEMBRANE] * stretched_m), 0.0)
    if total_m <= 0.0:
        tension_n = 0.0
    state.more[TENSION] = tension_n
    return tension_n


@compiled
def _pressing_pa(scalars: Any, vacuum_pa: float) -> float:
    """Return what presses fibre on fibre: the membrane takes up the first kilopascals, nowhere all at once."""
    if vacuum_pa < _NO_VACUUM_PA:
        return 0.0
    width_pa = 0.2 * scalars[ONSET_PA] + 1.0
    excess = (vacuum_pa - scalars[ONSET_PA]) / width_pa
    pressing_pa: float = scalars[SHARE_PA] * width_pa * (math.log1p(math.exp(excess)) if excess < _STRAIGHT else excess)
    return pressing_pa


@compiled
def _guess(state: Any, stretched_m: float, step_s: float) -> None:
    """Start from what would be if everything went on as in the step before, or even stretching where it stood."""
    before_m, new_m, speed = state.node_m, state.work[NEW], state.speed_m_s
    growth_m, end_m = stretched_m - before_m[SLICES], speed[SLICES] * step_s
    goes_on = abs(end_m) > _STANDING_M and 0.0 < growth_m / end_m < _FASTEST
    for i in range(1, SLICES):
        share_m = growth_m / end_m * step_s * speed[i] if goes_on else growth_m * i / SLICES
        new_m[i] = before_m[i] + share_m
    new_m[0] = 0.0
    new_m[SLICES] = stretched_m


@compiled
def _carry(law: Any, state: Any) -> None:
    """Write the stress that is left of the past, and how much more than the static stress a slice answers with."""
    for i in range(SLICES):
        carried, instant = 0.0, 1.0
        for b in range(BRANCHES):
            carried += law.decay[b] * state.branch_pa[b, i]
            instant += law.gain[b, i]
        state.work[CARRIED, i] = carried
        state.work[INSTANT, i] = instant


@compiled
def _rub_tendon(law: Any, state: Any, pressing_pa: float) -> None:
    """Write the most that each contact can hold, more at rest than sliding, and its bristles' stiffness."""
    scalars, speed = law.scalars, state.speed_m_s
    for k in range(1, HALF + 1):
        slip_m_s = abs(speed[k] + speed[SLICES - k] - speed[SLICES])
        rest = 1.0 + scalars[STRICTION] * math.exp(-((slip_m_s / scalars[STRIBECK]) ** 2))
        state.work[MOST, k] = law.rub[k] * pressing_pa * rest
        state.work[BEND, k] = law.rub[k] * scalars[SHARE_PA] * _BRISTLE_PA / scalars[BRISTLE]


@compiled
def _stress(law: Any, state: Any, soft: float, stiff: float) -> None:
    """Write stress and slope of every slice at its present guess."""
    work, slices, scalars = state.work, law.slices, law.scalars
    for i in range(SLICES):
        stretch = max(1.0 + (work[NEW, i + 1] - work[NEW, i]) / slices[LENGTH, i], _LEAST_STRETCH)
        factor = soft if law.soft[i] > 0.0 else stiff
        if scalars[DAMAGE] > 0.0:
            factor *= 1.0 - scalars[DAMAGE] * (1.0 - math.exp(-state.stretched[i] / scalars[DAMAGE_STRETCH]))
        static, slope = gent_pa(slices[MODULUS, i] * factor, slices[LIMIT, i], stretch)
        instant = work[INSTANT, i]
        work[STATIC, i] = static
        work[STRESS, i] = instant * static - (instant - 1.0) * state.static_pa[i] + work[CARRIED, i]
        work[SLOPE, i] = instant * slope * slices[AREA, i] / slices[LENGTH, i]


@compiled
def _slip(state: Any, stretched_m: float) -> None:
    """Write force and slope of every contact at the present guess."""
    work, before_m = state.work, state.node_m
    for k in range(1, HALF + 1):
        slip_m = work[NEW, k] + work[NEW, SLICES - k] - stretched_m
        slip_m -= before_m[k] + before_m[SLICES - k] - before_m[SLICES]
        work[FORCE, k], work[RIGID, k] = bristle_n(state.bristle_n[k], slip_m, work[MOST, k], work[BEND, k])


@compiled
def _balance(law: Any, state: Any) -> float:
    """Write the force that is left over at every inner node, and return the largest, N."""
    work, area, worst_n = state.work, law.slices[AREA], 0.0
    for i in range(1, SLICES):
        held_n = work[FORCE, min(i, SLICES - i)]
        work[LEFT, i] = area[i] * work[STRESS, i] - area[i - 1] * work[STRESS, i - 1] - held_n
        worst_n = max(worst_n, abs(work[LEFT, i]))
    state.more[UNBALANCED] = worst_n
    return worst_n


@compiled
def _solve(state: Any) -> None:
    """Take one Newton step: node k and its mirror together, from the plates to the middle and back."""
    slope, rigid, left, node_m = state.work[SLOPE], state.work[RIGID], state.work[LEFT], state.work[NEW]
    blocks = state.blocks
    for k in range(1, HALF):
        m = SLICES - k
        a = slope[k] + slope[k - 1] + rigid[k]
        d = slope[m] + slope[m - 1] + rigid[k]
        b = c = rigid[k]
        r0, r1 = left[k], left[m]
        if k > 1:  # neighbours toward the plates: k - 1 by slice k - 1, m + 1 by slice m
            before = blocks[k - 1]
            a -= slope[k - 1] * before[0, 0]
            b -= slope[k - 1] * before[0, 1]
            c -= slope[m] * before[1, 0]
            d -= slope[m] * before[1, 1]
            r0 += slope[k - 1] * before[2, 0]
            r1 += slope[m] * before[2, 1]
        determinant = a * d - b * c
        block = blocks[k]  # neighbours toward the middle: k + 1 by slice k, m - 1 by slice m - 1
        block[0, 0] = d * slope[k] / determinant
        block[0, 1] = -b * slope[m - 1] / determinant
        block[1, 0] = -c * slope[k] / determinant
        block[1, 1] = a * slope[m - 1] / determinant
        block[2, 0] = (d * r0 - b * r1) / determinant
        block[2, 1] = (a * r1 - c * r0) / determinant
    below, above, before = slope[HALF - 1], slope[HALF], blocks[HALF - 1]
    # The middle is its own mirror: its slip is twice its motion, its friction acts on it once.
    a = (
        below
        + above
        + 2.0 * rigid[HALF]
        - below * (before[0, 0] + before[0, 1])
        - above * (before[1, 0] + before[1, 1])
    )
    first = (left[HALF] + below * before[2, 0] + above * before[2, 1]) / a
    node_m[HALF] += first
    second = first
    for k in range(HALF - 1, 0, -1):
        block = blocks[k]
        one = block[2, 0] + block[0, 0] * first + block[0, 1] * second
        two = block[2, 1] + block[1, 0] * first + block[1, 1] * second
        node_m[k] += one
        node_m[SLICES - k] += two
        first, second = one, two


@compiled
def _keep(law: Any, state: Any) -> None:
    """Remember what the next step needs."""
    work, before_m = state.work, state.node_m
    for k in range(1, HALF + 1):
        state.bristle_n[k] = work[FORCE, k]
    for i in range(SLICES):
        growth_pa = work[STATIC, i] - state.static_pa[i]
        state.static_pa[i] = work[STATIC, i]
        for b in range(BRANCHES):
            state.branch_pa[b, i] = law.decay[b] * state.branch_pa[b, i] + law.gain[b, i] * growth_pa
        longer_m = (work[NEW, i + 1] - work[NEW, i]) - (before_m[i + 1] - before_m[i])
        state.stretched[i] += max(longer_m, 0.0) / law.slices[LENGTH, i]
    for i in range(SLICES + 1):
        state.speed_m_s[i] = (work[NEW, i] - before_m[i]) / law.scalars[STEP]
        before_m[i] = work[NEW, i]


@compiled
def tendon_history(law: Any, state: Any, extension_m: Any, vacuum_pa: Any, tension_n: Any) -> None:
    """Take one tendon through a history, one entry per time step; `tension_n` is written."""
    for i in range(extension_m.shape[0]):
        tension_n[i] = tendon_tension_n(law, state, extension_m[i], vacuum_pa[i])
