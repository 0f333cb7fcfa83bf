"""A leg: hip on a base that a boom guides without letting it turn, knee, and a jammable ankle."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from jammkle_common.constants import STANDARD_GRAVITY_M_S2
from jammkle_sim.physics.ankle import AnkleParameters
from jammkle_sim.physics.constants import tendon_parameters
from jammkle_sim.physics.engine import mujoco
from jammkle_sim.physics.pneumatics import PneumaticParameters
from jammkle_sim.physics.sensors import SensorParameters
from jammkle_sim.rigs.model import add_hold, new_spec, weigh
from jammkle_sim.rigs.options import checked
from jammkle_sim.robots.ground import IMPEDANCE_RATIO, Ground, compiled_on, events_of
from jammkle_sim.robots.limb import (
    HIP,
    KNEE,
    START_S,
    Fitting,
    Gait,
    LimbParameters,
    add_limb,
    make_servo,
    stance_back_m,
    toe_drop_m,
)
from jammkle_sim.robots.options import Behaviour, RobotOptions
from jammkle_sim.robots.robot import Robot

if TYPE_CHECKING:
    from jammkle_sim.rigs.rig import FootPlan

ANKLE = "ankle"
"""Name of its ankle."""
BASE_X, BASE_Z = "base_x", "base_z"
"""Slides of its base: forward and up, level whatever the ground."""
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


class LegControl:
    """Targets of hip and knee, and of the boom while it walks."""

    def __init__(self, model: Any, options: RobotOptions, parameters: LegParameters, ankle: AnkleParameters) -> None:
        """Know where the controls are.

        Args:
            model: The mujoco.MjModel.
            options: What the leg does.
            parameters: Its sizes.
            ankle: What it stands on.

        """
        self._back_m = stance_back_m(ankle)
        self._segments = parameters.limb.segments
        self._stance_m = parameters.limb.stance_m
        self._lead_s = parameters.limb.lag_s
        self._slope_rad = math.radians(options.slope_deg)
        self._servos = (model.actuator(HIP).id, model.actuator(KNEE).id)
        self._walks = options.behaviour == Behaviour.WALK.value
        self._gait = Gait(
            options.speed_m_s,
            options.step_period_s,
            options.step_height_m + toe_drop_m(ankle),
            options.touch_down_m_s,
            parameters.bearing_share,
            parameters.push_m,
        )
        if self._walks:
            self._drives = (model.actuator(BASE_X).id, model.actuator(BASE_Z).id)
            self._forward_at = int(model.joint(BASE_X).qposadr[0])

    def command(self, time_s: float, data: Any) -> None:
        """Say where hip and knee shall be."""
        along_m, off_m = 0.0, 0.0
        if self._walks:
            along_m, off_m = self._gait.place_m(time_s + self._lead_s, 0.0)
            speed_m_s = self._gait.speed_m_s if time_s >= START_S else 0.0
            speed_m_s *= min((time_s - START_S) / self._gait.period_s, 1.0) if time_s >= START_S else 0.0
            forward, up = self._drives
            data.ctrl[forward] = speed_m_s * math.cos(self._slope_rad)
            data.ctrl[up] = float(data.qpos[self._forward_at]) * math.tan(self._slope_rad)
        sine, cosine = math.sin(self._slope_rad), math.cos(self._slope_rad)
        forward_m = along_m * cosine - off_m * sine - self._back_m
        up_m = along_m * sine + off_m * cosine - self._stance_m
        data.ctrl[list(self._servos)] = self._segments.angles_rad(forward_m, up_m)

    def plan(self, ankle: str, time_s: float) -> FootPlan | None:  # noqa: ARG002 - it has but one
        """Return what the gait plans of the foot; None: it does not walk."""
        return self._gait.plan(time_s, 0.0) if self._walks else None


def leg(options: RobotOptions, parameters: LegParameters | None = None, ankle: AnkleParameters | None = None) -> Robot:
    """Build the leg.

    Args:
        options: What it does, where.
        parameters: Its sizes; None: as they stand.
        ankle: Constants of the ankle but for its pose, which is an option; None: as they stand.

    Raises:
        ParameterError: an option out of range.

    """
    options = checked(options)
    parameters = parameters or LegParameters()
    ankle = dataclasses.replace(ankle or AnkleParameters(), hang_pitch_rad=math.radians(options.hang_pitch_deg))
    back_m = stance_back_m(ankle)
    sensors, limb = SensorParameters(seed=options.seed), parameters.limb
    ground = Ground.drawn(options.slope_deg, options.roughness_m, options.seed)
    spec = new_spec("leg", options.timestep_s)
    spec.option.impratio = IMPEDANCE_RATIO
    ground.add_to(spec, ankle.contact_time_s)
    base = spec.worldbody.add_body(name=_BASE)
    for name, axis in ((BASE_X, (1.0, 0.0, 0.0)), (BASE_Z, (0.0, 0.0, 1.0))):
        base.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
    weigh(base, parameters.mass_kg - limb.thigh_kg - limb.shank_kg - ankle.mass_kg + options.payload_kg)
    fitting = Fitting(limb, ankle, sensors, options, _BASE)
    attached = add_limb(spec, base, fitting, ANKLE, (0.0, 0.0, 0.0))
    drop_m = 0.0
    if options.behaviour == Behaviour.WALK.value:
        _add_boom(spec, parameters, options)
    if options.behaviour in {Behaviour.DROP.value, Behaviour.HANG.value}:
        drop_m = options.drop_height_m
        for joint in (BASE_X, BASE_Z):
            add_hold(spec, ankle.contact_time_s, joint)
    angles_rad = limb.segments.angles_rad(-back_m, -limb.stance_m)
    model = compiled_on(spec, base, ground, (attached,), dict(zip((HIP, KNEE), angles_rad, strict=True)), drop_m)
    tendon = tendon_parameters(options.parameter_set)
    pneumatics = PneumaticParameters(reservoir_volume_m3=options.reservoir_volume_m3)
    return Robot(
        name="leg",
        spec=spec,
        model=model,
        ankles=(attached,),
        base=_BASE,
        tendon=tendon,
        pneumatics=pneumatics,
        sensors=sensors,
        control=LegControl(model, options, parameters, ankle),
        events=events_of(options, (attached,)),
        options=options,
        parts={"ankle": ankle, "leg": parameters},
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
