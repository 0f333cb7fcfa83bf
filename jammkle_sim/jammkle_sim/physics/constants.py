"""Constants of the tendon, and the named sets of them. Every number has its unit and where it comes from.

"Paper" is the Jammkle paper (Brett et al.). "Fitted" means chosen so that the eight rows of its tensile table and its
drop test come out; "assumed" means that nothing was found to say otherwise.
"""

from __future__ import annotations

import dataclasses
import enum
from dataclasses import dataclass

from jammkle_sim.physics.materials.elastic import bundle_area_m2

GRAVITY_M_S2 = 9.81
"""Standard gravity, rounded as the paper's limits are."""

AMBIENT_PA = 101_325.0
"""Standard atmosphere (ISO 2533)."""


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

    c1_pa: float = 0.1028e6
    """First Yeoh constant of Shore A-30, long-term. Fitted; the paper prints 0.012 MPa."""
    c2_pa: float = 1.0e-4 * 1e6
    """Second Yeoh constant. Paper."""
    c3_pa: float = 0.0255e6
    """Third Yeoh constant, long-term. Fitted; the paper prints 0.0062 MPa."""
    modulus_pa: float = 4.764e6
    """Young's modulus of Shore A-85, long-term. Fitted; the paper prints 7.34 MPa."""
    soft_length_m: float = 0.030
    """Free length of the soft section. Paper; 0 for a bundle of Shore A-85 alone."""
    stiff_length_m: float = 0.050
    """Free length of the stiff section between the end plates. The paper's fibre is 80 mm and its sections 30 and
    55 mm: read as 5 mm of the stiff one inside the end plate."""
    area_m2: float = bundle_area_m2(18, 0.002)
    """Cross-section of 18 fibres of 2 mm. Paper."""


@dataclass(frozen=True)
class TendonParameters:
    """One tendon: elasticity, relaxation, jamming friction, grip of the membrane, break."""

    fibres: Fibres = dataclasses.field(default_factory=Fibres)
    """Elasticity of the bundle."""
    relaxation_gains: tuple[float, float, float, float] = (1.291, 0.861, 0.538, 0.377)
    """Gain of each Maxwell branch over the long-term force. Fitted; Agilus30's loss factor of 1.3 to 1.4 at 1 to 10 Hz
    and 20 degC asks for sums of this size."""
    relaxation_times_s: tuple[float, float, float, float] = (0.003, 0.03, 0.3, 3.0)
    """Time constant of each branch. Assumed: one per decade over what the tests span."""
    friction_stiffness_n_m: tuple[float, float] = (941.0, 499.0)
    """Stiffness of each elastic-Coulomb (Jenkin) element of the jamming friction. Fitted."""
    friction_yield_n_per_pa: tuple[float, float] = (0.339e-3, 0.404e-3)
    """Yield force of each element per vacuum beyond the onset, before `friction_scale`. Fitted."""
    friction_scale: float = 0.9
    """Factor on all yield forces. Fitted."""
    friction_onset_pa: float = 8.52e3
    """Vacuum below which the fibres do not touch with force. Fitted: 0 to -10 kPa adds little in the paper."""
    pressure_stiffening: float = 0.115
    """Relative gain of the viscoelastic force at 50 kPa of vacuum. Fitted to the single-material tendons."""
    grip_n_per_pa: float = 2.92e-5
    """Pull of the membrane that grips the fibres, per vacuum. Fitted to the jump of the single-material tendons, which
    fibre friction cannot explain, as identical fibres do not slide."""
    grip_saturation_m: float = 0.002
    """Extension at which the grip is fully built up. Fitted."""
    break_extension_m: float = 0.055
    """Extension at which the tendon tears. Paper."""


TENDON_SETS: dict[str, TendonParameters] = {
    "fitted": TendonParameters(),
    "as_printed": TendonParameters(
        fibres=Fibres(c1_pa=0.012e6, c2_pa=1.0e2, c3_pa=0.0062e6, modulus_pa=7.34e6),
        relaxation_gains=(0.0, 0.0, 0.0, 0.0),
        # The paper's three coefficients of friction, hexagonal packing (line force p d / sqrt(3), 27 contacts between
        # mirrored and unmirrored fibres) and both printed materials in a distributed shear-lag model, stretched to
        # 20 mm at 20 to 50 kPa; these two elements reproduce its friction within 0.53 N rms.
        friction_stiffness_n_m=(1844.0, 878.0),
        friction_yield_n_per_pa=(0.508e-3, 0.690e-3),
        friction_scale=1.0,
        friction_onset_pa=0.0,
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
    parameters = TENDON_SETS[name]
    if fibre is Fibre.MULTI_MATERIAL:
        return parameters
    fibres = parameters.fibres
    length_m = fibres.soft_length_m + fibres.stiff_length_m
    soft_length_m = length_m if fibre is Fibre.SHORE_A30 else 0.0
    single = dataclasses.replace(fibres, soft_length_m=soft_length_m, stiff_length_m=length_m - soft_length_m)
    # Identical fibres stretch alike and do not slide on each other: no jamming friction.
    return dataclasses.replace(parameters, fibres=single, friction_scale=0.0)
