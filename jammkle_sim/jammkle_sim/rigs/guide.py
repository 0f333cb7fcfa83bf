"""How a shank is guided that a hand, a drive or a robot's own joints move: as it was moved, whatever hangs on it.

Three ways lead to the rows that `physics.kernels.guide` follows. A motion that is given, as poses over time. One that
an IMU on the shank measured: then the world is the shank's own frame, in which the foot feels no more of the motion
than the specific force f, the angular velocity w and its rate, so that neither place nor heading need be known and
nothing is integrated (d'Alembert's principle). And one whose height was measured and whose tilt is that of the specific
force, for a shank that moves slowly over the ground.

The rigs load SciPy where they make such a motion: a node that lands or walks makes none, and would start a third later.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from jammkle_common.constants import STANDARD_GRAVITY_M_S2
from jammkle_sim.physics import records

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from scipy.spatial.transform import Rotation  # type: ignore[import-untyped]  # carries no types

    Floats = NDArray[np.float64]

_UP = np.array((0.0, 0.0, STANDARD_GRAVITY_M_S2))
_POSITION, _QUATERNION, _VELOCITY, _RATE, _FORCE, _ANGULAR = (
    slice(0, 3),
    slice(3, 7),
    slice(7, 10),
    slice(10, 13),
    slice(13, 16),
    slice(16, 19),
)


def guided_by_poses(step_s: float, position_m: Floats, turn: Rotation) -> Floats:
    """Return the rows of a carriage that takes these poses, one per time step.

    Args:
        step_s: Time step, s.
        position_m: Of the ankle's joint, in the world, shape (n, 3), m; n is 3 or more.
        turn: From the shank's frame to the world's, n of them.

    """
    rows = np.zeros((len(position_m), records.GUIDE_COLUMNS))
    velocity_m_s = np.gradient(position_m, step_s, axis=0)
    x, y, z, w = turn.as_quat().T
    rows[:, _POSITION], rows[:, _QUATERNION], rows[:, _VELOCITY] = (
        position_m,
        np.column_stack((w, x, y, z)),
        velocity_m_s,
    )
    rows[1:-1, _RATE] = (turn[:-2].inv() * turn[2:]).as_rotvec() / (2.0 * step_s)
    rows[:, _FORCE] = np.gradient(velocity_m_s, step_s, axis=0) + _UP
    rows[:, _ANGULAR] = np.gradient(rows[:, _RATE], step_s, axis=0)
    return rows


def guided_by_imu(step_s: float, specific_force_m_s2: Floats, rate_rad_s: Floats) -> Floats:
    """Return the rows of a carriage whose IMU measures this, a row per time step, in the shank's own frame.

    Args:
        step_s: Time step, s.
        specific_force_m_s2: In the frame of the shank, at the ankle's joint, shape (n, 3).
        rate_rad_s: Angular velocity in the same frame, shape (n, 3).

    """
    rows = np.zeros((len(rate_rad_s), records.GUIDE_COLUMNS))
    rows[:, _QUATERNION.start] = 1.0
    rows[:, _RATE], rows[:, _FORCE] = rate_rad_s, specific_force_m_s2
    rows[:, _ANGULAR] = np.gradient(rate_rad_s, step_s, axis=0)
    return rows


def smooth_course(corner_s: Floats, corners: Floats, time_s: Floats) -> Floats:
    """Return a course through corners, at rest in each: half a cosine leads from one to the next.

    Args:
        corner_s: Rising, shape (k,), s.
        corners: Shape (k, columns).
        time_s: Shape (n,), s.

    """
    place = np.interp(time_s, corner_s, np.arange(len(corner_s), dtype=np.float64))
    before = np.minimum(place.astype(int), len(corner_s) - 2)
    share = (0.5 - 0.5 * np.cos(np.pi * (place - before)))[:, np.newaxis]
    course: Floats = (1.0 - share) * corners[before] + share * corners[before + 1]
    return course
