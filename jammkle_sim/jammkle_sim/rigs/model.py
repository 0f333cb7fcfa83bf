"""Parts that the models of several rigs share: ground, carriage on its slide, hold, drive, sensors.

Frame of every rig: z up, x where the toe points, y to the left; the carriage slides along z.
"""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING, Any

import numpy as np

from jammkle_common.constants import STANDARD_GRAVITY_M_S2
from jammkle_common.names import CARRIAGE_JOINT, CHANNELS, TENDONS_OF_CHANNEL
from jammkle_sim.physics.ankle import PITCH, AnkleParameters, add_ankle, corner_m, free_lengths_m
from jammkle_sim.physics.constants import tendon_parameters
from jammkle_sim.physics.engine import mujoco
from jammkle_sim.physics.pneumatics import PneumaticParameters
from jammkle_sim.physics.records import GUIDED_KG, GUIDED_KG_M2
from jammkle_sim.physics.sensors import SensorParameters
from jammkle_sim.physics.tendon import tendon_law
from jammkle_sim.rigs.guide import guided_by_poses
from jammkle_sim.rigs.rig import ACCELEROMETER, GROUND, GYRO, LOAD_CELL, Rig, free

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray
    from scipy.spatial.transform import Rotation  # type: ignore[import-untyped]  # carries no types

    from jammkle_sim.physics.constants import TendonParameters
    from jammkle_sim.rigs.rig import Event

HOLD = "hold"
"""What the names of constraints begin with that keep a machine where it starts."""
DRIVE = "drive"
"""Actuator that moves the carriage; its control is a speed, m/s."""


def new_spec(name: str, timestep_s: float) -> Any:
    """Return an empty mujoco.MjSpec with the options that all rigs share.

    Args:
        name: Name of the model.
        timestep_s: Time step, s.

    """
    spec = mujoco.MjSpec()
    spec.modelname = name
    spec.compiler.degree = False
    spec.option.timestep = timestep_s
    spec.option.gravity = (0.0, 0.0, -STANDARD_GRAVITY_M_S2)
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 10.0  # less creep of a foot that sticks for a moment
    spec.option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    return spec


def touch_down_height_m(slope_deg: float, ankle: AnkleParameters) -> float:
    """Return the height of the joint above the slope, straight down, at which the hanging foot first touches it, m.

    Args:
        slope_deg: Inclination, degrees, toe uphill.
        ankle: Geometry and pose.

    """
    slope = math.radians(slope_deg)
    # A rounded corner touches where its normal is that of the slope.
    corners_m = [corner_m(ankle, lever_m) for lever_m in (ankle.toe_m, -ankle.heel_m)]
    highest_m = max(forward_m * math.tan(slope) + below_m for forward_m, below_m in corners_m)
    return highest_m + ankle.contact_radius_m / math.cos(slope)


def add_slope(spec: Any, slope_deg: float, friction: float, contact_time_s: float) -> None:
    """Add the ground through the origin, rising toward x.

    Args:
        spec: The mujoco.MjSpec.
        slope_deg: Its inclination, degrees.
        friction: Coefficient of sliding friction.
        contact_time_s: Time constant of the contact, s.

    """
    slope = math.radians(slope_deg)
    spec.worldbody.add_geom(
        name=GROUND,
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=(1.0, 1.0, 0.1),
        quat=(math.cos(slope / 2.0), 0.0, -math.sin(slope / 2.0), 0.0),
        friction=(friction, 0.0, 0.0),
        solref=(contact_time_s, 1.0),
    )


def add_carriage(spec: Any, start_m: float, mass_kg: float) -> Any:
    """Add the carriage on its vertical slide, with the IMU on it, and return its body.

    Args:
        spec: The mujoco.MjSpec.
        start_m: Where it starts; its joint reads as much there.
        mass_kg: Its mass.

    """
    carriage = spec.worldbody.add_body(name="carriage", pos=(0.0, 0.0, start_m))
    slide = carriage.add_joint(name=CARRIAGE_JOINT, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=(0.0, 0.0, 1.0))
    slide.ref = start_m
    weigh(carriage, mass_kg)
    carriage.add_site(name="imu")
    return carriage


def add_guided_carriage(spec: Any) -> Any:
    """Add a carriage that is moved as `physics.kernels.guide` says, with the IMU on it, and return its body.

    To be added first, as its joints must be the first of the model.
    """
    carriage = spec.worldbody.add_body(name="carriage")
    slides = ("carriage_x", "carriage_y", CARRIAGE_JOINT)
    for name, axis in zip(slides, np.eye(3).tolist(), strict=True):
        carriage.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
    carriage.add_joint(name="carriage_turn", type=mujoco.mjtJoint.mjJNT_BALL)
    carriage.mass, carriage.ipos, carriage.inertia = GUIDED_KG, (0.0, 0.0, 0.0), (GUIDED_KG_M2,) * 3
    carriage.explicitinertial = True
    carriage.add_site(name="imu")
    # MuJoCo ends its search for contact forces by the mean inertia of the machine, to which a foot is nothing: by
    # default they are so rough that rounding of the motion moves a pressed foot by 0.1 mrad.
    spec.option.tolerance /= GUIDED_KG
    return carriage


def add_hold(spec: Any, contact_time_s: float, joint: str = CARRIAGE_JOINT) -> None:
    """Hold a slide where it starts, until `release` is called."""
    hold = spec.add_equality(name=f"{HOLD}_{joint}", type=mujoco.mjtEq.mjEQ_JOINT, objtype=mujoco.mjtObj.mjOBJ_JOINT)
    hold.name1 = joint
    hold.data[:5] = 0.0
    hold.solref = (contact_time_s, 1.0)
    hold.solimp[:2] = 0.9999  # MuJoCo's hardest, so that the carriage does not sag when the rig starts


def release(data: Any) -> None:
    """Let go of what is held where it starts."""
    for index in range(data.model.neq):
        if data.model.equality(index).name.startswith(HOLD):
            data.eq_active[index] = 0


def add_drive(spec: Any, mass_kg: float, rate_rad_s: float) -> None:
    """Add a spindle that moves the carriage at the speed of its control: a critically damped servo.

    To be added after the tendons, whose actuators come first. Its position starts at 0 unless a keyframe says more.

    Args:
        spec: The mujoco.MjSpec.
        mass_kg: Mass of all that it moves, kg.
        rate_rad_s: Natural frequency of the servo, rad/s; below half the step rate.

    """
    stiffness_n_m, damping_n_s_m = mass_kg * rate_rad_s**2, 2.0 * mass_kg * rate_rad_s
    drive = spec.add_actuator(name=DRIVE, trntype=mujoco.mjtTrn.mjTRN_JOINT, target=CARRIAGE_JOINT)
    drive.dyntype = mujoco.mjtDyn.mjDYN_INTEGRATOR
    drive.gaintype = mujoco.mjtGain.mjGAIN_FIXED
    drive.biastype = mujoco.mjtBias.mjBIAS_AFFINE
    drive.gainprm[0] = stiffness_n_m
    drive.biasprm[:3] = (0.0, -stiffness_n_m, -damping_n_s_m)


def set_speed(data: Any, speed_m_s: float) -> None:
    """Make the drive move at a speed from now on, m/s, up positive."""
    data.ctrl[data.model.actuator(DRIVE).id] = speed_m_s


def compile_with_start(spec: Any, positions: Mapping[str, float], drive_m: float | None = None) -> Any:
    """Compile the model with a keyframe, if some joints start elsewhere than they were drawn or there is a drive.

    Args:
        spec: The mujoco.MjSpec, otherwise finished.
        positions: Start by joint, rad or m.
        drive_m: Start of the drive's position, m, where there is a drive.

    Returns:
        The mujoco.MjModel.

    """
    model = spec.compile()
    if not positions and drive_m is None:
        return model
    start = mujoco.MjData(model).qpos.copy()
    for name, value in positions.items():
        start[model.joint(name).qposadr[0]] = value
    key = spec.add_key(name="start", qpos=start.tolist())
    if drive_m is not None:
        key.act = [drive_m]
    return spec.compile()


def hanging(ankle: AnkleParameters) -> dict[str, float]:
    """Return where the ankle's joints start, by name, rad, for `compile_with_start`."""
    return {PITCH: ankle.hang_pitch_rad} if ankle.hang_pitch_rad != 0.0 else {}


def ankle_laws(tendon: TendonParameters, ankle: AnkleParameters, timestep_s: float) -> NDArray[Any]:
    """Return the TENDON_LAW records of an ankle's tendons, in the order of TENDONS.

    Args:
        tendon: Constants of each of them.
        ankle: Geometry and pose.
        timestep_s: Time step, s.

    """
    channels = [index for index, channel in enumerate(CHANNELS) for _ in TENDONS_OF_CHANNEL[channel]]
    laws = [
        tendon_law(tendon, timestep_s, float(free_length_m), channel)
        for free_length_m, channel in zip(free_lengths_m(ankle), channels, strict=True)
    ]
    return np.concatenate(laws)


def ankle_under_carriage(  # noqa: PLR0913 - as many as it has parts
    spec: Any,
    options: Any,
    ankle: AnkleParameters,
    *,
    start_m: float = 0.0,
    mass_kg: float = 0.0,
    friction: float = 0.0,
    events: tuple[Event, ...] = (),
    pneumatics: PneumaticParameters | None = None,
    guide: NDArray[np.float64] | None = None,
) -> Rig:
    """Finish a rig whose ankle hangs under a carriage that is held where it starts, or guided.

    Args:
        spec: The mujoco.MjSpec, with what is in the rig beside the ankle; its name is the rig's.
        options: What the rig was made from, with `seed`, `parameter_set` and `timestep_s`.
        ankle: Constants of the ankle.
        start_m: Height of the ankle's joint at the start, m, of a carriage that is held.
        mass_kg: Of that carriage, beside leg and foot.
        friction: Coefficient of sliding friction of the foot.
        events: What the rig does by itself.
        pneumatics: Pump, valves and volumes; None: as they stand.
        guide: How the carriage is guided; None: it is held.

    """
    sensors, pneumatics = SensorParameters(seed=options.seed), pneumatics or PneumaticParameters()
    tendon = tendon_parameters(options.parameter_set)
    carriage = add_carriage(spec, start_m, mass_kg) if guide is None else add_guided_carriage(spec)
    leg = carriage.add_body(name="leg")
    weigh(leg, ankle.mass_kg - ankle.foot_mass_kg)
    add_ankle(spec, leg, ankle, friction)
    if guide is None:
        add_hold(spec, ankle.contact_time_s)
    add_imu_sensors(spec, sensors)
    add_load_cell(spec, leg)
    return Rig(
        name=spec.modelname,
        spec=spec,
        model=compile_with_start(spec, hanging(ankle)),
        tendon_laws=ankle_laws(tendon, ankle, options.timestep_s),
        pneumatics=pneumatics,
        sensors=sensors,
        events=events,
        options=options,
        parts={"ankle": ankle, "tendon": tendon, "pneumatics": pneumatics, "sensors": sensors},
        guide=free() if guide is None else guide,
    )


def guided_ankle(
    spec: Any, options: Any, ankle: AnkleParameters | None, position_m: Any, turn: Rotation, friction: float = 0.0
) -> Rig:
    """Finish an exercise: an ankle as `ankle_under_carriage`, with pose and reservoir of the options, that takes poses.

    They are of its joint, shape (n, 3), m, and from the shank's frame to the world's, n of them, one per time step.
    """
    return ankle_under_carriage(
        spec,
        options,
        hung(ankle, options.hang_pitch_deg),
        friction=friction,
        pneumatics=PneumaticParameters(reservoir_volume_m3=options.reservoir_volume_m3),
        guide=guided_by_poses(options.timestep_s, position_m, turn),
    )


def add_imu_sensors(spec: Any, sensors: SensorParameters) -> None:
    """Put accelerometer, clipped at its range, and gyro onto the site `imu`."""
    site = mujoco.mjtObj.mjOBJ_SITE
    spec.add_sensor(
        name=ACCELEROMETER,
        type=mujoco.mjtSensor.mjSENS_ACCELEROMETER,
        objtype=site,
        objname="imu",
        cutoff=sensors.acceleration_limit_m_s2,
    )
    spec.add_sensor(name=GYRO, type=mujoco.mjtSensor.mjSENS_GYRO, objtype=site, objname="imu")


def add_load_cell(spec: Any, body: Any) -> None:
    """Measure the force between a body and the one that it hangs on: pulled is positive on z, pushed negative."""
    body.add_site(name=LOAD_CELL)
    spec.add_sensor(
        name=LOAD_CELL, type=mujoco.mjtSensor.mjSENS_FORCE, objtype=mujoco.mjtObj.mjOBJ_SITE, objname=LOAD_CELL
    )


def weigh(body: Any, mass_kg: float) -> None:
    """Give a body that only slides its mass; its inertia never matters."""
    body.mass = mass_kg
    body.ipos = (0.0, 0.0, 0.0)  # else the mass is left out of a saved model
    body.inertia = (mass_kg * 1e-3,) * 3
    body.explicitinertial = True


def hung(ankle: AnkleParameters | None, hang_pitch_deg: float) -> AnkleParameters:
    """Return an ankle whose foot hangs by so much more; None: AnkleParameters as they stand."""
    ankle = ankle or AnkleParameters()
    return dataclasses.replace(ankle, hang_pitch_rad=ankle.hang_pitch_rad + math.radians(hang_pitch_deg))
