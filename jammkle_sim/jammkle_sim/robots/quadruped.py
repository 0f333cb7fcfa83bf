"""A quadruped: a trunk on four legs of three servos each, with an ankle at the end of each."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from jammkle_sim.physics.ankle import AnkleParameters
from jammkle_sim.physics.constants import tendon_parameters
from jammkle_sim.physics.engine import mujoco
from jammkle_sim.physics.pneumatics import PneumaticParameters
from jammkle_sim.physics.sensors import SensorParameters
from jammkle_sim.rigs.model import HOLD, new_spec
from jammkle_sim.rigs.options import checked
from jammkle_sim.robots.ground import IMPEDANCE_RATIO, Ground, compiled_on, events_of
from jammkle_sim.robots.limb import (
    ABDUCTION,
    HIP,
    KNEE,
    Fitting,
    Gait,
    LimbParameters,
    abducted,
    add_limb,
    add_servo,
    stance_back_m,
    toe_drop_m,
)
from jammkle_sim.robots.options import Behaviour, RobotOptions
from jammkle_sim.robots.robot import Robot

if TYPE_CHECKING:
    from jammkle_sim.rigs.rig import FootPlan
    from jammkle_sim.robots.robot import AttachedAnkle


_TRUNK = "trunk"


@dataclass(frozen=True)
class Corner:
    """One leg's place."""

    leg: str
    forward: int
    """1 in front, -1 behind."""
    left: int
    """1 to the left, -1 to the right."""
    phase: float
    """By which share of a trot's period its foot is ahead: diagonal feet step together."""

    @property
    def ankle(self) -> str:
        """Name of its ankle."""
        return f"{self.leg}_ankle"


CORNERS = (Corner("lf", 1, 1, 0.0), Corner("rf", 1, -1, 0.5), Corner("lh", -1, 1, 0.5), Corner("rh", -1, -1, 0.0))
"""Legs, in the order of `jammkle_common.names.QUADRUPED_ANKLES`."""


@dataclass(frozen=True)
class QuadrupedParameters:
    """The quadruped: all assumed, sized so that each ankle bears what falls in the paper's drop test, 1.8 kg."""

    limb: LimbParameters = field(default_factory=LimbParameters)
    trunk_kg: float = 2.392
    """With battery, pumps and computer; with the legs, 1.202 kg each, 7.2 kg: four times 1.8 kg."""
    trunk_m: tuple[float, float, float] = (0.44, 0.14, 0.09)
    """Length, width and height of the trunk, a box of even density."""
    hip_kg: float = 0.35
    """From trunk to thigh: motors of abduction and hip."""
    forward_m: float = 0.19
    """Hips before and behind the middle."""
    left_m: float = 0.06
    """Abduction axes to the left and right of it."""
    offset_m: float = 0.05
    """From there out to the plane of the leg."""
    bearing_share: float = 0.6
    """Share of a trot's period for which a foot stands: two of them overlap."""


class QuadrupedControl:
    """Targets of all twelve servos; legs hang down along gravity, the trunk is along the ground."""

    def __init__(
        self, model: Any, options: RobotOptions, parameters: QuadrupedParameters, ankle: AnkleParameters
    ) -> None:
        """Know where the controls are.

        Args:
            model: The mujoco.MjModel.
            options: What it does.
            parameters: Its sizes.
            ankle: What it stands on, four times.

        """
        self._back_m = stance_back_m(ankle)
        self._parameters = parameters
        slope_rad = math.radians(options.slope_deg)
        self._down = (-math.sin(slope_rad), -math.cos(slope_rad))
        self._walks = options.behaviour == Behaviour.WALK.value
        self._gait = Gait(
            options.speed_m_s,
            options.step_period_s,
            options.step_height_m + toe_drop_m(ankle),
            options.touch_down_m_s,
            parameters.bearing_share,
        )
        self._lead_s = parameters.limb.lag_s
        self._phases = {corner.ankle: corner.phase for corner in CORNERS}
        names = [f"{corner.leg}_{joint}" for corner in CORNERS for joint in (ABDUCTION, HIP, KNEE)]
        self._servos = np.array([model.actuator(name).id for name in names])

    def command(self, time_s: float, data: Any) -> None:
        """Say where all servos shall be."""
        data.ctrl[self._servos] = [
            angle_rad for corner in CORNERS for angle_rad in self._angles_rad(corner, time_s + self._lead_s)
        ]

    def plan(self, ankle: str, time_s: float) -> FootPlan | None:
        """Return what the trot plans of a foot; None: it does not walk."""
        return self._gait.plan(time_s, self._phases[ankle]) if self._walks else None

    def _angles_rad(self, corner: Corner, time_s: float) -> tuple[float, float, float]:
        forward_m, up_m = self._gait.place_m(time_s, corner.phase) if self._walks else (0.0, 0.0)
        forward, up = -self._down[1], self._down[0]  # level, in the trunk's frame
        return stance_rad(
            self._parameters, corner, self._down, forward_m - self._back_m * forward, up_m - self._back_m * up
        )


def stance_rad(
    parameters: QuadrupedParameters, corner: Corner, down: tuple[float, float], forward_m: float, up_m: float
) -> tuple[float, float, float]:
    """Return abduction, hip and knee of a leg, rad.

    Args:
        parameters: Sizes.
        corner: Which leg.
        down: Where gravity points, forward and up, in the trunk's frame.
        forward_m: How far the ankle is forward of where it stands, along the ground.
        up_m: How far it is off the ground.

    """
    offset_m, stance_m = corner.left * parameters.offset_m, parameters.limb.stance_m
    place_m = (stance_m * down[0] + forward_m, offset_m, stance_m * down[1] + up_m)
    return abducted(parameters.limb.segments, offset_m, place_m)


def quadruped(
    options: RobotOptions, parameters: QuadrupedParameters | None = None, ankle: AnkleParameters | None = None
) -> Robot:
    """Build the quadruped.

    Args:
        options: What it does, where.
        parameters: Its sizes; None: as they stand.
        ankle: Constants of its ankles but for their pose, which is an option; None: as they stand.

    Raises:
        ParameterError: an option out of range.

    """
    options = checked(options)
    parameters = parameters or QuadrupedParameters()
    ankle = dataclasses.replace(ankle or AnkleParameters(), hang_pitch_rad=math.radians(options.hang_pitch_deg))
    back_m = stance_back_m(ankle)
    sensors = SensorParameters(seed=options.seed)
    ground = Ground.drawn(options.slope_deg, options.roughness_m, options.seed)
    spec = new_spec("quadruped", options.timestep_s)
    spec.option.impratio = IMPEDANCE_RATIO
    ground.add_to(spec, ankle.contact_time_s)
    trunk = _add_trunk(spec, parameters, options, ground.slope_rad)
    fitting = Fitting(parameters.limb, ankle, sensors, options, _TRUNK)
    ankles = tuple(_add_leg(spec, trunk, corner, parameters, fitting) for corner in CORNERS)
    drop_m = 0.0
    if options.behaviour in {Behaviour.DROP.value, Behaviour.HANG.value}:
        drop_m = options.drop_height_m
        _add_hold(spec, ankle.contact_time_s)
    down = (-math.sin(ground.slope_rad), -math.cos(ground.slope_rad))
    level = (-back_m * -down[1], -back_m * down[0])
    joints = {
        f"{corner.leg}_{joint}": angle_rad
        for corner in CORNERS
        for joint, angle_rad in zip((ABDUCTION, HIP, KNEE), stance_rad(parameters, corner, down, *level), strict=True)
    }
    model = compiled_on(spec, trunk, ground, ankles, joints, drop_m)
    tendon = tendon_parameters(options.parameter_set)
    pneumatics = PneumaticParameters(reservoir_volume_m3=options.reservoir_volume_m3)
    return Robot(
        name="quadruped",
        spec=spec,
        model=model,
        ankles=ankles,
        base=_TRUNK,
        tendon=tendon,
        pneumatics=pneumatics,
        sensors=sensors,
        control=QuadrupedControl(model, options, parameters, ankle),
        events=events_of(options, ankles),
        options=options,
        parts={"ankle": ankle, "quadruped": parameters},
    )


def _add_trunk(spec: Any, parameters: QuadrupedParameters, options: RobotOptions, slope_rad: float) -> Any:
    trunk = spec.worldbody.add_body(name=_TRUNK, quat=(math.cos(slope_rad / 2.0), 0.0, -math.sin(slope_rad / 2.0), 0.0))
    trunk.add_freejoint(name=_TRUNK)
    trunk.add_geom(
        name=_TRUNK,
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[length_m / 2.0 for length_m in parameters.trunk_m],
        mass=parameters.trunk_kg + options.payload_kg,
        contype=2,  # it meets the ground, should it fall, and no foot
        conaffinity=0,
    )
    return trunk


def _add_leg(spec: Any, trunk: Any, corner: Corner, parameters: QuadrupedParameters, fitting: Fitting) -> AttachedAnkle:
    limb, side = parameters.limb, f"{corner.leg}_"
    place_m = (corner.forward * parameters.forward_m, corner.left * parameters.left_m, 0.0)
    hip = trunk.add_body(name=f"{side}hip", pos=place_m)
    hip.add_geom(
        type=mujoco.mjtGeom.mjGEOM_SPHERE,
        size=(2.0 * limb.radius_m, 0.0, 0.0),
        pos=(0.0, corner.left * parameters.offset_m / 2.0, 0.0),
        mass=parameters.hip_kg,
        contype=0,
        conaffinity=0,
    )
    add_servo(spec, hip, f"{side}{ABDUCTION}", (1.0, 0.0, 0.0), limb, (-1.0, 1.0))
    return add_limb(spec, hip, fitting, corner.ankle, (0.0, corner.left * parameters.offset_m, 0.0), side)


def _add_hold(spec: Any, contact_time_s: float) -> None:
    hold = spec.add_equality(name=HOLD, type=mujoco.mjtEq.mjEQ_WELD)
    hold.objtype = mujoco.mjtObj.mjOBJ_BODY
    hold.name1 = _TRUNK
    hold.solref = (contact_time_s, 1.0)
    hold.solimp[:2] = 0.9999  # MuJoCo's hardest, so that it does not sag


def place_of(ankle: str) -> dict[str, float]:
    """Return parameters of the controller of an ankle, by its name; of a leg's none: its hip is its base's origin."""
    quadruped = QuadrupedParameters()
    return {
        name: value
        for corner in CORNERS
        if corner.ankle == ankle
        for name, value in (
            ("hip_x_m", corner.forward * quadruped.forward_m),
            ("hip_y_m", corner.left * quadruped.left_m),
            ("hip_offset_m", corner.left * quadruped.offset_m),
        )
    }
