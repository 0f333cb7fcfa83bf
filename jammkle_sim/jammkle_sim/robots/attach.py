"""Attach the ankle to a body of any MJCF robot: foot, joint, tendons, their pulls, and the sensors of one ankle.

    spec = mujoco.MjSpec.from_file("robot.xml")
    ankle = attach_ankle(spec, "left_shank", "left_ankle", position_m=(0.0, 0.0, -0.2))
    simulation = RobotSimulation(robot_of(spec, (ankle,)))

Everything that is added carries the ankle's name and a slash: `left_ankle/foot`, `left_ankle/ankle_pitch`.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from jammkle_common.names import ANKLE_JOINTS, TENDONS
from jammkle_common.parameters import ParameterError
from jammkle_sim.physics import records
from jammkle_sim.physics.ankle import AnkleParameters, add_ankle
from jammkle_sim.physics.engine import mujoco
from jammkle_sim.physics.sensors import SensorParameters
from jammkle_sim.rigs.rig import ACCELEROMETER, GYRO
from jammkle_sim.robots.options import ImuPlace

if TYPE_CHECKING:
    from collections.abc import Mapping

_MOUNT, _FOOT, _IMU, _SOLE = "mount", "foot", "imu", "sole_contacts"
_DATA = mujoco.mjtConDataField
_WORLD = "world"
_LARGEST_STEP_S = 1e-3
"""Longest time step, s: the one beyond which landings read too high (`rigs.options.timestep_option`)."""
_LOCK_IMPEDANCE = 0.9999
"""MuJoCo's hardest constraint, so that a locked ankle gives by less than a milliradian."""


@dataclass(frozen=True)
class AttachedAnkle:
    """An ankle on a robot. `names` leads from the names of an ankle alone to those of the robot's model."""

    name: str
    """Name of the ankle; on the graph the namespace of its topics, if the robot has several."""
    parameters: AnkleParameters
    imu: ImuPlace
    joints: Mapping[str, str]
    """Joints that are told together with the ankle's own, by the name they are told under: those of the leg."""
    rigid: bool = False

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
    """Hinges and slides told together with the ankle's: name in the model by the name told."""
    sensors: SensorParameters = field(default_factory=SensorParameters)
    """Range of the IMU."""
    rigid: bool = False
    """Whether the joint is locked: the baseline without an ankle."""


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
            the shank's lean in the stance, so that the foot is level there.
        fitting: What the ankle is; None: as it stands.

    Returns:
        What a simulation needs to know of it.

    Raises:
        ParameterError: no such body, the name is taken, or a robot with `settotalmass` does not compile by itself.

    """
    fitting = fitting or AnkleFitting()
    ankle = AttachedAnkle(name, fitting.parameters, fitting.imu, dict(fitting.leg_joints), fitting.rigid)
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


_STRONGEST_FIRST = 2
"""Reduction `maxforce` of MuJoCo's contact sensor."""


def _lock(spec: Any, ankle: AttachedAnkle) -> None:
    for joint in ANKLE_JOINTS:
        lock = spec.add_equality(name=ankle.named(f"lock_{joint}"), type=mujoco.mjtEq.mjEQ_JOINT)
        lock.objtype = mujoco.mjtObj.mjOBJ_JOINT
        lock.name1 = ankle.named(joint)
        lock.data[:5] = 0.0
        lock.solref = (ankle.parameters.contact_time_s, 1.0)
        lock.solimp[:2] = _LOCK_IMPEDANCE


def tendon_names(ankle: AttachedAnkle) -> tuple[str, ...]:
    """Return the names in the robot's model of an ankle's tendons and of their pulls."""
    return tuple(ankle.named(tendon) for tendon in TENDONS)
