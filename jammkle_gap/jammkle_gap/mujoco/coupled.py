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
_SOLVED = 1e-6
"""Violation, m or rad, up to which a chain is closed."""
_LONGEST = 0.2
"""Longest step of the iteration, rad or m. Chosen: small beside a turn, so that it stays on its way."""
_ACTS = 1e-9
"""Entry of a Jacobian from which on a joint counts as coupled."""
_DECIDED = 1e-6
"""Share of the largest singular value from which on the equalities decide a direction."""


def followers_of(model: mujoco.MjModel, known: Iterable[int]) -> list[int]:
    """Return the joints that equalities couple to known ones, directly or by other joints; by number."""
    pose = model.qpos0.copy()
    turned = np.random.default_rng(0).uniform(0.02, 0.1, model.nv)
    mujoco.mj_integratePos(model, pose, turned, 1.0)  # away from poses in which an entry happens to be 0
    rows = np.abs(Equalities(model, ()).relative(pose)) > _ACTS
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

    def relative(self, position: Array) -> Array:
        """Return the Jacobian at a pose that need not close, without what moves both bodies of an equality together."""
        table, _ = self.rows(position)
        model = self._model
        bodies = {int(mujoco.mjtEq.mjEQ_CONNECT), int(mujoco.mjtEq.mjEQ_WELD)}
        site = int(mujoco.mjtObj.mjOBJ_SITE)
        for row, number in zip(table, self._data.efc_id.tolist(), strict=True):
            if int(model.eq_type[number]) not in bodies:
                continue
            ends = [int(model.eq_obj1id[number]), int(model.eq_obj2id[number])]
            if int(model.eq_objtype[number]) == site:
                ends = [int(model.site_bodyid[end]) for end in ends]
            first, second = (self._movers(end) for end in ends)
            row[list(first & second)] = 0.0
        return table

    def _movers(self, body: int) -> set[int]:
        """Return the degrees of freedom that move a body."""
        model, found = self._model, set[int]()
        while body:
            first = int(model.body_dofadr[body])
            found |= set(range(first, first + int(model.body_dofnum[body]))) if first >= 0 else set()
            body = int(model.body_parentid[body])
        return found

    def _own_rows(self, position: Array) -> tuple[Array, Array]:
        table, violation = self.rows(position)
        own = (np.abs(table[:, self._coupled]) > _ACTS).any(axis=1)
        return table[own], violation[own]

    def placed(self, position: Array, start: Array | None = None) -> Array:
        """Return a pose in which the coupled joints are where the equalities put them, by Gauss-Newton.

        A chain may close in several ways: coupled joints stay within their ranges, and of the model's own pose and the
        middle of these ranges the first begins that closes it.

        Args:
            position: Shape (nq,); what it says of the coupled joints does not count.
            start: A solved pose nearby, if there is one.

        """
        if start is not None:
            return self._followed(position, start, 1)
        begins = (self._model.qpos0, self._middle())
        found = [self._followed(position, begin, _STEPS) for begin in begins]
        left = [float(np.abs(self._own_rows(each)[1]).max(initial=0.0)) for each in found]
        return found[0] if left[0] < _SOLVED else found[int(np.argmin(left))]

    def _limited(self) -> list[int]:
        """Return the coupled hinges and slides that have a range."""
        model = self._model
        joints = {int(model.dof_jntid[dof]) for dof in self._coupled}
        ball = int(mujoco.mjtJoint.mjJNT_BALL)
        return [joint for joint in joints if model.jnt_limited[joint] and int(model.jnt_type[joint]) != ball]

    def _middle(self) -> Array:
        pose: Array = self._model.qpos0.copy()
        for joint in self._limited():
            pose[int(self._model.jnt_qposadr[joint])] = self._model.jnt_range[joint].mean()
        return pose

    def _followed(self, position: Array, start: Array, steps: int) -> Array:
        model = self._model
        found: Array = start.copy()
        way = np.zeros(model.nv)
        mujoco.mj_differentiatePos(model, way, 1.0, found, position)
        way[self._coupled] = 0.0
        change = np.zeros(model.nv)
        limited = self._limited()
        places, ranges = model.jnt_qposadr[limited], model.jnt_range[limited]
        for _ in range(steps):
            mujoco.mj_integratePos(model, found, way, 1.0 / steps)
            for _ in range(_ITERATIONS):
                table, violation = self._own_rows(found)
                step = -np.linalg.pinv(table[:, self._coupled], _DECIDED) @ violation
                change[self._coupled] = step * min(_LONGEST / max(float(np.abs(step).max(initial=0.0)), 1e-12), 1.0)
                mujoco.mj_integratePos(model, found, change, 1.0)
                found[places] = np.clip(found[places], *ranges.T)
                if np.abs(step).max(initial=0.0) < _CLOSED:
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
