"""The tensile rows by the tendon's law, and that law beside the reference model, on load and return.

The test: 0 to 20 mm at 5 mm/s, five repeats, mean peak force and standard error of the mean. Law and reference are
compared as rate-independent tendons: the fibres as stiff as they are at the rate of the tensile test, without
relaxation and without the membrane, so that only the friction of the jammed fibres differs.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import least_squares  # type: ignore[import-untyped]  # carries no types

from jammkle_sim.physics import kernels
from jammkle_sim.physics.constants import Fibre, of_fibre
from jammkle_sim.physics.tendon import force_table_n, relaxed_state, tendon_law
from studies.paper.shear_lag import PRINTED_FRICTION, ShearLagOptions, ShearLagTendon
from studies.paper.tables import TENSILE_ROWS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from jammkle_sim.physics.constants import Fibres, TendonParameters
    from studies.paper.tables import PaperRow

SPEED_M_S = 0.005
"""Speed of the tensile test, m/s. Paper."""
EXTENSION_M = 0.020
"""Extension of the tensile test, m. Paper."""
_TIMESTEP_S = 0.004
"""Exact for a ramp at any time step; short enough not to miss the end of it."""


FIBRES = {"multi": Fibre.MULTI_MATERIAL, "a30": Fibre.SHORE_A30, "a85": Fibre.SHORE_A85}
"""What fibres are of, by name of the material."""

NO_MEMBRANE_ROW, *FITTED_ROWS = TENSILE_ROWS
"""The bundle without its membrane, which is not fitted, as the law has no membrane where there is no vacuum; and the
eight rows that are."""


class Tendon:
    """A tendon between two clamps, moved as one likes: what a tensile test does to it."""

    def __init__(self, parameters: TendonParameters, timestep_s: float) -> None:
        """Make a relaxed tendon at its free length.

        Args:
            parameters: The tendon.
            timestep_s: Time between two entries of a history, s.

        """
        self._law = tendon_law(parameters, timestep_s)
        self._state = relaxed_state(self._law, 0.0)

    @property
    def broken(self) -> bool:
        """True for good once it was stretched to its break extension."""
        return bool(self._state["broken"][0] > 0.0)

    def follow(self, extension_m: NDArray[np.float64], vacuum_pa: NDArray[np.float64]) -> NDArray[np.float64]:
        """Go through a history, one entry per time step, and return the tension at each.

        Args:
            extension_m: Length beyond the free length, shape (n,), m.
            vacuum_pa: Pressure below ambient, shape (n,), Pa, 0 or more.

        Returns:
            Tension, shape (n,), N, never negative.

        """
        tension_n = np.zeros(len(extension_m))
        kernels.tendon_history(self._law, self._state, extension_m, vacuum_pa, tension_n)
        return tension_n


def row_peak_n(parameters: TendonParameters, row: PaperRow) -> float:
    """Peak force of a row of the tensile test by the law, N."""
    return peak_force_n(parameters, FIBRES[row.material], row.vacuum_pa)


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


VACUUMS_PA = (10e3, 20e3, 30e3, 50e3)
"""Vacuums at which the two are compared, Pa."""
REFERENCE_OPTIONS = ShearLagOptions(friction=PRINTED_FRICTION)
"""The reference of the comparison: all three coefficients of friction of the paper."""
_HISTORY_STEP_M = 0.001
_ONE_S = 1.0
"""Any time step: nothing depends on it without relaxation."""


@dataclass(frozen=True)
class Comparison:
    """Fast law and reference through one cycle at one vacuum."""

    vacuum_pa: float
    extension_m: NDArray[np.float64]
    """0 to 20 mm and back, shape (n,), m."""
    fast_n: NDArray[np.float64]
    """Tension of the law that runs every step, shape (n,), N."""
    reference_n: NDArray[np.float64]
    """Tension of the reference, shape (n,), N."""

    @property
    def deviation_n(self) -> NDArray[np.float64]:
        """Fast minus reference, shape (n,), N."""
        return self.fast_n - self.reference_n


def cycle_m(step_m: float = _HISTORY_STEP_M) -> NDArray[np.float64]:
    """Extensions of load and return: 0 to 20 mm and back to 0, m."""
    up_m = np.linspace(0.0, EXTENSION_M, round(EXTENSION_M / step_m) + 1)
    return np.concatenate([up_m, up_m[-2::-1]])


def static_force_n(parameters: TendonParameters, extension_m: float) -> float:
    """Long-term static force F0 of the multi-material tendon, N.

    At the break (55 mm) it is 116 N, and 150 N with the fibres as stiff as the tensile test finds them (`rate_ratio`),
    which is also what the same rows give when they are fitted without relaxation. A pull to the break at 5 mm/s reads
    136 N, as the slow branches have relaxed further by then. A long-term force of 150 N could be had only with a second
    Yeoh constant of -0.17 MPa, against the paper's 0.0001 MPa.

    Args:
        parameters: The tendon.
        extension_m: Length beyond the free length, m.

    """
    return float(force_table_n(parameters.fibres, extension_m, 2)[1])


def rate_ratio(parameters: TendonParameters) -> float:
    """How much stiffer than in the long term the unjammed tendon is in the tensile test: force over F0 at 20 mm."""
    return peak_force_n(parameters, Fibre.MULTI_MATERIAL, 0.0) / static_force_n(parameters, EXTENSION_M)


def fibres_at_rate(parameters: TendonParameters) -> Fibres:
    """Fibres as stiff as the tensile test finds them."""
    fibres, ratio = parameters.fibres, rate_ratio(parameters)
    return dataclasses.replace(
        fibres,
        c1_pa=fibres.c1_pa * ratio,
        c2_pa=fibres.c2_pa * ratio,
        c3_pa=fibres.c3_pa * ratio,
        modulus_pa=fibres.modulus_pa * ratio,
    )


def contact_pressure_pa(parameters: TendonParameters, vacuum_pa: float) -> float:
    """Pressure between the fibres at a vacuum, Pa."""
    return parameters.contact_share * max(vacuum_pa - parameters.friction_onset_pa, 0.0)


def reference_tension_n(
    parameters: TendonParameters,
    vacuum_pa: float,
    extension_m: NDArray[np.float64],
    options: ShearLagOptions = REFERENCE_OPTIONS,
) -> NDArray[np.float64]:
    """Take a fresh reference tendon through extensions, shape (n,), m, at constant vacuum; tension, shape (n,), N."""
    tendon = ShearLagTendon(fibres_at_rate(parameters), options)
    return tendon.follow(extension_m, np.full(len(extension_m), contact_pressure_pa(parameters, vacuum_pa)))


def fast_tension_n(
    parameters: TendonParameters, vacuum_pa: float, extension_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Take the fast law, without relaxation and membrane, through the same; tension, shape (n,), N."""
    bare = dataclasses.replace(
        parameters,
        fibres=fibres_at_rate(parameters),
        relaxation_gains=(0.0, 0.0, 0.0, 0.0),
        pressure_stiffening=0.0,
        grip_n_per_pa=0.0,
    )
    return Tendon(bare, _ONE_S).follow(extension_m, np.full(len(extension_m), vacuum_pa))


def compare(
    parameters: TendonParameters,
    vacuums_pa: Sequence[float] = VACUUMS_PA,
    options: ShearLagOptions = REFERENCE_OPTIONS,
) -> tuple[Comparison, ...]:
    """Take both models through 0 to 20 mm and back at each vacuum."""
    path_m = cycle_m()
    return tuple(
        Comparison(
            vacuum_pa,
            path_m,
            fast_tension_n(parameters, vacuum_pa, path_m),
            reference_tension_n(parameters, vacuum_pa, path_m, options),
        )
        for vacuum_pa in vacuums_pa
    )


def rms_n(comparisons: Sequence[Comparison]) -> float:
    """Root mean square of fast minus reference over all entries, N."""
    return float(np.sqrt(np.mean(np.concatenate([comparison.deviation_n for comparison in comparisons]) ** 2)))


def with_fitted_friction(parameters: TendonParameters, elements: int = 2) -> TendonParameters:
    """Choose the elastic-Coulomb elements so that the fast law comes closest to the reference; all else stays.

    Args:
        parameters: The tendon, whose elements are the start of the search.
        elements: 2, or 1 to see what one alone would do.

    """
    path_m = cycle_m()
    reference_n = [reference_tension_n(parameters, vacuum_pa, path_m) for vacuum_pa in VACUUMS_PA]
    start = np.array([*parameters.friction_stiffness_n_m, *parameters.friction_yield_n_per_pa])
    free = np.array([True, elements > 1, True, elements > 1])
    start[2] = start[2:].sum() if elements == 1 else start[2]
    start[3] *= elements > 1

    def chosen(factors: NDArray[np.float64]) -> TendonParameters:
        values = start.copy()
        values[free] *= factors
        return with_friction(parameters, values)

    def deviation_n(factors: NDArray[np.float64]) -> NDArray[np.float64]:
        fast_n = [fast_tension_n(chosen(factors), vacuum_pa, path_m) for vacuum_pa in VACUUMS_PA]
        return np.concatenate(fast_n) - np.concatenate(reference_n)

    result = least_squares(deviation_n, np.ones(free.sum()), bounds=(0.01, 100.0), diff_step=1e-4)
    return chosen(result.x)


def with_friction(parameters: TendonParameters, values: NDArray[np.float64]) -> TendonParameters:
    """Replace the two stiffnesses, N/m, and the two yield forces per vacuum, N/Pa, in this order."""
    stiffness_1, stiffness_2, yield_1, yield_2 = (float(value) for value in values)
    return dataclasses.replace(
        parameters,
        friction_stiffness_n_m=(stiffness_1, stiffness_2),
        friction_yield_n_per_pa=(yield_1, yield_2),
    )
