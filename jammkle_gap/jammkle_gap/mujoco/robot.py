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

from jammkle_gap.mujoco.coupled import followers_of
from jammkle_gap.mujoco.drives import (
    Drive,
    actuator_kind,
    actuators_of,
    add_motor,
    become_pd,
    estimated_gains,
    free_name,
    joints_of,
    take_gear,
)
from jammkle_gap.mujoco.nonideal import TEXT_NAME
from jammkle_gap.mujoco.prescribed import BASE_JOINTS, free_joint, prescribe_base, prescribe_joint
from jammkle_gap.mujoco.runs import BadRobotError, Base, Quantity, Sense
from jammkle_sim.physics.engine import mujoco

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from jammkle_gap.mujoco.runs import RobotMap, Run

_HINGE = int(mujoco.mjtJoint.mjJNT_HINGE)
_HELD = (mujoco.mjtJoint.mjJNT_FREE, mujoco.mjtJoint.mjJNT_BALL)
"""Joints that may be held, and are gone then."""
_LOCKING = 1e7
"""Armature of a locked joint, kg m^2 or kg. Chosen: 100 N m move it by 0.02 mrad in 2 s."""
_TURNED = 1.5
"""Times the model's limits from which on angles are doubted to be radians."""
_BEYOND = 0.02
"""Share of a range by which readings may leave it. Assumed: stops give, and zeros are set to a degree."""
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
    prescribed: tuple[str, ...] = ()
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
    return _Matching(file, runs, given).robot()


def sensor_name(site: str, sense: Sense) -> str:
    """Return the name of a sensor that is added to the prepared model."""
    return f"jammkle {sense.value} {site}"


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
    if any(joint.type in _HELD for joint in spec.joints):
        spec.compiler.fusestatic = False  # a body that is held in the prepared model stays the same body in both
    taken = {each.name for each in (*spec.bodies, *spec.joints)}
    for each, kind in (*((body, "body") for body in spec.bodies), *((joint, "joint") for joint in spec.joints)):
        if not each.name:
            where = kind if kind == "body" else f"{each.parent.name}_joint"
            each.name = next(name for k in itertools.count(1) if (name := f"{where}_{k}") not in taken)
            taken.add(each.name)
    model = _compiled(spec, file)
    if spec.compiler.settotalmass > 0.0:
        _keep_masses(spec, model)
        model = _compiled(spec, file)
    return spec, model


def _keep_masses(spec: mujoco.MjSpec, model: mujoco.MjModel) -> None:
    """Give every body the mass that `settotalmass` has scaled it to, so that one of them can change by itself."""
    for body in spec.bodies[1:]:
        own = model.body(body.name)
        body.explicitinertial, body.mass = True, float(own.mass[0])
        body.inertia, body.ipos, body.iquat = own.inertia, own.ipos, own.iquat
        body.fullinertia = np.full(6, np.nan)
    spec.compiler.settotalmass = -1.0
    spec.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_AUTO


def _compiled(spec: mujoco.MjSpec, file: Path) -> mujoco.MjModel:
    try:
        return spec.compile()
    except ValueError as error:
        msg = f"model {file} cannot be compiled: {' '.join(str(error).split())}"
        raise BadRobotError(msg) from error


class _Matching:
    """A model on its way to be matched with recordings: it is changed, and notes are taken, step by step."""

    def __init__(self, file: Path, runs: Sequence[Run], given: RobotMap) -> None:
        self._file, self._runs, self._given = file, runs, given
        self._spec, self._model = load(file)
        """The model to be prepared, and as it was loaded."""
        self._notes: list[str] = []
        fixed = {each.name1 for each in self._spec.equalities
                 if each.type == mujoco.mjtEq.mjEQ_JOINT and not each.name2}  # fmt: skip
        self._scalar = [name for name in joints_of(self._model) if name not in fixed]
        """Hinges and slides that may move."""

    def robot(self) -> Robot:
        """Do everything."""
        spec, given, runs = self._spec, self._given, self._runs
        measured = self._measured_joints()
        followers = self._followers(measured)
        missing = self._missing_joints(followers)
        locked = [*given.locked, *missing]
        self._hold_balls(followers)
        self._check_units(measured)
        self._note_ranges(measured)
        commanded = self._commanded(measured)
        strange = self._strange_commands()
        asked = {joint for run in runs for joint, quantity in run.commands if quantity is Quantity.EFFORT}
        prescribed = [joint for joint in measured if joint in given.prescribed]
        commanded = {joint: each for joint, each in commanded.items() if joint not in prescribed}
        others = [joint for joint in measured if joint not in {*commanded, *prescribed}]
        prescribed += self._moved_by_others(others, asked, by_commands=bool(commanded))
        drives, estimated = self._made_drives(commanded)
        self._check_commands(drives)
        known = self._known_efforts(measured)
        measured = [joint for joint in measured if joint not in prescribed]
        efforts = [joint for joint in measured if joint in known]
        if not drives:
            efforts = self._efforts_alone([joint for joint in measured if joint in known | asked], asked, strange)
        floating = self._put_base(forward=bool(drives))
        for name in (*locked, *prescribed, *followers):
            for actuator in actuators_of(spec, name):
                actuator.gainprm, actuator.biasprm = np.zeros_like(actuator.gainprm), np.zeros_like(actuator.biasprm)
        for joint in locked:
            spec.joint(joint).armature = _LOCKING
            spec.joint(joint).limited = mujoco.mjtLimited.mjLIMITED_FALSE  # the model may have it beyond its range
        for joint in prescribed:
            prescribe_joint(spec, joint)
        self._note_unknown()
        for body in spec.bodies:
            body.gravcomp = body.gravcomp or _WEIGHTLESS
        for joint in dict.fromkeys((*efforts, *(each.joint for each in drives))):
            kind, of_joint = mujoco.mjtSensor.mjSENS_JOINTACTFRC, mujoco.mjtObj.mjOBJ_JOINT
            spec.add_sensor(name=f"{EFFORT_SENSOR}{joint}", type=kind, objtype=of_joint, objname=joint)
        senses = self._matched_senses()
        for site, sense in senses:
            name = sensor_name(site, sense)
            spec.add_sensor(name=name, type=SENSORS[sense], objtype=mujoco.mjtObj.mjOBJ_SITE, objname=site)
        return Robot(
            file=self._file,
            model=_compiled(spec, self._file),
            joints=tuple(measured),
            drives=drives,
            efforts=tuple(efforts),
            locked=tuple(locked),
            estimated=estimated,
            given=given,
            notes=tuple(self._notes),
            senses=senses,
            prescribed=(*prescribed, *(BASE_JOINTS if given.base is Base.MEASURED else ())),
            followers=followers,
            floating=floating,
        )

    def _measured_joints(self) -> list[str]:
        """Return the model's joints that all recordings measure."""
        given, scalar, file = self._given, self._scalar, self._file
        for name in (*given.locked, *given.prescribed, *given.gains, *given.torque_constants):
            if name not in scalar:
                msg = f"the map names joint {name}, which model {file.name} has not; it has: {', '.join(scalar)}"
                raise BadRobotError(msg)
        measured = [name for name in scalar if self._in_all(name) and name not in given.locked]
        if not measured:
            msg = f"no joint of the recordings ({', '.join(self._recorded())}) is in model {file.name}"
            msg += f" ({', '.join(scalar)}); say which is which in a map (joints: {{recorded: model}})"
            raise BadRobotError(msg)
        return measured

    def _recorded(self) -> list[str]:
        return list(dict.fromkeys(joint for run in self._runs for joint in run.joints()))

    def _in_all(self, joint: str) -> bool:
        return all(joint in run.joints() for run in self._runs)

    def _followers(self, measured: Sequence[str]) -> tuple[str, ...]:
        """Return the joints that equalities couple to measured ones."""
        model = self._model
        found = [model.joint(each).name for each in followers_of(model, [model.joint(name).id for name in measured])]
        found = [name for name in found if name not in self._given.locked]
        if found:
            self._notes.append(f"nobody measured {', '.join(found)}: the model's equalities say where they are")
        return tuple(found)

    def _missing_joints(self, followers: Sequence[str]) -> list[str]:
        """Return the joints that no recording measures, nobody locked, and that follow none."""
        scalar, names = [joint for joint in self._scalar if joint not in followers], self._recorded()
        strange = [name for name in names if name not in scalar]
        missing = [name for name in scalar if name not in names and name not in self._given.locked]
        if strange and missing:
            near = difflib.get_close_matches(strange[0], missing, 1, 0.0)[0]
            msg = f"joint {strange[0]} of the recordings is not in model {self._file.name}"
            msg += f", and these of its joints not in them: {', '.join(missing)}"
            msg += f"; if {near} is meant write 'joints: {{{strange[0]}: {near}}}' into a map, else '{near}: locked'"
            raise BadRobotError(msg)
        if strange:
            self._notes.append(f"joints of the recordings that the model has not are left out: {', '.join(strange)}")
        some = [name for name in names if name in scalar and not self._in_all(name)]
        if some:
            msg = f"joint {some[0]} is measured in some recordings and not in others; lock it, or leave these out"
            raise BadRobotError(msg)
        if missing:
            note = f"joints of the model that nobody measured are locked where it has them: {', '.join(missing)}"
            self._notes.append(note)
        return missing

    def _hold_balls(self, followers: Sequence[str]) -> None:
        """Hold ball joints that follow nothing where the model has them: joint states do not have them."""
        balls = [each for each in self._spec.joints
                 if each.type == mujoco.mjtJoint.mjJNT_BALL and each.name not in followers]  # fmt: skip
        if balls:
            names = ", ".join(each.name for each in balls)
            self._notes.append(f"ball joints are held where the model has them: {names}")
        _delete(self._spec, balls)

    def _check_units(self, measured: Sequence[str]) -> None:
        """Refuse angles that look like degrees, unless the map says what they are."""
        if self._given.degrees is not None:
            return
        for joint in measured:
            own = self._model.joint(joint)
            if int(own.type[0]) != _HINGE:
                continue
            limited = self._model.jnt_limited[own.id]
            limit = _TURNED * float(np.abs(own.range).max()) if limited else _SUSPICIOUS_RAD
            for run in self._runs:
                largest = float(np.abs(run.measured[joint, Quantity.POSITION].values).max())
                if largest > limit:
                    msg = f"joint {joint} of recording {run.name} reads up to {largest:.4g}, more than {limit:.3g} rad"
                    msg += "; write 'units: degrees' into a map, or 'units: radians' if it does turn so far"
                    raise BadRobotError(msg)

    def _note_ranges(self, measured: Sequence[str]) -> None:
        """Note joints that are read beyond the range that the model has of them, as by another sign or zero."""
        for joint in measured:
            number = self._model.joint(joint).id
            if not self._model.jnt_limited[number]:
                continue
            least, most = self._model.jnt_range[number].tolist()
            read = [run.measured[joint, Quantity.POSITION].values for run in self._runs]
            low, high = min(float(each.min()) for each in read), max(float(each.max()) for each in read)
            if max(least - low, high - most) > _BEYOND * (most - least):
                limits = f"the model's range of {least:.3g} to {most:.3g}, where it stops"
                note = f"joint {joint} reads {low:.3g} to {high:.3g}, beyond {limits}: look at its sign, zero and range"
                self._notes.append(note)

    def _commanded(self, measured: Sequence[str]) -> dict[str, set[Quantity]]:
        """Return what is commanded of each joint, positions or velocities among it."""
        first: dict[str, set[Quantity]] = {}
        for run in self._runs:
            asked: dict[str, set[Quantity]] = {}
            for joint, quantity in run.commands:
                if joint in measured:
                    asked.setdefault(joint, set()).add(quantity)
            found = {joint: each for joint, each in asked.items() if each - {Quantity.EFFORT}}
            first = found if run is self._runs[0] else first
            if found != first:
                differ = sorted(set(found) ^ set(first)) or sorted(found)
                msg = f"recordings {self._runs[0].name} and {run.name} have different commands (joint {differ[0]})"
                msg += "; diagnose them apart"
                raise BadRobotError(msg)
        return first

    def _strange_commands(self) -> str:
        """Return the names of commanded joints that neither recordings nor model have, and note them."""
        known = {*self._recorded(), *self._scalar}
        found = dict.fromkeys(joint for run in self._runs for joint, _ in run.commands if joint not in known)
        strange = ", ".join(found)
        if strange:
            self._notes.append(f"commands of joints that recordings and model have not are left out: {strange}")
        return strange

    def _efforts_alone(self, efforts: list[str], asked: set[str], strange: str) -> list[str]:
        """Return the joints whose efforts are compared where no drive is commanded; refuse a robot that has none."""
        if not efforts:
            msg = "the recordings hold neither commands of positions or velocities nor efforts of any joint"
            if strange:
                msg += f", but commands of {strange}; say which is which in a map (joints: {{commanded: model}})"
            else:
                msg += "; record the topic of the commands, or joint_states with efforts"
            raise BadRobotError(msg)
        why = "no positions or velocities were commanded" if asked else "no commands were recorded"
        self._notes.append(f"{why}: efforts of {', '.join(efforts)} are compared with those of the motion")
        return efforts

    def _moved_by_others(self, others: Sequence[str], asked: set[str], *, by_commands: bool) -> list[str]:
        """Return the joints that an actuator moves, nobody knows how: their own, or that of a tendon which spans them.

        Those whose efforts are commanded, in `asked`, are among them where others follow positions: an effort alone
        does not keep a joint where it was measured. A tendon spans all joints that lie between its places.
        """
        spanned = _spanned_by_tendons(self._model)
        left = [joint for joint in others if joint in spanned or (by_commands and actuators_of(self._spec, joint))]
        by_effort = [joint for joint in left if joint in asked]
        if by_effort:
            names = ", ".join(by_effort)
            note = f"moved as measured, as their efforts are commanded and not their positions: {names}"
            self._notes.append(f"{note}; to compare these efforts, give recordings without the other commands")
        uncommanded = [joint for joint in left if joint not in asked]
        if uncommanded:
            names = ", ".join(uncommanded)
            self._notes.append(f"moved as measured, as nobody commands the actuators that act on them: {names}")
        return left

    def _made_drives(self, commanded: Mapping[str, set[Quantity]]) -> tuple[tuple[Drive, ...], tuple[str, ...]]:
        """Give each commanded joint an actuator that takes what is commanded; name those whose gains are estimated."""
        drives, estimated = [], []
        for joint, quantities in commanded.items():
            wanted = Quantity.POSITION if Quantity.POSITION in quantities else Quantity.VELOCITY
            own = actuators_of(self._spec, joint)
            if len(own) > 1:
                msg = f"joint {joint} has {len(own)} actuators; the library knows one per joint"
                msg += ": merge them in the model"
                raise BadRobotError(msg)
            if own and float(own[0].gear[0]) == 0.0:
                msg = f"the actuator of joint {joint} has a gear of 0, so that nothing moves it; give it another one"
                raise BadRobotError(msg)
            kind = actuator_kind(own[0]) if own else Quantity.EFFORT
            gains = self._given.gains.get(joint)
            if gains is None and kind is not wanted:
                gains = estimated_gains(self._runs, joint, wanted)
                if gains is None:
                    raise BadRobotError(self._no_controller(joint, wanted, own, kind))
                estimated.append(joint)
                self._notes.append(
                    f"nobody described the controller of joint {joint}: kp {gains.kp:.4g} and kd {gains.kd:.4g} are "
                    "estimated from its efforts, and fitted as constants"
                )
            if gains is not None and wanted is Quantity.POSITION and gains.kp == 0.0:
                msg = f"joint {joint} is commanded by position, and its gains in the map have no kp"
                msg += f"; write gains: {{{joint}: {{kp: ..., kd: ...}}}}"
                raise BadRobotError(msg)
            actuator = own[0] if own else add_motor(self._spec, joint)
            actuator.name = actuator.name or free_name(self._spec, joint)
            if gains is not None:
                become_pd(actuator, gains, wanted)
            else:
                take_gear(actuator)
            feeds_velocity = wanted is Quantity.POSITION and Quantity.VELOCITY in quantities
            drives.append(Drive(joint, actuator.name, wanted, feeds_velocity, Quantity.EFFORT in quantities))
        return tuple(drives), tuple(estimated)

    def _no_controller(
        self, joint: str, wanted: Quantity, own: Sequence[mujoco.MjsActuator], kind: Quantity | None
    ) -> str:
        known = {Quantity.EFFORT: "a motor", Quantity.POSITION: "a position actuator"}
        what = (
            known.get(kind, "a velocity actuator") if own and kind else "an actuator of another kind" if own else "none"
        )
        msg = f"joint {joint} is commanded by {wanted.value}, and the model has {what} for it"
        msg += f"; describe its controller in a map (gains: {{{joint}: {{kp: ..., kd: ...}}}})"
        msg += ", or record efforts to estimate it from"
        if not own and any(each.trntype == mujoco.mjtTrn.mjTRN_TENDON for each in self._spec.actuators):
            msg += f"; if a tendon moves it write 'joints: {{{joint}: measured}}'"
        return msg

    def _check_commands(self, drives: Sequence[Drive]) -> None:
        """Refuse commanded positions that a joint follows, but in another unit; note those that it moves against."""
        by_position = [each.joint for each in drives if each.quantity is Quantity.POSITION]
        for joint, run in itertools.product(by_position, self._runs):
            read = run.measured[joint, Quantity.POSITION]
            asked = run.commands[joint, Quantity.POSITION].at(read.time_s)
            moved, wanted = read.values - read.values.mean(), asked - asked.mean()
            size = float(np.linalg.norm(moved) * np.linalg.norm(wanted))
            share = float(moved @ wanted) / max(float(wanted @ wanted), 1e-12)
            if min(np.ptp(read.values), np.ptp(asked)) < _STANDS:
                continue
            if float(moved @ wanted) < -_FOLLOWS * size:
                self._notes.append(f"joint {joint} of {run.name} moves against its commands: look at the sign of one")
            if float(moved @ wanted) > _FOLLOWS * size and not 1.0 / _OTHER_UNIT < share < _OTHER_UNIT:
                msg = f"joint {joint} of recording {run.name} moves by {share:.3g} of what is commanded"
                msg += "; write 'commands: {units: degrees}', or radians, into the map, if angles of one are in degrees"
                raise BadRobotError(msg)

    def _known_efforts(self, measured: Sequence[str]) -> set[str]:
        """Return the joints whose efforts were measured, without those that never change, as a driver fills them in."""
        tracks = {joint: [run.measured[joint, Quantity.EFFORT] for run in self._runs
                          if (joint, Quantity.EFFORT) in run.measured] for joint in measured}  # fmt: skip
        known = {
            joint for joint, efforts in tracks.items() if any(float(np.ptp(each.values)) > 0.0 for each in efforts)
        }
        if constant := [joint for joint, efforts in tracks.items() if efforts and joint not in known]:
            self._notes.append(f"efforts that never change are left out: {', '.join(constant)}")
        return known

    def _put_base(self, *, forward: bool) -> str:
        """Move a floating base as it was measured, or hold it; it is free only where the model is run forward.

        Returns:
            Its joint if it is free and was measured.

        """
        spec, base = self._spec, self._given.base
        if base is Base.MEASURED:
            prescribe_base(spec, self._runs)
            return ""
        if base is Base.FREE and forward:
            free = free_joint(spec, "free")
            without = [run.name for run in self._runs if not run.base]
            if not without:
                return str(free.name)
            note = f"recording {without[0]} holds no odometry: every recording is one window"
            self._notes.append(f"{note}, in which the base starts where the model has it")
            return ""
        floating = [each for each in spec.joints if each.type == mujoco.mjtJoint.mjJNT_FREE]
        self._notes += [f"the floating base ({each.parent.name}) is held where the model has it" for each in floating]
        _delete(spec, floating)
        return ""

    def _note_unknown(self) -> None:
        spec, closing = self._spec, {mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD}
        chains = [
            each.name or f"{each.name1} to {each.name2 or 'world'}" for each in spec.equalities if each.type in closing
        ]
        if chains:
            names = ", ".join(chains)
            self._notes.append(f"closed chains run as the model has them, and no effect acts on them: {names}")
        tendons = [each.name for each in spec.actuators if each.trntype == mujoco.mjtTrn.mjTRN_TENDON]
        if tendons:
            names = ", ".join(tendons)
            self._notes.append(f"actuators on tendons get no command, and no effect acts on them: {names}")
        if any(each.name == TEXT_NAME for each in spec.texts):
            note = "the model was corrected before: what its text says beside MJCF is not simulated, but found anew"
            self._notes.append(note)

    def _matched_senses(self) -> tuple[tuple[str, Sense], ...]:
        """Return the sensors that all recordings have and whose site the model has; note which are left out."""
        runs, sites = self._runs, [each.name for each in self._spec.sites if each.name]
        for name, asked in self._given.sensors.items():
            if asked.site not in sites:
                msg = f"the map puts sensor {name} at site {asked.site}, which the model has not"
                msg += f"; it has: {', '.join(sites) or 'none'}"
                raise BadRobotError(msg)
        if not self._given.senses:
            return ()
        everywhere = [key for key in runs[0].sensed if all(key in run.sensed for run in runs)]
        strange = sorted({site for run in runs for site, _ in run.sensed if site not in sites})
        if strange:
            self._notes.append(
                f"readings of sensors at {', '.join(strange)} are left out, as no site of the model has that name "
                f"({', '.join(sites) or 'it has none'}); say where they are in a map (sensors: {{{strange[0]}: SITE}})"
            )
        partly = {site for run in runs for site, sense in run.sensed if (site, sense) not in everywhere}
        if some := sorted(partly - {*strange}):
            names = ", ".join(some)
            self._notes.append(f"readings of sensors at {names} are left out, as not all recordings have them")
        return tuple(key for key in everywhere if key[0] in sites)


_STANDS = 1e-3
"""Travel, rad or m, below which a joint, or its command, stands: an encoder's step."""
_FOLLOWS = 0.8
"""Correlation of position and command from which on a joint follows."""
_OTHER_UNIT = 10.0
"""How many times what is commanded a joint may move. Chosen: degrees are 57 rad, and no drive is as soft as this."""


def _delete(spec: mujoco.MjSpec, joints: Sequence[mujoco.MjsJoint]) -> None:
    """Take joints out of a model, and its keys, whose positions are of other joints then."""
    for each in (*joints, *(list(spec.keys) if joints else ())):
        spec.delete(each)


def _spanned_by_tendons(model: mujoco.MjModel) -> set[str]:
    """Return the joints that tendons with an actuator span."""
    found: set[int] = set()
    for actuator in range(model.nu):
        if int(model.actuator_trntype[actuator]) != int(mujoco.mjtTrn.mjTRN_TENDON):
            continue
        tendon = int(model.actuator_trnid[actuator, 0])
        own = slice(int(model.tendon_adr[tendon]), int(model.tendon_adr[tendon] + model.tendon_num[tendon]))
        parts = list(zip(model.wrap_type[own].tolist(), model.wrap_objid[own].tolist(), strict=True))
        found |= {part for kind, part in parts if kind == int(mujoco.mjtWrap.mjWRAP_JOINT)}
        places = [int(model.site_bodyid[part]) for kind, part in parts if kind == int(mujoco.mjtWrap.mjWRAP_SITE)]
        lines = [_ancestors(model, body) for body in places]
        bodies = {body for line in lines for body in line if any(body not in other for other in lines)}
        found |= {joint for joint in range(model.njnt) if int(model.jnt_bodyid[joint]) in bodies}
    return {model.joint(joint).name for joint in found}


def _ancestors(model: mujoco.MjModel, body: int) -> set[int]:
    """Return a body and all that it hangs on."""
    found = {body}
    while body:
        body = int(model.body_parentid[body])
        found.add(body)
    return found
