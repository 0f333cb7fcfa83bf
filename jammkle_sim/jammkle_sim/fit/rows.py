"""The tensile rows of the paper, and what the tendon's law says to each.

The test: 0 to 20 mm at 5 mm/s, five repeats, mean peak force and standard error of the mean.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from jammkle_sim.paper_tables import paper_row
from jammkle_sim.physics.constants import Fibre, of_fibre
from jammkle_sim.physics.tendon import Tendon

if TYPE_CHECKING:
    from jammkle_sim.physics.constants import TendonParameters

SPEED_M_S = 0.005
"""Speed of the tensile test, m/s. Paper."""
EXTENSION_M = 0.020
"""Extension of the tensile test, m. Paper."""
_TIMESTEP_S = 0.004
"""Exact for a ramp at any time step; short enough not to miss the end of it."""


@dataclass(frozen=True)
class TensileRow:
    """One row of the paper's table of characterisation tests, and the tendon it was measured on."""

    identifier: str
    fibre: Fibre
    vacuum_pa: float

    @property
    def mean_n(self) -> float:
        """Mean of the peak forces, N."""
        return paper_row(self.identifier).mean

    @property
    def standard_error_n(self) -> float:
        """Standard error of the mean, N."""
        return paper_row(self.identifier).standard_error


_MULTI, _A30, _A85 = Fibre.MULTI_MATERIAL, Fibre.SHORE_A30, Fibre.SHORE_A85

NO_MEMBRANE_ROW = TensileRow("no_membrane_atm", _MULTI, 0.0)
"""The bundle without its membrane: not fitted, as the law has no membrane where there is no vacuum."""

TENSILE_ROWS = (
    TensileRow("membrane_atm", _MULTI, 0.0),
    TensileRow("a30_atm", _A30, 0.0),
    TensileRow("a30_vac50", _A30, 50e3),
    TensileRow("a85_atm", _A85, 0.0),
    TensileRow("a85_vac50", _A85, 50e3),
    TensileRow("multi_vac10", _MULTI, 10e3),
    TensileRow("multi_vac30", _MULTI, 30e3),
    TensileRow("multi_vac50", _MULTI, 50e3),
)
"""The eight rows that are fitted."""


def peak_force_n(
    parameters: TendonParameters,
    fibre: Fibre,
    vacuum_pa: float,
    extension_m: float = EXTENSION_M,
    speed_m_s: float = SPEED_M_S,
) -> float:
    """Largest tension of a fresh tendon that is pulled once at constant speed and vacuum, N.

    Args:
        parameters: Constants of the multi-material tendon.
        fibre: What the fibres are of.
        vacuum_pa: Vacuum, Pa.
        extension_m: How far, m; from the break on the tendon carries nothing.
        speed_m_s: How fast, m/s.

    """
    steps = round(extension_m / SPEED_M_S / _TIMESTEP_S)
    tendon = Tendon(of_fibre(parameters, fibre), extension_m / speed_m_s / steps)
    pulled_m = np.linspace(0.0, extension_m, steps + 1)[1:]
    return float(tendon.follow(pulled_m, np.full(steps, vacuum_pa)).max())
