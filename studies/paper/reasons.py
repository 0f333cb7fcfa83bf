"""Why the constants as printed miss what the paper measured, or do not: one sentence per row and claim.

Each sentence names its culprits as constants; a test puts the fitted ones in their place and sees the tensile row come
back. Jammed in the drop, the printed tendon with the fitted fibres alone comes to 42.0 m/s^2, with the fitted
relaxation alone to 36.9, of 33.3 printed and 42.5 measured.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass


class Miss(enum.Enum):
    """Where the set `as_printed` comes out, compared with the measurement."""

    NONE = "none"
    """Within two standard errors or 3 %, or the claim holds."""
    TOO_LOW = "too_low"
    TOO_HIGH = "too_high"
    ELSEWHERE = "elsewhere"
    """The claim does not hold, with either set, and no constant of the tendon is to blame."""


@dataclass(frozen=True)
class Reason:
    """Why one row or claim comes out as it does with the set `as_printed`."""

    identifier: str
    """Row or claim of `paper_tables`."""
    miss: Miss
    sentence: str
    culprits: tuple[str, ...] = ()
    """Fields of TendonParameters or Fibres whose printed values are to blame; empty where none is."""


_SOFT = ("c1_pa", "c3_pa", "relaxation_gains")
_STIFF = ("modulus_pa", "relaxation_gains")
_MEMBRANE = ("pressure_stiffening", "grip_n_per_pa")
_RUBBING = ("friction_stiffness_n_m", "friction_yield_n_per_pa", "friction_onset_pa")
_ALL = ("c1_pa", "c3_pa", *_STIFF, *_MEMBRANE, *_RUBBING)

REASONS = (
    Reason(
        "no_membrane_atm",
        Miss.TOO_LOW,
        "Unjammed, nearly all the stretch is in the Shore A-30 sections, and the printed Yeoh constants make those "
        "about ten times too soft.",
        _SOFT,
    ),
    Reason(
        "membrane_atm",
        Miss.TOO_LOW,
        "As without the membrane: the printed Yeoh constants make the Shore A-30 sections, which take nearly all the "
        "stretch, about ten times too soft.",
        _SOFT,
    ),
    Reason(
        "a30_atm",
        Miss.TOO_LOW,
        "The printed C1 of 0.012 MPa is ten times too small: at the speed of the test the measured force needs "
        "0.13 MPa.",
        ("c1_pa", "relaxation_gains"),
    ),
    Reason(
        "a30_vac50",
        Miss.TOO_LOW,
        "C1 is ten times too small, and identical fibres do not slide on each other, so the printed model has nothing "
        "by which vacuum could stiffen them; the fitted one has the grip of the membrane.",
        ("c1_pa", "relaxation_gains", *_MEMBRANE),
    ),
    Reason(
        "a85_atm",
        Miss.TOO_HIGH,
        "The printed modulus of 7.34 MPa is nearly a quarter too large: the row itself says 6.0 MPa at the speed of "
        "the test.",
        _STIFF,
    ),
    Reason(
        "a85_vac50",
        Miss.TOO_HIGH,
        "The modulus is nearly a quarter too large; the miss is smaller than without vacuum because the measured "
        "tendon stiffens with vacuum and the printed one, whose identical fibres do not slide, does not.",
        (*_STIFF, *_MEMBRANE),
    ),
    Reason(
        "multi_vac10",
        Miss.TOO_LOW,
        "The Shore A-30 sections are ten times too soft; printed friction, which sets in with the first pascal of "
        "vacuum where the measured one waits for 8 kPa, makes up for more than half of it.",
        _ALL,
    ),
    Reason(
        "multi_vac30",
        Miss.TOO_LOW,
        "The Shore A-30 sections are ten times too soft; friction without an onset and with all of the vacuum behind "
        "it makes up for most of it.",
        _ALL,
    ),
    Reason(
        "multi_vac50",
        Miss.TOO_LOW,
        "Close, as the printed friction was fitted to this very curve: it is too strong by almost as much as the "
        "Shore A-30 sections are too soft.",
        _ALL,
    ),
    Reason(
        "rigid_ankle",
        Miss.NONE,
        "No tendon takes part: the rigid ankle clips the sensor with any constants.",
    ),
    Reason(
        "standard_foot",
        Miss.NONE,
        "No tendon takes part: the standard foot clips the sensor with any constants.",
    ),
    Reason(
        "squash_ball",
        Miss.NONE,
        "No tendon takes part: the ball's own stiffness makes the peak.",
    ),
    Reason(
        "jammed_ankle",
        Miss.TOO_LOW,
        "The Shore A-30 sections are ten times too soft and, without relaxation, gain nothing at the speed of a "
        "landing; friction makes up for part of it: the leg sinks further and is stopped more gently.",
        _ALL,
    ),
    Reason(
        "unjammed_ankle",
        Miss.TOO_HIGH,
        "The printed tendon is so soft that the leg falls through all its travel and the heel hits the ground, so hard "
        "that the sensor clips.",
        _ALL,
    ),
    Reason(
        "largest_peak_jammed",
        Miss.NONE,
        "Holds: jammed, printed friction carries the tendon almost to its measured force.",
    ),
    Reason(
        "peak_unjammed_like_rigid",
        Miss.ELSEWHERE,
        "No tendon is to blame: the rigid ankle slides at the first touch under little more than its own weight. "
        "Printed, the unjammed one is several times too soft, and so nearer to it for the wrong reason.",
    ),
    Reason(
        "dissipates_more_jammed",
        Miss.NONE,
        "Holds: at -50 kPa the printed tendon pulls almost as hard as the measured one, as friction that is too strong "
        "makes up for sections that are too soft.",
    ),
)
"""In the order of the paper's tables, then its claims on the slip test."""
