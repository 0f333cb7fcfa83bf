"""What a stream of IMU samples says of motion: the quantities that the detectors decide on, sample by sample.

All of them are first-order low-passes by implicit Euler, whose time constants are times and not counts, so that they
are stable and mean the same at any rate, with dropped samples and jitter; none depends on how the IMU is turned.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from jammkle_graph.constants import STANDARD_GRAVITY_M_S2

if TYPE_CHECKING:
    from jammkle_controller.core.imu import ImuSample

Vector = tuple[float, float, float]

LOAD_TIME_S = 0.01
"""Time constant of the load, s: above the ringing of a foot (30 Hz and more), below a step."""
STILL_TIME_S = 0.03
"""Window of the zero-velocity statistic, s. Skog et al. take 5 to 25 ms at 250 Hz and more on a boot."""
GRAVITY_TIME_S = 1.0
"""Time constant with which gravity follows the accelerometer, s; the gyro carries it in between."""
STILL_GRAVITY_TIME_S = 0.05
"""As above, while the IMU is still: then what it reads is gravity."""
STILL_FORCE_M2_S4 = 0.25
STILL_RATE_RAD2_S2 = 0.04
"""Squared deviations, below which the IMU is still: 0.5 m/s^2 for 0.05 g of bias, and 0.2 rad/s."""


class Motion:
    """Load, stillness and gravity at the IMU."""

    def __init__(self, force: Vector = (0.0, 0.0, STANDARD_GRAVITY_M_S2)) -> None:
        """Begin at a specific force, m/s^2, that is taken for gravity."""
        self.force_m_s2 = self._load_m_s2 = math.hypot(*force)
        self.gravity: Vector = force
        self.unrest_m2_s4 = self.turning_rad2_s2 = 0.0
        self._mean = force
        self._mean_unrest = 0.0
        self._mean_turning = 0.0

    def update(self, sample: ImuSample, interval_s: float) -> None:
        """Take the next sample, `interval_s` after the one before.

        `unrest_m2_s4` and `turning_rad2_s2` are then the two parts of the generalised likelihood ratio for zero
        velocity, SHOE (Skog, Haendel, Nilsson, Rantakokko, "Zero-Velocity Detection - An Algorithm Evaluation", IEEE
        Trans. Biomed. Eng. 57, 2010, eq. 13), of this sample alone and kept apart:

            |f - g mean(f)/|mean(f)||^2   and   |w|^2
        """
        _, x, y, z, p, q, r = sample
        self.force_m_s2 = force = math.sqrt(x * x + y * y + z * z)
        self._load_m_s2 += (force - self._load_m_s2) * interval_s / (interval_s + LOAD_TIME_S)
        share = interval_s / (interval_s + STILL_TIME_S)
        mx, my, mz = self._mean
        mx, my, mz = mx + (x - mx) * share, my + (y - my) * share, mz + (z - mz) * share
        self._mean = (mx, my, mz)
        scale = STANDARD_GRAVITY_M_S2 / (math.sqrt(mx * mx + my * my + mz * mz) or 1.0)
        self.unrest_m2_s4 = unrest = (x - scale * mx) ** 2 + (y - scale * my) ** 2 + (z - scale * mz) ** 2
        self.turning_rad2_s2 = turning = p * p + q * q + r * r
        self._mean_unrest += (unrest - self._mean_unrest) * share
        self._mean_turning += (turning - self._mean_turning) * share
        self._follow_gravity(sample, interval_s)

    def _follow_gravity(self, sample: ImuSample, interval_s: float) -> None:
        """Turn gravity with the body, g' = -w x g, and pull it to the accelerometer: r' = -w x r + (f - r) / T."""
        _, x, y, z, p, q, r = sample
        gx, gy, gz = self.gravity
        follow_s = STILL_GRAVITY_TIME_S if self.is_still else GRAVITY_TIME_S
        follow = interval_s / (interval_s + follow_s)
        self.gravity = (
            gx + interval_s * (r * gy - q * gz) + (x - gx) * follow,
            gy + interval_s * (p * gz - r * gx) + (y - gy) * follow,
            gz + interval_s * (q * gx - p * gy) + (z - gz) * follow,
        )

    @property
    def is_still(self) -> bool:
        """Whether the zero-velocity statistic is that of an IMU at rest."""
        return self._mean_unrest < STILL_FORCE_M2_S4 and self._mean_turning < STILL_RATE_RAD2_S2

    @property
    def load(self) -> float:
        """Low-passed |specific force| in units of gravity: 0 in free fall, 1 at rest."""
        return self._load_m_s2 / STANDARD_GRAVITY_M_S2
