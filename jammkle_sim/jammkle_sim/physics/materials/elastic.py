"""Static force of the fibre bundle: an incompressible Yeoh section in series with a linear one.

Written with the stretch of the soft section as the running variable, both force and extension are explicit, so the
series needs no solver: the curve is computed once and tabulated over equal steps of extension.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from jammkle_sim.physics.constants import Fibres

_CURVE_POINTS = 4001
"""Points of the curve over stretch; the error of the force is below 1e-5 of its largest value."""


def yeoh_nominal_stress_pa(
    stretch: NDArray[np.float64], c1_pa: float, c2_pa: float, c3_pa: float
) -> NDArray[np.float64]:
    """Nominal (first Piola-Kirchhoff) stress of an incompressible Yeoh solid pulled along one axis.

    `2 (l - l^-2) (C1 + 2 C2 (I1 - 3) + 3 C3 (I1 - 3)^2)` with `I1 = l^2 + 2 / l`.

    Args:
        stretch: Length over free length, any shape, 1 or more.
        c1_pa: First Yeoh constant, Pa.
        c2_pa: Second Yeoh constant, Pa.
        c3_pa: Third Yeoh constant, Pa.

    """
    invariant = stretch**2 + 2.0 / stretch - 3.0
    return 2.0 * (stretch - stretch**-2) * (c1_pa + 2.0 * c2_pa * invariant + 3.0 * c3_pa * invariant**2)


def yeoh_tangent_pa(stretch: NDArray[np.float64], c1_pa: float, c2_pa: float, c3_pa: float) -> NDArray[np.float64]:
    """Slope of `yeoh_nominal_stress_pa` over the stretch, Pa; same arguments."""
    invariant = stretch**2 + 2.0 / stretch - 3.0
    strain = stretch - stretch**-2
    modulus = c1_pa + 2.0 * c2_pa * invariant + 3.0 * c3_pa * invariant**2
    return 2.0 * (1.0 + 2.0 * stretch**-3) * modulus + 8.0 * strain**2 * (c2_pa + 3.0 * c3_pa * invariant)


def force_table_n(fibres: Fibres, extension_step_m: float, points: int) -> NDArray[np.float64]:
    """Long-term static force of the bundle at extensions 0, step, 2 step ...

    Args:
        fibres: Materials and lengths; a section of length 0 is left out.
        extension_step_m: Distance of neighbouring points, m.
        points: How many.

    Returns:
        Force, N, shape (points,), rising from 0.

    """
    extensions = np.arange(points, dtype=np.float64) * extension_step_m
    stiffness_area_n = fibres.modulus_pa * fibres.area_m2
    if fibres.soft_length_m <= 0.0:
        return stiffness_area_n / fibres.stiff_length_m * extensions
    largest_stretch = 1.0 + extensions[-1] / fibres.soft_length_m
    stretch = np.linspace(1.0, largest_stretch, _CURVE_POINTS)
    force = fibres.area_m2 * yeoh_nominal_stress_pa(stretch, fibres.c1_pa, fibres.c2_pa, fibres.c3_pa)
    extension = fibres.soft_length_m * (stretch - 1.0) + force * fibres.stiff_length_m / stiffness_area_n
    return np.interp(extensions, extension, force)
