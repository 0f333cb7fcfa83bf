"""Figures that several rigs take from their recordings."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from jammkle_common.constants import STANDARD_GRAVITY_M_S2

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from jammkle_sim.rigs.run import Series

_SMOOTHED_ROWS = 5
"""Rows of 2 ms that a reported force is the mean of: 10 ms, as a test machine's filter. Assumed."""
SMOOTHED_S = 0.010
"""The same as a time, s."""


def smoothed(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the moving mean of a load cell over 10 ms, centred, same shape; the ends are held."""
    half = _SMOOTHED_ROWS // 2
    padded = np.pad(values, half, mode="edge")
    return np.convolve(padded, np.full(_SMOOTHED_ROWS, 1.0 / _SMOOTHED_ROWS), mode="valid")


def work_j(position_m: NDArray[np.float64], force_n: NDArray[np.float64]) -> float:
    """Return the integral of force over position, J, by trapezoids; both of shape (n,)."""
    return float((np.diff(position_m) * (force_n[1:] + force_n[:-1])).sum() / 2.0)


def peak_deceleration_m_s2(imu: Series, release_s: float) -> float:
    """Return the largest upward acceleration, net of gravity, that the IMU gave after the release, m/s^2."""
    upward = imu.column("linear_acceleration_z_m_s2")[imu.time_s > release_s]
    return float(upward.max()) - STANDARD_GRAVITY_M_S2


def rebound_m(height_m: NDArray[np.float64]) -> float:
    """Return how far a height rises again after its lowest point, m."""
    lowest = int(np.argmin(height_m))
    return float(height_m[lowest:].max() - height_m[lowest])
