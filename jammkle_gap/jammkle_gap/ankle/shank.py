"""How a shank moved while an ankle was exercised, by the IMU on it: an input of the simulator.

Where it moves its IMU is taken at its word. Where it stands still more is known than an IMU reads: it does not turn,
and what it feels is gravity. There the accelerometer says no more than which way is up, and what else it reads, and
what the gyro reads at all, is the sensors' own and is compared.
"""

from __future__ import annotations

import dataclasses
import hashlib
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import uniform_filter1d  # type: ignore[import-untyped]  # carries no types
from scipy.signal import savgol_filter  # type: ignore[import-untyped]  # carries no types

from jammkle_common.constants import STANDARD_GRAVITY_M_S2
from jammkle_sim.rigs.guide import guided_by_imu
from jammkle_sim.rigs.replay import timestep_s, true_time_s
from jammkle_sim.rigs.rig import laws_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from jammkle_gap.ankle.bag import Samples
    from jammkle_sim.rigs.rig import Rig

    Floats = NDArray[np.float64]

FORCES = tuple(f"specific_force_{axis}" for axis in "xyz")
RATES = tuple(f"angular_velocity_{axis}" for axis in "xyz")
_CALM_S = 0.2
"""Time over which an IMU must be calm around a moment for the shank to count as still then. Assumed: a servo settles
within, and no exercise moves more slowly than to be seen in it."""
_CALMER = 3.0
"""How much more it may scatter than in the calmest tenth of its recording. Assumed."""
_CALMEST = 10.0
"""Percentile of the scatter that is taken for that of rest."""
_NOISIEST = (0.5, 0.1)
"""Scatter above which nothing counts as still, m/s^2 and rad/s. Assumed: what a standing robot's fans and gears make."""
_SMOOTHED_S = 0.02
"""Length of the cubics that readings are smoothed by. Chosen: they keep 6 Hz to 1 part in 10,000, and take away two
thirds of the noise."""


@dataclass(frozen=True)
class ShankMotion:
    """What the IMU on a shank read, since the start of the rig."""

    time_s: Floats
    """Rising, shape (n,), s, as stamped."""
    readings: Floats
    """Specific force, m/s^2, then angular velocity, rad/s, in the sensor's frame, shape (n, 6)."""

    @cached_property
    def still(self) -> Floats:
        """Whether it stood still, 0 to 1, shape (n,)."""
        between_s = float(np.median(np.diff(self.time_s)))
        around = max(round(_CALM_S / between_s), 3)
        calm = np.ones(len(self.time_s), dtype=bool)
        for axes, noisiest in zip((slice(0, 3), slice(3, 6)), _NOISIEST, strict=True):
            values = self.readings[:, axes]
            mean = uniform_filter1d(values, around, axis=0)
            scatter = np.sqrt(np.maximum(uniform_filter1d(values**2, around, axis=0) - mean**2, 0.0).sum(axis=1))
            calm &= scatter <= min(_CALMER * float(np.percentile(scatter, _CALMEST)), noisiest)
        share: Floats = uniform_filter1d(calm.astype(np.float64), around)
        return share

    @cached_property
    def digest(self) -> bytes:
        """What tells it from other motions."""
        return hashlib.blake2b(self.time_s.tobytes() + self.readings.tobytes(), digest_size=16).digest()


def shank_motion(imu: Samples, start_s: float, end_s: float) -> ShankMotion:
    """Return the motion between two stamps, s, that an IMU read."""
    within = (imu.stamp_s >= start_s) & (imu.stamp_s <= end_s)
    readings = np.column_stack([imu.columns[column][within] for column in (*FORCES, *RATES)])
    return ShankMotion(imu.stamp_s[within] - start_s, readings)


def moved_as_read(rig: Rig, motion: ShankMotion) -> Rig:
    """Return a guided rig that moves as its IMU must have moved to read this.

    Args:
        rig: With effects in it, or without; not touched. How its IMU errs, and how late it is, is taken out.
        motion: What was read.

    """
    law, step_s = laws_of(rig).imu[0], timestep_s(rig)
    true = (motion.readings - law["offset"]).reshape(-1, 2, 3) @ law["turn"]
    force, rate, still = true[:, 0], true[:, 1], motion.still[:, np.newaxis]
    # Each pole of the filter is late by (1 - s) / s steps, and a reading comes at the end of the step it is taken in.
    filter_s = step_s * (1.0 + 2.0 * (1.0 - float(law["smoothing"])) / float(law["smoothing"]))
    moment_s = true_time_s(motion.time_s, rig.wiring.imu_delay_s, rig.wiring.clock_skew) - filter_s
    grid_s = step_s * np.arange(int(moment_s[-1] / step_s) + 1)
    gravity = force * (STANDARD_GRAVITY_M_S2 / np.linalg.norm(force, axis=1, keepdims=True))
    felt = np.column_stack((still * gravity + (1.0 - still) * force, (1.0 - still) * rate))
    window = 2 * round(0.5 * _SMOOTHED_S / step_s) + 1
    smooth = savgol_filter(np.column_stack([np.interp(grid_s, moment_s, axis) for axis in felt.T]), window, 3, axis=0)
    return dataclasses.replace(rig, guide=guided_by_imu(step_s, smooth[:, :3], smooth[:, 3:]))
