"""The library of a robot: effects on its joints, links, drives, sensors and timing, and the constants of its machine.

Bounds of effects on joints are shares of what the recorded motion takes (torque, speed, inertia), so that one table
serves a finger and a hip. Such an effect is offered for all joints, for those of one kind and for each, so that a cause
that joints share is one effect.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from jammkle_gap.core.effects import Effect, EffectParameter, Library, Nuisance
from jammkle_gap.mujoco import changes
from jammkle_gap.mujoco.runs import Base, Quantity, Sense
from jammkle_sim.physics.engine import mujoco

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_gap.core.data import Recording
    from jammkle_gap.mujoco.changes import JointChange
    from jammkle_gap.mujoco.robot import Robot
    from jammkle_gap.mujoco.simulator import Change, Changes, Motion


@dataclass(frozen=True)
class RobotLibrary:
    """What may differ between a robot and its model, and what each of it changes."""

    effects: Library
    constants: tuple[Nuisance, ...]
    scatter: tuple[Nuisance, ...]
    """What no two runs have the same."""
    changes: Changes
    members: Mapping[str, tuple[str, ...]]
    """By effect that joints share, the effects of single joints."""


def robot_library(robot: Robot, recordings: Sequence[Recording]) -> RobotLibrary:
    """Return all effects that a robot may have, and the constants of its machine.

    Args:
        robot: As it was matched.
        recordings: Of it; bounds are set by the motion in them.

    """
    scales = _scales_of(robot, recordings)
    constants = list(_constants(robot))
    scatter: list[tuple[Nuisance, Change]] = []
    if robot.drives:
        source = "the clocks of computer and drive meet anew in each run: within half a cycle of 1 kHz"
        arrival = Nuisance("run/arrival", "s", 0.0, 0.0005, source, -0.01, 0.01)
        scatter.append((arrival, partial(changes.change_timing, "arrival_s")))
    found: dict[str, tuple[tuple[str, ...], tuple[float, ...], Change]] = {
        each.name: ((each.name,), (each.null,), change) for each, change in (*constants, *scatter)
    }
    effects: list[Effect] = []
    members: dict[str, tuple[str, ...]] = {}

    def offer(effect: Effect, change: Change) -> None:
        effects.append(effect)
        keys = tuple(effect.key(each) for each in effect.parameters)
        found[effect.name] = keys, tuple(each.null for each in effect.parameters), change

    for family in FAMILIES:
        joints = _joints_of(robot, family)
        for ending, group in groups_of(robot, joints).items():
            name = f"{family.name}{ending}"
            offer(*_on_joints(family, name, group, scales))
            members[name] = tuple(f"{family.name}_{joint}" for joint in group)
        for joint in joints:
            offer(*_on_joints(family, f"{family.name}_{joint}", (joint,), scales))
    for own in (_on_links(robot), _stops(robot, scales), _on_timing(robot), _on_base(robot), _on_sensors(robot)):
        for effect, change in own:
            offer(effect, change)
    return RobotLibrary(
        Library(tuple(effects)),
        tuple(each for each, _ in constants),
        tuple(each for each, _ in scatter),
        found,
        members,
    )


@dataclass(frozen=True)
class _Scale:
    """What the recorded motion asks of one joint, by which bounds are set."""

    torque: float
    """Largest that inverse dynamics of the nominal model gives, N m or N."""
    beyond: float
    """Root mean square of what acted beside that, by its drive or as its effort was read, N m or N."""
    speed: float
    """Largest, rad/s or m/s."""
    inertia: float
    """That a motor on the joint turns, kg m^2 or kg."""
    stiffness: float
    """kp of its drive, N m/rad or N/m; nan without one."""
    turning: bool
    reach: tuple[float, float]
    """Least and largest position that was measured, rad or m."""

    def size_of(self, kind: str) -> float:
        """Return what a number of a family is measured in, by its kind: a key of `_UNITS`."""
        return {
            "torque": self.torque,
            "damping": self.torque / self.speed,
            "speed": self.speed,
            "inertia": self.inertia,
            "compliance": 1.0 / self.stiffness,
            "angle": 1.0 if self.turning else _METRES,
        }.get(kind, 1.0)


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
"""By kind of a number, its units on a hinge and on a slide."""
_PLAIN = ("time", "share", "angle")
"""Kinds that are the same for all joints; of others joints share a part of each one's own."""
_METRES = 0.2
"""Length of a slide that counts as one rad of a hinge, m."""


def _scales_of(robot: Robot, recordings: Sequence[Recording]) -> dict[str, _Scale]:
    """Return the scale of every measured joint."""
    model = robot.model
    data = mujoco.MjData(model)
    positions = [int(model.joint(name).qposadr[0]) for name in robot.joints]
    dofs = [robot.dof(name) for name in robot.joints]
    torque, speed, inertia, beyond = (np.zeros(len(dofs)) for _ in range(4))
    lowest, highest = np.full(len(dofs), np.inf), np.full(len(dofs), -np.inf)
    for recording in recordings:
        motion: Motion = recording.inputs
        lowest = np.minimum(lowest, motion.position.min(axis=0))
        highest = np.maximum(highest, motion.position.max(axis=0))
        speed = np.maximum(speed, np.abs(motion.velocity).max(axis=0))
        acted = _acted(robot, recording)
        sampled = range(0, len(motion.position), max(len(motion.position) // _SAMPLES, 1))
        squares, known = np.zeros(len(dofs)), np.maximum(np.isfinite(acted[sampled]).sum(axis=0), 1)
        for k in sampled:
            data.qpos[positions], data.qvel[dofs] = motion.position[k], motion.velocity[k]
            data.qacc[dofs] = motion.acceleration[k]
            mujoco.mj_inverse(model, data)
            torque = np.maximum(torque, np.abs(data.qfrc_inverse[dofs]))
            squares += np.square(np.nan_to_num(acted[k] - data.qfrc_inverse[dofs]))
            mass = np.zeros((model.nv, model.nv))
            mujoco.mj_fullM(model, data, mass)
            inertia = np.maximum(inertia, np.diag(mass)[dofs])
        beyond = np.maximum(beyond, np.sqrt(squares / known))
    turning = [robot.is_turning(name) for name in robot.joints]
    for kind in (True, False):
        own = np.array([each == kind for each in turning])
        if own.any():
            torque[own] = np.maximum(torque[own], max(_LEAST * torque[own].max(), _STANDING))
            speed[own] = np.maximum(speed[own], max(_LEAST * speed[own].max(), _STANDING))
    kp = {each.joint: float(model.actuator(each.actuator).gainprm[0]) for each in robot.drives}
    return {
        name: _Scale(
            torque=float(torque[k]),
            beyond=float(beyond[k]),
            speed=float(speed[k]),
            inertia=float(inertia[k]),
            stiffness=kp.get(name, float("nan")),
            turning=turning[k],
            reach=(float(lowest[k]), float(highest[k])),
        )
        for k, name in enumerate(robot.joints)
    }


def _acted(robot: Robot, recording: Recording) -> NDArray[np.float64]:
    """Return what acted on each joint, by its drive or its effort, shape (n, joints), N m or N; NaN: nobody knows."""
    motion: Motion = recording.inputs
    found = np.full(motion.position.shape, np.nan)
    for column, drive in enumerate(robot.drives):
        actuator, k = robot.model.actuator(drive.actuator), robot.joints.index(drive.joint)
        force = actuator.gainprm[0] * motion.set_points[:, column] + actuator.biasprm[0] + motion.fed_effort[:, column]
        force += actuator.biasprm[1] * motion.position[:, k]
        force += actuator.biasprm[2] * (motion.velocity[:, k] - motion.fed_velocity[:, column])
        limited = robot.model.actuator_forcelimited[actuator.id]
        found[:, k] = np.clip(force, *actuator.forcerange) if limited else force
    if not robot.drives:
        grid_s = motion.step_s * np.arange(len(motion.position))
        for joint in robot.efforts:
            read = recording.signal(f"{joint}/effort")
            at_s = read.time_s + motion.starts_s[0]
            found[:, robot.joints.index(joint)] = np.interp(grid_s, at_s, read.values, np.nan, np.nan)
    return found


_MOVES = 0.25
"""Share of a recording that a joint which rubs moves for at least, so that twice a root mean square is its friction."""
_SAMPLES = 200
"""Of a recording that the largest torque is taken from."""
_LEAST = 0.05
"""Of the largest joint's scale that any joint has: one without load may rub too."""
_STANDING = 1e-3
"""Scale of torque, N m or N, and of speed, rad/s or m/s, where all joints of a kind stand. Chosen: above rounding."""


@dataclass(frozen=True)
class Family:
    """An effect that every joint may have."""

    name: str
    subsystem: str
    numbers: tuple[EffectParameter, ...]
    """With a key of `_UNITS` as their unit, and bounds in what that is on a joint."""
    change: JointChange
    finding: str
    """What is wrong with `{where}`; of `[have|has]` the first stands for several joints, the second for one."""
    check: str
    able: str = "joint"
    """Joints that it may be of: a `joint`, a `motor` (of a drive, or whose effort is known), a `drive`, or a `position`
    drive."""
    seen: bool = False
    """Whether its first number may be as large as what was seen to act beside what the motion takes."""


_SHEETS = "data sheets of gears and servos: no-load running torque of a tenth to a half of the rated one"
_BY_MOTION = "assumed: up to what the motion takes of torque, and four times that of a torque that grows with speed"
_BY_FORCE = "assumed: up to what the motion takes, or what was seen to act beside it in a quarter of the time"
FAMILIES = (
    Family("friction", "joints", (EffectParameter("torque", "torque", 0.0, 0.0, 1.0, _BY_FORCE),),
           partial(changes.add_to_dof, "dof_frictionloss"), "{where} [rub|rubs] more than the model says",
           "turn by hand with the motors off; look at bearings and seals", seen=True),
    Family("damping", "joints", (EffectParameter("coefficient", "damping", 0.0, 0.0, 4.0, _BY_MOTION),),
           partial(changes.add_to_dof, "dof_damping"),
           "{where} [are|is] slowed by [their|its] speed more than the model says",
           "look at the grease and its temperature"),
    Family("stribeck", "joints",
           (EffectParameter("torque", "torque", 0.0, 0.0, 0.8, _SHEETS),
            EffectParameter("speed", "speed", 0.1, 0.02, 0.3,
                            "Armstrong-Helouvry 1991: a hundredth to a third of the speed")),
           partial(changes.put, "stribeck"), "{where} [stick|sticks] before [they slide|it slides]",
           "look at the lubrication, and at preload of the bearings"),
    Family("load_friction", "joints",
           (EffectParameter("share", "share", 0.0, 0.0, 0.8, "gears of 43 to 100 %: 2 (1 - eta) / (1 + eta)"),),
           partial(changes.put, "load_friction"), "gears of {where} rub in proportion to their load",
           "look at the wear of the gears"),
    Family("armature", "joints",
           (EffectParameter("inertia", "inertia", 0.0, 0.0, 2.0,
                            "rotors by the gear ratio squared: twice that of links"),),
           partial(changes.add_to_dof, "dof_armature"), "{where} [have|has] more rotor inertia than the model",
           "look up rotor and gear in the data sheet"),
    Family("torque_constant", "drives",
           (EffectParameter("scale", "share", 1.0, 0.6, 1.4,
                            "motors from hot to cold, and wrong entries of a data sheet"),),
           changes.scale_torque_constant, "motors of {where} give another torque per current",
           "compare torque constant and gear ratio with the data sheet", "motor"),
    Family("position_gain", "drives", (EffectParameter("scale", "share", 1.0, 0.5, 2.0, "assumed: half to double"),),
           changes.scale_position_gain, "drives of {where} have another position gain", "read kp from the controller",
           "position"),
    Family("rate_gain", "drives", (EffectParameter("scale", "share", 1.0, 0.2, 3.0, "assumed: a fifth to threefold"),),
           changes.scale_velocity_gain, "drives of {where} have another velocity gain", "read kd from the controller",
           "drive"),
    # 1, 0.9, 0.7, 0.45, 0.25 and 0.1 of what the motion takes: above it a limit is none.
    Family("torque_limit", "drives",
           (EffectParameter("torque", "torque", 2.0, 0.1, 2.0, "from a tenth to twice what the motion takes",
                            shares=(0.53, 0.58, 0.68, 0.82, 0.92, 1.0)),), changes.limit_torque,
           "drives of {where} are limited in torque", "look at current limits and the supply", "drive"),
    Family("set_point_lag", "drives", (EffectParameter("time", "time", 0.0, 0.0, 0.1, "filters of 2 Hz and more"),),
           partial(changes.put, "set_point_lag_s"), "drives of {where} smooth their set points",
           "look for a filter or profile in the drive", "drive"),
    Family("velocity_feed_forward", "drives",
           (EffectParameter("share", "share", 0.0, -1.0, 1.0, "from none to all of the set point's rate"),),
           partial(changes.put, "forward_share"),
           "drives of {where} feed forward another share of the set point's rate",
           "look for a feed-forward gain in the controller", "position"),
    Family("compliance", "joints",
           (EffectParameter("compliance", "compliance", 0.0, 0.0, 0.5, "up to half of the give of the position loop"),),
           changes.soften_transmission, "transmissions of {where} give under load",
           "look at couplings, belts and harmonic drives", "position"),
    Family("backlash", "joints", (EffectParameter("width", "angle", 0.0, 0.0, 0.05, "small servos: up to 3 degrees"),),
           partial(changes.put, "slack"), "gears of {where} have backlash", "feel for play with the motors on",
           "position"),
    Family("encoder_offset", "sensing",
           (EffectParameter("offset", "angle", 0.0, -0.1, 0.1, "homing within 6 degrees"),),
           partial(changes.put, "offset"), "zeros of {where} lie elsewhere", "home anew, and compare with a gauge"),
    Family("reading_offset", "sensing",
           (EffectParameter("offset", "angle", 0.0, -0.1, 0.1, "as homing: within 6 degrees"),),
           partial(changes.put, "reading_offset"),
           "positions of {where} are read from another zero than that of their commands",
           "compare the zero of the joint states with that of the drive", "position"),
    Family("encoder_scale", "sensing",
           (EffectParameter("scale", "share", 1.0, 0.95, 1.05, "a tooth more or less in twenty"),),
           changes.scale_encoder, "encoders of {where} read another angle per turn",
           "compare the gear ratio with the data sheet"),
)  # fmt: skip


def _joints_of(robot: Robot, family: Family) -> tuple[str, ...]:
    driven = {each.joint for each in robot.drives}
    able = {
        "joint": {*robot.joints},
        "motor": driven or {*robot.efforts},
        "drive": driven,
        "position": {each.joint for each in robot.drives if each.quantity is Quantity.POSITION},
    }[family.able]
    return tuple(name for name in robot.joints if name in able)


def groups_of(robot: Robot, joints: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Return joints that may share a cause, by the ending of its name: all (no ending), and those of one kind.

    Of one kind are those with the same limit of torque and the same rotor in the model.
    """
    kinds: dict[tuple[Any, ...], list[str]] = {}
    for name in joints:
        drive = next((each for each in robot.drives if each.joint == name), None)
        limit = () if drive is None else tuple(robot.model.actuator(drive.actuator).forcerange.round(6).tolist())
        rotor = round(float(robot.model.dof_armature[robot.dof(name)]), 9)
        kinds.setdefault((robot.is_turning(name), limit, rotor), []).append(name)
    found: dict[str, tuple[str, ...]] = {}
    if len(joints) > 1 and len({robot.is_turning(name) for name in joints}) == 1:
        found[""] = tuple(joints)
    groups = [group for group in kinds.values() if 1 < len(group) < len(joints)]
    labels = [_label(group) for group in groups]
    for group, label in zip(groups, labels, strict=True):
        found[f"_{label if labels.count(label) == 1 else _ends_of(group)}"] = tuple(group)
    return found


def _label(names: Sequence[str]) -> str:
    words = [re.split(r"[_\W]+|\d+", name) for name in names]
    common = [word for word in words[0] if len(word) > 2 and all(word in each for each in words)]  # noqa: PLR2004
    common = [word for word in common if word not in {"joint", "link", "motor"}]
    return "_".join(common) if common else _ends_of(names)


def _ends_of(names: Sequence[str]) -> str:
    return f"{names[0]}_to_{names[-1]}"


def _on_joints(
    family: Family, name: str, joints: tuple[str, ...], scales: Mapping[str, _Scale]
) -> tuple[Effect, Change]:
    """Return an effect of one joint, in its units, or of several, in shares of what each joint's motion takes."""
    numbers = family.numbers
    if family.seen:
        first, *rest = numbers
        acted = min(scales[joint].beyond / scales[joint].torque for joint in joints) / np.sqrt(_MOVES)
        numbers = (replace(first, maximum=max(first.maximum, float(acted))), *rest)
    sizes = tuple(tuple(scales[joint].size_of(each.unit) for each in numbers) for joint in joints)
    if len(joints) == 1:
        where, turning = f"joint {joints[0]}", scales[joints[0]].turning
        parameters = tuple(
            replace(
                each,
                unit=_UNITS[each.unit][0 if turning else 1],
                null=each.null * size,
                minimum=each.minimum * size,
                maximum=each.maximum * size,
            )
            for each, size in zip(numbers, sizes[0], strict=True)
        )
        sizes = (tuple(1.0 for _ in numbers),)
    else:
        where = f"the joints {', '.join(joints)}"
        parameters = tuple(replace(each, unit=_UNITS[each.unit][0] if each.unit in _PLAIN else "1") for each in numbers)
    finding = re.sub(r"\[(.+?)\|(.+?)\]", r"\2" if len(joints) == 1 else r"\1", family.finding).format(where=where)
    sentence = f"{finding[:1].upper()}{finding[1:]}: {family.check}."
    change = partial(changes.change_joints, family.change, joints, sizes)
    return Effect(name, family.subsystem, parameters, sentence), change


def _moving_bodies(robot: Robot) -> list[str]:
    """Return the bodies with a mass that a measured joint, one that follows it or a free base moves, in order."""
    model = robot.model
    base = (robot.floating,) if robot.floating else ()
    roots = {int(model.joint(name).bodyid[0]) for name in (*robot.joints, *robot.followers, *base)}
    found = []
    for number in range(1, model.nbody):
        above = number
        while above and above not in roots:
            above = int(model.body_parentid[above])
        if above and model.body_mass[number] > 0.0 and model.body(number).name:
            found.append(model.body(number).name)
    return found


def _axes(unit: str, most: float, source: str, names: Sequence[str] = ("x", "y", "z")) -> tuple[EffectParameter, ...]:
    """Return parameters that are off at 0 and may be as far to either side."""
    return tuple(EffectParameter(axis, unit, 0.0, -most, most, source) for axis in names)


def _on_links(robot: Robot) -> Iterator[tuple[Effect, Change]]:
    model = robot.model
    bodies = _moving_bodies(robot)
    total = sum(float(model.body(name).mass[0]) for name in bodies)
    for name in bodies:
        scale = EffectParameter("scale", "1", 1.0, 0.5, 2.0, "assumed: half to double")
        sentence = f"Body {name} has another mass than the model says: weigh it."
        yield Effect(f"mass_{name}", "links", (scale,), sentence), partial(changes.scale_mass, name)
        axes = _axes("m", 0.2 * max(_extent(robot, name), 0.02), "assumed: a fifth of the link's length")
        sentence = f"The centre of mass of body {name} lies elsewhere: balance it on an edge."
        yield Effect(f"centre_{name}", "links", axes, sentence), partial(changes.move_centre, name)
    tips = [name for name in bodies if not _carries(robot, name)]
    for name in tips:
        label = "payload" if len(tips) == 1 else f"payload_{name}"
        mass = EffectParameter("mass", "kg", 0.0, 0.0, 0.3 * total, "assumed: up to 0.3 of what moves")
        sentence = f"Body {name} carries a load that the model has not: look for tools, cables or what it grips."
        yield Effect(label, "links", (mass,), sentence), partial(changes.add_payload, name, _tip(robot, name))


def _stops(robot: Robot, scales: Mapping[str, _Scale]) -> Iterator[tuple[Effect, Change]]:
    """Yield end stops that a driven joint may meet early: near where it turned back, or beyond, as far as it moved."""
    source = "where the joint turned back, and as far again; a stop gives by a few hundredths of the travel"
    for joint in (each.joint for each in robot.drives):
        low, high = scales[joint].reach
        travel = high - low
        if not travel:
            continue
        for which, end, outward in (("lower", low, -travel), ("upper", high, travel)):
            least, most = sorted((end - _STOP_INWARD * outward, end + outward))
            unit = "rad" if scales[joint].turning else "m"
            position = EffectParameter("position", unit, end + outward, least, most, source)
            sentence = f"Joint {joint} meets its {which} stop early: look for what it runs into, and for cables."
            effect = Effect(f"{which}_stop_{joint}", "joints", (position,), sentence)
            yield effect, partial(changes.put_stop, joint, which == "upper")


_STOP_INWARD = 0.05
"""Of the travel, how far within it a stop is looked for. Assumed: stops of rubber and links give under load."""


def _carries(robot: Robot, name: str) -> bool:
    """Return whether bodies with a mass hang on a body."""
    model = robot.model
    below = model.body_parentid == model.body(name).id
    return bool((model.body_subtreemass[below] > 0.0).any())


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


def _on_timing(robot: Robot) -> Iterator[tuple[Effect, Change]]:
    """Yield effects of timing, and of all drives together."""
    # Late commands and late readings are one effect: no recording of both tells which of them is late.
    most_s, sentence = 0.05, "Positions come late behind efforts: look at filters of the sensors and at the bus."
    if robot.drives:
        most_s = 0.08
        sentence = "Commands or readings come late: look at the load of bus and computer, and at sensor filters."
    delay = EffectParameter("time", "s", 0.0, 0.0, most_s, "buses and drivers: up to some tens of milliseconds")
    yield Effect("delay", "timing", (delay,), sentence), partial(changes.change_timing, "delay_s")
    if not robot.drives:
        return
    rate = EffectParameter("rate", "1", 0.0, -0.01, 0.01, "assumed: clocks without synchronisation, within 1 %")
    sentence = "The clock of the readings runs at another rate than that of the commands: synchronise them."
    yield Effect("clock_skew", "timing", (rate,), sentence), partial(changes.change_timing, "clock_rate")
    if robot.given.base is not Base.FREE:  # MuJoCo would hold a base that is free, too
        driven = tuple(each.joint for each in robot.drives)
        passive = tuple(name for name in robot.joints if name not in driven)
        lowest = -1.0 if float(robot.model.body_gravcomp.max()) > 0.5 else 0.0  # noqa: PLR2004 - rather with it
        share = EffectParameter("share", "1", 0.0, lowest, lowest + 1.0, "from none to all of the weight")
        sentence = "The drives hold another share of the weight by themselves: look at gravity compensation."
        effect = Effect("gravity_compensation", "drives", (share,), sentence)
        yield effect, partial(changes.hold_weight, driven, passive)


def _on_base(robot: Robot) -> Iterator[tuple[Effect, Change]]:
    if robot.given.base is not Base.HELD:
        scale = EffectParameter("scale", "1", 1.0, 0.2, 2.0, "tables of dry friction")
        sentence = "The floor grips otherwise than the model says: clean it, or measure its friction."
        yield Effect("floor_friction", "base", (scale,), sentence), changes.scale_contact_friction
        scale = EffectParameter("scale", "1", 1.0, 0.3, 5.0, "assumed: from a steel plate to a mat")
        sentence = "The floor gives otherwise than the model says: stand the robot on a plate, and compare."
        yield Effect("floor_give", "base", (scale,), sentence), changes.scale_contact_time
    elif np.any(robot.model.opt.gravity):
        angles = _axes("rad", 0.1, "assumed: a base set up by eye, within 6 degrees", ("roll", "pitch"))
        sentence = "The base stands askew: put a level on it."
        yield Effect("base_tilt", "base", angles, sentence), changes.tilt_base


def _on_sensors(robot: Robot) -> Iterator[tuple[Effect, Change]]:
    """Yield errors of sensors at sites: zero, scale, and how they are mounted."""
    weight = 9.81 * float(robot.model.body_mass[1:].sum())
    zeros = {
        Sense.ACCELERATION: (1.0, "data sheets of MEMS sensors: zero within 0.1 g"),
        Sense.RATE: (0.1, "data sheets of MEMS sensors: zero within 6 degrees/s"),
        Sense.FORCE: (0.5 * weight, "assumed: zeroed with up to half of the weight on it"),
        Sense.TORQUE: (0.1 * weight, "assumed: the same at 0.2 m"),
    }
    for site, sense in robot.senses:
        signal, what = f"{site}/{sense.value}", f"the {sense.value.replace('_', ' ')} at {site}"
        axes = _axes(sense.unit, *zeros[sense])
        sentence = f"Readings of {what} have another zero: let the robot stand still, and zero the sensor."
        effect = Effect(f"{sense.value}_offset_{site}", "sensing", axes, sentence)
        yield effect, partial(changes.put, "sensor_offset", signal)
        scale = EffectParameter("scale", "1", 1.0, 0.8, 1.2, "assumed: a wrong range or unit is far off, others less")
        sentence = f"Readings of {what} have another scale: look at the sensor's range and calibration."
        effect = Effect(f"{sense.value}_scale_{site}", "sensing", (scale,), sentence)
        yield effect, partial(changes.put, "sensor_scale", signal)
    for site in dict.fromkeys(site for site, _ in robot.senses):
        turns = _axes("rad", 0.2, "assumed: mounted within 12 degrees")
        sentence = f"The sensor at {site} sits askew: look at how it is mounted, and at its frame."
        yield Effect(f"mounting_{site}", "sensing", turns, sentence), partial(changes.put, "sensor_turn", site)


_TOLERANCES = {"mass": 0.025, "length": 0.02, "gain": 0.025}
"""Standard deviations, as shares, of what no machine has as its model says. Assumed: drawings and data sheets are kept
within 2 to 3 %. Friction, damping and armature have none unless the map gives one: they are effects."""
_FARTHEST = 4.0
"""Standard deviations up to which a constant is looked for."""
_BY_DOF = {"friction": "dof_frictionloss", "damping": "dof_damping", "armature": "dof_armature"}


def _share(robot: Robot, name: str, kind: str) -> Nuisance:
    """Return a constant that scales what the model says, with the tolerance of its kind."""
    given = robot.given.tolerances.get(kind)
    sigma = _TOLERANCES[kind] if given is None else given
    source = "drawings and data sheets: within 2 to 3 %" if given is None else f"the map: within {100.0 * given:g} %"
    return Nuisance(name, "1", 1.0, sigma, source, max(1.0 - _FARTHEST * sigma, 0.05), 1.0 + _FARTHEST * sigma)


def _constants(robot: Robot) -> Iterator[tuple[Nuisance, Change]]:
    """Yield masses, lengths, gains and times of arrival, and what else the map gives a tolerance."""
    for name in _moving_bodies(robot):
        yield _share(robot, f"{name}/mass", "mass"), partial(changes.scale_mass, name)
        if _extent(robot, name) > 0.0:
            yield _share(robot, f"{name}/length", "length"), partial(changes.scale_length, name)
    if robot.drives:
        source = "a recorder stamps commands when it receives them: within milliseconds"
        arrival = Nuisance("commands/arrival", "s", 0.0, 0.003, source, -0.01, 0.01)
        yield arrival, partial(changes.change_timing, "arrival_s")
    if robot.efforts:
        source = "a drive reads position and effort within a cycle of its own: within milliseconds"
        arrival = Nuisance("efforts/arrival", "s", 0.0, 0.002, source, -0.01, 0.01)
        yield arrival, partial(changes.change_timing, "effort_delay_s")
    yield from _gain_constants(robot)
    for kind, own in _BY_DOF.items():
        if kind in robot.given.tolerances:
            for name in (each for each in robot.joints if getattr(robot.model, own)[robot.dof(each)] > 0.0):
                yield _share(robot, f"{name}/{kind}", kind), partial(changes.scale_dof, own, name)
    for joint in robot.given.torque_constants:
        if joint in robot.efforts:
            source = "data sheets: torque constants within 5 %"
            constant = Nuisance(f"{joint}/torque_constant", "1", 1.0, 0.05, source, 0.7, 1.3)
            yield constant, partial(changes.scale_effort, joint)


def _gain_constants(robot: Robot) -> Iterator[tuple[Nuisance, Change]]:
    """Yield the gains of drives: both together, and kd by itself, as the step of a model damps a little, too."""
    for drive in robot.drives:
        joint = drive.joint
        kd = partial(changes.scale_velocity_gain, joint)
        if joint in robot.estimated:
            guess = "estimated from efforts: within 20 %"
            kp = partial(changes.scale_position_gain, joint)
            yield Nuisance(f"{joint}/kp", "1", 1.0, 0.2, guess, 0.3, 3.0), kp
            yield Nuisance(f"{joint}/kd", "1", 1.0, 0.2, guess, 0.3, 3.0), kd
            continue
        yield _share(robot, f"{joint}/gain", "gain"), partial(changes.scale_gains, joint)
        if drive.quantity is Quantity.POSITION and robot.model.actuator(drive.actuator).biasprm[2] != 0.0:
            yield _share(robot, f"{joint}/kd", "gain"), kd
