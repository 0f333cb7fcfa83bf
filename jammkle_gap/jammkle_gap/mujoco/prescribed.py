"""Prescribed motion: joints that move as they were measured, whatever acts on them; a floating base is six of them.

They have so large an armature that nothing but their drives moves them. These get the force that the measured
acceleration takes, and a PD controller keeps them on the measured path. In place of a base's free joint there are three
slides and three hinges.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation  # type: ignore[import-untyped]  # carries no types

from jammkle_gap.mujoco.runs import BASE_COLUMNS, BadRobotError
from jammkle_sim.physics.engine import mujoco

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from jammkle_gap.mujoco.runs import Run

    Array = NDArray[np.float64]

COORDINATES = ("x", "y", "z", "yaw", "pitch", "roll")
"""Of a base: m, and rad about z, the new y and the new x in turn."""
BASE_JOINTS = tuple(f"jammkle base {each}" for each in COORDINATES)
"""Joints that move the base."""
_AXES = ((1, 0, 0), (0, 1, 0), (0, 0, 1), (0, 0, 1), (0, 1, 0), (1, 0, 0))
_HEAVY = 1e7
"""Armature of each, kg or kg m^2. Chosen: 1000 N move it by 0.2 mm in 2 s."""
_RATE = 2.0 * np.pi * 3.0
"""Natural frequency of the drives, critically damped, rad/s. Chosen: 3 Hz is well below the 100 Hz and more that models
are stepped at."""


def prescribe_base(spec: mujoco.MjSpec, runs: Sequence[Run]) -> None:
    """Give a floating base joints and drives that move it as it was measured.

    Raises:
        BadRobotError: the model has no floating base, or a recording no odometry.

    """
    free = free_joint(spec, "measured")
    without = [run.name for run in runs if not run.base]
    if without:
        msg = f"recording {without[0]} holds no odometry of the base; record nav_msgs/Odometry, or write 'base: held'"
        raise BadRobotError(msg)
    body = free.parent
    spec.delete(free)
    for key in list(spec.keys):
        spec.delete(key)  # its positions are of other joints now
    body.pos, body.quat = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
    for number, (name, axis) in enumerate(zip(BASE_JOINTS, _AXES, strict=True)):
        kind = mujoco.mjtJoint.mjJNT_SLIDE if number < len(_AXES) // 2 else mujoco.mjtJoint.mjJNT_HINGE
        body.add_joint(name=name, type=kind, axis=axis)
        prescribe_joint(spec, name)


def free_joint(spec: mujoco.MjSpec, wanted: str) -> mujoco.MjsJoint:
    """Return the joint of a floating base.

    Raises:
        BadRobotError: there is none, or more than one.

    """
    free = [each for each in spec.joints if each.type == mujoco.mjtJoint.mjJNT_FREE]
    if len(free) != 1:
        msg = f"the map says 'base: {wanted}', and the model has {len(free)} free joints, not one; write 'base: held'"
        raise BadRobotError(msg)
    return free[0]


def prescribe_joint(spec: mujoco.MjSpec, name: str) -> None:
    """Make a joint heavy, and give it a drive of its own; one that it has must have been switched off."""
    spec.joint(name).armature = _HEAVY
    spec.joint(name).limited = mujoco.mjtLimited.mjLIMITED_FALSE  # an end stop would move what was measured
    drive = spec.add_actuator(name=drive_of(name), trntype=mujoco.mjtTrn.mjTRN_JOINT, target=name)
    drive.gaintype, drive.biastype = mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtBias.mjBIAS_AFFINE
    gain, bias = np.zeros_like(drive.gainprm), np.zeros_like(drive.biasprm)
    gain[0], bias[1], bias[2] = _HEAVY, -_HEAVY * _RATE**2, -2.0 * _HEAVY * _RATE
    drive.gainprm, drive.biasprm = gain, bias


def drive_of(joint: str) -> str:
    """Return the name of the actuator that moves a joint."""
    return f"jammkle drive of {joint}"


def controls_of(motion: Array) -> Array:
    """Return the controls of the drives on the grid, shape (n, joints).

    Args:
        motion: Position, velocity and acceleration of the joints, shape (3, n, joints).

    """
    found: Array = motion[2] + 2.0 * _RATE * motion[1] + _RATE**2 * motion[0]
    return found


def coordinates_of(poses: Array) -> Array:
    """Return the joints' positions from poses (x, y, z, and w, x, y, z of a quaternion); shapes (n, 7) and (n, 6)."""
    turns = Rotation.from_quat(poses[:, [4, 5, 6, 3]]).as_euler("ZYX")
    return np.column_stack([poses[:, : len(BASE_COLUMNS) - 4], np.unwrap(turns, axis=0)])


def state_of(coordinates: Array, rates: Array) -> tuple[Array, Array]:
    """Return position and velocity of a free joint, shapes (7,) and (6,), as MuJoCo has them.

    Args:
        coordinates: By `COORDINATES`.
        rates: Of these, 1/s.

    """
    turn = Rotation.from_euler("ZYX", coordinates[3:])
    quaternion = turn.as_quat()[[3, 0, 1, 2]]
    pitch, roll = coordinates[4:]
    yawing, pitching, rolling = rates[3:]
    # Rates of angles in turn, as a vector in the body's own frame.
    spin = [
        rolling - yawing * np.sin(pitch),
        pitching * np.cos(roll) + yawing * np.cos(pitch) * np.sin(roll),
        yawing * np.cos(pitch) * np.cos(roll) - pitching * np.sin(roll),
    ]
    return np.concatenate([coordinates[:3], quaternion]), np.concatenate([rates[:3], spin])
