"""What the paper measured: both tables with numbers, beside the options of our rigs, and its claims on the slip test.

Source of everything here: Brett, Lo Surdo, Hanson, Pinskier, Howard: "Jammkle: Fibre jamming 3D printed multi-material
tendons and their application in a robotic ankle". Forces in N, accelerations in m/s^2. Five repeats everywhere.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

    from jammkle_common.parameters import Value

TENSILE_TEST, DROP_TEST, SLIP_TEST = "tensile_test", "drop_test", "slip_test"
REPEATS = 5
"""Of every test in the paper."""
STANDARD_ERRORS, RELATIVE = 2.0, 0.03
"""A row is reproduced when it is within so many standard errors of the paper's mean, or within this share of it."""
SIMILAR = 0.2
"""Relative difference up to which two peak forces are called similar. Chosen: the paper says no number."""
SIGNIFICANT = 1.5
"""Ratio from which on one dissipates significantly more than the other. Chosen: the paper says no number."""


@dataclass(frozen=True)
class PaperRow:
    """One row of a table: the peak of something over five repeats."""

    identifier: str
    test: str
    title: str
    unit: str
    largest: float
    mean: float
    standard_error: float
    """Of the mean."""
    options: Mapping[str, Value]
    """What differs from the defaults of the rig that stands for the test."""
    clipped: bool = False
    """True where the paper marks that the sensor's limit was reached."""

    @property
    def material(self) -> str:
        """What the tendon of a tensile test was printed of, as the rig has it."""
        return str(self.options.get("material", "multi"))

    @property
    def vacuum_pa(self) -> float:
        """Vacuum of a tensile test."""
        return float(self.options.get("vacuum_pa", 0.0))


@dataclass(frozen=True)
class PaperClaim:
    """Something the paper says of the slip test without printing a number."""

    identifier: str
    text: str


def _tensile(
    identifier: str, title: str, largest: float, mean: float, standard_error: float, **options: Value
) -> PaperRow:
    return PaperRow(identifier, TENSILE_TEST, title, "N", largest, mean, standard_error, options)


def _drop(
    identifier: str, title: str, largest: float, mean: float, standard_error: float, foot: str, *, clipped: bool = False
) -> PaperRow:
    return PaperRow(identifier, DROP_TEST, title, "m/s²", largest, mean, standard_error, {"foot": foot}, clipped)


TENSILE_ROWS = (
    _tensile("no_membrane_atm", "Multi-material without membrane, atmosphere", 26.125, 23.634, 0.663, membrane="no"),
    _tensile("membrane_atm", "Multi-material with membrane, atmosphere", 24.879, 23.330, 0.406),
    _tensile("a30_atm", "Shore A-30, atmosphere", 9.110, 8.997, 0.038, material="a30"),
    _tensile("a30_vac50", "Shore A-30, -50 kPa", 11.601, 11.501, 0.032, material="a30", vacuum_pa=50e3),
    _tensile("a85_atm", "Shore A-85, atmosphere", 92.133, 84.294, 1.993, material="a85"),
    _tensile("a85_vac50", "Shore A-85, -50 kPa", 110.119, 96.492, 3.535, material="a85", vacuum_pa=50e3),
    _tensile("multi_vac10", "Multi-material, -10 kPa", 27.292, 25.415, 0.488, vacuum_pa=10e3),
    _tensile("multi_vac30", "Multi-material, -30 kPa", 41.423, 39.852, 0.466, vacuum_pa=30e3),
    _tensile("multi_vac50", "Multi-material, -50 kPa", 52.534, 50.214, 0.864, vacuum_pa=50e3),
)
"""Peak force of one tendon: 0 to 20 mm at 5 mm/s and back."""

DROP_ROWS = (
    _drop("rigid_ankle", "Rigid ankle", 71.040, 71.023, 0.005, "rigid_ankle", clipped=True),
    _drop("standard_foot", "Standard foot", 71.022, 71.002, 0.005, "standard", clipped=True),
    _drop("squash_ball", "Squash ball foot", 61.359, 60.602, 0.230, "squash_ball"),
    _drop("jammed_ankle", "Jammed ankle", 43.187, 42.520, 0.314, "jammed"),
    _drop("unjammed_ankle", "Unjammed ankle", 32.621, 31.259, 0.451, "unjammed"),
)
"""Peak deceleration, upward and net of gravity: 1.8 kg dropped from 50 mm."""

ROWS = (*TENSILE_ROWS, *DROP_ROWS)

SLIP_CLAIMS = (
    PaperClaim("largest_peak_jammed", "jammed ankle has the largest peak force"),
    PaperClaim("peak_unjammed_like_rigid", "unjammed and rigid ankle have similar peak force before sliding"),
    PaperClaim("dissipates_more_jammed", "jammed ankle dissipates significantly more than the rigid ankle"),
)
"""Slope of 40 degrees, 5 mm/s down for 110 mm."""


def is_reproduced(simulated: float, mean: float, standard_error: float) -> bool:
    """Whether a simulated mean counts as the paper's.

    Args:
        simulated: Mean of the repeats.
        mean: The paper's.
        standard_error: Of the paper's mean.

    """
    return abs(simulated - mean) <= max(STANDARD_ERRORS * standard_error, RELATIVE * mean)


def are_similar(peak_n: float, other_n: float) -> bool:
    """Whether two peak forces are similar: the first within SIMILAR of the second."""
    return abs(peak_n / other_n - 1.0) <= SIMILAR


def paper_row(identifier: str) -> PaperRow:
    """Return a row.

    Raises:
        ValueError: there is no such row.

    """
    for row in ROWS:
        if row.identifier == identifier:
            return row
    msg = f"row '{identifier}' is not in the paper's tables; known are: {', '.join(row.identifier for row in ROWS)}"
    raise ValueError(msg)
