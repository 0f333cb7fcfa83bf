"""Joints that nobody measured and that equalities of the model couple to measured ones: mimic joints, closed chains.

They are where the equalities put them, move as these let them, and hand on what moves them: with the rows J of the
equalities, split into coupled joints u that no motor moves and all others m, `J_u v_u + J_m v_m = 0`, and their effort
`tau_u` acts on the others as `-J_m^T (J_u^T)^+ tau_u` (d'Alembert; Featherstone 2008, Rigid Body Dynamics Algorithms,
chapter 8).
"""

from __future__ import annotations

import copy
from typing import TYPE_CHECKING

import numpy as np

from jammkle_sim.physics.engine import mujoco

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from numpy.typing import NDArray

    Array = NDArray[np.float64]

_STEPS = 10
"""From the model's own pose to a measured one, each solved from the last. Chosen: a tenth of a turn at most."""
_ITERATIONS = 20
_CLOSED = 1e-10
"""Change, rad or m, at which an equality counts as solved."""
_ACTS = 1e-9
"""Entry of a Jacobian from which on a joint counts as coupled."""
_DECIDED = 1e-6
"""Share of the largest singular value from which on the equalities decide a direction."""


def followers_of(model: mujoco.MjModel, known: Iterable[int]) -> list[int]:
    """Return the joints that equalities couple to known ones, directly or by other joints; by number."""
    pose = model.qpos0.copy()
    turned = np.random.default_rng(0).uniform(0.02, 0.1, model.nv)
    mujoco.mj_integratePos(model, pose, turned, 1.0)  # away from poses in which an entry happens to be 0
    rows = np.abs(Equalities(model, ()).rows(pose)[0]) > _ACTS
    free = int(mujoco.mjtJoint.mjJNT_FREE)
    groups = [
        {int(joint) for joint in model.dof_jntid[np.flatnonzero(row)] if int(model.jnt_type[joint]) != free}
        for row in rows
    ]
    asked = set(known)
    reached = set(asked)
    while further := {joint for group in groups if group & reached for joint in group} - reached:
        reached |= further
    return sorted(reached - asked)


class Equalities:
    """What the active equalities of a model say of some of its degrees of freedom, the coupled ones."""

    def __init__(self, model: mujoco.MjModel, coupled: Sequence[int]) -> None:
        """Take a model, and the coupled degrees of freedom."""
        self._model = copy.copy(model)
        self._model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
        bits = mujoco.mjtDisableBit
        for each in (bits.mjDSBL_CONTACT, bits.mjDSBL_LIMIT, bits.mjDSBL_FRICTIONLOSS):
            self._model.opt.disableflags |= int(each)
        self._data = mujoco.MjData(self._model)
        self._coupled = list(coupled)
        self._others = [dof for dof in range(model.nv) if dof not in self._coupled]

    def rows(self, position: Array) -> tuple[Array, Array]:
        """Return Jacobian and violation of all equalities at a pose, shapes (rows, nv) and (rows,)."""
        data = self._data
        data.qpos[:] = position
        mujoco.mj_fwdPosition(self._model, data)
        return data.efc_J.reshape(data.nefc, self._model.nv).copy(), data.efc_pos.copy()

    def _own_rows(self, position: Array) -> tuple[Array, Array]:
        table, violation = self.rows(position)
        own = (np.abs(table[:, self._coupled]) > _ACTS).any(axis=1)
        return table[own], violation[own]

    def placed(self, position: Array, start: Array | None = None) -> Array:
        """Return a pose in which the coupled joints are where the equalities put them, by Gauss-Newton.

        Args:
            position: Shape (nq,); what it says of the coupled joints does not count.
            start: A solved pose nearby; the model's own pose, from where it goes in steps, if there is none.

        """
        model = self._model
        steps = _STEPS if start is None else 1
        found: Array = model.qpos0.copy() if start is None else start.copy()
        way = np.zeros(model.nv)
        mujoco.mj_differentiatePos(model, way, 1.0, found, position)
        way[self._coupled] = 0.0
        change = np.zeros(model.nv)
        for _ in range(steps):
            mujoco.mj_integratePos(model, found, way, 1.0 / steps)
            for _ in range(_ITERATIONS):
                table, violation = self._own_rows(found)
                change[self._coupled] = -np.linalg.pinv(table[:, self._coupled], _DECIDED) @ violation
                mujoco.mj_integratePos(model, found, change, 1.0)
                if np.abs(change).max(initial=0.0) < _CLOSED:
                    break
        return found

    def moved(self, position: Array, velocity: Array) -> Array:
        """Return a velocity, shape (nv,), in which the coupled joints move as the equalities let them."""
        table, _ = self._own_rows(position)
        found: Array = velocity.copy()
        rest = table[:, self._others] @ velocity[self._others]
        found[self._coupled] = -np.linalg.pinv(table[:, self._coupled], _DECIDED) @ rest
        return found

    def handed_on(self, position: Array, effort: Array) -> Array:
        """Return efforts, shape (nv,), with which the others alone do what all of them would."""
        table, _ = self._own_rows(position)
        found: Array = effort.copy()
        forces = np.linalg.pinv(table[:, self._coupled].T, _DECIDED) @ effort[self._coupled]
        found[self._others] -= table[:, self._others].T @ forces
        found[self._coupled] = 0.0
        return found
