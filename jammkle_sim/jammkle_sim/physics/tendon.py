"""One jamming tendon: constants packed for the compiled law, and its relaxed state.

    F = max(0, (1 + beta p / 50 kPa) Q[F0](x) + sum T_i + a_m p min(x / x_m, 1))    while x > 0, else 0

F0 is the static force of the fibres, Q quasi-linear viscoelasticity with an exact exponential update, T_i the friction
of the jammed fibres with a yield force that grows with the vacuum p, the last term the grip of the membrane.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from jammkle_sim.physics import records

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from jammkle_sim.physics.constants import Fibres, TendonParameters


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


_STIFFENING_REFERENCE_PA = 50e3
"""Vacuum at which `pressure_stiffening` is given: the paper's."""


def tendon_law(
    parameters: TendonParameters, timestep_s: float, free_length_m: float = 0.0, channel: int = 0
) -> NDArray[Any]:
    """Constants of a tendon for one time step, shape (1,) of TENDON_LAW.

    Args:
        parameters: The tendon.
        timestep_s: Time step, s.
        free_length_m: Length at which the fibres are straight and carry nothing, m.
        channel: Index of the pneumatic channel that evacuates it.

    """
    law = np.zeros(1, dtype=records.TENDON_LAW)
    record = law[0]
    times_s = np.array([*parameters.relaxation_times_s, parameters.creep_time_s])
    decay = np.exp(-timestep_s / times_s)
    step_m = parameters.break_extension_m / (records.TABLE_POINTS - 2)
    record["table_step_m"] = step_m
    record["static_force_n"] = force_table_n(parameters.fibres, step_m, records.TABLE_POINTS)
    record["decay"] = decay
    record["gain"] = (
        np.array([*parameters.relaxation_gains, parameters.creep_gain]) * times_s / timestep_s * (1.0 - decay)
    )
    record["friction_stiffness_n_m"], yields_n_per_pa = slip_elements(
        np.array(parameters.friction_stiffness_n_m),
        np.array(parameters.friction_yield_n_per_pa),
        parameters.early_slip,
    )
    record["friction_yield_n_per_pa"] = yields_n_per_pa * parameters.friction_scale
    record["friction_onset_pa"] = parameters.friction_onset_pa
    record["stiffening_per_pa"] = parameters.pressure_stiffening / _STIFFENING_REFERENCE_PA
    record["grip_n_per_pa"] = parameters.grip_n_per_pa
    record["grip_saturation_m"] = parameters.grip_saturation_m
    record["softening_travel_m"] = 1.0
    record["break_extension_m"] = parameters.break_extension_m
    record["free_length_m"] = free_length_m
    record["channel"] = channel
    return law


def slip_elements(
    stiffness_n_m: NDArray[np.float64], yield_n_per_pa: NDArray[np.float64], early_slip: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return elastic-Coulomb elements whose contacts slide one after the other, to a share.

    Two elements hold all of a pull until the first slides. Where friction along a contact is overcome from its end on,
    the force grows with the root of the extension from the start (shear lag with a constant friction: Cox 1952, Br. J.
    Appl. Phys. 3:72; Kelly and Tyson 1965, J. Mech. Phys. Solids 13:329). Four elements follow that root by chords; all
    slide at the same extension, with the same force, as the two do (Iwan 1966, J. Appl. Mech. 33:893).

    Args:
        stiffness_n_m: Of two elements, the first to slide first, N/m.
        yield_n_per_pa: Force at which each slides, per vacuum, N/Pa.
        early_slip: Share of the root; the rest is as the two elements have it.

    Returns:
        Stiffness, N/m, and yield force per vacuum, N/Pa, shape (4,), the first to slide first.

    """
    first, last = yield_n_per_pa / stiffness_n_m
    if last <= 0.0:  # nothing rubs
        return np.array([*stiffness_n_m, *stiffness_n_m]), np.zeros(4)
    slides = np.array([last / 36.0, last / 9.0, first, last])
    slope = np.diff(yield_n_per_pa.sum() * np.sqrt(slides / last), prepend=0.0) / np.diff(slides, prepend=0.0)
    stiffness = early_slip * -np.diff(slope, append=0.0)
    stiffness[2:] += (1.0 - early_slip) * stiffness_n_m
    return np.maximum(stiffness, _LEAST_STIFFNESS_N_M), stiffness * slides


_LEAST_STIFFNESS_N_M = 1e-6
"""Of an element that holds nothing, N/m: it follows, and the law divides by it."""


def relaxed_state(law: NDArray[Any], extension_m: float) -> NDArray[Any]:
    """State, shape (1,) of TENDON_STATE, of a tendon held at an extension, without vacuum, until it has relaxed.

    Args:
        law: Its constants, shape (1,) of TENDON_LAW.
        extension_m: Length beyond the free length as drawn, m.

    """
    state = np.zeros(1, dtype=records.TENDON_STATE)
    beyond_m = extension_m + float(law["shorter_m"][0])
    stretched_m = max(beyond_m, 0.0)
    places_m = np.arange(records.TABLE_POINTS) * law["table_step_m"][0]
    state["extension_m"] = extension_m
    state["static_n"] = np.interp(stretched_m, places_m, law["static_force_n"][0])
    state["tension_n"] = state["static_n"]
    state["slider_m"] = stretched_m
    state["stretched_m"] = stretched_m
    return state
