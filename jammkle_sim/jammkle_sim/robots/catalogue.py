"""Our robots by name: the leg, the quadruped, which has a file of its own, and an ankle by itself."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from jammkle_common.constants import STANDARD_GRAVITY_M_S2
from jammkle_common.names import BASE_FRAME, LOAD_CELL_FRAME
from jammkle_common.parameters import ParameterError
from jammkle_sim.physics.engine import mujoco
from jammkle_sim.rigs.model import add_hold, new_spec, weigh
from jammkle_sim.rigs.simulation import Simulation
from jammkle_sim.robots.ground import Building
from jammkle_sim.robots.limb import HIP, KNEE, LimbControl, LimbParameters, add_limb, make_servo, stance_back_m
from jammkle_sim.robots.options import ROBOTS, Behaviour, RobotOptions
from jammkle_sim.robots.quadruped import quadruped
from jammkle_sim.robots.robot import AnkleFitting, Robot, attach_ankle, robot_of

if TYPE_CHECKING:
    from collections.abc import Callable

    from jammkle_sim.physics.ankle import AnkleParameters

ANKLE = "ankle"
"""Name of the ankle of a leg, and of one by itself, which is a robot of that name."""
BASE_X, BASE_Z = "base_x", "base_z"
"""Slides of the leg's base: forward and up, level whatever the ground."""
_BASE = "base"


@dataclass(frozen=True)
class LegParameters:
    """The leg on its boom."""

    limb: LimbParameters = field(default_factory=LimbParameters)
    mass_kg: float = 1.8
    """All of it, payload not counted: what falls in the paper's drop test. The base gets what the limb leaves."""
    bearing_share: float = 0.6
    """Share of a step's period for which the foot stands. Assumed."""
    push_m: float = 0.01
    """While it walks a soft spring of the boom bears the base, as other legs would; the foot stands by pushing down so
    far, and bears about the whole weight then. Assumed."""
    drive_n: float = 60.0
    """Largest force with which the boom moves the base forward. Assumed: three times the weight."""
    drive_n_s_m: float = 200.0
    """Damping of that drive toward its speed. Assumed."""


class LegControl(LimbControl):
    """Targets of hip and knee, and of the boom while it walks."""

    def __init__(self, model: Any, building: Building, parameters: LegParameters) -> None:
        """Know where the controls are."""
        self._limb = parameters.limb
        phases, share, push_m = {ANKLE: 0.0}, parameters.bearing_share, parameters.push_m
        super().__init__(model, building, self._limb, (HIP, KNEE), phases, share, push_m)
        if self.walks:
            self._drives = (model.actuator(BASE_X).id, model.actuator(BASE_Z).id)
            self._forward_at = int(model.joint(BASE_X).qposadr[0])

    def command(self, time_s: float, data: Any) -> None:
        """Say where hip and knee shall be."""
        sine, cosine = math.sin(self.slope_rad), math.cos(self.slope_rad)
        if self.walks:
            forward, up = self._drives
            data.ctrl[forward] = self.gait.grown(time_s) * self.gait.speed_m_s * cosine
            data.ctrl[up] = float(data.qpos[self._forward_at]) * math.tan(self.slope_rad)
        along_m, off_m = self.place_m(ANKLE, time_s)
        forward_m = along_m * cosine - off_m * sine - self.back_m
        up_m = along_m * sine + off_m * cosine - self._limb.stance_m
        data.ctrl[self.servos] = self._limb.segments.angles_rad(forward_m, up_m)


def leg(options: RobotOptions) -> Robot:
    """Build the leg: hip on a base that a boom guides without letting it turn, knee, and a jammable ankle.

    Raises:
        ParameterError: an option out of range.

    """
    parameters = LegParameters()
    limb = parameters.limb
    building = Building("leg", _BASE, options)
    spec, ankle = building.spec, building.ankle
    base = spec.worldbody.add_body(name=_BASE)
    for name, axis in ((BASE_X, (1.0, 0.0, 0.0)), (BASE_Z, (0.0, 0.0, 1.0))):
        base.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
    weigh(base, parameters.mass_kg - limb.thigh_kg - limb.shank_kg - ankle.mass_kg + options.payload_kg)
    attached = add_limb(building, limb, base, ANKLE, (0.0, 0.0, 0.0))
    if options.behaviour == Behaviour.WALK.value:
        _add_boom(spec, parameters, options)
    if building.is_held:
        for joint in (BASE_X, BASE_Z):
            add_hold(spec, ankle.contact_time_s, joint)
    angles_rad = limb.segments.angles_rad(-stance_back_m(ankle), -limb.stance_m)
    return building.finished(
        (attached,),
        dict(zip((HIP, KNEE), angles_rad, strict=True)),
        lambda model: LegControl(model, building, parameters),
        {"leg": parameters},
    )


def _add_boom(spec: Any, parameters: LegParameters, options: RobotOptions) -> None:
    """Move the base forward, and bear it with a soft spring, critically damped."""
    forward = spec.add_actuator(name=BASE_X, trntype=mujoco.mjtTrn.mjTRN_JOINT, target=BASE_X)
    make_servo(forward, parameters.drive_n_s_m, 0.0, parameters.drive_n)
    forward.biasprm[:3] = (0.0, 0.0, -parameters.drive_n_s_m)  # a speed, not a place
    mass_kg = parameters.mass_kg + options.payload_kg
    weight_n = STANDARD_GRAVITY_M_S2 * mass_kg
    stiffness_n_m = weight_n / parameters.push_m
    up = spec.add_actuator(name=BASE_Z, trntype=mujoco.mjtTrn.mjTRN_JOINT, target=BASE_Z)
    make_servo(up, stiffness_n_m, 2.0 * math.sqrt(stiffness_n_m * mass_kg), 3.0 * weight_n)
    up.biasprm[0] = weight_n


_BUILT_BY: dict[str, Callable[[RobotOptions], Robot]] = dict(zip(ROBOTS, (leg, quadruped), strict=True))


def robot(name: str, options: RobotOptions) -> Robot:
    """Build one of our robots.

    Raises:
        ParameterError: there is no such robot, or an option out of range.

    """
    if name not in _BUILT_BY:
        msg = f"robot '{name}' does not exist; known are: {', '.join(ROBOTS)}"
        raise ParameterError(msg)
    return _BUILT_BY[name](options)


def robot_simulation(name: str, options: RobotOptions) -> Simulation:
    """Build one of our robots, ready to run; as `robot` otherwise."""
    return Simulation(robot(name, options))


def ankle_alone(parameters: AnkleParameters | None = None) -> Robot:
    """Build an ankle that hangs on nothing but a fixed base, with the IMU at the centre of its joint, as the rigs have.

    The base has no mass; its origin is the centre of the ball joint, and so is that of the rigs' load cell.
    """
    spec = new_spec(ANKLE, RobotOptions().timestep_s)
    spec.worldbody.add_body(name=BASE_FRAME)
    fitting = AnkleFitting() if parameters is None else AnkleFitting(parameters)
    ankle = attach_ankle(spec, BASE_FRAME, ANKLE, fitting=fitting)
    spec.body(ankle.mount).add_site(name=ankle.named(LOAD_CELL_FRAME))
    return robot_of(spec, (ankle,), base=BASE_FRAME)
