"""Joints of a model and the actuators that drive them: what an actuator takes, and how it becomes a PD controller."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from jammkle_gap.mujoco.runs import Gains, Quantity
from jammkle_sim.physics.engine import mujoco

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from jammkle_gap.mujoco.runs import Run


@dataclass(frozen=True)
class Drive:
    """An actuator that the recordings command."""

    joint: str
    actuator: str
    quantity: Quantity
    """POSITION or VELOCITY, as its set point is."""
    feeds_velocity: bool
    """Whether commanded velocities are fed forward by its kd."""
    feeds_effort: bool
    """Whether commanded efforts are fed forward."""


def joint_of(model: mujoco.MjModel, actuator: int) -> str:
    """Return the name of the joint that an actuator acts on; empty for one on a tendon, a site or a body."""
    kinds = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
    on_joint = int(model.actuator_trntype[actuator]) in kinds
    return str(model.joint(int(model.actuator_trnid[actuator, 0])).name) if on_joint else ""


def joints_of(model: mujoco.MjModel) -> list[str]:
    """Return the names of hinges and slides."""
    kinds = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
    return [name for k in range(model.njnt) if int(model.jnt_type[k]) in kinds and (name := model.joint(k).name)]


def actuators_of(spec: mujoco.MjSpec, joint: str) -> list[mujoco.MjsActuator]:
    """Return the actuators that act on a joint."""
    kinds = {mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT}
    return [each for each in spec.actuators if each.trntype in kinds and each.target == joint]


def add_motor(spec: mujoco.MjSpec, joint: str) -> mujoco.MjsActuator:
    """Give a joint an actuator of torque, by its name where no other actuator has that."""
    return spec.add_actuator(name=free_name(spec, joint), trntype=mujoco.mjtTrn.mjTRN_JOINT, target=joint)


def free_name(spec: mujoco.MjSpec, joint: str) -> str:
    """Return a name for an actuator of a joint that no actuator has."""
    taken = {each.name for each in spec.actuators}
    return next(name for k in itertools.count(1) if (name := joint if k == 1 else f"{joint}_{k}") not in taken)


def actuator_kind(each: mujoco.MjsActuator) -> Quantity | None:
    """Return what an actuator takes; None for what the library does not know, such as a muscle."""
    simple = each.gaintype == mujoco.mjtGain.mjGAIN_FIXED and each.dyntype == mujoco.mjtDyn.mjDYN_NONE
    if not simple:
        return None
    if each.biastype == mujoco.mjtBias.mjBIAS_NONE:
        return Quantity.EFFORT
    if each.biastype != mujoco.mjtBias.mjBIAS_AFFINE:
        return None
    if each.biasprm[1] != 0.0:
        return Quantity.POSITION
    return Quantity.VELOCITY if each.biasprm[2] != 0.0 else Quantity.EFFORT


def _is_limited(said: int, limits: NDArray[np.float64]) -> bool:
    """Return whether a range counts, as MuJoCo decides: where it is said, or left open and the range is not empty."""
    return said == mujoco.mjtLimited.mjLIMITED_TRUE or (
        said == mujoco.mjtLimited.mjLIMITED_AUTO and bool(limits[0] < limits[1])
    )


def take_gear(actuator: mujoco.MjsActuator) -> None:
    """Put the gear of an actuator into its numbers, so that set points are of the joint, as commands of ROS are.

    MuJoCo's force `gain ctrl + b0 + b1 g q + b2 g dq` acts on the joint g times, with `ctrl` of g times the joint.
    """
    gear = float(actuator.gear[0])
    if gear == 1.0:
        return
    actuator.gainprm = gear**2 * np.array(actuator.gainprm)
    powers = np.full_like(actuator.biasprm, gear**2)
    powers[0] = gear
    actuator.biasprm = powers * np.array(actuator.biasprm)
    actuator.forcerange = np.sort(gear * np.array(actuator.forcerange))
    actuator.ctrlrange = np.sort(np.array(actuator.ctrlrange) / gear)
    actuator.gear = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0])


def become_pd(actuator: mujoco.MjsActuator, gains: Gains, wanted: Quantity) -> None:
    """Make an actuator `kp (set point - q) - kd dq`, or `kd (set point - dq)`; its limit of torque stays.

    A motor may have its limit as a range of controls, which are torques then.
    """
    gear = float(actuator.gear[0]) or 1.0
    controls = np.array(actuator.ctrlrange)
    if actuator_kind(actuator) is Quantity.EFFORT and _is_limited(actuator.ctrllimited, controls):
        limits = np.sort(float(actuator.gainprm[0]) * controls)
        own = np.array(actuator.forcerange)
        if _is_limited(actuator.forcelimited, own):
            limits = np.array([max(limits[0], own[0]), min(limits[1], own[1])])
        actuator.forcerange, actuator.forcelimited = limits, mujoco.mjtLimited.mjLIMITED_TRUE
    actuator.forcerange = np.sort(gear * np.array(actuator.forcerange))
    actuator.gear = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    actuator.ctrllimited = False
    actuator.gaintype, actuator.biastype = mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtBias.mjBIAS_AFFINE
    actuator.dyntype = mujoco.mjtDyn.mjDYN_NONE
    gain, bias = np.zeros_like(actuator.gainprm), np.zeros_like(actuator.biasprm)
    if wanted is Quantity.POSITION:
        gain[0], bias[1], bias[2] = gains.kp, -gains.kp, -gains.kd
    else:
        gain[0], bias[2] = gains.kd, -gains.kd
    actuator.gainprm, actuator.biasprm = gain, bias


def estimated_gains(runs: Sequence[Run], joint: str, wanted: Quantity) -> Gains | None:
    """Return the gains that recorded efforts show, by least squares; None without efforts, or where they show none."""
    rows, efforts = [], []
    for run in runs:
        effort = run.measured.get((joint, Quantity.EFFORT))
        if effort is None:
            return None
        position = run.measured[joint, Quantity.POSITION]
        rate = np.gradient(position.values, position.time_s)
        asked = run.commands[joint, wanted].at(position.time_s)
        error = asked - (position.values if wanted is Quantity.POSITION else rate)
        rows.append(np.column_stack([error, -rate, np.ones_like(rate)]))
        fed = run.commands.get((joint, Quantity.EFFORT))
        efforts.append(effort.at(position.time_s) - (0.0 if fed is None else fed.at(position.time_s)))
    table = np.concatenate(rows)
    if wanted is Quantity.VELOCITY:
        table[:, 1] = 0.0
    (first, damping, _), *_ = np.linalg.lstsq(table, np.concatenate(efforts), rcond=None)
    if first <= 0.0:
        return None
    return Gains(float(first), max(float(damping), 0.0)) if wanted is Quantity.POSITION else Gains(0.0, float(first))
