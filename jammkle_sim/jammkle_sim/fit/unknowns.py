"""What the fit may choose, where it starts, and what it holds fixed and why."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from jammkle_sim.fit.reference import with_friction
from jammkle_sim.physics.constants import TENDON_SETS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from jammkle_sim.physics.constants import TendonParameters


@dataclass(frozen=True)
class Unknown:
    """One constant that the fit chooses."""

    name: str
    """Field of TendonParameters or of its Fibres; `[i]` for an entry of a tuple."""
    unit: str
    start: float
    """Where the fit starts; it must not matter."""
    fitted_to: str
    """The measurements that decide it."""


_REFERENCE = "the reference model on load and return at -10 to -50 kPa"

UNKNOWNS = (
    Unknown("c1_pa", "Pa", 0.1e6, "rows a30_atm and membrane_atm"),
    Unknown("c3_pa", "Pa", 0.03e6, "rows a30_atm and membrane_atm"),
    Unknown("modulus_pa", "Pa", 5.0e6, "row a85_atm"),
    Unknown("pressure_stiffening", "1", 0.1, "rows a30_vac50 and a85_vac50"),
    Unknown("grip_n_per_pa", "N/Pa", 3.0e-5, "rows a30_vac50 and a85_vac50"),
    Unknown("friction_onset_pa", "Pa", 8.0e3, "rows multi_vac10, multi_vac30 and multi_vac50"),
    Unknown("contact_share", "1", 0.7, "rows multi_vac10, multi_vac30 and multi_vac50, by way of the reference model"),
    Unknown("friction_stiffness_n_m[0]", "N/m", 1000.0, _REFERENCE),
    Unknown("friction_stiffness_n_m[1]", "N/m", 500.0, _REFERENCE),
    Unknown("friction_yield_n_per_pa[0]", "N/Pa", 0.3e-3, f"{_REFERENCE}, and the jammed rows"),
    Unknown("friction_yield_n_per_pa[1]", "N/Pa", 0.3e-3, f"{_REFERENCE}, and the jammed rows"),
)
"""Eleven numbers against eight rows and the four cycles of the reference."""

HELD_FIXED = {
    "c2_pa": "the paper's: rows at one extension decide three elastic constants, not four",
    "soft_length_m": "geometry",
    "stiff_length_m": "geometry",
    "area_m2": "geometry",
    "relaxation_gains": "the tensile rows have one speed and say nothing on rate; taken over from an earlier "
    "fit to the jammed and unjammed rows of the drop test in another pose (38 deg, toe at 60 mm), not refitted",
    "relaxation_times_s": "one per decade; gains and times cannot both be told from two peaks",
    "friction_scale": "only its product with the yield forces matters",
    "grip_saturation_m": "any value well below 20 mm gives the same peaks",
    "break_extension_m": "the paper's",
}
"""Every other constant of the tendon, and why the fit leaves it alone."""

_STIFFNESS_AND_YIELD = slice(7, 11)


def start_values() -> NDArray[np.float64]:
    """Start of the fit, one value per unknown, SI."""
    return np.array([unknown.start for unknown in UNKNOWNS])


def values_of(parameters: TendonParameters) -> NDArray[np.float64]:
    """Read the unknowns of a tendon, SI."""
    fibres = parameters.fibres
    return np.array(
        [
            fibres.c1_pa,
            fibres.c3_pa,
            fibres.modulus_pa,
            parameters.pressure_stiffening,
            parameters.grip_n_per_pa,
            parameters.friction_onset_pa,
            parameters.contact_share,
            *parameters.friction_stiffness_n_m,
            *parameters.friction_yield_n_per_pa,
        ]
    )


def with_values(values: NDArray[np.float64]) -> TendonParameters:
    """Make a tendon of given unknowns, SI; what is held fixed is as in the set `fitted`."""
    c1_pa, c3_pa, modulus_pa, stiffening, grip_n_per_pa, onset_pa, share = (float(value) for value in values[:7])
    base = TENDON_SETS["fitted"]
    return with_friction(
        dataclasses.replace(
            base,
            fibres=dataclasses.replace(base.fibres, c1_pa=c1_pa, c3_pa=c3_pa, modulus_pa=modulus_pa),
            pressure_stiffening=stiffening,
            grip_n_per_pa=grip_n_per_pa,
            friction_onset_pa=onset_pa,
            contact_share=share,
        ),
        values[_STIFFNESS_AND_YIELD],
    )
