"""What may be wrong with any robot, and what it changes in a machine.

Bounds are shares of what the recorded motion takes (torque, speed, inertia), so that one table serves a finger and a
hip; each entry says where its share comes from.
"""

from __future__ import annotations

from dataclasses import dataclass
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
    Apply = Callable[[Machine, str, Sequence[float]], None]


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


def _damping(machine: Machine, joint: str, values: Sequence[float]) -> None:
    machine.model.dof_damping[machine.robot.dof(joint)] += values[0]


def _friction(machine: Machine, joint: str, values: Sequence[float]) -> None:
    machine.model.dof_frictionloss[machine.robot.dof(joint)] += values[0]


def _stribeck(machine: Machine, joint: str, values: Sequence[float]) -> None:
    machine.stribeck[joint] = (values[0], values[1])


def _load_friction(machine: Machine, joint: str, values: Sequence[float]) -> None:
    machine.load_friction[joint] = values[0]


def _armature(machine: Machine, joint: str, values: Sequence[float]) -> None:
    machine.model.dof_armature[machine.robot.dof(joint)] += values[0]


def _actuator(machine: Machine, joint: str) -> Any:
    return next(machine.model.actuator(each.actuator) for each in machine.robot.drives if each.joint == joint)


def _torque_constant(machine: Machine, joint: str, values: Sequence[float]) -> None:
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


def _position_gain(machine: Machine, joint: str, values: Sequence[float]) -> None:
    actuator = _actuator(machine, joint)
    actuator.gainprm[0] *= values[0]
    actuator.biasprm[1] *= values[0]


def _rate_gain(machine: Machine, joint: str, values: Sequence[float]) -> None:
    actuator = _actuator(machine, joint)
    actuator.biasprm[2] *= values[0]
    if actuator.biasprm[1] == 0.0:
        actuator.gainprm[0] *= values[0]


def _limit(machine: Machine, joint: str, values: Sequence[float]) -> None:
    actuator = _actuator(machine, joint)
    machine.model.actuator_forcelimited[actuator.id] = 1
    own = actuator.forcerange[1] if actuator.forcerange[1] > 0.0 else np.inf
    actuator.forcerange[:] = np.array([-1.0, 1.0]) * min(values[0], own)


def _compliance(machine: Machine, joint: str, values: Sequence[float]) -> None:
    # A stiff spring behind the encoder, without a mass of its own: the drive stands in series with it.
    actuator = _actuator(machine, joint)
    softer = 1.0 / (1.0 + values[0] * actuator.gainprm[0])
    actuator.gainprm[:] *= softer
    actuator.biasprm[:] *= softer
    _share_fed(machine, joint, softer)
    machine.compliance[joint] = values[0]


def _backlash(machine: Machine, joint: str, values: Sequence[float]) -> None:
    machine.slack[joint] = values[0]


def _offset(machine: Machine, joint: str, values: Sequence[float]) -> None:
    machine.offset[joint] = values[0]


def _gear(machine: Machine, joint: str, values: Sequence[float]) -> None:
    machine.scale[joint] = values[0]
    if any(each.joint == joint for each in machine.robot.drives):
        actuator = _actuator(machine, joint)
        actuator.gainprm[:] *= values[0]
        actuator.biasprm[:] *= values[0]


def _forward(machine: Machine, joint: str, values: Sequence[float]) -> None:
    machine.forward_share[joint] = values[0]


def _lag(machine: Machine, joint: str, values: Sequence[float]) -> None:
    machine.set_point_lag_s = {**machine.set_point_lag_s, joint: values[0]}


_SHEETS = "data sheets of gears and servos: no-load running torque of a tenth to a half of the rated one"
_BY_MOTION = "assumed: up to what the motion takes of torque, and four times that of a torque that grows with speed"
FAMILIES = (
    Family("friction", "joints", (Number("torque", "torque", 0.0, 0.0, 1.0, _BY_MOTION),), _friction,
           "{where} rub more than the model says", "turn by hand with the motors off; look at bearings and seals"),
    Family("damping", "joints", (Number("coefficient", "damping", 0.0, 0.0, 4.0, _BY_MOTION),), _damping,
           "{where} are slowed by their speed more than the model says", "look at the grease and its temperature"),
    Family("stribeck", "joints",
           (Number("torque", "torque", 0.0, 0.0, 0.8, _SHEETS),
            Number("speed", "speed", 0.1, 0.02, 0.3, "Armstrong-Helouvry 1991: a hundredth to a third of the speed")),
           _stribeck, "{where} stick before they slide", "look at the lubrication, and at preload of the bearings"),
    Family("load_friction", "joints",
           (Number("share", "share", 0.0, 0.0, 0.8, "gears of 43 to 100 %: 2 (1 - eta) / (1 + eta)"),), _load_friction,
           "gears of {where} rub in proportion to their load", "look at the wear of the gears"),
    Family("armature", "joints",
           (Number("inertia", "inertia", 0.0, 0.0, 2.0, "rotors by the gear ratio squared: twice that of links"),),
           _armature, "{where} have more rotor inertia than the model", "look up rotor and gear in the data sheet"),
    Family("torque_constant", "drives",
           (Number("scale", "share", 1.0, 0.6, 1.4, "motors from hot to cold, and wrong entries of a data sheet"),),
           _torque_constant, "motors of {where} give another torque per current",
           "compare torque constant and gear ratio with the data sheet"),
    Family("position_gain", "drives", (Number("scale", "share", 1.0, 0.5, 2.0, "assumed: half to double"),),
           _position_gain, "drives of {where} have another position gain", "read kp from the controller", drive=True,
           position=True),
    Family("rate_gain", "drives", (Number("scale", "share", 1.0, 0.2, 3.0, "assumed: a fifth to threefold"),),
           _rate_gain, "drives of {where} have another velocity gain", "read kd from the controller", drive=True),
    Family("torque_limit", "drives",
           (Number("torque", "torque", 2.0, 0.1, 2.0, "from a tenth to twice what the motion takes"),), _limit,
           "drives of {where} are limited in torque", "look at current limits and the supply", drive=True),
    Family("set_point_lag", "drives", (Number("time", "time", 0.0, 0.0, 0.1, "filters of 2 Hz and more"),),
           _lag, "drives of {where} smooth their set points", "look for a filter or profile in the drive", drive=True),
    Family("velocity_feed_forward", "drives",
           (Number("share", "share", 0.0, -1.0, 1.0, "from none to all of the set point's rate"),), _forward,
           "drives of {where} feed forward another share of the set point's rate",
           "look for a feed-forward gain in the controller", drive=True, position=True),
    Family("compliance", "joints",
           (Number("compliance", "compliance", 0.0, 0.0, 0.5, "up to half of the give of the position loop"),),
           _compliance, "transmissions of {where} give under load", "look at couplings, belts and harmonic drives",
           drive=True, position=True),
    Family("backlash", "joints", (Number("width", "angle", 0.0, 0.0, 0.05, "small servos: up to 3 degrees"),),
           _backlash, "gears of {where} have backlash", "feel for play with the motors on", drive=True, position=True),
    Family("encoder_offset", "sensing", (Number("offset", "angle", 0.0, -0.1, 0.1, "homing within 6 degrees"),),
           _offset, "zeros of {where} lie elsewhere", "home anew, and compare with a gauge"),
    Family("encoder_scale", "sensing", (Number("scale", "share", 1.0, 0.95, 1.05, "a tooth more or less in twenty"),),
           _gear, "encoders of {where} read another angle per turn", "compare the gear ratio with the data sheet"),
)  # fmt: skip


@dataclass(frozen=True)
class JointChange:
    """A family of effects on some joints."""

    family: int
    """In `FAMILIES`."""
    joints: tuple[str, ...]
    sizes: tuple[tuple[float, ...], ...]
    """By joint and number, what a value is multiplied with."""

    def __call__(self, machine: Machine, values: Sequence[float]) -> None:
        """Change the machine."""
        for joint, own in zip(self.joints, self.sizes, strict=True):
            FAMILIES[self.family].apply(machine, joint, [value * size for value, size in zip(values, own, strict=True)])


@dataclass(frozen=True)
class MassChange:
    """Another mass of a body, inertia with it."""

    body: str

    def __call__(self, machine: Machine, values: Sequence[float]) -> None:
        """Change the machine."""
        number = machine.model.body(self.body).id
        machine.model.body_mass[number] *= values[0]
        machine.model.body_inertia[number] *= values[0]


@dataclass(frozen=True)
class LengthChange:
    """Another length of a link: what hangs on it, its centre of mass, and its inertia."""

    body: str

    def __call__(self, machine: Machine, values: Sequence[float]) -> None:
        """Change the machine."""
        model = machine.model
        number = model.body(self.body).id
        model.body_ipos[number] *= values[0]
        model.body_inertia[number] *= values[0] ** 2
        model.body_pos[model.body_parentid == number] *= values[0]


@dataclass(frozen=True)
class CentreChange:
    """Another centre of mass."""

    body: str

    def __call__(self, machine: Machine, values: Sequence[float]) -> None:
        """Change the machine."""
        machine.model.body_ipos[machine.model.body(self.body).id] += np.array(values)


@dataclass(frozen=True)
class Payload:
    """A small mass that is fixed to a body."""

    body: str
    place: tuple[float, float, float]
    """In the frame of the body, m."""

    def __call__(self, machine: Machine, values: Sequence[float]) -> None:
        """Change the machine: masses, centre and tensor of inertia add up (parallel axes)."""
        model = machine.model
        number = model.body(self.body).id
        flat = np.zeros(9)
        mujoco.mju_quat2Mat(flat, model.body_iquat[number])
        turn = flat.reshape(3, 3)
        own, added = float(model.body_mass[number]), float(values[0])
        at, place = model.body_ipos[number].copy(), np.array(self.place)
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


@dataclass(frozen=True)
class Tilt:
    """A base that stands askew."""

    def __call__(self, machine: Machine, values: Sequence[float]) -> None:
        """Change the machine: gravity turns against it."""
        roll, pitch = values
        turn = np.zeros(9)
        quaternion = np.zeros(4)
        mujoco.mju_euler2Quat(quaternion, np.array([roll, pitch, 0.0]), "xyz")
        mujoco.mju_quat2Mat(turn, quaternion)
        machine.model.opt.gravity[:] = turn.reshape(3, 3).T @ machine.model.opt.gravity


@dataclass(frozen=True)
class Timing:
    """Commands or readings that come late, or a clock that is fast; a field of `Machine`."""

    name: str

    def __call__(self, machine: Machine, values: Sequence[float]) -> None:
        """Change the machine."""
        setattr(machine, self.name, getattr(machine, self.name) + values[0])


@dataclass(frozen=True)
class SensorOffset:
    """Another zero of a sensor at a site."""

    signal: str

    def __call__(self, machine: Machine, values: Sequence[float]) -> None:
        """Change the machine."""
        machine.sensor_offset[self.signal] = tuple(values)


@dataclass(frozen=True)
class SensorScale:
    """Another scale of it."""

    signal: str

    def __call__(self, machine: Machine, values: Sequence[float]) -> None:
        """Change the machine."""
        machine.sensor_scale[self.signal] = values[0]


@dataclass(frozen=True)
class SensorTurn:
    """A sensor that sits askew."""

    site: str

    def __call__(self, machine: Machine, values: Sequence[float]) -> None:
        """Change the machine."""
        machine.sensor_turn[self.site] = tuple(values)


@dataclass(frozen=True)
class Gravity:
    """Drives that hold a share of the weight beside their set points."""

    joints: tuple[str, ...]

    def __call__(self, machine: Machine, values: Sequence[float]) -> None:
        """Change the machine."""
        model = machine.model
        for joint in self.joints:
            model.jnt_actgravcomp[model.joint(joint).id] = 1
        model.body_gravcomp[:] += values[0]


@dataclass(frozen=True)
class Floor:
    """Another friction of all contacts."""

    def __call__(self, machine: Machine, values: Sequence[float]) -> None:
        """Change the machine."""
        machine.model.geom_friction[:, 0] *= values[0]


@dataclass(frozen=True)
class FloorGive:
    """Another time in which contacts come to rest: longer on what gives."""

    def __call__(self, machine: Machine, values: Sequence[float]) -> None:
        """Change the machine: of its contacts the time constant, or what the model has of stiffness and damping."""
        table, scale = machine.model.geom_solref, values[0]
        direct = table[:, 0] < 0.0
        table[~direct, 0] *= scale
        table[direct] /= [scale**2, scale]


@dataclass(frozen=True)
class Stop:
    """An end stop of a joint that it meets before the model's own."""

    joint: str
    upper: bool

    def __call__(self, machine: Machine, values: Sequence[float]) -> None:
        """Change the machine."""
        model = machine.model
        number = model.joint(self.joint).id
        if not model.jnt_limited[number]:
            model.jnt_limited[number], model.jnt_range[number] = 1, (-_ENDLESS, _ENDLESS)
        nearer = min if self.upper else max
        model.jnt_range[number, int(self.upper)] = nearer(model.jnt_range[number, int(self.upper)], values[0])


_ENDLESS = 1e6
"""Range of a joint that has none, rad or m."""


@dataclass(frozen=True)
class GainChange:
    """Both gains of a drive, or one of them, as a share."""

    joint: str
    kp: bool = True
    kd: bool = True

    def __call__(self, machine: Machine, values: Sequence[float]) -> None:
        """Change the machine."""
        if self.kp:
            _position_gain(machine, self.joint, values)
        if self.kd:
            _rate_gain(machine, self.joint, values)


@dataclass(frozen=True)
class DofScale:
    """Another friction, damping or armature of a joint, as a share of the model's."""

    joint: str
    field: str
    """Of the model."""

    def __call__(self, machine: Machine, values: Sequence[float]) -> None:
        """Change the machine."""
        getattr(machine.model, self.field)[machine.robot.dof(self.joint)] *= values[0]


@dataclass(frozen=True)
class EffortScale:
    """Another reading of an effort."""

    joint: str

    def __call__(self, machine: Machine, values: Sequence[float]) -> None:
        """Change the machine."""
        machine.effort_scale[self.joint] = machine.effort_scale.get(self.joint, 1.0) * values[0]
