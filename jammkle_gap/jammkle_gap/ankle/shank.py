"""How a shank moved while an ankle was exercised, by the IMU on it: an input of the simulator.

Where it moves its IMU is taken at its word. Where it stands still more is known than an IMU reads: in the mean it does
not turn, though it trembles as a hand or a servo does, and what it feels is gravity. There the accelerometer says no
more than which way is up, and what else it reads, and what the gyro reads in the mean, is the sensors' own and is
compared.

Over the ground it must be known where it is. There its height was measured, it moves slowly, and it is tilted as its
accelerometer says.
"""

from __future__ import annotations

import dataclasses
import hashlib
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy.integrate import cumulative_trapezoid  # type: ignore[import-untyped]  # carries no types
from scipy.ndimage import uniform_filter1d  # type: ignore[import-untyped]  # carries no types
from scipy.signal import savgol_filter  # type: ignore[import-untyped]  # carries no types
from scipy.spatial.transform import Rotation  # type: ignore[import-untyped]  # carries no types

from jammkle_common.constants import STANDARD_GRAVITY_M_S2
from jammkle_common.names import CARRIAGE_JOINT, CARRIAGE_X_JOINT
from jammkle_sim.rigs.guide import guided_by_imu, guided_by_poses
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
"""Scatter above which nothing counts as still, m/s^2 and rad/s. Assumed: fans and gears of a standing robot."""
_MOSTLY_STILL = 0.5
"""Share of a recording for which an IMU must be still to be compared. Assumed."""
_SMOOTHED_S = 0.02
"""Length of the cubics that readings are smoothed by. Chosen: they keep 6 Hz to 1 part in 10,000, and take away two
thirds of the noise."""
_TILTED_S = 1.0
"""Time over which a gyro and an accelerometer are brought together. Chosen: a gyro's noise walks by 0.1 mrad in it."""
_RESTS, _LEAST_REST = 0.9, 0.05
"""Share of stillness from which on a shank is at rest; share of that time which it must be. Chosen: begin and end of a
motion are not in it, and 50 readings of 1 kHz are."""
_JOLTED = 1e-3
"""How much less an accelerometer that moves is trusted than one at rest. Assumed."""


@dataclass(frozen=True)
class ShankMotion:
    """What the IMU on a shank read, since the start of the rig."""

    time_s: Floats
    """Rising, shape (n,), s, as stamped."""
    readings: Floats
    """Specific force, m/s^2, then angular velocity, rad/s, in the sensor's frame, shape (n, 6)."""
    place: tuple[Floats, Floats] | None = None
    """Over the ground: stamps, s, and how far the ankle's joint is forward and up, shape (m, 2), m, as read; None: it
    touches nothing."""

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

    @property
    def is_input_alone(self) -> bool:
        """Whether the IMU is not compared: it is seldom still, or the tilt of a slow motion is all it is for."""
        return self.place is not None or float(np.mean(self.still)) < _MOSTLY_STILL

    @cached_property
    def digest(self) -> bytes:
        """What tells it from other motions."""
        parts = (self.time_s, self.readings, *(self.place or ()))
        return hashlib.blake2b(b"".join(part.tobytes() for part in parts), digest_size=16).digest()


def shank_motion(imu: Samples, place: tuple[Floats, Floats] | None, start_s: float, end_s: float) -> ShankMotion:
    """Return the motion between two stamps, s, that an IMU read, and places with their stamps where those count."""
    within = (imu.stamp_s >= start_s) & (imu.stamp_s <= end_s)
    readings = np.column_stack([imu.columns[column][within] for column in (*FORCES, *RATES)])
    since = None if place is None else (place[0] - start_s, place[1])
    return ShankMotion(imu.stamp_s[within] - start_s, readings, since)


def moved_as_read(rig: Rig, motion: ShankMotion) -> Rig:
    """Return a guided rig that moves as its sensors must have moved to read this.

    Args:
        rig: With effects in it, or without; not touched. How its IMU errs, and how late it is, is taken out.
        motion: What was read.

    """
    law, step_s, wiring = laws_of(rig).imu[0], timestep_s(rig), rig.wiring
    true = (motion.readings - law["offset"]).reshape(-1, 2, 3) @ law["turn"]
    # Each pole of the filter is late by (1 - s) / s steps, and a reading comes at the end of the step it is taken in.
    filter_s = step_s * (1.0 + 2.0 * (1.0 - float(law["smoothing"])) / float(law["smoothing"]))
    moment_s = true_time_s(motion.time_s, wiring.imu_delay_s, wiring.clock_skew) - filter_s
    grid_s = np.arange(int(moment_s[-1] / step_s) + 1, dtype=np.float64) * np.float64(step_s)
    force, rate = true[:, 0], true[:, 1]
    if motion.place is not None:
        stamp_s, place_m = motion.place
        read_s = true_time_s(stamp_s, wiring.joint_delay_s, wiring.clock_skew) - step_s
        forward_m, height_m = _smooth(grid_s, read_s, place_m, _SMOOTHED_S).T
        position_m = np.column_stack((forward_m, np.zeros(len(grid_s)), height_m))
        guide = guided_by_poses(
            step_s, position_m, Rotation.from_euler("YX", _tilt_rad(grid_s, moment_s, force, rate, motion.still))
        )
    else:
        still = motion.still[:, np.newaxis]
        gravity = force * (STANDARD_GRAVITY_M_S2 / np.linalg.norm(force, axis=1, keepdims=True))
        felt = np.column_stack((still * gravity + (1.0 - still) * force, rate - still * _zero(rate, motion.still)))
        smooth = _smooth(grid_s, moment_s, felt, _SMOOTHED_S)
        guide = guided_by_imu(step_s, smooth[:, :3], smooth[:, 3:])
    return dataclasses.replace(rig, guide=guide)


def _tilt_rad(grid_s: Floats, moment_s: Floats, force: Floats, rate: Floats, still: Floats) -> Floats:
    """Return pitch and roll of a shank that does not turn about the vertical, on an even grid, shape (n, 2), rad.

    Turns are the gyro's, whose zero is what it reads at rest. Which way is up is the accelerometer's, at rest alone,
    as contact and a robot's joints jolt it; in between, a straight line leads from what they differed by at one rest
    to what they differ by at the next. Where it never rests, the accelerometer counts throughout.
    """
    zero = _zero(rate, still)
    columns = np.column_stack((force, rate - zero, still))
    felt = np.column_stack([np.interp(grid_s, moment_s, column) for column in columns.T])
    up, rests = felt[:, :3] / np.linalg.norm(felt[:, :3], axis=1, keepdims=True), felt[:, 6] > _RESTS
    leaning = np.column_stack((np.arcsin(np.clip(-up[:, 0], -1.0, 1.0)), np.arctan2(up[:, 1], up[:, 2])))
    turning = np.column_stack((felt[:, 4] / np.cos(leaning[:, 1]), felt[:, 3]))
    turned = cumulative_trapezoid(turning, grid_s, axis=0, initial=0.0)
    trust = (rests if rests.any() else ~rests).astype(np.float64)
    around = round(_TILTED_S / (grid_s[1] - grid_s[0]))
    weight = uniform_filter1d(trust, around)
    near = np.flatnonzero(weight > _LEAST_REST)
    sums = uniform_filter1d(trust[:, np.newaxis] * (leaning - turned), around, axis=0)
    differs = [np.interp(np.arange(len(grid_s)), near, each[near] / weight[near]) for each in sums.T]
    tilt_rad: Floats = turned + np.column_stack(differs)
    return tilt_rad


def _zero(rate: Floats, still: Floats) -> Floats:
    """Return what a gyro reads at rest, in the mean over a recording, shape (3,), rad/s."""
    zero: Floats = np.average(rate, axis=0, weights=still + _JOLTED)
    return zero


def _smooth(grid_s: Floats, time_s: Floats, values: Floats, over_s: float) -> Floats:
    """Return values, one column each, on an even grid, smoothed by cubics."""
    window = 2 * round(0.5 * over_s / (grid_s[1] - grid_s[0])) + 1
    even = np.column_stack([np.interp(grid_s, time_s, axis) for axis in values.T])
    smooth: Floats = savgol_filter(even, window, 3, axis=0)
    return smooth


def place_of(joints: Samples) -> tuple[Floats, Floats]:
    """Return stamps, s, and how far the ankle's joint is forward and up, m, by joints with a carriage among them."""
    stamp_s, height_m = joints.readings(f"{CARRIAGE_JOINT}/position")
    forward = f"{CARRIAGE_X_JOINT}/position"
    forward_m = np.interp(stamp_s, *joints.readings(forward)) if forward in joints.columns else np.zeros(len(stamp_s))
    return stamp_s, np.column_stack((forward_m, height_m))
