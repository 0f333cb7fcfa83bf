"""A model that is matched with recordings: its joints by name, its actuators by what was commanded.

The model is prepared for that: a floating base is held or free, joints that nobody measured or commanded are locked,
and actuators take what the recordings command. A PD controller of the map becomes a position actuator: it is the same.
"""

from __future__ import annotations

import difflib
import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from jammkle_gap.mujoco.carried import BASE_JOINTS, carry_base, carry_joint, free_joint
from jammkle_gap.mujoco.coupled import followers_of
from jammkle_gap.mujoco.runs import BadRobotError, Base, Gains, Quantity, Sense
from jammkle_gap.mujoco.unsaid import TEXT_NAME
from jammkle_sim.physics.engine import mujoco

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from jammkle_gap.mujoco.runs import RobotMap, Run

_HINGE, _SLIDE = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)
_LOCKING = 1e7
"""Armature of a locked joint, kg m^2 or kg. Chosen: 100 N m move it by 0.02 mrad in 2 s."""
_TURNED = 1.5
"""Times the model's limits from which on angles are doubted to be radians."""
_SUSPICIOUS_RAD = 8.0 * np.pi
"""The same without limits: four turns."""
_WEIGHTLESS = 1e-12
"""Share of the weight that is compensated at least: MuJoCo leaves it out where it is 0 in all of a compiled model."""
EFFORT_SENSOR = "jammkle effort "
"""Prefix of sensors that are added to the prepared model, one per joint that is driven or whose effort is compared."""
SENSORS = {
    Sense.ACCELERATION: mujoco.mjtSensor.mjSENS_ACCELEROMETER,
    Sense.RATE: mujoco.mjtSensor.mjSENS_GYRO,
    Sense.FORCE: mujoco.mjtSensor.mjSENS_FORCE,
    Sense.TORQUE: mujoco.mjtSensor.mjSENS_TORQUE,
}


@dataclass(frozen=True)
class Drive:
    """An actuator that the recordings command."""

    joint: str
    actuator: str
    quantity: Quantity
    """POSITION or VELOCITY, as its set point is."""
    leading: bool
    """Whether commanded velocities are fed forward by its kd."""
    feeding: bool
    """Whether commanded efforts are fed forward."""


@dataclass(frozen=True)
class Robot:
    """A model that is ready to be run at what was recorded."""

    file: Path
    model: mujoco.MjModel
    joints: tuple[str, ...]
    """Whose position is compared, in the model's order."""
    drives: tuple[Drive, ...]
    """Empty for a robot whose efforts alone are known: it is diagnosed by inverse dynamics."""
    efforts: tuple[str, ...]
    """Joints whose effort is compared."""
    locked: tuple[str, ...]
    estimated: tuple[str, ...]
    """Joints whose controller nobody described: its gains were estimated from efforts."""
    given: RobotMap
    notes: tuple[str, ...]
    senses: tuple[tuple[str, Sense], ...] = ()
    """Sensors at sites that are compared."""
    carried: tuple[str, ...] = ()
    """Joints that move as they were measured; those of a measured base come last."""
    followers: tuple[str, ...] = ()
    """Joints that nobody measured and that equalities of the model couple to measured ones."""
    floating: str = ""
    """Joint of a free base whose pose was measured: windows start there, and it is compared."""

    def is_turning(self, joint: str) -> bool:
        """Return whether a joint is a hinge, in rad and N m, and no slide, in m and N."""
        return int(self.model.joint(joint).type[0]) == _HINGE

    def dof(self, joint: str) -> int:
        """Return the degree of freedom of a joint."""
        return int(self.model.joint(joint).dofadr[0])

    def following(self) -> list[int]:
        """Return the degrees of freedom of the followers."""
        return [
            dof for dof in range(self.model.nv) if self.model.joint(self.model.dof_jntid[dof]).name in self.followers
        ]


def match(file: Path, runs: Sequence[Run], given: RobotMap) -> Robot:
    """Match a model with recordings in its own terms.

    Args:
        file: MJCF, or a URDF that MuJoCo loads.
        runs: By the model's names.
        given: What neither says.

    Raises:
        BadRobotError: they do not fit; the message says what would.

    """
    spec, model = load(file)
    held = {each.name1 for each in spec.equalities if each.type == mujoco.mjtEq.mjEQ_JOINT and not each.name2}
    scalar = [
        model.joint(k).name
        for k in range(model.njnt)
        if int(model.jnt_type[k]) in {_HINGE, _SLIDE} and model.joint(k).name not in held
    ]
    notes: list[str] = []
    measured = _measured_joints(file, scalar, runs, given)
    followers = _followers(model, measured, given, notes)
    missing = _missing_joints(file, [joint for joint in scalar if joint not in followers], runs, given, notes)
    if missing:
        notes.append(f"joints of the model that nobody measured are locked where it has them: {', '.join(missing)}")
    locked = [*given.locked, *missing]
    _hold_balls(spec, followers, notes)
    _check_units(model, measured, runs, given)
    commanded = _commanded(runs, measured)
    drives: tuple[Drive, ...] = ()
    estimated: tuple[str, ...] = ()
    asked = {joint for run in runs for joint, quantity in run.commands if quantity is Quantity.EFFORT}
    carried = [joint for joint in measured if joint in given.carried]
    commanded = {joint: each for joint, each in commanded.items() if joint not in carried}
    others = [joint for joint in measured if joint not in {*commanded, *carried}]
    carried += _left_to_others(spec, model, others, asked, notes, by_commands=bool(commanded))
    if commanded:
        drives, estimated = _made_drives(spec, commanded, runs, given, notes)
        _check_commands(drives, runs, notes)
    known = _known_efforts(runs, measured, notes)
    measured = [joint for joint in measured if joint not in carried]
    efforts = [joint for joint in measured if joint in known]
    if not drives:
        efforts = [joint for joint in measured if joint in known | asked]
        if not efforts:
            msg = "the recordings hold neither commands of positions or velocities nor efforts of any joint"
            msg += "; record the topic of the commands, or joint_states with efforts"
            raise BadRobotError(msg)
        why = "no positions or velocities were commanded" if asked else "no commands were recorded"
        notes.append(f"{why}: efforts of {', '.join(efforts)} are compared with those of the motion")
    floating = _put_base(spec, runs, given, notes, forward=bool(drives))
    _switch_off(spec, (*locked, *carried, *followers))
    for joint in locked:
        spec.joint(joint).armature = _LOCKING
    for joint in carried:
        carry_joint(spec, joint)
    _note_unknown(spec, notes)
    for body in spec.bodies:
        body.gravcomp = body.gravcomp or _WEIGHTLESS
    for joint in dict.fromkeys((*efforts, *(each.joint for each in drives))):
        spec.add_sensor(
            name=f"{EFFORT_SENSOR}{joint}",
            type=mujoco.mjtSensor.mjSENS_JOINTACTFRC,
            objtype=mujoco.mjtObj.mjOBJ_JOINT,
            objname=joint,
        )
    senses = _matched_senses(spec, runs, given, notes)
    for site, sense in senses:
        name = sensor_name(site, sense)
        spec.add_sensor(name=name, type=SENSORS[sense], objtype=mujoco.mjtObj.mjOBJ_SITE, objname=site)
    return Robot(
        file,
        _compiled(spec, file),
        tuple(measured),
        drives,
        tuple(efforts),
        tuple(locked),
        estimated,
        given,
        tuple(notes),
        senses,
        (*carried, *(BASE_JOINTS if given.base is Base.MEASURED else ())),
        followers,
        floating,
    )


def sensor_name(site: str, sense: Sense) -> str:
    """Return the name of a sensor that is added to the prepared model."""
    return f"jammkle {sense.value} {site}"


def _matched_senses(
    spec: mujoco.MjSpec, runs: Sequence[Run], given: RobotMap, notes: list[str]
) -> tuple[tuple[str, Sense], ...]:
    """Return the sensors that all recordings have and whose site the model has; say which are left out.

    Raises:
        BadRobotError: the map names a site that the model has not.

    """
    sites = [each.name for each in spec.sites if each.name]
    for name, asked in given.sensors.items():
        if asked.site not in sites:
            msg = f"the map puts sensor {name} at site {asked.site}, which the model has not"
            msg += f"; it has: {', '.join(sites) or 'none'}"
            raise BadRobotError(msg)
    if not given.senses:
        return ()
    everywhere = [key for key in runs[0].sensed if all(key in run.sensed for run in runs)]
    strange = sorted({site for run in runs for site, _ in run.sensed if site not in sites})
    if strange:
        notes.append(
            f"readings of sensors at {', '.join(strange)} are left out, as no site of the model has that name "
            f"({', '.join(sites) or 'it has none'}); say where they are in a map (sensors: {{{strange[0]}: SITE}})"
        )
    some = sorted({site for run in runs for site, sense in run.sensed if (site, sense) not in everywhere} - {*strange})
    if some:
        notes.append(f"readings of sensors at {', '.join(some)} are left out, as not all recordings have them")
    return tuple(key for key in everywhere if key[0] in sites)


def _followers(model: mujoco.MjModel, measured: Sequence[str], given: RobotMap, notes: list[str]) -> tuple[str, ...]:
    """Return the joints that equalities couple to measured ones."""
    found = [model.joint(joint).name for joint in followers_of(model, [model.joint(name).id for name in measured])]
    found = [name for name in found if name not in given.locked]
    if found:
        notes.append(f"nobody measured {', '.join(found)}: the model's equalities say where they are")
    return tuple(found)


def _hold_balls(spec: mujoco.MjSpec, followers: Sequence[str], notes: list[str]) -> None:
    """Hold ball joints that follow nothing where the model has them: joint states do not have them."""
    balls = [each for each in spec.joints if each.type == mujoco.mjtJoint.mjJNT_BALL and each.name not in followers]
    if balls:
        notes.append(f"ball joints are held where the model has them: {', '.join(each.name for each in balls)}")
    _delete(spec, balls)


def _delete(spec: mujoco.MjSpec, joints: Sequence[mujoco.MjsJoint]) -> None:
    """Take joints out of a model, and its keys, whose positions are of other joints then."""
    for each in (*joints, *(list(spec.keys) if joints else ())):
        spec.delete(each)


def load(file: Path) -> tuple[mujoco.MjSpec, mujoco.MjModel]:
    """Read a model; bodies and joints without a name get one.

    Raises:
        BadRobotError: MuJoCo cannot load it.

    """
    try:
        spec = mujoco.MjSpec.from_file(str(file))
    except (ValueError, OSError) as error:
        msg = f"model {file} cannot be loaded: {' '.join(str(error).split())}"
        raise BadRobotError(msg) from error
    taken = {each.name for each in (*spec.bodies, *spec.joints)}
    for each, kind in (*((body, "body") for body in spec.bodies), *((joint, "joint") for joint in spec.joints)):
        if not each.name:
            where = kind if kind == "body" else f"{each.parent.name}_joint"
            each.name = next(name for k in itertools.count(1) if (name := f"{where}_{k}") not in taken)
            taken.add(each.name)
    return spec, _compiled(spec, file)


def _compiled(spec: mujoco.MjSpec, file: Path) -> mujoco.MjModel:
    try:
        return spec.compile()
    except ValueError as error:
        msg = f"model {file} cannot be compiled: {' '.join(str(error).split())}"
        raise BadRobotError(msg) from error


def _measured_joints(file: Path, scalar: Sequence[str], runs: Sequence[Run], given: RobotMap) -> list[str]:
    """Return the model's joints that all recordings measure.

    Raises:
        BadRobotError: a name of the map has no joint that it could mean, or no joint was measured.

    """
    known = (*given.locked, *given.carried, *given.gains, *given.torque_constants)
    wrong = [name for name in known if name not in scalar]
    if wrong:
        msg = f"the map names joint {wrong[0]}, which model {file.name} has not; it has: {', '.join(scalar)}"
        raise BadRobotError(msg)
    names = list(dict.fromkeys(joint for run in runs for joint in run.joints()))
    measured = [name for name in scalar if all(name in run.joints() for run in runs) and name not in given.locked]
    if not measured:
        msg = f"no joint of the recordings ({', '.join(names)}) is in model {file.name} ({', '.join(scalar)})"
        msg += "; say which is which in a map (joints: {recorded: model})"
        raise BadRobotError(msg)
    return measured


def _missing_joints(
    file: Path, scalar: Sequence[str], runs: Sequence[Run], given: RobotMap, notes: list[str]
) -> list[str]:
    """Return the joints that no recording measures and nobody locked.

    Raises:
        BadRobotError: a name of a recording has no joint that it could mean.

    """
    names = list(dict.fromkeys(joint for run in runs for joint in run.joints()))
    strange = [name for name in names if name not in scalar]
    missing = [name for name in scalar if name not in names and name not in given.locked]
    if strange and missing:
        near = difflib.get_close_matches(strange[0], missing, 1, 0.0)[0]
        msg = f"joint {strange[0]} of the recordings is not in model {file.name}, and these of its joints not in them: "
        msg += f"{', '.join(missing)}; if {near} is meant write 'joints: {{{strange[0]}: {near}}}' into a map"
        msg += f", else '{near}: locked'"
        raise BadRobotError(msg)
    if strange:
        notes.append(f"joints of the recordings that the model has not are left out: {', '.join(strange)}")
    some = [name for name in names if name in scalar and not all(name in run.joints() for run in runs)]
    if some:
        msg = f"joint {some[0]} is measured in some recordings and not in others; lock it, or leave these out"
        raise BadRobotError(msg)
    return missing


def _check_units(model: mujoco.MjModel, joints: Sequence[str], runs: Sequence[Run], given: RobotMap) -> None:
    """Refuse angles that look like degrees, unless the map says what they are."""
    if given.degrees is not None:
        return
    for joint in joints:
        own = model.joint(joint)
        if int(own.type[0]) != _HINGE:
            continue
        limit = _TURNED * float(np.abs(own.range).max()) if model.jnt_limited[own.id] else _SUSPICIOUS_RAD
        for run in runs:
            largest = float(np.abs(run.measured[joint, Quantity.POSITION].values).max())
            if largest > limit:
                msg = f"joint {joint} of recording {run.name} reads up to {largest:.4g}, more than {limit:.3g} rad"
                msg += "; write 'units: degrees' into a map, or 'units: radians' if it does turn so far"
                raise BadRobotError(msg)


def _commanded(runs: Sequence[Run], measured: Sequence[str]) -> dict[str, set[Quantity]]:
    """Return what is commanded of each joint, positions or velocities among it.

    Raises:
        BadRobotError: recordings are not commanded in the same way.

    """
    found: list[dict[str, set[Quantity]]] = []
    for run in runs:
        asked: dict[str, set[Quantity]] = {}
        for joint, quantity in run.commands:
            if joint in measured:
                asked.setdefault(joint, set()).add(quantity)
        found.append({joint: each for joint, each in asked.items() if each - {Quantity.EFFORT}})
    for run, each in zip(runs, found, strict=True):
        if each != found[0]:
            differ = sorted(set(each) ^ set(found[0])) or sorted(each)
            msg = f"recordings {runs[0].name} and {run.name} have different commands (joint {differ[0]})"
            msg += "; diagnose them apart"
            raise BadRobotError(msg)
    return found[0]


def _check_commands(drives: Sequence[Drive], runs: Sequence[Run], notes: list[str]) -> None:
    """Refuse commanded positions that a joint follows, but in another unit; note those that it moves against."""
    for drive in drives:
        if drive.quantity is not Quantity.POSITION:
            continue
        for run in runs:
            read = run.measured[drive.joint, Quantity.POSITION]
            asked = run.commands[drive.joint, Quantity.POSITION].at(read.time_s)
            moved, wanted = read.values - read.values.mean(), asked - asked.mean()
            size = float(np.linalg.norm(moved) * np.linalg.norm(wanted))
            share = float(moved @ wanted) / max(float(wanted @ wanted), 1e-12)
            if min(np.ptp(read.values), np.ptp(asked)) < _STANDS:
                continue
            if float(moved @ wanted) < -_FOLLOWS * size:
                notes.append(f"joint {drive.joint} of {run.name} moves against its commands: look at the sign of one")
            if float(moved @ wanted) > _FOLLOWS * size and not 1.0 / _OTHER_UNIT < share < _OTHER_UNIT:
                msg = f"joint {drive.joint} of recording {run.name} moves by {share:.3g} of what is commanded"
                msg += "; write 'commands: {units: degrees}', or radians, into the map, if angles of one are in degrees"
                raise BadRobotError(msg)


_STANDS = 1e-3
"""Travel, rad or m, below which a joint, or its command, stands: an encoder's step."""
_FOLLOWS = 0.8
"""Correlation of position and command from which on a joint follows."""
_OTHER_UNIT = 10.0
"""How many times what is commanded a joint may move. Chosen: degrees are 57 rad, and no drive is as soft as this."""


def _known_efforts(runs: Sequence[Run], measured: Sequence[str], notes: list[str]) -> set[str]:
    """Return the joints whose efforts were measured, without those that never change, as a driver fills them in."""
    tracks = {joint: [run.measured[joint, Quantity.EFFORT] for run in runs if (joint, Quantity.EFFORT) in run.measured]
              for joint in measured}  # fmt: skip
    known = {joint for joint, efforts in tracks.items() if any(float(np.ptp(each.values)) > 0.0 for each in efforts)}
    if constant := [joint for joint, efforts in tracks.items() if efforts and joint not in known]:
        notes.append(f"efforts that never change are left out: {', '.join(constant)}")
    return known


def _actuators(spec: mujoco.MjSpec, joint: str) -> list[mujoco.MjsActuator]:
    kinds = {mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT}
    return [each for each in spec.actuators if each.trntype in kinds and each.target == joint]


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


def _made_drives(
    spec: mujoco.MjSpec,
    commanded: Mapping[str, set[Quantity]],
    runs: Sequence[Run],
    given: RobotMap,
    notes: list[str],
) -> tuple[tuple[Drive, ...], tuple[str, ...]]:
    """Make each commanded joint an actuator that takes what is commanded.

    Raises:
        BadRobotError: nothing says how a joint follows its commands.

    """
    drives, estimated = [], []
    for joint, quantities in commanded.items():
        wanted = Quantity.POSITION if Quantity.POSITION in quantities else Quantity.VELOCITY
        own = _actuators(spec, joint)
        if len(own) > 1:
            msg = f"joint {joint} has {len(own)} actuators; the library knows one per joint: merge them in the model"
            raise BadRobotError(msg)
        kind = actuator_kind(own[0]) if own else Quantity.EFFORT
        gains = given.gains.get(joint)
        if gains is None and kind is not wanted:
            gains = _estimated_gains(runs, joint, wanted)
            if gains is None:
                what = f"a {kind.value} actuator" if own and kind else "an actuator of another kind" if own else "none"
                msg = f"joint {joint} is commanded by {wanted.value}, and the model has {what} for it"
                msg += f"; describe its controller in a map (gains: {{{joint}: {{kp: ..., kd: ...}}}})"
                msg += ", or record efforts to estimate it from"
                if not own and any(each.trntype == mujoco.mjtTrn.mjTRN_TENDON for each in spec.actuators):
                    msg += f"; if a tendon moves it write 'joints: {{{joint}: measured}}'"
                raise BadRobotError(msg)
            estimated.append(joint)
            notes.append(
                f"nobody described the controller of joint {joint}: kp {gains.kp:.4g} and kd {gains.kd:.4g} are "
                "estimated from its efforts, and fitted as constants"
            )
        actuator = own[0] if own else spec.add_actuator(name=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT, target=joint)
        if not actuator.name:
            actuator.name = joint
        if gains is not None:
            _become_pd(actuator, gains, wanted)
        else:
            _take_gear(actuator)
        leading = wanted is Quantity.POSITION and Quantity.VELOCITY in quantities
        drives.append(Drive(joint, actuator.name, wanted, leading, Quantity.EFFORT in quantities))
    return tuple(drives), tuple(estimated)


def _is_limited(said: int, limits: NDArray[np.float64]) -> bool:
    """Return whether a range counts, as MuJoCo decides: where it is said, or left open and the range is not empty."""
    return said == mujoco.mjtLimited.mjLIMITED_TRUE or (
        said == mujoco.mjtLimited.mjLIMITED_AUTO and bool(limits[0] < limits[1])
    )


def _take_gear(actuator: mujoco.MjsActuator) -> None:
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


def _become_pd(actuator: mujoco.MjsActuator, gains: Gains, wanted: Quantity) -> None:
    """Make an actuator `kp (set point - q) - kd dq`, or `kd (set point - dq)`; its limit of torque stays.

    A motor may have its limit as a range of controls, which are torques then.
    """
    gear = abs(float(actuator.gear[0])) or 1.0
    controls = np.array(actuator.ctrlrange)
    if actuator_kind(actuator) is Quantity.EFFORT and _is_limited(actuator.ctrllimited, controls):
        limits = np.sort(float(actuator.gainprm[0]) * controls)
        own = np.array(actuator.forcerange)
        if _is_limited(actuator.forcelimited, own):
            limits = np.array([max(limits[0], own[0]), min(limits[1], own[1])])
        actuator.forcerange, actuator.forcelimited = limits, mujoco.mjtLimited.mjLIMITED_TRUE
    actuator.forcerange = gear * np.array(actuator.forcerange)
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


def _estimated_gains(runs: Sequence[Run], joint: str, wanted: Quantity) -> Gains | None:
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


def _put_base(spec: mujoco.MjSpec, runs: Sequence[Run], given: RobotMap, notes: list[str], *, forward: bool) -> str:
    """Carry a floating base as it was measured, or hold it; it is free only where the model is run forward.

    Returns:
        Its joint if it is free and was measured.

    """
    if given.base is Base.MEASURED:
        carry_base(spec, runs)
        return ""
    if given.base is Base.FREE and forward:
        free = free_joint(spec, "free")
        without = [run.name for run in runs if not run.base]
        if not without:
            return str(free.name)
        notes.append(
            f"recording {without[0]} holds no odometry: every recording is one window, in which the base starts where "
            "the model has it"
        )
        return ""
    free = [each for each in spec.joints if each.type == mujoco.mjtJoint.mjJNT_FREE]
    notes += [f"the floating base ({each.parent.name}) is held where the model has it" for each in free]
    _delete(spec, free)
    return ""


def _left_to_others(
    spec: mujoco.MjSpec,
    model: mujoco.MjModel,
    others: Sequence[str],
    asked: set[str],
    notes: list[str],
    *,
    by_commands: bool,
) -> list[str]:
    """Return the joints that an actuator moves, nobody knows how: their own, or that of a tendon which spans them.

    Those whose efforts are commanded, in `asked`, are among them where others follow positions: an effort alone does
    not keep a joint where it was measured.

    A tendon spans all joints that lie between its places.
    """
    found: set[int] = set()
    for actuator in range(model.nu):
        if int(model.actuator_trntype[actuator]) != int(mujoco.mjtTrn.mjTRN_TENDON):
            continue
        tendon = int(model.actuator_trnid[actuator, 0])
        own = slice(int(model.tendon_adr[tendon]), int(model.tendon_adr[tendon] + model.tendon_num[tendon]))
        parts = list(zip(model.wrap_type[own].tolist(), model.wrap_objid[own].tolist(), strict=True))
        found |= {part for kind, part in parts if kind == int(mujoco.mjtWrap.mjWRAP_JOINT)}
        places = [int(model.site_bodyid[part]) for kind, part in parts if kind == int(mujoco.mjtWrap.mjWRAP_SITE)]
        lines = [_line(model, body) for body in places]
        bodies = {body for line in lines for body in line if any(body not in other for other in lines)}
        found |= {joint for joint in range(model.njnt) if int(model.jnt_bodyid[joint]) in bodies}
    spanned = {model.joint(joint).name for joint in found}
    left = [joint for joint in others if joint in spanned or (by_commands and _actuators(spec, joint))]
    by_effort = [joint for joint in left if joint in asked]
    if by_effort:
        msg = f"moved as measured, as their efforts are commanded and not their positions: {', '.join(by_effort)}"
        notes.append(f"{msg}; to compare these efforts, give recordings without the other commands")
    uncommanded = [joint for joint in left if joint not in asked]
    if uncommanded:
        notes.append(f"moved as measured, as nobody commands the actuators that act on them: {', '.join(uncommanded)}")
    return left


def _line(model: mujoco.MjModel, body: int) -> set[int]:
    """Return a body and all that it hangs on."""
    found = {body}
    while body:
        body = int(model.body_parentid[body])
        found.add(body)
    return found


def _switch_off(spec: mujoco.MjSpec, joints: Iterable[str]) -> None:
    for name in joints:
        for actuator in _actuators(spec, name):
            actuator.gainprm, actuator.biasprm = np.zeros_like(actuator.gainprm), np.zeros_like(actuator.biasprm)


def _note_unknown(spec: mujoco.MjSpec, notes: list[str]) -> None:
    closing = {mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD}
    chains = [each.name or f"{each.name1} to {each.name2}" for each in spec.equalities if each.type in closing]
    if chains:
        notes.append(f"closed chains run as the model has them, and no effect acts on them: {', '.join(chains)}")
    tendons = [each.name for each in spec.actuators if each.trntype == mujoco.mjtTrn.mjTRN_TENDON]
    if tendons:
        notes.append(f"actuators on tendons get no command, and no effect acts on them: {', '.join(tendons)}")
    if any(each.name == TEXT_NAME for each in spec.texts):
        notes.append("the model was corrected before: what its text says beside MJCF is not simulated, but found anew")
