"""What the servos of a robot give, as drives tell it: in the mean since they got their latest targets."""

from __future__ import annotations

from typing import Any

import numpy as np

from jammkle_sim.physics.engine import mujoco


class Servos:
    """Efforts of a robot's joints.

    Targets come in steps, and so do the efforts; a drive tells its current low-passed. Of a spring and a damper toward
    a target that holds, the mean effort is that at the mean place and at the way made by the time.
    """

    def __init__(self, model: Any, data: Any) -> None:
        """Look at the servos of a model: actuators that act on one hinge or slide, with a fixed gain."""
        self._data = data
        on_joint = model.actuator_trntype == int(mujoco.mjtTrn.mjTRN_JOINT)
        steady = model.actuator_gaintype == int(mujoco.mjtGain.mjGAIN_FIXED)
        self._at = np.flatnonzero(on_joint & steady)
        joints = model.actuator_trnid[self._at, 0]
        self._joints = {model.joint(int(joint)).name: i for i, joint in enumerate(joints)}
        self._places = model.jnt_qposadr[joints]
        self._gear = model.actuator_gear[self._at, 0]
        self._gain = model.actuator_gainprm[self._at, 0]
        self._bias = model.actuator_biasprm[self._at, :3].T
        limited = model.actuator_forcelimited[self._at].astype(bool)
        self._limit = np.where(limited[:, None], model.actuator_forcerange[self._at], (-np.inf, np.inf)).T
        self.retarget()

    def retarget(self) -> None:
        """Note where the joints are as new targets come."""
        self._first = self._gear * self._data.qpos[self._places]
        self._first_s = float(self._data.time)

    def effort(self, joint: str) -> float:
        """Return the effort on a joint, N m or N, in the mean since the latest targets; 0 where it has no servo."""
        i = self._joints.get(joint)
        elapsed_s = float(self._data.time) - self._first_s
        if i is None or elapsed_s <= 0.0:
            return 0.0 if i is None else float(self._gear[i] * self._data.actuator_force[self._at[i]])
        first, now = float(self._first[i]), float(self._gear[i] * self._data.qpos[self._places[i]])
        constant, spring, damper = self._bias[:, i].tolist()
        force = self._gain[i] * self._data.ctrl[self._at[i]] + constant + spring * (first + now) / 2.0
        force += damper * (now - first) / elapsed_s
        return float(self._gear[i] * min(max(force, self._limit[0, i]), self._limit[1, i]))
