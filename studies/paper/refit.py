"""The fit that made the set `fitted`, to be done again by anybody who doubts it.

Minimised is the sum of squares of two kinds of residual: each of the eight tensile rows, in its standard errors, and
the force of the fast law minus that of the reference model over load and return at four vacuums, their root mean
square in units of REFERENCE_ERROR_N. The rows weigh far more: they are measurements, the reference is a model.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import least_squares  # type: ignore[import-untyped]  # carries no types

from jammkle_sim.physics.constants import TENDON_SETS
from studies.paper.reference import (
    FITTED_ROWS,
    VACUUMS_PA,
    Comparison,
    compare,
    cycle_m,
    fast_tension_n,
    reference_tension_n,
    rms_n,
    row_peak_n,
    with_friction,
)
from studies.paper.shear_lag import PRINTED_FRICTION, ShearLagOptions

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from jammkle_sim.physics.constants import TendonParameters
    from studies.paper.tables import PaperRow


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
    "creep_gain": "no row lasts for a minute",
    "creep_time_s": "as creep_gain",
    "early_slip": "0 in the reference model, whose curves the friction is fitted to",
    "friction_scale": "only its product with the yield forces matters",
    "grip_saturation_m": "any value well below 20 mm gives the same peaks",
    "break_extension_m": "the paper's",
}
"""Every other constant of the tendon, and why the fit leaves it alone."""

_STIFFNESS_AND_YIELD = slice(7, 11)


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


REFERENCE_ERROR_N = 0.5
"""Root mean square by which the fast law may differ from the reference at the cost of one standard error of a row, N.
Assumed: about the standard error of the jammed rows."""
TOLERANCE = 0.005
"""A refit from the start values gives the committed constants within this share of each."""
_REFERENCE_OPTIONS = ShearLagOptions(friction=PRINTED_FRICTION, element_m=0.0034)
"""Coarser than elsewhere, for speed: within 0.1 N of the finest mesh."""
_DIFFERENCE = 1e-4
_OF_THE_REFERENCE = 7
"""The first unknowns change the reference; those after them only the fast law."""
_EXPECTED_EVALUATIONS = 100
_ALMOST = 0.99


@dataclass(frozen=True)
class ConstantResult:
    """One constant as fitted and as committed."""

    unknown: Unknown
    fitted: float
    committed: float

    @property
    def deviation(self) -> float:
        """Fitted over committed, minus 1."""
        return self.fitted / self.committed - 1.0


@dataclass(frozen=True)
class RowResult:
    """One row of the paper as the fitted constants give it."""

    row: PaperRow
    simulated_n: float

    @property
    def residual(self) -> float:
        """Simulation minus paper, in standard errors."""
        return (self.simulated_n - self.row.mean) / self.row.standard_error


@dataclass(frozen=True)
class FitResult:
    """What the fit gave."""

    constants: tuple[ConstantResult, ...]
    rows: tuple[RowResult, ...]
    comparisons: tuple[Comparison, ...]
    """Fast law and reference with the fitted constants."""
    parameters: TendonParameters
    """The fitted tendon."""
    evaluations: int
    """How many sets of constants were tried."""

    @property
    def reference_rms_n(self) -> float:
        """Root mean square of fast law minus reference, N."""
        return rms_n(self.comparisons)

    @property
    def largest_deviation(self) -> float:
        """Largest relative deviation of a constant from the committed one."""
        return max(abs(constant.deviation) for constant in self.constants)

    @property
    def reproduces_committed(self) -> bool:
        """True when every constant is the committed one within TOLERANCE."""
        return self.largest_deviation <= TOLERANCE


class Objective:
    """The residuals of the fit as a function of the unknowns."""

    def __init__(self) -> None:
        """Start with nothing computed."""
        self._known: dict[bytes, list[NDArray[np.float64]]] = {}
        self.evaluations = 0

    def __call__(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Residuals of one set of constants, SI: eight of the rows, then those of the reference."""
        self.evaluations += 1
        parameters = with_values(values)
        rows = [result.residual for result in row_results(parameters)]
        path_m = cycle_m()
        fast_n = np.concatenate([fast_tension_n(parameters, vacuum_pa, path_m) for vacuum_pa in VACUUMS_PA])
        deviation_n = fast_n - np.concatenate(self._reference_n(values, parameters))
        return np.concatenate([rows, deviation_n / (REFERENCE_ERROR_N * np.sqrt(deviation_n.size))])

    def _reference_n(self, values: NDArray[np.float64], parameters: TendonParameters) -> list[NDArray[np.float64]]:
        key = values[:_OF_THE_REFERENCE].tobytes()
        if key not in self._known:
            self._known[key] = [
                reference_tension_n(parameters, vacuum_pa, cycle_m(), _REFERENCE_OPTIONS) for vacuum_pa in VACUUMS_PA
            ]
        return self._known[key]


def row_results(parameters: TendonParameters) -> tuple[RowResult, ...]:
    """Simulate the eight rows."""
    return tuple(RowResult(row, row_peak_n(parameters, row)) for row in FITTED_ROWS)


def refit(on_progress: Callable[[float], None]) -> FitResult:
    """Fit the constants anew, from the start values; some tens of seconds.

    Args:
        on_progress: Called with the share done, 0 to 1, estimated.

    """
    begin = np.array([unknown.start for unknown in UNKNOWNS])
    objective = Objective()

    def residuals(factors: NDArray[np.float64]) -> NDArray[np.float64]:
        on_progress(min(objective.evaluations / _EXPECTED_EVALUATIONS, _ALMOST))
        return objective(factors * begin)

    result = least_squares(residuals, np.ones(len(UNKNOWNS)), bounds=(0.1, 10.0), diff_step=_DIFFERENCE)
    values = result.x * begin
    parameters = with_values(values)
    committed = values_of(TENDON_SETS["fitted"])
    on_progress(1.0)
    return FitResult(
        constants=tuple(
            ConstantResult(unknown, float(fitted), float(was))
            for unknown, fitted, was in zip(UNKNOWNS, values, committed, strict=True)
        ),
        rows=row_results(parameters),
        comparisons=compare(parameters),
        parameters=parameters,
        evaluations=objective.evaluations,
    )
