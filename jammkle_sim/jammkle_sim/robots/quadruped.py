"""A quadruped: a trunk on four legs of three servos each, with an ankle at the end of each."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from jammkle_sim.physics.engine import mujoco
from jammkle_sim.rigs.model import HOLD
from jammkle_sim.robots.ground import Building
from jammkle_sim.robots.limb import (
    ABDUCTION,
    HIP,
    KNEE,
    LimbControl,
    LimbParameters,
    abducted,
    add_limb,
    add_servo,
    stance_back_m,
)

if TYPE_CHECKING:
    from jammkle_sim.robots.options import RobotOptions
    from jammkle_sim.robots.robot import AttachedAnkle, Robot

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


class QuadrupedControl(LimbControl):
    """Targets of all twelve servos; legs hang down along gravity, the trunk is along the ground."""

    def __init__(self, model: Any, building: Building, parameters: QuadrupedParameters) -> None:
        """Know where the controls are."""
        servos = [f"{corner.leg}_{joint}" for corner in CORNERS for joint in (ABDUCTION, HIP, KNEE)]
        phases = {corner.ankle: corner.phase for corner in CORNERS}
        super().__init__(model, building, parameters.limb, servos, phases, parameters.bearing_share)
        self._parameters = parameters

    def command(self, time_s: float, data: Any) -> None:
        """Say where all servos shall be."""
        data.ctrl[self.servos] = [
            angle_rad
            for corner in CORNERS
            for angle_rad in stance_rad(
                self._parameters, corner, self.slope_rad, self.back_m, *self.place_m(corner.ankle, time_s)
            )
        ]


def stance_rad(
    parameters: QuadrupedParameters,
    corner: Corner,
    slope_rad: float,
    back_m: float,
    forward_m: float = 0.0,
    up_m: float = 0.0,
) -> tuple[float, float, float]:
    """Return abduction, hip and knee of a leg, rad, with the trunk along the slope.

    Args:
        parameters: Sizes.
        corner: Which leg.
        slope_rad: Inclination of the ground.
        back_m: How far behind its hip, level, the ankle stands.
        forward_m: How far the ankle is forward of where it stands, along the ground.
        up_m: How far it is off the ground.

    """
    down_forward, down_up = -math.sin(slope_rad), -math.cos(slope_rad)  # where gravity points in the trunk's frame
    offset_m, stance_m = corner.left * parameters.offset_m, parameters.limb.stance_m
    place_m = (
        stance_m * down_forward + (forward_m - back_m * -down_up),
        offset_m,
        stance_m * down_up + (up_m - back_m * down_forward),
    )
    return abducted(parameters.limb.segments, offset_m, place_m)


def quadruped(options: RobotOptions) -> Robot:
    """Build the quadruped.

    Raises:
        ParameterError: an option out of range.

    """
    parameters = QuadrupedParameters()
    building = Building("quadruped", _TRUNK, options)
    slope_rad = building.ground.slope_rad
    trunk = _add_trunk(building.spec, parameters, options, slope_rad)
    ankles = tuple(_add_leg(building, trunk, corner, parameters) for corner in CORNERS)
    if building.is_held:
        _add_hold(building.spec, building.ankle.contact_time_s)
    joints = {
        f"{corner.leg}_{joint}": angle_rad
        for corner in CORNERS
        for joint, angle_rad in zip(
            (ABDUCTION, HIP, KNEE),
            stance_rad(parameters, corner, slope_rad, stance_back_m(building.ankle)),
            strict=True,
        )
    }
    return building.finished(
        ankles, joints, lambda model: QuadrupedControl(model, building, parameters), {"quadruped": parameters}
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


def _add_leg(building: Building, trunk: Any, corner: Corner, parameters: QuadrupedParameters) -> AttachedAnkle:
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
    add_servo(building.spec, hip, f"{side}{ABDUCTION}", (1.0, 0.0, 0.0), limb, (-1.0, 1.0))
    return add_limb(building, limb, hip, corner.ankle, (0.0, corner.left * parameters.offset_m, 0.0), side)


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
