"""A robot that stands on ankles, and how an ankle is attached to a body of any MJCF robot.

    spec = mujoco.MjSpec.from_file("robot.xml")
    ankle = attach_ankle(spec, "left_shank", "left_ankle", position_m=(0.0, 0.0, -0.2))
    simulation = Simulation(robot_of(spec, (ankle,)))

Foot, joint, tendons, their pulls and the sensors of one ankle are added. Everything that is added carries the ankle's
name and a slash: `left_ankle/foot`, `left_ankle/ankle_pitch`.
"""

from __future__ import annotations

import dataclasses
import math
import warnings
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from jammkle_common.constants import STANDARD_GRAVITY_M_S2
from jammkle_common.names import ANKLE_JOINTS, TENDONS
from jammkle_common.parameters import ParameterError
from jammkle_sim.physics import records
from jammkle_sim.physics.ankle import PITCH, AnkleParameters, add_ankle, joint_law
from jammkle_sim.physics.constants import TENDON_SETS, TendonParameters
from jammkle_sim.physics.engine import mujoco
from jammkle_sim.physics.pneumatics import PneumaticParameters, pneumatic_law
from jammkle_sim.physics.sensors import SensorParameters, imu_law
from jammkle_sim.rigs.model import ankle_laws
from jammkle_sim.rigs.rig import ACCELEROMETER, GYRO, AnkleInModel
from jammkle_sim.robots.options import ImuPlace

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from jammkle_common.parameters import ParameterClass
    from jammkle_sim.rigs.rig import Change, Event, FootPlan, JointControl

_MOUNT, _FOOT, _IMU, _SOLE = "mount", "foot", "imu", "sole_contacts"
_DATA = mujoco.mjtConDataField
_WORLD = "world"
_LARGEST_STEP_S = 1e-3
"""Longest time step, s: the one beyond which landings read too high (`rigs.options.timestep_option`)."""
_LOCK_IMPEDANCE = 0.9999
"""MuJoCo's hardest constraint, so that a locked ankle gives by less than a milliradian."""
_STRONGEST_FIRST = 2
"""Reduction `maxforce` of MuJoCo's contact sensor."""
_SEEDS_APART = 2**32
"""From one ankle's seed to the next one's: more than any seed that can be asked for, so that no two are the same."""


@dataclass(frozen=True)
class AttachedAnkle:
    """An ankle on a robot. `names` leads from the names of an ankle alone to those of the robot's model."""

    name: str
    """Name of the ankle; on the graph the namespace of its topics, if the robot has several."""
    parameters: AnkleParameters
    imu: ImuPlace
    joints: Mapping[str, str]
    """Joints that are reported together with the ankle's own, by the name they are reported under: those of the leg."""

    def named(self, part: str) -> str:
        """Return the name in the robot's model of a part of the ankle: `ankle_pitch`, `achilles_left`, `foot`."""
        return f"{self.name}/{part}"

    @property
    def mount(self) -> str:
        """Name of the body that the foot hangs on."""
        return self.named(_MOUNT)

    @property
    def foot(self) -> str:
        """Name of the foot's body."""
        return self.named(_FOOT)

    @property
    def accelerometer(self) -> str:
        """Name of the accelerometer; the gyro's data come right after its."""
        return self.named(ACCELEROMETER)

    @property
    def contacts(self) -> str:
        """Name of the sensor of the foot's contacts."""
        return self.named(_SOLE)

    @property
    def corners(self) -> tuple[str, ...]:
        """Names of the geoms that touch the ground."""
        return tuple(self.named(f"{end}_{side}") for end in ("toe", "heel") for side in ("left", "right"))


@dataclass(frozen=True)
class AnkleFitting:
    """What an ankle is, and what it is attached with."""

    parameters: AnkleParameters = field(default_factory=AnkleParameters)
    """Geometry, mass, contact."""
    friction: float = 0.8
    """Coefficient of sliding friction of the foot, whatever the ground's."""
    imu: ImuPlace = ImuPlace.SHANK
    """Where the IMU is."""
    imu_body: str = ""
    """Body whose origin it is at, if `imu` says BODY."""
    leg_joints: Mapping[str, str] = field(default_factory=dict)
    """Hinges and slides reported together with the ankle's: name in the model by the name reported."""
    sensors: SensorParameters = field(default_factory=SensorParameters)
    """Range of the IMU."""
    rigid: bool = False
    """Whether the joint is locked: the baseline without an ankle."""


class NoControl:
    """Leaves all controls as they are: the user's own code sets them."""

    def command(self, time_s: float, data: Any) -> None:
        """Do nothing."""

    def plan(self, ankle: str, time_s: float) -> FootPlan | None:  # noqa: ARG002 - for any of them
        """There is no gait."""
        return None


@dataclass(frozen=True)
class JointCourse:
    """Where some joints of a robot shall be over time: straight lines between points, the last of which stays."""

    joints: tuple[str, ...]
    """With a servo, in the model."""
    time_s: NDArray[np.float64]
    """Since it was given, rising, shape (n,), s; the joints go to the first point from where they were asked to be."""
    angles_rad: NDArray[np.float64]
    """Shape (n, joints)."""
    begins_s: float | None = None
    """Time of the run at which it begins, s; until then the joints stay. None: with the next command."""


@dataclass
class _Followed:
    """A course that is followed, by the servos of its joints that no later one names."""

    course: JointCourse
    servos: list[int]
    angles_rad: NDArray[np.float64]
    """Of the course, shape (points, servos)."""
    begun_s: float | None = None

    def begin(self, time_s: float, before_rad: NDArray[np.float64]) -> None:
        """Begin, or begin with a run that starts anew, from what was asked of all servos before."""
        begins_s = self.course.begins_s if self.begun_s is None else None
        self.begun_s = time_s if begins_s is None else begins_s
        self._times_s = self.begun_s + np.concatenate(([0.0], self.course.time_s))
        self._path_rad = np.vstack((before_rad[self.servos], self.angles_rad))

    def asked_rad(self, time_s: float) -> list[float]:
        """Return what each servo is asked once it has begun."""
        return [float(np.interp(time_s, self._times_s, angles)) for angles in self._path_rad.T]

    def leave(self, servos: list[int]) -> None:
        """Leave servos to a later course."""
        kept = [place for place, servo in enumerate(self.servos) if servo not in servos]
        self.servos, self.angles_rad = [self.servos[place] for place in kept], self.angles_rad[:, kept]
        if self.begun_s is not None:
            self._path_rad = self._path_rad[:, kept]


class FollowingControl:
    """Lets a robot's joints follow courses, in place of what its own control asks of them."""

    def __init__(self, model: Any, own: JointControl) -> None:
        """Begin with what its own control asks."""
        self._model, self._own = model, own
        self._followed: list[_Followed] = []
        self._commanded_s = 0.0

    def follow(self, course: JointCourse | None) -> None:
        """Follow a course from when it begins, or the robot's own control again.

        Joints that the course does not name go on with the course that they follow. A course that is still followed
        when a run starts anew begins with it.

        Raises:
            ParameterError: the robot has no such servo, one is named twice, or an angle is beyond its joint's range.

        """
        if course is None:
            self._followed.clear()
            return
        known = {
            self._model.actuator(i).name: i
            for i in range(self._model.nu)
            if self._model.actuator(i).trntype[0] == mujoco.mjtTrn.mjTRN_JOINT
        }
        for place, joint in enumerate(course.joints):
            if joint not in known or joint in course.joints[:place]:
                problem = "is named twice" if joint in known else "has no servo"
                msg = f"joint '{joint}' {problem}; this robot's are: {', '.join(known)}"
                raise ParameterError(msg)
        for joint, angles_rad in zip(course.joints, course.angles_rad.T, strict=True):
            number = int(self._model.actuator(joint).trnid[0])
            low_rad, high_rad = self._model.jnt_range[number].tolist()
            if self._model.jnt_limited[number] and not low_rad <= angles_rad.min() <= angles_rad.max() <= high_rad:
                least, most = float(angles_rad.min()), float(angles_rad.max())
                msg = f"joint '{joint}' shall go from {least:.4g} to {most:.4g} rad"
                msg += f"; it must stay within {low_rad:.4g} to {high_rad:.4g}"
                raise ParameterError(msg)
        servos = [known[joint] for joint in course.joints]
        for followed in self._followed:
            followed.leave(servos)
        self._followed = [followed for followed in self._followed if followed.servos]
        self._followed.append(_Followed(course, servos, course.angles_rad))

    def command(self, time_s: float, data: Any) -> None:
        """Say where the joints shall be."""
        before_rad = data.ctrl.copy()
        self._own.command(time_s, data)
        for followed in self._followed:
            if followed.begun_s is None or time_s < self._commanded_s:
                followed.begin(time_s, before_rad)
            data.ctrl[followed.servos] = followed.asked_rad(time_s)
        self._commanded_s = time_s

    def plan(self, ankle: str, time_s: float) -> FootPlan | None:
        """Return what the gait plans of a foot, of the robot's own control."""
        return self._own.plan(ankle, time_s)


@dataclass(frozen=True)
class Robot:
    """A robot, its ankles, and what moves it."""

    name: str
    spec: Any
    """The mujoco.MjSpec that the model was compiled from."""
    model: Any
    """The mujoco.MjModel. A keyframe, if it has one, is the start."""
    ankles: tuple[AttachedAnkle, ...]
    base: str
    """Body that stands for the whole: its pose is reported, and the IMU is on it where that is asked for."""
    tendon: TendonParameters
    pneumatics: PneumaticParameters
    """Of each ankle: every one has its own pump and manifold."""
    sensors: SensorParameters
    control: JointControl = field(default_factory=NoControl)
    events: tuple[Event, ...] = ()
    """By rising step."""
    options: ParameterClass | None = None
    """What it was built from, if it is one of ours."""
    parts: Mapping[str, Any] = field(default_factory=dict)
    """Every other dataclass of constants that went into it, by name."""
    changes: Mapping[str, Change] = field(default_factory=dict)
    """What is done to an ankle, by its name."""

    @property
    def one_imu(self) -> bool:
        """Whether all ankles have the robot's IMU."""
        return all(ankle.imu is ImuPlace.BODY for ankle in self.ankles)

    @property
    def left_out(self) -> tuple[str, ...]:
        """What of an effects file its ankles go without, by `constant.parameter`."""
        return tuple(dict.fromkeys(key for change in self.changes.values() for key in change.left_out))

    def in_model(self) -> tuple[AnkleInModel, ...]:
        """Return every ankle, as the model has it.

        Raises:
            InputError: an ankle cannot be changed as asked for.

        """
        step_s = float(self.model.opt.timestep)
        ankles = (
            AnkleInModel(
                name=ankle.name,
                laws=records.Laws(
                    pneumatic_law(self.pneumatics, step_s),
                    ankle_laws(self.tendon, ankle.parameters, step_s),
                    imu_law(self.sensors, step_s),
                    joint_law(step_s),
                ),
                sensors=dataclasses.replace(self.sensors, seed=self.sensors.seed + index * _SEEDS_APART),
                tendons={tendon: ankle.named(tendon) for tendon in TENDONS},
                joints={**{joint: ankle.named(joint) for joint in ANKLE_JOINTS}, **ankle.joints},
                hinges=tuple(ankle.named(joint) for joint in ANKLE_JOINTS),
                accelerometer=ankle.accelerometer,
                contacts=ankle.contacts,
                bearing_n=STANDARD_GRAVITY_M_S2 * ankle.parameters.foot_mass_kg,
            )
            for index, ankle in enumerate(self.ankles)
        )
        return tuple(
            self.changes[each.name].on_ankle(each, step_s) if each.name in self.changes else each for each in ankles
        )

    def description(self) -> dict[str, object]:
        """Return its name and all its parameters, ready for YAML."""
        parts = {"tendon": self.tendon, "pneumatics": self.pneumatics, "sensors": self.sensors, **self.parts}
        if self.options is not None:
            parts = {"options": self.options, **parts}
        plain = {name: dataclasses.asdict(part) for name, part in parts.items()}
        ankles = [ankle.name for ankle in self.ankles]
        effects = {name: dict(change.values) for name, change in self.changes.items()}
        changed = {"effects": effects} if effects else {}
        return {"robot": self.name, "timestep_s": float(self.model.opt.timestep), "ankles": ankles, **plain, **changed}


def robot_of(
    spec: Any,
    ankles: Sequence[AttachedAnkle],
    *,
    base: str = "",
    parameter_set: str = "fitted",
    pneumatics: PneumaticParameters | None = None,
    seed: int = 0,
    control: JointControl | None = None,
) -> Robot:
    """Make a robot of a user's own model with ankles attached.

    Args:
        spec: The mujoco.MjSpec, with ground, ankles attached. Its first keyframe, if it has one, is the start.
        ankles: What `attach_ankle` returned, one or several.
        base: Body that stands for the whole; empty: the first one of the model.
        parameter_set: Constants of the tendons.
        pneumatics: Pump, valves and volumes of each ankle; None: as they stand, without a reservoir.
        seed: Of all noise.
        control: Moves the robot's own joints; None: `Simulation.data.ctrl` is the user's.

    Raises:
        ParameterError: its time step or integrator does not go with the tendons.

    """
    model = spec.compile()
    check_steps(model)
    return Robot(
        name=spec.modelname,
        spec=spec,
        model=model,
        ankles=tuple(ankles),
        base=base or model.body(1).name,
        tendon=TENDON_SETS[parameter_set],
        pneumatics=pneumatics or PneumaticParameters(),
        sensors=SensorParameters(seed=seed),
        control=control or NoControl(),
    )


def attach_ankle(
    spec: Any,
    body: str,
    name: str,
    *,
    position_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
    pitch_rad: float = 0.0,
    fitting: AnkleFitting | None = None,
) -> AttachedAnkle:
    """Attach an ankle to a body of a robot, with tendons, IMU and the sensor of its contacts.

    The ankle weighs what it does in the paper, and the robot what it did, also one whose compiler has `settotalmass`.
    What does not turn with the foot goes to the body as a part of its own, spread along the tendons. Only the four
    corners of the foot touch anything.

    Args:
        spec: The mujoco.MjSpec of the robot, changed in place.
        body: Body that the ankle hangs on: the shank.
        name: Of the ankle.
        position_m: Centre of the ball joint in the body's frame.
        pitch_rad: How the ankle's frame (x to the toe, z up along the tendons) is turned against the body's about y:
            the shank's lean in the stance. The foot hangs `fitting.parameters.hang_pitch_rad` toe-down from there.
        fitting: What the ankle is; None: as it stands.

    Returns:
        What a simulation needs to know of it.

    Raises:
        ParameterError: no such body, the name is taken, or a robot with `settotalmass` does not compile by itself.

    """
    fitting = fitting or AnkleFitting()
    ankle = AttachedAnkle(name, fitting.parameters, fitting.imu, dict(fitting.leg_joints))
    shank = _body(spec, body)
    if spec.body(ankle.foot) is not None:
        msg = f"ankle '{name}' is attached already: give this one another name"
        raise ParameterError(msg)
    _fix_masses(spec)
    spec.compiler.fusestatic = False  # the mount does not move on its body, and is looked for by its name
    frame = shank.add_frame(pos=position_m, quat=(math.cos(pitch_rad / 2.0), 0.0, math.sin(pitch_rad / 2.0), 0.0))
    frame.attach_body(_ankle_alone(fitting.parameters, fitting.friction), f"{name}/", "")
    places = {ImuPlace.FOOT: ankle.foot, ImuPlace.SHANK: ankle.mount, ImuPlace.BODY: fitting.imu_body}
    _body(spec, places[fitting.imu]).add_site(name=ankle.named(_IMU))
    _add_sensors(spec, ankle, fitting.sensors)
    if fitting.rigid:
        _lock(spec, ankle)
    return ankle


def check_steps(model: Any) -> None:
    """Refuse a model that cannot be stepped together with the tendons' law.

    Raises:
        ParameterError: its time step is too long, or its integrator is the one that MuJoCo cannot take in two halves.

    """
    if model.opt.timestep > _LARGEST_STEP_S:
        msg = f"the robot's timestep is {model.opt.timestep:g} s; it must be {_LARGEST_STEP_S:g} s or less, 0.0005 best"
        raise ParameterError(msg)
    if model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4:
        msg = "the robot's integrator is RK4, which takes no forces between its stages: use implicitfast"
        raise ParameterError(msg)


def _body(spec: Any, name: str) -> Any:
    found = spec.body(name)
    if found is None:
        known = ", ".join(body.name for body in spec.bodies if body.name)
        msg = f"the robot has no body '{name}'; its bodies are: {known}"
        raise ParameterError(msg)
    return found


def _fix_masses(spec: Any) -> None:
    """Scale the robot to its `settotalmass` now, so that what is attached is not scaled with it."""
    if spec.compiler.settotalmass <= 0.0:
        return
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # that settotalmass is on its way out
        try:
            scaled_kg = float(spec.compile().body_mass.sum())
            spec.compiler.settotalmass = -1.0
            scale = scaled_kg / float(spec.compile().body_mass.sum())
        except ValueError as error:
            msg = f"the robot has a settotalmass, and does not compile without its ankle: {error}"
            raise ParameterError(msg) from error
    for geom in spec.geoms:
        geom.density *= scale
        geom.mass *= scale  # NaN where the density counts
    for body in spec.bodies:
        body.mass *= scale
        body.inertia = scale * body.inertia
        body.fullinertia = scale * body.fullinertia


def _ankle_alone(parameters: AnkleParameters, friction: float) -> Any:
    """Return the body of an ankle in a model of its own, so that its names and units are not the robot's."""
    spec = mujoco.MjSpec()
    mount = spec.worldbody.add_body(name=_MOUNT)
    add_ankle(spec, mount, parameters, friction)
    # It starts as it hangs, whatever keyframes the robot has: the angle is still counted from the neutral pose.
    half_rad = parameters.hang_pitch_rad / 2.0
    spec.body("foot").quat = (math.cos(half_rad), 0.0, math.sin(half_rad), 0.0)
    spec.joint(PITCH).ref = parameters.hang_pitch_rad
    mass_kg, length_m = parameters.mass_kg - parameters.foot_mass_kg, parameters.tendon_length_m
    mount.mass = mass_kg
    mount.ipos = (0.0, 0.0, length_m / 2.0)
    mount.inertia = (
        *(mass_kg * (length_m**2 / 12.0 + parameters.half_width_m**2 / 4.0),) * 2,
        mass_kg * parameters.half_width_m**2 / 2.0,
    )
    mount.explicitinertial = True
    return mount


def _add_sensors(spec: Any, ankle: AttachedAnkle, sensors: SensorParameters) -> None:
    site = {"objtype": mujoco.mjtObj.mjOBJ_SITE, "objname": ankle.named(_IMU)}
    limit_m_s2 = sensors.acceleration_limit_m_s2
    spec.add_sensor(name=ankle.accelerometer, type=mujoco.mjtSensor.mjSENS_ACCELEROMETER, cutoff=limit_m_s2, **site)
    spec.add_sensor(name=ankle.named(GYRO), type=mujoco.mjtSensor.mjSENS_GYRO, **site)
    spec.add_sensor(
        name=ankle.contacts,
        type=mujoco.mjtSensor.mjSENS_CONTACT,
        objtype=mujoco.mjtObj.mjOBJ_BODY,
        objname=ankle.foot,
        reftype=mujoco.mjtObj.mjOBJ_BODY,
        refname=_WORLD,
        intprm=(
            1 << int(_DATA.mjCONDATA_FORCE) | 1 << int(_DATA.mjCONDATA_LINVEL),
            _STRONGEST_FIRST,
            records.CONTACT_SLOTS,
        ),
    )


def _lock(spec: Any, ankle: AttachedAnkle) -> None:
    for joint in ANKLE_JOINTS:
        lock = spec.add_equality(name=ankle.named(f"lock_{joint}"), type=mujoco.mjtEq.mjEQ_JOINT)
        lock.objtype = mujoco.mjtObj.mjOBJ_JOINT
        lock.name1 = ankle.named(joint)
        lock.data[:5] = 0.0
        lock.solref = (ankle.parameters.contact_time_s, 1.0)
        lock.solimp[:2] = _LOCK_IMPEDANCE
