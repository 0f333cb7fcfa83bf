"""Where bodies and tendons of a model are when its joints are where they are said to be."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Any

import numpy as np

from jammkle_sim.physics.engine import mujoco

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from jammkle_view.core.samples import Base

_BASE = 1
"""Body that carries a robot: the first after the world."""
_GROUNDS = (int(mujoco.mjtGeom.mjGEOM_PLANE), int(mujoco.mjtGeom.mjGEOM_HFIELD))
_BALL = int(mujoco.mjtGeom.mjGEOM_SPHERE)
_FOOT_BALLS = 4
"""Rounded corners of a sole."""
_SITE = int(mujoco.mjtWrap.mjWRAP_SITE)


def tendon_sites(model: Any) -> dict[str, tuple[int, ...]]:
    """Return the sites that each tendon passes through, in order, by name of the tendon."""
    found = {}
    for index in range(model.ntendon):
        first, count = int(model.tendon_adr[index]), int(model.tendon_num[index])
        wraps = range(first, first + count)
        found[model.tendon(index).name] = tuple(
            int(model.wrap_objid[place]) for place in wraps if int(model.wrap_type[place]) == _SITE
        )
    return found


class Kinematics:
    """A model that is moved by the positions of its joints, without any dynamics."""

    def __init__(self, model: Any) -> None:
        """Stand at the model's start.

        Args:
            model: The mujoco.MjModel; a keyframe, if it has one, is the start.

        """
        self._model = model
        self._data = mujoco.MjData(model)
        if model.nkey:
            mujoco.mj_resetDataKeyframe(model, self._data, 0)
        simple = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
        self._address = {
            model.joint(index).name: int(model.jnt_qposadr[index])
            for index in range(model.njnt)
            if int(model.jnt_type[index]) in simple
        }
        kinds = [int(kind) for kind in model.geom_type]
        self._ground = next((index for index, kind in enumerate(kinds) if kind in _GROUNDS), None)
        balls = [int(model.geom_bodyid[index]) for index, kind in enumerate(kinds) if kind == _BALL]
        self._corners = [
            index
            for index, kind in enumerate(kinds)
            if kind == _BALL and balls.count(int(model.geom_bodyid[index])) >= _FOOT_BALLS
        ]
        self.bodies: tuple[str, ...] = tuple(model.body(index).name for index in range(1, model.nbody))
        """Names, in the order of `positions_m` and `rotations`; the world is not among them."""
        sites = tendon_sites(model)
        pairs = [(name, begin, end) for name, places in sites.items() for begin, end in itertools.pairwise(places)]
        self.segments: tuple[str, ...] = tuple(name for name, _, _ in pairs)
        """Name of the tendon that each straight piece belongs to."""
        self._begins = [begin for _, begin, _ in pairs]
        self._ends = [end for _, _, end in pairs]
        self.move({})

    def move(self, positions: Mapping[str, float], base: Base | None = None) -> None:
        """Put joints where they are.

        Args:
            positions: By name, rad or m; those that the model does not have are passed over.
            base: Where the body that carries the robot is; None: where the model has it.

        """
        for name, value in positions.items():
            address = self._address.get(name)
            if address is not None:
                self._data.qpos[address] = value
        mujoco.mj_kinematics(self._model, self._data)
        self._turn, self._matrix, self._shift_m = np.array((1.0, 0.0, 0.0, 0.0)), np.eye(3), np.zeros(3)
        if base is not None:
            back, matrix = np.zeros(4), np.zeros(9)
            mujoco.mju_negQuat(back, self._data.xquat[_BASE])
            mujoco.mju_mulQuat(self._turn, np.array(base.rotation), back)
            mujoco.mju_normalize4(self._turn)
            mujoco.mju_quat2Mat(matrix, self._turn)
            self._matrix = matrix.reshape(3, 3)
            self._shift_m = np.array(base.position_m) - self._matrix @ self._data.xpos[_BASE]

    @property
    def travel_m(self) -> NDArray[np.float64]:
        """Way along the ground to below the base from below where the model has its origin, m."""
        x, y, _ = self._placed(self._data.xpos[_BASE])
        nx, ny, nz = self.ground_matrix[:, 2]
        return np.array((x, y, -(nx * x + ny * y) / nz))

    @property
    def ground_matrix(self) -> NDArray[np.float64]:
        """Axes of the ground as columns: along it, to the left, up from it; level where there is none."""
        if self._ground is None:
            return np.eye(3)
        found: NDArray[np.float64] = self._data.geom_xmat[self._ground].reshape(3, 3)
        return found

    @property
    def ground_rotation(self) -> NDArray[np.float64]:
        """The same as a quaternion (w, x, y, z)."""
        turn = np.zeros(4)
        mujoco.mju_mat2Quat(turn, self.ground_matrix.ravel())
        return turn

    def _placed(self, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        found: NDArray[np.float64] = points_m @ self._matrix.T + self._shift_m
        return found

    @property
    def clearance_m(self) -> float:
        """How far the lowest foot is above the ground, straight up, m; 0 where there is no ground or no foot.

        Bumps of rough ground are left out.
        """
        if self._ground is None or not self._corners:
            return 0.0
        normal = self.ground_matrix[:, 2]
        above_m = (self._placed(self._data.geom_xpos[self._corners]) - self._data.geom_xpos[self._ground]) @ normal
        return float((above_m - self._model.geom_size[self._corners, 0]).min() / normal[2])

    @property
    def positions_m(self) -> NDArray[np.float64]:
        """Origin of each body, shape (bodies, 3), m."""
        return self._placed(self._data.xpos[1:])

    @property
    def rotations(self) -> NDArray[np.float64]:
        """Orientation of each body as a quaternion (w, x, y, z), shape (bodies, 4)."""
        w, x, y, z = self._turn
        left = np.array(((w, -x, -y, -z), (x, w, -z, y), (y, z, w, -x), (z, -y, x, w)))  # quaternions multiply so
        found: NDArray[np.float64] = self._data.xquat[1:] @ left.T
        return found

    @property
    def segment_ends_m(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Begin and end of each straight piece of a tendon, each of shape (segments, 3), m."""
        return self._placed(self._data.site_xpos[self._begins]), self._placed(self._data.site_xpos[self._ends])


def along(
    begins_m: NDArray[np.float64], ends_m: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return how to lay unit cylinders, whose axis is z, along straight pieces.

    Args:
        begins_m: Shape (n, 3), m.
        ends_m: Shape (n, 3), m.

    Returns:
        Quaternions (w, x, y, z), shape (n, 4), and lengths, shape (n,), m.

    """
    way_m = ends_m - begins_m
    length_m: NDArray[np.float64] = np.linalg.norm(way_m, axis=1)
    axis = way_m / np.maximum(length_m, 1e-9)[:, np.newaxis]
    # The shortest turn from z to the axis: half the angle, about z cross axis.
    turn = np.stack((1.0 + axis[:, 2], -axis[:, 1], axis[:, 0], np.zeros(len(axis))), axis=1)
    size = np.linalg.norm(turn, axis=1)
    turn[size < 1e-6] = (0.0, 1.0, 0.0, 0.0)  # noqa: PLR2004 - straight down: half a turn about x
    rotation: NDArray[np.float64] = turn / np.where(size < 1e-6, 1.0, size)[:, np.newaxis]  # noqa: PLR2004 - as above
    return rotation, length_m
