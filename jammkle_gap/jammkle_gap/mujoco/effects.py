"""Effects that any robot may have, and the constants that every machine has a little otherwise.

An effect of joints is offered for all of them, for those of one kind and for each, so that a cause they share is one
effect. Bounds are shares of what the recorded motion takes (torque, speed, inertia), so that one table serves a finger
and a hip; each entry says where its share comes from.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from jammkle_gap.core.effects import Effect, EffectParameter, Library, Nuisance
from jammkle_gap.mujoco.runs import Base, Quantity, Sense
from jammkle_sim.physics.engine import mujoco

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

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


def scales_of(robot: Robot, recordings: Sequence[Recording]) -> dict[str, Scale]:
    """Return the scale of every measured joint."""
    model = robot.model
    data = mujoco.MjData(model)
    positions = [int(model.joint(name).qposadr[0]) for name in robot.joints]
    dofs = [robot.dof(name) for name in robot.joints]
    torque, speed, inertia = (np.zeros(len(dofs)) for _ in range(3))
    for recording in recordings:
        motion: Motion = recording.inputs
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
        name: Scale(float(torque[k]), float(speed[k]), float(inertia[k]), kp.get(name, float("nan")), turning[k])
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


_UNITS = {
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


def _size(scale: str, own: Scale) -> float:
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
    machine.effort_scale[joint] = machine.effort_scale.get(joint, 1.0) / values[0]


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


@dataclass(frozen=True)
class Offer:
    """What a robot is offered: effects, constants of the machine, and what each of them changes."""

    library: Library
    constants: tuple[Nuisance, ...]
    scatter: tuple[Nuisance, ...]
    """What no two runs have the same."""
    changes: Mapping[str, tuple[tuple[str, ...], tuple[float, ...], Any]]
    members: Mapping[str, tuple[str, ...]]
    """By effect that joints share, the effects of single joints."""

    @property
    def names(self) -> frozenset[str]:
        """Of all effects."""
        return frozenset(effect.name for effect in self.library)


def offer_of(robot: Robot, scales: Mapping[str, Scale]) -> Offer:
    """Return all effects that a robot may have, those that joints share among them, and its constants."""
    effects: list[Effect] = []
    changes: dict[str, tuple[tuple[str, ...], tuple[float, ...], Any]] = {}
    members: dict[str, tuple[str, ...]] = {}

    def offered(effect: Effect, change: Any) -> None:
        effects.append(effect)
        keys = tuple(effect.key(each) for each in effect.parameters)
        changes[effect.name] = (keys, tuple(each.null for each in effect.parameters), change)

    constants = []
    for nuisance, change in _constants(robot):
        constants.append(nuisance)
        changes[nuisance.name] = ((nuisance.name,), (nuisance.null,), change)
    scatter = []
    if robot.drives:
        source = "the clocks of computer and drive meet anew in each run: within half a cycle of 1 kHz"
        scatter.append(Nuisance("run/arrival", "s", 0.0, 0.0005, source, -0.01, 0.01))
        changes["run/arrival"] = (("run/arrival",), (0.0,), Timing("arrival_s"))
    driven = {each.joint for each in robot.drives}
    at_position = {each.joint for each in robot.drives if each.quantity is Quantity.POSITION}
    for number, family in enumerate(FAMILIES):
        able = at_position if family.position else driven if family.drive else set(robot.joints)
        if family.name == "torque_constant":
            able = driven or set(robot.efforts)
        joints = tuple(name for name in robot.joints if name in able)
        single = {joint: f"{family.name}_{joint}" for joint in joints}
        for label, group in groups_of(robot, joints).items():
            effect, change = _shared(number, f"{family.name}{label}", group, scales)
            offered(effect, change)
            members[effect.name] = tuple(single[joint] for joint in group)
        for joint in joints:
            effect, change = _single(number, single[joint], joint, scales[joint])
            offered(effect, change)
    for effect, change in (*_of_links(robot), *_of_all(robot), *_of_senses(robot)):
        offered(effect, change)
    return Offer(Library(tuple(effects)), tuple(constants), tuple(scatter), changes, members)


def groups_of(robot: Robot, joints: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Return joints that may share a cause, by the ending of its name: all (no ending), and those of one kind.

    Of one kind are those with the same limit of torque and the same rotor in the model.
    """
    kinds: dict[tuple[Any, ...], list[str]] = {}
    for name in joints:
        drive = next((each for each in robot.drives if each.joint == name), None)
        limit = () if drive is None else tuple(robot.model.actuator(drive.actuator).forcerange.round(6).tolist())
        dof = robot.dof(name)
        kinds.setdefault((robot.is_turning(name), limit, round(float(robot.model.dof_armature[dof]), 9)), []).append(
            name
        )
    found: dict[str, tuple[str, ...]] = {}
    if len(joints) > 1 and len({robot.is_turning(name) for name in joints}) == 1:
        found[""] = tuple(joints)
    for group in kinds.values():
        if 1 < len(group) < len(joints):
            found[f"_{_label(group)}"] = tuple(group)
    return found


def _label(names: Sequence[str]) -> str:
    words = [re.split(r"[_\W]+|\d+", name) for name in names]
    common = [word for word in words[0] if len(word) > 2 and all(word in each for each in words)]  # noqa: PLR2004
    common = [word for word in common if word not in {"joint", "link", "motor"}]
    return "_".join(common) if common else f"{names[0]}_to_{names[-1]}"


def _shared(number: int, name: str, joints: tuple[str, ...], scales: Mapping[str, Scale]) -> tuple[Effect, JointChange]:
    family = FAMILIES[number]
    parameters = tuple(
        EffectParameter(
            each.name,
            _UNITS[each.scale][0] if each.scale in _PLAIN else "1",
            each.null,
            each.minimum,
            each.maximum,
            each.source,
        )
        for each in family.numbers
    )
    sizes = tuple(tuple(_size(each.scale, scales[joint]) for each in family.numbers) for joint in joints)
    where = f"the joints {', '.join(joints)}"
    return Effect(name, family.subsystem, parameters, _sentence(family, where)), JointChange(number, joints, sizes)


_PLAIN = ("time", "share", "angle")
"""Scales that are the same for all joints; of others joints share a part of each one's own."""


def _single(number: int, name: str, joint: str, scale: Scale) -> tuple[Effect, JointChange]:
    family = FAMILIES[number]
    parameters = []
    for each in family.numbers:
        size = _size(each.scale, scale)
        unit = _UNITS[each.scale][0 if scale.turning else 1]
        parameters.append(
            EffectParameter(each.name, unit, each.null * size, each.minimum * size, each.maximum * size, each.source)
        )
    effect = Effect(name, family.subsystem, tuple(parameters), _sentence(family, f"joint {joint}"))
    return effect, JointChange(number, (joint,), (tuple(1.0 for _ in family.numbers),))


def _sentence(family: Family, where: str) -> str:
    finding = family.finding.format(where=where)
    if where.startswith("joint "):
        for plural, singular in ((f"{where} rub", f"{where} rubs"), (f"{where} are", f"{where} is"),
                                 (f"{where} stick before they slide", f"{where} sticks before it slides"),
                                 (f"{where} have more", f"{where} has more"),
                                 ("by their speed", "by its speed")):  # fmt: skip
            finding = finding.replace(plural, singular)
    return f"{finding[:1].upper()}{finding[1:]}: {family.check}."


def moving_bodies(robot: Robot) -> list[str]:
    """Return the bodies with a mass that a measured joint moves, in the model's order."""
    model = robot.model
    roots = {int(model.joint(name).bodyid[0]) for name in robot.joints}
    found = []
    for number in range(1, model.nbody):
        above = number
        while above and above not in roots:
            above = int(model.body_parentid[above])
        if above and model.body_mass[number] > 0.0 and model.body(number).name:
            found.append(model.body(number).name)
    return found


def _of_links(robot: Robot) -> list[tuple[Effect, Any]]:
    found: list[tuple[Effect, Any]] = []
    model = robot.model
    bodies = moving_bodies(robot)
    total = sum(float(model.body(name).mass[0]) for name in bodies)
    for name in bodies:
        scale = EffectParameter("scale", "1", 1.0, 0.5, 2.0, "assumed: half to double")
        sentence = f"Body {name} has another mass than the model says: weigh it."
        found.append((Effect(f"mass_{name}", "links", (scale,), sentence), MassChange(name)))
        reach = 0.2 * max(_extent(robot, name), 0.02)
        axes = tuple(
            EffectParameter(axis, "m", 0.0, -reach, reach, "assumed: a fifth of the link's length") for axis in "xyz"
        )
        sentence = f"The centre of mass of body {name} lies elsewhere: balance it on an edge."
        found.append((Effect(f"centre_{name}", "links", axes, sentence), CentreChange(name)))
    tips = [name for name in bodies if not _children(robot, name)]
    for name in tips:
        label = "payload" if len(tips) == 1 else f"payload_{name}"
        mass = EffectParameter("mass", "kg", 0.0, 0.0, 0.3 * total, "assumed: up to 0.3 of what moves")
        sentence = f"Body {name} carries a load that the model has not: look for tools, cables or what it grips."
        found.append((Effect(label, "links", (mass,), sentence), Payload(name, _tip(robot, name))))
    return found


def _children(robot: Robot, name: str) -> list[int]:
    model = robot.model
    own = model.body(name).id
    below = [k for k in range(1, model.nbody) if int(model.body_parentid[k]) == own]
    return [k for k in below if model.body_mass[k] > 0.0 or model.body_subtreemass[k] > 0.0]


def _extent(robot: Robot, name: str) -> float:
    """Return how far a body's own frame is from what hangs on it, or from its centre of mass, m."""
    model = robot.model
    own = model.body(name).id
    below = np.linalg.norm(model.body_pos[model.body_parentid == own], axis=1)
    return float(max([*below.tolist(), 2.0 * float(np.linalg.norm(model.body_ipos[own]))]))


def _tip(robot: Robot, name: str) -> tuple[float, float, float]:
    model = robot.model
    own = model.body(name).id
    sites = [k for k in range(model.nsite) if int(model.site_bodyid[k]) == own]
    places = [model.site_pos[k] for k in sites] or [model.body_ipos[own]]
    x, y, z = max(places, key=lambda each: float(np.linalg.norm(each))).tolist()
    return x, y, z


def _of_all(robot: Robot) -> list[tuple[Effect, Any]]:
    """Return effects of timing, of the base, and of drives together."""
    late = "buses and drivers: up to some tens of milliseconds"
    found: list[tuple[Effect, Any]] = []
    if robot.drives:
        delay = EffectParameter("time", "s", 0.0, 0.0, 0.08, late)
        sentence = "Commands come late: look at the load of bus and computer."
        found.append((Effect("command_delay", "timing", (delay,), sentence), Timing("command_delay_s")))
        rate = EffectParameter("rate", "1", 0.0, -0.01, 0.01, "assumed: clocks without synchronisation, within 1 %")
        sentence = "The clock of the readings runs at another rate than that of the commands: synchronise them."
        found.append((Effect("clock_skew", "timing", (rate,), sentence), Timing("clock_rate")))
        held = tuple(each.joint for each in robot.drives if robot.is_turning(each.joint))
        if held:
            lowest = -1.0 if float(robot.model.body_gravcomp.max()) > 0.5 else 0.0  # noqa: PLR2004 - rather with it
            share = EffectParameter("share", "1", 0.0, lowest, lowest + 1.0, "from none to all of the weight")
            sentence = "The drives hold another share of the weight by themselves: look at gravity compensation."
            found.append((Effect("gravity_compensation", "drives", (share,), sentence), Gravity(held)))
    delay = EffectParameter("time", "s", 0.0, 0.0, 0.05, late)
    sentence = "Readings come late: look at filters of the sensors and at the bus."
    found.append((Effect("reading_delay", "timing", (delay,), sentence), Timing("reading_delay_s")))
    if robot.given.base is Base.HELD and np.any(robot.model.opt.gravity):
        source = "assumed: a base set up by eye, within 6 degrees"
        angles = tuple(EffectParameter(axis, "rad", 0.0, -0.1, 0.1, source) for axis in ("roll", "pitch"))
        sentence = "The base stands askew: put a level on it."
        found.append((Effect("base_tilt", "base", angles, sentence), Tilt()))
    elif robot.given.base is not Base.HELD:
        scale = EffectParameter("scale", "1", 1.0, 0.2, 2.0, "tables of dry friction")
        sentence = "The floor grips otherwise than the model says: clean it, or measure its friction."
        found.append((Effect("floor_friction", "base", (scale,), sentence), Floor()))
    return found


def _of_senses(robot: Robot) -> list[tuple[Effect, Any]]:
    """Return errors of sensors at sites: zero, scale, and how they are mounted."""
    weight = 9.81 * float(robot.model.body_mass[1:].sum())
    zeros = {
        Sense.ACCELERATION: ("m/s^2", 1.0, "data sheets of MEMS sensors: zero within 0.1 g"),
        Sense.RATE: ("rad/s", 0.1, "data sheets of MEMS sensors: zero within 6 degrees/s"),
        Sense.FORCE: ("N", 0.5 * weight, "assumed: zeroed with up to half of the weight on it"),
        Sense.TORQUE: ("N m", 0.1 * weight, "assumed: the same at 0.2 m"),
    }
    found: list[tuple[Effect, Any]] = []
    for site, sense in robot.senses:
        signal, (unit, most, source) = f"{site}/{sense.value}", zeros[sense]
        axes = tuple(EffectParameter(axis, unit, 0.0, -most, most, source) for axis in "xyz")
        what = f"the {sense.value.replace('_', ' ')} at {site}"
        sentence = f"Readings of {what} have another zero: let the robot stand still, and zero the sensor."
        found.append((Effect(f"{sense.value}_offset_{site}", "sensing", axes, sentence), SensorOffset(signal)))
        scale = EffectParameter("scale", "1", 1.0, 0.8, 1.2, "assumed: a wrong range or unit is far off, others less")
        sentence = f"Readings of {what} have another scale: look at the sensor's range and calibration."
        found.append((Effect(f"{sense.value}_scale_{site}", "sensing", (scale,), sentence), SensorScale(signal)))
    for site in dict.fromkeys(site for site, _ in robot.senses):
        source = "assumed: mounted within 12 degrees"
        turns = tuple(EffectParameter(axis, "rad", 0.0, -0.2, 0.2, source) for axis in "xyz")
        sentence = f"The sensor at {site} sits askew: look at how it is mounted, and at its frame."
        found.append((Effect(f"mounting_{site}", "sensing", turns, sentence), SensorTurn(site)))
    return found


_TOLERANCES = {"mass": 0.025, "length": 0.02, "gain": 0.025}
"""Standard deviations, as shares, of what no machine has as its model says. Assumed: drawings and data sheets are kept
within 2 to 3 %. Friction, damping and armature have none unless the map gives one: they are effects."""
_FARTHEST = 4.0
"""Standard deviations up to which a constant is looked for."""


def _share(robot: Robot, name: str, kind: str) -> Nuisance:
    """Return a constant that scales what the model says, with the tolerance of its kind."""
    given = robot.given.tolerances.get(kind)
    sigma = _TOLERANCES[kind] if given is None else given
    source = "drawings and data sheets: within 2 to 3 %" if given is None else f"the map: within {100.0 * given:g} %"
    return Nuisance(name, "1", 1.0, sigma, source, max(1.0 - _FARTHEST * sigma, 0.05), 1.0 + _FARTHEST * sigma)


def _constants(robot: Robot) -> list[tuple[Nuisance, Any]]:
    """Return masses, lengths, gains and times of arrival, and what else the map gives a tolerance."""
    found: list[tuple[Nuisance, Any]] = []
    for name in moving_bodies(robot):
        found.append((_share(robot, f"{name}/mass", "mass"), MassChange(name)))
        if _extent(robot, name) > 0.0:
            found.append((_share(robot, f"{name}/length", "length"), LengthChange(name)))
    if robot.drives:
        source = "a recorder stamps commands when it receives them: within milliseconds"
        found.append((Nuisance("commands/arrival", "s", 0.0, 0.003, source, -0.01, 0.01), Timing("arrival_s")))
    if robot.efforts:
        source = "a drive reads position and effort within a cycle of its own: within milliseconds"
        found.append((Nuisance("efforts/arrival", "s", 0.0, 0.002, source, -0.01, 0.01), Timing("effort_delay_s")))
    found += _gain_constants(robot)
    for kind, own in _BY_DOF.items():
        if kind in robot.given.tolerances:
            able = [name for name in robot.joints if getattr(robot.model, own)[robot.dof(name)] > 0.0]
            found += [(_share(robot, f"{name}/{kind}", kind), DofScale(name, own)) for name in able]
    for joint in robot.given.torque_constants:
        if joint in robot.efforts:
            source = "data sheets: torque constants within 5 %"
            found.append((Nuisance(f"{joint}/torque_constant", "1", 1.0, 0.05, source, 0.7, 1.3), EffortScale(joint)))
    return found


_BY_DOF = {"friction": "dof_frictionloss", "damping": "dof_damping", "armature": "dof_armature"}


def _gain_constants(robot: Robot) -> list[tuple[Nuisance, Any]]:
    """Return the gains of drives: both together, and kd by itself, as the step of a model damps a little, too."""
    guess = "estimated from efforts: within 20 %"
    found: list[tuple[Nuisance, Any]] = []
    for drive in robot.drives:
        joint = drive.joint
        kp, kd = GainChange(joint, kd=False), GainChange(joint, kp=False)
        if joint in robot.estimated:
            found.append((Nuisance(f"{joint}/kp", "1", 1.0, 0.2, guess, 0.3, 3.0), kp))
            found.append((Nuisance(f"{joint}/kd", "1", 1.0, 0.2, guess, 0.3, 3.0), kd))
            continue
        found.append((_share(robot, f"{joint}/gain", "gain"), GainChange(joint)))
        if drive.quantity is Quantity.POSITION and robot.model.actuator(drive.actuator).biasprm[2] != 0.0:
            found.append((_share(robot, f"{joint}/kd", "gain"), kd))
    return found
