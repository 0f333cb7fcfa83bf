"""The reference tendon: 18 fibres side by side, each with its own displacement along its length, rubbing on each other.

Slower by orders of magnitude than the law of `jammkle_sim.physics.kernels`, which it is there to check. Every fibre is
a bar (Yeoh where it is soft, linear where it is stiff), every second one mirrored. Neighbours press on each other with
a line force `p d / sqrt(3)` (hexagonal packing) and hold each other by Coulomb friction up to that force times the
coefficient of their materials; below it the contact gives by elastic shear. As the pressure is given, each step is the
minimum of a convex energy, so it has one solution at every pressure; a Newton method with a line search finds it. What
slid is remembered, so loading and return differ. Without relaxation and without the membrane.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import solveh_banded  # type: ignore[import-untyped]  # carries no types

from jammkle_sim.physics.constants import FIBRE_COUNT, FIBRE_DIAMETER_M
from jammkle_sim.physics.tendon import yeoh_nominal_stress_pa

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from jammkle_sim.physics.constants import Fibres

_RINGS = (1, 2)
_TOLERANCE_N = 1e-8
"""Force out of balance at a node that counts as solved."""
_LARGEST_ITERATIONS = 200
_HALVINGS = 40
_FLAT = 0.5
"""Share of its first slope at which the energy counts as level along a step."""
_SMALLEST_STRETCH = 0.05
"""Below it a step is too long: no fibre is squeezed to nothing."""


class NoConvergenceError(ArithmeticError):
    """A step of the reference tendon was not solved."""


@dataclass(frozen=True)
class Friction:
    """Coefficients of friction between fibres."""

    soft_soft: float = 0.0
    """Shore A-30 on Shore A-30. The paper prints 0.74; 0 where only the overlap of the stiff sections is to rub."""
    soft_stiff: float = 0.0
    """Shore A-30 on Shore A-85. The paper prints 0.75; 0 as above."""
    stiff_stiff: float = 0.99
    """Shore A-85 on Shore A-85. Paper."""


PRINTED_FRICTION = Friction(soft_soft=0.74, soft_stiff=0.75, stiff_stiff=0.99)
"""All three coefficients of the paper."""


@dataclass(frozen=True)
class ShearLagOptions:
    """How the reference tendon is meshed and how its contacts give."""

    friction: Friction = Friction()
    """Coefficients of friction. Paper."""
    element_m: float = 0.002
    """Largest length of an element, m. Chosen: halving it changes the force by less than 0.03 N at -50 kPa."""
    contact_shear_pa: float = 1.6e6
    """Shear stiffness of a contact per length and slip, N/m per m. Assumed: the shear modulus of Shore A-85, a third of
    its fitted modulus; at 50 kPa a contact gives 36 um before it slides. Four times as stiff changes the force by less
    than 0.04 N."""


@dataclass(frozen=True)
class Packing:
    """Which fibres lie mirrored, and which touch."""

    mirrored: NDArray[np.bool_]
    """Shape (18,)."""
    contacts: NDArray[np.intp]
    """Pairs of fibres that touch, shape (36, 2)."""


def hexagonal_packing() -> Packing:
    """Two rings of a hexagonal lattice without its centre, every second fibre of each ring mirrored.

    Read from the paper's "hexagonal tiling" and "every second fibre is mirrored": 36 contacts, 27 of them between a
    mirrored and an unmirrored fibre.
    """
    places = []
    mirrored = []
    for ring in _RINGS:
        for corner in range(6):
            start = ring * np.exp(1j * math.pi / 3.0 * corner)
            side = np.exp(1j * math.pi / 3.0 * (corner + 2))
            for step in range(ring):
                mirrored.append((corner * ring + step) % 2 == 1)
                places.append(start + step * side)
    place = np.array(places)
    distance = np.abs(place[:, None] - place[None, :])
    contacts = np.argwhere(np.triu(np.abs(distance - 1.0) < 0.01))  # noqa: PLR2004  # a hundredth of a diameter
    return Packing(mirrored=np.array(mirrored), contacts=contacts)


def line_force_n_m(pressure_pa: float) -> float:
    """Force per length with which neighbouring fibres press on each other, N/m: `p d / sqrt(3)`."""
    return pressure_pa * FIBRE_DIAMETER_M / math.sqrt(3.0)


class ShearLagTendon:
    """A reference tendon between two clamps, moved as one likes."""

    def __init__(self, fibres: Fibres, options: ShearLagOptions | None = None) -> None:
        """Make a relaxed tendon at its free length.

        Args:
            fibres: Materials and lengths; friction depends on pressure alone.
            options: Coefficients, mesh and compliance of the contacts.

        """
        options = options or ShearLagOptions()
        packing = hexagonal_packing()
        length_m = fibres.soft_length_m + fibres.stiff_length_m
        node_m = _mesh(sorted({0.0, fibres.soft_length_m, fibres.stiff_length_m, length_m}), options.element_m)
        middle_m = (node_m[1:] + node_m[:-1]) / 2.0
        from_soft_end_m = np.where(packing.mirrored[None, :], length_m - middle_m[:, None], middle_m[:, None])
        self._fibres = fibres
        self._area_m2 = fibres.area_m2 / FIBRE_COUNT
        self._place = node_m / length_m
        self._element_m = np.diff(node_m)[:, None]
        self._soft = from_soft_end_m < fibres.soft_length_m
        self._first, self._second = packing.contacts.T
        softs = self._soft[:, self._first].astype(int) + self._soft[:, self._second]
        ends = np.zeros((len(packing.contacts), FIBRE_COUNT))
        ends[np.arange(len(ends)), self._first] = 1.0
        ends[np.arange(len(ends)), self._second] = -1.0
        self._ends = ends
        rubbing = np.array([options.friction.stiff_stiff, options.friction.soft_stiff, options.friction.soft_soft])
        # What an element rubs is shared by the two nodes at its ends.
        self._rub_m = _share(rubbing[softs] * self._element_m)
        self._shear_n_m = options.contact_shear_pa * _share(self._element_m * np.ones_like(self._rub_m[:1]))
        self._displacement_m = np.zeros((len(node_m), FIBRE_COUNT))
        self._slid_m = np.zeros_like(self._rub_m)
        self._last_change_m = np.zeros_like(self._displacement_m)
        self._last_growth_m = 0.0

    @property
    def element_m(self) -> NDArray[np.float64]:
        """Undeformed length of each element along the tendon, shape (elements,), m."""
        return self._element_m[:, 0]

    @property
    def soft(self) -> NDArray[np.bool_]:
        """True where a fibre is of the soft material, shape (elements, fibres)."""
        return self._soft

    @property
    def strain(self) -> NDArray[np.float64]:
        """Strain as the latest entry of the history left it, shape (elements, fibres)."""
        return self._stretch(self._displacement_m) - 1.0

    def follow(self, extension_m: NDArray[np.float64], pressure_pa: NDArray[np.float64]) -> NDArray[np.float64]:
        """Go through a history and return the tension at each entry; time does not matter.

        Args:
            extension_m: Length beyond the free length, shape (n,), m; below 0 the tendon is slack.
            pressure_pa: Pressure that presses the fibres together, shape (n,), Pa, 0 or more.

        Returns:
            Tension, shape (n,), N, never negative.

        Raises:
            NoConvergenceError: a step was not solved; the message names it.

        """
        return np.array([self._step(float(x), float(p)) for x, p in zip(extension_m, pressure_pa, strict=True)])

    def _step(self, extension_m: float, pressure_pa: float) -> float:
        yield_n = self._rub_m * line_force_n_m(pressure_pa)
        stretched_m = max(extension_m, 0.0)
        growth_m = stretched_m - self._displacement_m[-1, 0]
        if growth_m * self._last_growth_m > 0.0:  # goes on as before: so will most of what slides
            u = self._displacement_m + self._last_change_m * (growth_m / self._last_growth_m)
        else:
            u = self._displacement_m + self._place[:, None] * growth_m
        for _ in range(_LARGEST_ITERATIONS):
            gradient_n = self._gradient_n(u, yield_n)
            if np.abs(gradient_n).max() < _TOLERANCE_N:
                break
            change = np.zeros_like(u)
            change[1:-1] = -solveh_banded(
                self._hessian_n_m(u, yield_n), gradient_n.ravel(), lower=True, check_finite=False
            ).reshape(gradient_n.shape)
            u = self._along(u, change, yield_n)
        else:
            msg = (
                f"the reference tendon at {extension_m * 1e3:.2f} mm and {pressure_pa:.0f} Pa was not solved in "
                f"{_LARGEST_ITERATIONS} iterations, {np.abs(gradient_n).max():.1e} N are left; take smaller steps"
            )
            raise NoConvergenceError(msg)
        self._last_change_m, self._last_growth_m = u - self._displacement_m, growth_m
        self._displacement_m = u
        slip_m = u[:, self._first] - u[:, self._second]
        held_n = np.clip(self._shear_n_m * (slip_m - self._slid_m), -yield_n, yield_n)
        self._slid_m = slip_m - held_n / self._shear_n_m
        return max(float(self._area_m2 * self._stress_pa(u)[0].sum()), 0.0)

    def _along(
        self, u: NDArray[np.float64], change: NDArray[np.float64], yield_n: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Go along a Newton step as far as the energy falls.

        The energy is convex, so its slope along the step only grows, and halving an interval finds where it is level.
        """
        slope_j = self._slope_j(u, change, yield_n)
        low, high = 0.0, 1.0
        share = 1.0
        for _ in range(_HALVINGS):
            here_j = self._slope_j(u + share * change, change, yield_n)
            if here_j > -_FLAT * slope_j:
                high = share
            elif share < 1.0 and here_j < _FLAT * slope_j:
                low = share
            else:
                break
            share = (low + high) / 2.0
        return u + share * change

    def _slope_j(self, u: NDArray[np.float64], change: NDArray[np.float64], yield_n: NDArray[np.float64]) -> float:
        """How fast the energy grows along a change; infinite where a fibre is squeezed to nothing."""
        if self._stretch(u).min() < _SMALLEST_STRETCH:
            return math.inf
        return float((self._gradient_n(u, yield_n) * change[1:-1]).sum())

    def _stretch(self, u: NDArray[np.float64]) -> NDArray[np.float64]:
        return 1.0 + np.diff(u, axis=0) / self._element_m

    def _stress_pa(self, u: NDArray[np.float64]) -> NDArray[np.float64]:
        fibres, stretch = self._fibres, self._stretch(u)
        soft_pa = yeoh_nominal_stress_pa(stretch, fibres.c1_pa, fibres.c2_pa, fibres.c3_pa)
        return np.where(self._soft, soft_pa, fibres.modulus_pa * (stretch - 1.0))

    def _gradient_n(self, u: NDArray[np.float64], yield_n: NDArray[np.float64]) -> NDArray[np.float64]:
        """Force out of balance at the inner nodes: the gradient of the energy."""
        bar_n = self._area_m2 * self._stress_pa(u)
        give_n = self._shear_n_m * (u[:, self._first] - u[:, self._second] - self._slid_m)
        balance_n: NDArray[np.float64] = bar_n[:-1] - bar_n[1:] + np.clip(give_n, -yield_n, yield_n)[1:-1] @ self._ends
        return balance_n

    def _hessian_n_m(self, u: NDArray[np.float64], yield_n: NDArray[np.float64]) -> NDArray[np.float64]:
        """Hessian of the energy at the inner nodes as lower bands; node by node, fibre by fibre."""
        fibres, stretch = self._fibres, self._stretch(u)
        soft_pa = yeoh_tangent_pa(stretch, fibres.c1_pa, fibres.c2_pa, fibres.c3_pa)
        bar_n_m = self._area_m2 / self._element_m * np.where(self._soft, soft_pa, fibres.modulus_pa)
        give_n = self._shear_n_m * (u[:, self._first] - u[:, self._second] - self._slid_m)
        held_n_m = np.where(np.abs(give_n) < yield_n, self._shear_n_m, 0.0)[1:-1]
        nodes = np.arange(len(held_n_m))[:, None]
        bands = np.zeros((FIBRE_COUNT + 1, len(held_n_m), FIBRE_COUNT))
        bands[0] = bar_n_m[:-1] + bar_n_m[1:] + held_n_m @ np.abs(self._ends)
        bands[self._second - self._first, nodes, self._first] = -held_n_m
        bands[FIBRE_COUNT, :-1] = -bar_n_m[1:-1]
        return bands.reshape(FIBRE_COUNT + 1, -1)


def yeoh_tangent_pa(stretch: NDArray[np.float64], c1_pa: float, c2_pa: float, c3_pa: float) -> NDArray[np.float64]:
    """Slope of `yeoh_nominal_stress_pa` over the stretch, Pa; same arguments."""
    invariant = stretch**2 + 2.0 / stretch - 3.0
    strain = stretch - stretch**-2
    modulus = c1_pa + 2.0 * c2_pa * invariant + 3.0 * c3_pa * invariant**2
    return 2.0 * (1.0 + 2.0 * stretch**-3) * modulus + 8.0 * strain**2 * (c2_pa + 3.0 * c3_pa * invariant)


def _mesh(edges_m: list[float], element_m: float) -> NDArray[np.float64]:
    """Nodes from the first edge to the last, with one on every edge and none further apart than an element."""
    parts = [
        np.linspace(low, high, max(1, math.ceil((high - low) / element_m - 1e-9)), endpoint=False)
        for low, high in itertools.pairwise(edges_m)
    ]
    return np.concatenate([*parts, [edges_m[-1]]])


def _share(per_element: NDArray[np.float64]) -> NDArray[np.float64]:
    """Halve what belongs to each element between the nodes at its ends."""
    per_node = np.zeros((len(per_element) + 1, *per_element.shape[1:]))
    per_node[:-1] += per_element / 2.0
    per_node[1:] += per_element / 2.0
    return per_node
