"""Hoses between valve and tendon: the air that they hold, what they let through, and how long a change takes."""

from __future__ import annotations

import math

BORE_M = 0.0025
"""Inner diameter of a hose, m: polyurethane of 4/2.5 mm, the common size for valves of 0.1 dm^3/(s bar). Data sheet."""
_SOUND_M_S = 343.0
"""Speed of sound in air of 20 degC; in a hose a change of pressure travels with it."""
_TUBE, _INLET = 0.029, 510.0
"""Conductance of a tube by its bore D and length L, both in m: 0.029 D^2 / sqrt(L / D^1.25 + 510), m^3/(s Pa). From
Eckersten, as in Beater, Pneumatic Drives, 2007, for the turbulent flow of ISO 6358; 510 is its inlet."""


def held_m3(length_m: float) -> float:
    """Return the air in a hose, m^3."""
    return math.pi / 4.0 * BORE_M**2 * length_m


def travel_s(length_m: float) -> float:
    """Return how long a change of pressure takes to its end, s."""
    return length_m / _SOUND_M_S


def behind(conductance_m3_s_pa: float, length_m: float) -> float:
    """Return the sonic conductance, m^3/(s Pa), of a valve with so much more hose behind it.

    In series the inverse cubes of conductances add up (ISO 6358-3); the inlet of the hose is the valve's own.

    Args:
        conductance_m3_s_pa: Of the valve with what is behind it already.
        length_m: More hose, m.

    """
    bare, long = (_INLET + part / BORE_M**1.25 for part in (0.0, length_m))
    narrower = (long**1.5 - bare**1.5) / (_TUBE * BORE_M**2) ** 3
    together: float = (conductance_m3_s_pa**-3 + narrower) ** (-1.0 / 3.0)
    return together
