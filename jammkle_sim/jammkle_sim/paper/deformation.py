"""Where along a jammed and an unjammed tendon the stretch sits, by the reference model with its 18 fibres."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from jammkle_sim.fit.reference import REFERENCE_OPTIONS, contact_pressure_pa, fibres_at_rate
from jammkle_sim.fit.rows import EXTENSION_M
from jammkle_sim.physics.shear_lag import ShearLagTendon

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from jammkle_sim.physics.constants import TendonParameters

_STEPS = 20


@dataclass(frozen=True)
class Deformation:
    """Strain of a tendon at 20 mm."""

    vacuum_pa: float
    place_mm: NDArray[np.float64]
    """Middle of each element from the lower end plate, undeformed, shape (n,)."""
    strain: NDArray[np.float64]
    """Mean strain of all fibres in each element, shape (n,)."""
    soft_strain: NDArray[np.float64]
    """Mean strain of the fibres that are soft there, shape (n,); NaN where none is."""
    stiff_strain: NDArray[np.float64]
    """As above, of the stiff ones."""
    soft_share: float
    """Share of the extension that the soft sections take, mean over the fibres."""


def deformation(parameters: TendonParameters, vacuum_pa: float) -> Deformation:
    """Stretch a fresh reference tendon to 20 mm at constant vacuum and look where its strain is."""
    tendon = ShearLagTendon(fibres_at_rate(parameters), REFERENCE_OPTIONS)
    pulled_m = np.linspace(0.0, EXTENSION_M, _STEPS + 1)
    tendon.follow(pulled_m, np.full(len(pulled_m), contact_pressure_pa(parameters, vacuum_pa)))
    strain, soft, length_m = tendon.strain, tendon.soft, tendon.element_m
    end_m = np.cumsum(length_m)
    stretch_m = strain * length_m[:, None]
    return Deformation(
        vacuum_pa,
        (end_m - length_m / 2.0) * 1e3,
        strain.mean(axis=1),
        _mean_where(strain, soft),
        _mean_where(strain, ~soft),
        float(stretch_m[soft].sum() / stretch_m.sum()),
    )


def _mean_where(strain: NDArray[np.float64], chosen: NDArray[np.bool_]) -> NDArray[np.float64]:
    count = chosen.sum(axis=1)
    total = np.where(chosen, strain, 0.0).sum(axis=1)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)
