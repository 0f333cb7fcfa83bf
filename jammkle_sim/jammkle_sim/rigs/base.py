"""Where the base of a simulated robot is, and how it moves: the truth, as no sensor has it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from jammkle_sim.physics.engine import mujoco


@dataclass(frozen=True)
class BaseSample:
    """Pose and velocity of the base, at the start of the latest time step."""

    position_m: tuple[float, float, float]
    """Of its origin, in the world: z up, x where the toes point."""
    rotation: tuple[float, float, float, float]
    """From the base's frame to the world's, as a quaternion (w, x, y, z)."""
    linear_m_s: tuple[float, float, float]
    """Velocity of its origin, in its own frame."""
    angular_rad_s: tuple[float, float, float]
    """Angular velocity, in its own frame."""


def base_sample(model: Any, data: Any, body: int) -> BaseSample:
    """Return the pose and velocity of a body.

    Args:
        model: The mujoco.MjModel.
        data: The mujoco.MjData.
        body: Number of the body.

    """
    velocity = np.zeros(6)
    in_own_frame = 1
    mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_XBODY, body, velocity, in_own_frame)
    roll, pitch, yaw, forward, left, up = velocity.tolist()
    x, y, z = data.xpos[body].tolist()
    qw, qx, qy, qz = data.xquat[body].tolist()
    return BaseSample((x, y, z), (qw, qx, qy, qz), (forward, left, up), (roll, pitch, yaw))
