"""What may be wrong with any robot, and what it changes in a machine.

Bounds are shares of what the recorded motion takes (torque, speed, inertia), so that one table serves a finger and a
hip; each entry says where its share comes from.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from jammkle_sim.physics.engine import mujoco

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from jammkle_gap.core.data import Recording
    from jammkle_gap.mujoco.robot import Robot
    from jammkle_gap.mujoco.simulator import Machine, Motion

    Array = NDArray[np.float64]
    Apply = Callable[[str, Machine, Sequence[float]], None]
    """Changes a joint of a machine by the values of an effect's parameters, in order."""


@dataclass(frozen=True)
class Scale:
    """What the recorded motion asks of one joint, by which bounds are set."""

    torque: float
    """Largest that inverse dynamics of the nominal model gives, N m or N."""
    speed: float
    """Largest, rad/s or m/s."""
    inertia: float
    """That a motor on the joint turns, kg m^2 or kg."""
    stiffness: float
    """kp of its drive, N m/rad or N/m; nan without one."""
    turning: bool
    reach: tuple[float, float]
    """Least and largest position that was measured, rad or m."""


def scales_of(robot: Robot, recordings: Sequence[Recording]) -> dict[str, Scale]:
    """Return the scale of every measured joint."""
    model = robot.model
    data = mujoco.MjData(model)
    positions = [int(model.joint(name).qposadr[0]) for name in robot.joints]
    dofs = [robot.dof(name) for name in robot.joints]
    torque, speed, inertia = (np.zeros(len(dofs)) for _ in range(3))
    lowest, highest = np.full(len(dofs), np.inf), np.full(len(dofs), -np.inf)
    for recording in recordings:
        motion: Motion = recording.inputs
        lowest = np.minimum(lowest, motion.position.min(axis=0))
        highest = np.maximum(highest, motion.position.max(axis=0))
        speed = np.maximum(speed, np.abs(motion.velocity).max(axis=0))
        for k in range(0, len(motion.position), max(len(motion.position) // _SAMPLES, 1)):
            data.qpos[positions], data.qvel[dofs] = motion.position[k], motion.velocity[k]
            data.qacc[dofs] = motion.acceleration[k]
            mujoco.mj_inverse(model, data)
            torque = np.maximum(torque, np.abs(data.qfrc_inverse[dofs]))
            mass = np.zeros((model.nv, model.nv))
            mujoco.mj_fullM(model, data, mass)
            inertia = np.maximum(inertia, np.diag(mass)[dofs])
    turning = [robot.is_turning(name) for name in robot.joints]
    for kind in (True, False):
        own = np.array([each == kind for each in turning])
        if own.any():
            torque[own] = np.maximum(torque[own], _LEAST * torque[own].max())
            speed[own] = np.maximum(speed[own], _LEAST * speed[own].max())
    kp = {each.joint: float(model.actuator(each.actuator).gainprm[0]) for each in robot.drives}
    return {
        name: Scale(
            float(torque[k]),
            float(speed[k]),
            float(inertia[k]),
            kp.get(name, float("nan")),
            turning[k],
            (float(lowest[k]), float(highest[k])),
        )
        for k, name in enumerate(robot.joints)
    }


_SAMPLES = 200
"""Of a recording that the largest torque is taken from."""
_LEAST = 0.05
"""Of the largest joint's scale that any joint has: one without load may rub too."""


@dataclass(frozen=True)
class Number:
    """A parameter of a family; in the unit of the scale that it goes with."""

    name: str
    scale: str
    null: float
    minimum: float
    maximum: float
    source: str
    shares: tuple[float, ...] = ()
    """Of the way from null to a bound, at which a search simulates it; see `EffectParameter`."""


UNITS = {
    "torque": ("N m", "N"),
    "damping": ("N m s/rad", "N s/m"),
    "speed": ("rad/s", "m/s"),
    "inertia": ("kg m^2", "kg"),
    "compliance": ("rad/(N m)", "m/N"),
    "angle": ("rad", "m"),
    "time": ("s", "s"),
    "share": ("1", "1"),
}
_METRES = 0.2
"""Length of a slide that counts as one rad of a hinge, m."""


def size_of(scale: str, own: Scale) -> float:
    """Return what a number of a family is measured in, on one joint."""
    return {
        "torque": own.torque,
        "damping": own.torque / own.speed,
        "speed": own.speed,
        "inertia": own.inertia,
        "compliance": 1.0 / own.stiffness,
        "angle": 1.0 if own.turning else _METRES,
        "time": 1.0,
        "share": 1.0,
    }[scale]


@dataclass(frozen=True)
class Family:
    """An effect that every joint may have."""

    name: str
    subsystem: str
    numbers: tuple[Number, ...]
    apply: Apply
    finding: str
    """What is wrong with `{where}`."""
    check: str
    drive: bool = False
    """Whether it needs a drive that follows set points."""
    position: bool = False
    """Whether that drive must be one of position."""


def _add(field: str, joint: str, machine: Machine, values: Sequence[float]) -> None:
    """Add to what the model has of a degree of freedom."""
    getattr(machine.model, field)[machine.robot.dof(joint)] += values[0]


def _put(field: str, joint: str, machine: Machine, values: Sequence[float]) -> None:
    """Put a number of a joint beside the model."""
    getattr(machine, field)[joint] = values[0]


def _stribeck(joint: str, machine: Machine, values: Sequence[float]) -> None:
    machine.stribeck[joint] = (values[0], values[1])


def _actuator(machine: Machine, joint: str) -> Any:
    return next(machine.model.actuator(each.actuator) for each in machine.robot.drives if each.joint == joint)


def _torque_constant(joint: str, machine: Machine, values: Sequence[float]) -> None:
    if machine.robot.drives:
        actuator = _actuator(machine, joint)
        actuator.gainprm[:] *= values[0]
        actuator.biasprm[:] *= values[0]
        _share_fed(machine, joint, values[0])
    machine.effort_scale[joint] = machine.effort_scale.get(joint, 1.0) / values[0]


def _share_fed(machine: Machine, joint: str, share: float) -> None:
    """Let a share of commanded efforts arrive, where there are any."""
    if any(each.joint == joint and each.feeding for each in machine.robot.drives):
        machine.fed_share[joint] = machine.fed_share.get(joint, 1.0) * share


def change_position_gain(joint: str, machine: Machine, values: Sequence[float]) -> None:
    """Scale the position gain of a drive."""
    actuator = _actuator(machine, joint)
    actuator.gainprm[0] *= values[0]
    actuator.biasprm[1] *= values[0]


def change_rate_gain(joint: str, machine: Machine, values: Sequence[float]) -> None:
    """Scale the velocity gain of a drive."""
    actuator = _actuator(machine, joint)
    actuator.biasprm[2] *= values[0]
    if actuator.biasprm[1] == 0.0:
        actuator.gainprm[0] *= values[0]


def _limit(joint: str, machine: Machine, values: Sequence[float]) -> None:
    actuator = _actuator(machine, joint)
    machine.model.actuator_forcelimited[actuator.id] = 1
    own = actuator.forcerange[1] if actuator.forcerange[1] > 0.0 else np.inf
    actuator.forcerange[:] = np.array([-1.0, 1.0]) * min(values[0], own)


def _compliance(joint: str, machine: Machine, values: Sequence[float]) -> None:
    # A stiff spring behind the encoder, without a mass of its own: the drive stands in series with it.
    actuator = _actuator(machine, joint)
    softer = 1.0 / (1.0 + values[0] * actuator.gainprm[0])
    actuator.gainprm[:] *= softer
    actuator.biasprm[:] *= softer
    _share_fed(machine, joint, softer)
    machine.compliance[joint] = values[0]


def _gear(joint: str, machine: Machine, values: Sequence[float]) -> None:
    machine.scale[joint] = values[0]
    if any(each.joint == joint for each in machine.robot.drives):
        actuator = _actuator(machine, joint)
        actuator.gainprm[:] *= values[0]
        actuator.biasprm[:] *= values[0]


_SHEETS = "data sheets of gears and servos: no-load running torque of a tenth to a half of the rated one"
_BY_MOTION = "assumed: up to what the motion takes of torque, and four times that of a torque that grows with speed"
FAMILIES = (
    Family("friction", "joints", (Number("torque", "torque", 0.0, 0.0, 1.0, _BY_MOTION),),
           partial(_add, "dof_frictionloss"), "{where} rub more than the model says",
           "turn by hand with the motors off; look at bearings and seals"),
    Family("damping", "joints", (Number("coefficient", "damping", 0.0, 0.0, 4.0, _BY_MOTION),),
           partial(_add, "dof_damping"), "{where} are slowed by their speed more than the model says",
           "look at the grease and its temperature"),
    Family("stribeck", "joints",
           (Number("torque", "torque", 0.0, 0.0, 0.8, _SHEETS),
            Number("speed", "speed", 0.1, 0.02, 0.3, "Armstrong-Helouvry 1991: a hundredth to a third of the speed")),
           _stribeck, "{where} stick before they slide", "look at the lubrication, and at preload of the bearings"),
    Family("load_friction", "joints",
           (Number("share", "share", 0.0, 0.0, 0.8, "gears of 43 to 100 %: 2 (1 - eta) / (1 + eta)"),),
           partial(_put, "load_friction"), "gears of {where} rub in proportion to their load",
           "look at the wear of the gears"),
    Family("armature", "joints",
           (Number("inertia", "inertia", 0.0, 0.0, 2.0, "rotors by the gear ratio squared: twice that of links"),),
           partial(_add, "dof_armature"), "{where} have more rotor inertia than the model",
           "look up rotor and gear in the data sheet"),
    Family("torque_constant", "drives",
           (Number("scale", "share", 1.0, 0.6, 1.4, "motors from hot to cold, and wrong entries of a data sheet"),),
           _torque_constant, "motors of {where} give another torque per current",
           "compare torque constant and gear ratio with the data sheet"),
    Family("position_gain", "drives", (Number("scale", "share", 1.0, 0.5, 2.0, "assumed: half to double"),),
           change_position_gain, "drives of {where} have another position gain", "read kp from the controller",
           drive=True, position=True),
    Family("rate_gain", "drives", (Number("scale", "share", 1.0, 0.2, 3.0, "assumed: a fifth to threefold"),),
           change_rate_gain, "drives of {where} have another velocity gain", "read kd from the controller", drive=True),
    # 1, 0.9, 0.7, 0.45, 0.25 and 0.1 of what the motion takes: above it a limit is none.
    Family("torque_limit", "drives",
           (Number("torque", "torque", 2.0, 0.1, 2.0, "from a tenth to twice what the motion takes",
                   (0.53, 0.58, 0.68, 0.82, 0.92, 1.0)),), _limit,
           "drives of {where} are limited in torque", "look at current limits and the supply", drive=True),
    Family("set_point_lag", "drives", (Number("time", "time", 0.0, 0.0, 0.1, "filters of 2 Hz and more"),),
           partial(_put, "set_point_lag_s"), "drives of {where} smooth their set points",
           "look for a filter or profile in the drive", drive=True),
    Family("velocity_feed_forward", "drives",
           (Number("share", "share", 0.0, -1.0, 1.0, "from none to all of the set point's rate"),),
           partial(_put, "forward_share"), "drives of {where} feed forward another share of the set point's rate",
           "look for a feed-forward gain in the controller", drive=True, position=True),
    Family("compliance", "joints",
           (Number("compliance", "compliance", 0.0, 0.0, 0.5, "up to half of the give of the position loop"),),
           _compliance, "transmissions of {where} give under load", "look at couplings, belts and harmonic drives",
           drive=True, position=True),
    Family("backlash", "joints", (Number("width", "angle", 0.0, 0.0, 0.05, "small servos: up to 3 degrees"),),
           partial(_put, "slack"), "gears of {where} have backlash", "feel for play with the motors on",
           drive=True, position=True),
    Family("encoder_offset", "sensing", (Number("offset", "angle", 0.0, -0.1, 0.1, "homing within 6 degrees"),),
           partial(_put, "offset"), "zeros of {where} lie elsewhere", "home anew, and compare with a gauge"),
    Family("encoder_scale", "sensing", (Number("scale", "share", 1.0, 0.95, 1.05, "a tooth more or less in twenty"),),
           _gear, "encoders of {where} read another angle per turn", "compare the gear ratio with the data sheet"),
)  # fmt: skip


def change_joints(
    family: int,
    joints: tuple[str, ...],
    sizes: tuple[tuple[float, ...], ...],
    machine: Machine,
    values: Sequence[float],
) -> None:
    """Apply a family of effects, by its place in `FAMILIES`; each value times its size, by joint and number."""
    for joint, own in zip(joints, sizes, strict=True):
        FAMILIES[family].apply(joint, machine, [value * size for value, size in zip(values, own, strict=True)])


def change_mass(body: str, machine: Machine, values: Sequence[float]) -> None:
    """Scale the mass of a body, inertia with it."""
    number = machine.model.body(body).id
    machine.model.body_mass[number] *= values[0]
    machine.model.body_inertia[number] *= values[0]


def change_length(body: str, machine: Machine, values: Sequence[float]) -> None:
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


def change_timing(field: str, machine: Machine, values: Sequence[float]) -> None:
    """Let commands or readings come late, or a clock be fast; a field of `Machine`."""
    setattr(machine, field, getattr(machine, field) + values[0])


def offset_sensor(signal: str, machine: Machine, values: Sequence[float]) -> None:
    """Give a sensor at a site another zero."""
    machine.sensor_offset[signal] = tuple(values)


def scale_sensor(signal: str, machine: Machine, values: Sequence[float]) -> None:
    """Give a sensor at a site another scale."""
    machine.sensor_scale[signal] = values[0]


def turn_sensor(site: str, machine: Machine, values: Sequence[float]) -> None:
    """Put the sensor at a site askew, rad."""
    machine.sensor_turn[site] = tuple(values)


def hold_weight(joints: tuple[str, ...], machine: Machine, values: Sequence[float]) -> None:
    """Let drives hold a share of the weight beside their set points."""
    model = machine.model
    for joint in joints:
        model.jnt_actgravcomp[model.joint(joint).id] = 1
    model.body_gravcomp[:] += values[0]


def change_grip(machine: Machine, values: Sequence[float]) -> None:
    """Scale the friction of all contacts."""
    machine.model.geom_friction[:, 0] *= values[0]


def change_give(machine: Machine, values: Sequence[float]) -> None:
    """Scale the time in which contacts come to rest, or what the model has of their stiffness and damping."""
    table, scale = machine.model.geom_solref, values[0]
    direct = table[:, 0] < 0.0
    table[~direct, 0] *= scale
    table[direct] /= [scale**2, scale]


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


def change_gains(joint: str, machine: Machine, values: Sequence[float]) -> None:
    """Scale both gains of a drive."""
    change_position_gain(joint, machine, values)
    change_rate_gain(joint, machine, values)


def scale_dof(field: str, joint: str, machine: Machine, values: Sequence[float]) -> None:
    """Scale the friction, damping or armature that the model has of a joint."""
    getattr(machine.model, field)[machine.robot.dof(joint)] *= values[0]


def scale_effort(joint: str, machine: Machine, values: Sequence[float]) -> None:
    """Scale the reading of an effort."""
    machine.effort_scale[joint] = machine.effort_scale.get(joint, 1.0) * values[0]
