"""Constants of the tendon, and the named sets of them. Every number has its unit and where it comes from.

"Paper" is the Jammkle paper (Brett et al.). "Fitted" says to what: rows of its tensile table by their names (a30_vac50:
Shore A-30 at -50 kPa), its drop test, or the reference model of every fibre by itself; the study of the paper does it
again. "Assumed" means that nothing was found to say otherwise.
"""

from __future__ import annotations

import dataclasses
import enum
import math
from dataclasses import dataclass

FIBRE_COUNT = 18
"""Fibres of a tendon. Paper."""

FIBRE_DIAMETER_M = 0.002
"""Diameter of a fibre, m. Paper."""


class Fibre(enum.Enum):
    """What the fibres of a tendon are printed of."""

    MULTI_MATERIAL = "multi_material"
    """Shore A-30 in series with Shore A-85: the paper's own tendon."""
    SHORE_A30 = "shore_a30"
    """Soft all along."""
    SHORE_A85 = "shore_a85"
    """Stiff all along."""


@dataclass(frozen=True)
class Fibres:
    """The bundle's elasticity."""

    c1_pa: float = 0.10274e6
    """First Yeoh constant of Shore A-30, long-term, Pa. Fitted to rows a30_atm and membrane_atm; the paper prints
    0.012 MPa."""
    c2_pa: float = 1.0e-4 * 1e6
    """Second Yeoh constant, Pa. Paper."""
    c3_pa: float = 0.02538e6
    """Third Yeoh constant, long-term, Pa. Fitted to rows a30_atm and membrane_atm; the paper prints 0.0062 MPa."""
    modulus_pa: float = 4.747e6
    """Young's modulus of Shore A-85, long-term, Pa. Fitted to row a85_atm; the paper prints 7.34 MPa."""
    soft_length_m: float = 0.030
    """Free length of the soft section, m. Paper; 0 for a bundle of Shore A-85 alone."""
    stiff_length_m: float = 0.050
    """Free length of the stiff section between the end plates, m. Paper, read: its fibre is 80 mm and its sections 30
    and 55 mm, so 5 mm of the stiff one are taken to sit in the end plate."""
    area_m2: float = FIBRE_COUNT * math.pi * FIBRE_DIAMETER_M**2 / 4.0
    """Cross-section of 18 fibres of 2 mm, m^2. Paper."""


@dataclass(frozen=True)
class TendonParameters:
    """One tendon: elasticity, relaxation, jamming friction, grip of the membrane, break."""

    fibres: Fibres = dataclasses.field(default_factory=Fibres)
    """Elasticity of the bundle."""
    relaxation_gains: tuple[float, float, float, float] = (1.291, 0.861, 0.538, 0.377)
    """Gain of each Maxwell branch over the long-term force, 1. Fitted to the jammed and unjammed rows of the drop test,
    but earlier, in another pose (38 degrees, toe at 60 mm) than the drop rig has now; the refit takes them over as they
    are. They give a loss factor of 0.23 to 0.24 at 1 to 10 Hz, where Agilus30 by itself has 1.3 to 1.4 at 20 degC."""
    relaxation_times_s: tuple[float, float, float, float] = (0.003, 0.03, 0.3, 3.0)
    """Time constant of each branch, s. Assumed: one per decade over what the tests span."""
    creep_gain: float = 0.0
    """Gain of a fifth, slow branch over the long-term force, 1. Assumed: 0, as no test of the paper lasts that long."""
    creep_time_s: float = 30.0
    """Its time constant, s. Assumed: a decade beyond the others."""
    friction_stiffness_n_m: tuple[float, float] = (1036.7, 477.1)
    """Stiffness of each elastic-Coulomb (Jenkin) element of the jamming friction, N/m. Fitted to the reference model
    on load and return at -10 to -50 kPa."""
    friction_yield_n_per_pa: tuple[float, float] = (0.31346e-3, 0.31911e-3)
    """Yield force of each element per vacuum beyond the onset, before `friction_scale`, N/Pa. Fitted to the reference
    model, and to rows multi_vac10, multi_vac30 and multi_vac50."""
    early_slip: float = 0.0
    """Share of the friction whose contacts slide one after the other instead of together, 1; 0 to 1. See
    `physics.tendon.slip_elements`. Assumed: 0, as all contacts of the reference model have one coefficient of friction
    for a pair of materials."""
    friction_scale: float = 1.0
    """Factor on all yield forces, 1. Assumed: the tendon as new; 0 for identical fibres, which do not slide."""
    friction_onset_pa: float = 8.000e3
    """Vacuum below which the fibres do not touch with force, Pa. Fitted to rows multi_vac10, multi_vac30 and
    multi_vac50: 0 to -10 kPa adds little in the paper."""
    pressure_stiffening: float = 0.12681
    """Relative gain of the viscoelastic force at 50 kPa of vacuum, 1. Fitted to rows a30_vac50 and a85_vac50."""
    grip_n_per_pa: float = 2.7253e-5
    """Pull of the membrane that grips the fibres, per vacuum, N/Pa. Fitted to rows a30_vac50 and a85_vac50, whose jump
    fibre friction cannot explain, as identical fibres do not slide."""
    grip_saturation_m: float = 0.002
    """Extension at which the grip is fully built up, m. Assumed: anything well below 20 mm gives the same peaks."""
    contact_share: float = 0.6357
    """Share of the vacuum beyond the onset that presses the fibres together in the reference model, 1; the law that
    runs every step has it in its yield forces. Fitted to rows multi_vac10, multi_vac30 and multi_vac50."""
    break_extension_m: float = 0.055
    """Extension at which the tendon tears, m. Paper."""


TENDON_SETS: dict[str, TendonParameters] = {
    "fitted": TendonParameters(),
    "as_printed": TendonParameters(
        fibres=Fibres(c1_pa=0.012e6, c2_pa=1.0e2, c3_pa=0.0062e6, modulus_pa=7.34e6),
        relaxation_gains=(0.0, 0.0, 0.0, 0.0),
        # Fitted to the reference model with the printed materials and the three printed coefficients of friction, on
        # load and return to 20 mm at -10 to -50 kPa: 0.65 N rms.
        friction_stiffness_n_m=(1853.5, 806.9),
        friction_yield_n_per_pa=(0.54915e-3, 0.69990e-3),
        friction_scale=1.0,
        friction_onset_pa=0.0,
        contact_share=1.0,
        pressure_stiffening=0.0,
        grip_n_per_pa=0.0,
    ),
}
"""Named sets: `fitted` reproduces the paper's tensile tests; `as_printed` is the paper's own model, without relaxation
and membrane, which does not: the first gap between simulation and reality that this project shows."""


def tendon_parameters(name: str, fibre: Fibre = Fibre.MULTI_MATERIAL) -> TendonParameters:
    """Constants of a tendon by the name of their set and by what its fibres are of.

    Raises:
        ValueError: there is no such set.

    """
    if name not in TENDON_SETS:
        msg = f"parameter set '{name}' does not exist; known are: {', '.join(TENDON_SETS)}"
        raise ValueError(msg)
    return of_fibre(TENDON_SETS[name], fibre)


def of_fibre(parameters: TendonParameters, fibre: Fibre) -> TendonParameters:
    """Constants of a tendon whose fibres are of something, from those of the multi-material one."""
    if fibre is Fibre.MULTI_MATERIAL:
        return parameters
    fibres = parameters.fibres
    length_m = fibres.soft_length_m + fibres.stiff_length_m
    soft_length_m = length_m if fibre is Fibre.SHORE_A30 else 0.0
    single = dataclasses.replace(fibres, soft_length_m=soft_length_m, stiff_length_m=length_m - soft_length_m)
    # Identical fibres stretch alike and do not slide on each other: no jamming friction.
    return dataclasses.replace(parameters, fibres=single, friction_scale=0.0)
