"""What effects and constants change in a machine.

Every function takes what it is bound to first (a joint, a body, a field), then the machine and the values of the
parameters, in order. All of them can be pickled, so that runs may be spread over processes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from jammkle_sim.physics.engine import mujoco

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from jammkle_gap.mujoco.simulator import Machine

    JointChange = Callable[[str, Machine, Sequence[float]], None]
    """Changes one joint of a machine."""


def change_joints(
    change: JointChange,
    joints: tuple[str, ...],
    sizes: tuple[tuple[float, ...], ...],
    machine: Machine,
    values: Sequence[float],
) -> None:
    """Make a change to several joints: each value times its size, shape (joints, values)."""
    for joint, own in zip(joints, sizes, strict=True):
        change(joint, machine, [value * size for value, size in zip(values, own, strict=True)])


def put(field: str, key: str, machine: Machine, values: Sequence[float]) -> None:
    """Add to one entry of a nonideality, a number or several: an effect of all joints and one of each act together."""
    entries = getattr(machine, field)
    own = list(values)
    if key in entries and field == "sensor_scale":
        own = [entries[key] * values[0]]
    elif key in entries and field == "stribeck":  # the speed is that of the last
        own = [entries[key][0] + values[0], values[1]]
    elif key in entries:
        before = entries[key] if len(values) > 1 else (entries[key],)
        own = [one + more for one, more in zip(before, values, strict=True)]
    entries[key] = own[0] if len(own) == 1 else tuple(own)


def change_timing(field: str, machine: Machine, values: Sequence[float]) -> None:
    """Let commands or readings come late, or a clock be fast; a field of `Machine`."""
    setattr(machine, field, getattr(machine, field) + values[0])


def add_to_dof(field: str, joint: str, machine: Machine, values: Sequence[float]) -> None:
    """Add to the friction, damping or armature that the model has of a joint."""
    getattr(machine.model, field)[machine.robot.dof(joint)] += values[0]


def scale_dof(field: str, joint: str, machine: Machine, values: Sequence[float]) -> None:
    """Scale the same."""
    getattr(machine.model, field)[machine.robot.dof(joint)] *= values[0]


def scale_torque_constant(joint: str, machine: Machine, values: Sequence[float]) -> None:
    """Scale the torque that a motor gives per current, from which its effort is reckoned."""
    _scale_drive(machine, joint, values[0], fed=True)
    machine.effort_scale[joint] = machine.effort_scale.get(joint, 1.0) / values[0]


def scale_effort(joint: str, machine: Machine, values: Sequence[float]) -> None:
    """Scale the reading of an effort."""
    machine.effort_scale[joint] = machine.effort_scale.get(joint, 1.0) * values[0]


def scale_position_gain(joint: str, machine: Machine, values: Sequence[float]) -> None:
    """Scale the position gain of a drive."""
    actuator = _actuator(machine, joint)
    actuator.gainprm[0] *= values[0]
    actuator.biasprm[1] *= values[0]


def scale_velocity_gain(joint: str, machine: Machine, values: Sequence[float]) -> None:
    """Scale the velocity gain of a drive."""
    actuator = _actuator(machine, joint)
    actuator.biasprm[2] *= values[0]
    if actuator.biasprm[1] == 0.0:
        actuator.gainprm[0] *= values[0]


def scale_gains(joint: str, machine: Machine, values: Sequence[float]) -> None:
    """Scale both gains of a drive."""
    scale_position_gain(joint, machine, values)
    scale_velocity_gain(joint, machine, values)


def limit_torque(joint: str, machine: Machine, values: Sequence[float]) -> None:
    """Limit the torque of a drive, N m or N; a limit of the model's that is lower stays."""
    actuator = _actuator(machine, joint)
    low, high = actuator.forcerange if machine.model.actuator_forcelimited[actuator.id] else (-np.inf, np.inf)
    machine.model.actuator_forcelimited[actuator.id] = 1
    actuator.forcerange[:] = max(-values[0], low), min(values[0], high)


def soften_transmission(joint: str, machine: Machine, values: Sequence[float]) -> None:
    """Put a massless spring between encoder and link, rad/(N m) or m/N: in series with the drive."""
    _scale_drive(machine, joint, 1.0 / (1.0 + values[0] * _actuator(machine, joint).gainprm[0]), fed=True)
    machine.compliance[joint] = machine.compliance.get(joint, 0.0) + values[0]


def scale_encoder(joint: str, machine: Machine, values: Sequence[float]) -> None:
    """Scale the reading of an encoder, which its drive regulates."""
    machine.scale[joint] = machine.scale.get(joint, 1.0) * values[0]
    _scale_drive(machine, joint, values[0], fed=False)


def _actuator(machine: Machine, joint: str) -> Any:
    return next(machine.model.actuator(each.actuator) for each in machine.robot.drives if each.joint == joint)


def _scale_drive(machine: Machine, joint: str, factor: float, *, fed: bool) -> None:
    """Scale what a drive makes of its set points, if the joint has one, and what arrives of efforts fed forward."""
    for drive in machine.robot.drives:
        if drive.joint == joint:
            actuator = machine.model.actuator(drive.actuator)
            actuator.gainprm[:] *= factor
            actuator.biasprm[:] *= factor
            if fed and drive.feeds_effort:
                machine.fed_share[joint] = machine.fed_share.get(joint, 1.0) * factor


def hold_weight(driven: tuple[str, ...], passive: tuple[str, ...], machine: Machine, values: Sequence[float]) -> None:
    """Let drives hold a share of the weight beside their set points; at joints without a drive nothing holds any."""
    model = machine.model
    for joint in (*driven, *passive):
        model.jnt_actgravcomp[model.joint(joint).id] = 1
    for joint in passive:  # what would act there is cut to nothing
        number = model.joint(joint).id
        model.jnt_actfrclimited[number], model.jnt_actfrcrange[number] = 1, (-_NOTHING, _NOTHING)
    model.body_gravcomp[:] += values[0]


_NOTHING = 1e-9
"""Limit of a torque or force that is none, N m or N: MuJoCo takes no empty range."""


def put_stop(joint: str, upper: bool, machine: Machine, values: Sequence[float]) -> None:  # noqa: FBT001 - lower, or upper
    """Put an end stop that a joint meets before the model's own, rad or m."""
    model = machine.model
    number = model.joint(joint).id
    if not model.jnt_limited[number]:
        model.jnt_limited[number], model.jnt_range[number] = 1, (-_ENDLESS, _ENDLESS)
    nearer = min if upper else max
    model.jnt_range[number, int(upper)] = nearer(model.jnt_range[number, int(upper)], values[0])


_ENDLESS = 1e6
"""Range of a joint that has none, rad or m."""


def scale_mass(body: str, machine: Machine, values: Sequence[float]) -> None:
    """Scale the mass of a body, inertia with it."""
    number = machine.model.body(body).id
    machine.model.body_mass[number] *= values[0]
    machine.model.body_inertia[number] *= values[0]


def scale_length(body: str, machine: Machine, values: Sequence[float]) -> None:
    """Scale the length of a link: what hangs on it, its centre of mass, and its inertia."""
    model = machine.model
    number = model.body(body).id
    model.body_ipos[number] *= values[0]
    model.body_inertia[number] *= values[0] ** 2
    model.body_pos[model.body_parentid == number] *= values[0]


def move_centre(body: str, machine: Machine, values: Sequence[float]) -> None:
    """Move the centre of mass of a body, m."""
    machine.model.body_ipos[machine.model.body(body).id] += np.array(values)


def add_payload(body: str, place_m: tuple[float, float, float], machine: Machine, values: Sequence[float]) -> None:
    """Fix a small mass, kg, to a place in a body's frame: masses, centres and inertias add up (parallel axes)."""
    model = machine.model
    number = model.body(body).id
    flat = np.zeros(9)
    mujoco.mju_quat2Mat(flat, model.body_iquat[number])
    turn = flat.reshape(3, 3)
    own, added = float(model.body_mass[number]), float(values[0])
    at, place = model.body_ipos[number].copy(), np.array(place_m)
    centre = (own * at + added * place) / (own + added)
    tensor = turn @ np.diag(model.body_inertia[number]) @ turn.T
    for mass, where in ((own, at - centre), (added, place - centre)):
        tensor = tensor + mass * (where @ where * np.eye(3) - np.outer(where, where))
    moments, axes = np.linalg.eigh(tensor)
    if np.linalg.det(axes) < 0.0:
        axes[:, 0] *= -1.0
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, axes.ravel())
    model.body_mass[number], model.body_ipos[number] = own + added, centre
    model.body_inertia[number], model.body_iquat[number] = moments, quaternion


def tilt_base(machine: Machine, values: Sequence[float]) -> None:
    """Put the base askew by roll and pitch, rad: gravity turns against it."""
    roll, pitch = values
    turn = np.zeros(9)
    quaternion = np.zeros(4)
    mujoco.mju_euler2Quat(quaternion, np.array([roll, pitch, 0.0]), "xyz")
    mujoco.mju_quat2Mat(turn, quaternion)
    machine.model.opt.gravity[:] = turn.reshape(3, 3).T @ machine.model.opt.gravity


def scale_contact_friction(machine: Machine, values: Sequence[float]) -> None:
    """Scale the friction of all contacts."""
    machine.model.geom_friction[:, 0] *= values[0]


def scale_contact_time(machine: Machine, values: Sequence[float]) -> None:
    """Scale the time in which contacts come to rest, or what the model has of their stiffness and damping."""
    table, scale = machine.model.geom_solref, values[0]
    direct = table[:, 0] < 0.0
    table[~direct, 0] *= scale
    table[direct] /= [scale**2, scale]
