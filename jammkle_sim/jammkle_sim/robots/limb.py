"""A limb of our robots: its angles, its gait, thigh and shank with servos at hip and knee, and an ankle at its end."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from jammkle_common.names import LEG_JOINTS
from jammkle_sim.physics.ankle import corner_m
from jammkle_sim.physics.engine import mujoco
from jammkle_sim.rigs.rig import FootPlan
from jammkle_sim.robots.options import AnkleKind, Behaviour, ImuPlace
from jammkle_sim.robots.robot import AnkleFitting, attach_ankle

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from jammkle_sim.physics.ankle import AnkleParameters
    from jammkle_sim.robots.ground import Building
    from jammkle_sim.robots.robot import AttachedAnkle


_STRAIGHTEST = 0.999
"""Longest reach, as a share of a straight leg: there the knee's angle still says where the ankle is."""


@dataclass(frozen=True)
class Segments:
    """Lengths of a leg."""

    thigh_m: float
    """From hip to knee."""
    shank_m: float
    """From knee to ankle."""

    def angles_rad(self, forward_m: float, up_m: float) -> tuple[float, float]:
        """Return hip and knee angle that bring the ankle to a place as seen from the hip, or as near as it reaches."""
        straight_m = self.thigh_m + self.shank_m
        distance_m = min(max(math.hypot(forward_m, up_m), abs(self.thigh_m - self.shank_m)), _STRAIGHTEST * straight_m)
        product = 2.0 * self.thigh_m * self.shank_m
        bend = math.acos((distance_m**2 - self.thigh_m**2 - self.shank_m**2) / product)
        backward = math.atan2(-forward_m, -up_m)
        ahead = math.atan2(self.shank_m * math.sin(bend), self.thigh_m + self.shank_m * math.cos(bend))
        return backward + ahead, -bend


def abducted(segments: Segments, offset_m: float, place_m: tuple[float, float, float]) -> tuple[float, float, float]:
    """Return abduction, hip and knee angle that bring the ankle to a place.

    Args:
        segments: Lengths.
        offset_m: How far to the left of the abduction axis the leg's plane is; negative: to the right.
        place_m: Of the ankle, in the frame of the hip.

    """
    forward_m, left_m, up_m = place_m
    along_m = -math.sqrt(max(left_m**2 + up_m**2 - offset_m**2, 0.0))
    abduction = math.atan2(up_m, left_m) - math.atan2(along_m, offset_m)
    return math.remainder(abduction, 2.0 * math.pi), *segments.angles_rad(forward_m, along_m)


ABDUCTION, HIP, KNEE = LEG_JOINTS


@dataclass(frozen=True)
class LimbParameters:
    """Lengths, masses and servos of a limb. All assumed: a leg of the size that the paper's ankle and loads ask for."""

    thigh_m: float = 0.15
    """From hip to knee."""
    shank_m: float = 0.15
    """From knee to the ankle's joint."""
    stance_m: float = 0.26
    """From hip straight down to the ankle's joint as it stands: the knee is bent by 60 degrees."""
    thigh_kg: float = 0.35
    """With the knee's motor at its upper end."""
    shank_kg: float = 0.15
    """Without the ankle."""
    radius_m: float = 0.015
    """Of both, as cylinders."""
    stiffness_n_m: float = 80.0
    """Of the servos, N m/rad: 2 degrees of give under twice the weight that a limb bears."""
    damping_n_m_s: float = 2.0
    """Of the servos, N m s/rad: about critical with the limb's own inertia."""
    torque_n_m: float = 12.0
    """Largest torque of a servo: small quasi-direct drives give 10 to 20."""
    armature_kg_m2: float = 0.004
    """Inertia of a motor behind its gear."""

    @property
    def segments(self) -> Segments:
        """Lengths, for the angles."""
        return Segments(self.thigh_m, self.shank_m)

    @property
    def lag_s(self) -> float:
        """How far the servos are behind a target that moves steadily: their damping knows nothing of its speed."""
        return self.damping_n_m_s / self.stiffness_n_m

    def lean_rad(self, back_m: float) -> float:
        """Lean of the shank, its lower end ahead of the upper one, where the ankle stands so far behind the hip."""
        hip_rad, knee_rad = self.segments.angles_rad(-back_m, -self.stance_m)
        return -(hip_rad + knee_rad)


def stance_back_m(ankle: AnkleParameters) -> float:
    """Return how far behind the hip an ankle stands, m, so that what bears is below it: the toe, or the middle."""
    return corner_m(ankle, ankle.toe_m)[0] if ankle.hang_pitch_rad > 0.0 else 0.0


def toe_drop_m(ankle: AnkleParameters) -> float:
    """Return how much further a foot is lifted, m: its toe drops as the load goes, from about half of the pitch."""
    half = dataclasses.replace(ankle, hang_pitch_rad=ankle.hang_pitch_rad / 2.0)
    return corner_m(ankle, ankle.toe_m)[1] - corner_m(half, ankle.toe_m)[1]


def add_limb(
    building: Building,
    limb: LimbParameters,
    parent: Any,
    ankle_name: str,
    position_m: tuple[float, float, float],
    side: str = "",
) -> AttachedAnkle:
    """Add thigh, shank, servos and ankle.

    Args:
        building: The robot.
        limb: Its sizes.
        parent: Body that the limb hangs on.
        ankle_name: Name of its ankle.
        position_m: Of the hip, in the parent's frame.
        side: What the names of its bodies and joints begin with, as `lf_`.

    Returns:
        The ankle, whose leg's joints are hip and knee, and the abduction if `parent` has one of that name.

    """
    spec, options = building.spec, building.options
    thigh = add_segment(parent, f"{side}thigh", limb.thigh_m, limb.thigh_kg, limb.radius_m, position_m)
    add_servo(spec, thigh, f"{side}{HIP}", (0.0, 1.0, 0.0), limb, (-2.0, 2.5))
    shank = add_segment(thigh, f"{side}shank", limb.shank_m, limb.shank_kg, limb.radius_m, (0.0, 0.0, -limb.thigh_m))
    add_servo(spec, shank, f"{side}{KNEE}", (0.0, 1.0, 0.0), limb, (-2.7, 0.0))
    joints = (ABDUCTION, HIP, KNEE) if spec.joint(f"{side}{ABDUCTION}") is not None else (HIP, KNEE)
    return attach_ankle(
        spec,
        shank.name,
        ankle_name,
        position_m=(0.0, 0.0, -limb.shank_m),
        pitch_rad=limb.lean_rad(stance_back_m(building.ankle)),
        fitting=AnkleFitting(
            parameters=building.ankle,
            friction=options.friction,
            imu=ImuPlace(options.imu),
            imu_body=building.base,
            leg_joints={joint: f"{side}{joint}" for joint in joints},
            sensors=building.sensors,
            rigid=options.ankle == AnkleKind.RIGID.value,
        ),
    )


def add_segment(
    parent: Any, name: str, length_m: float, mass_kg: float, radius_m: float, position_m: tuple[float, float, float]
) -> Any:
    """Add a cylinder that hangs down from its origin, and return its body; it touches nothing."""
    body = parent.add_body(name=name, pos=position_m)
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        size=(radius_m, length_m / 2.0, 0.0),
        pos=(0.0, 0.0, -length_m / 2.0),
        mass=mass_kg,
        contype=0,
        conaffinity=0,
    )
    return body


def add_servo(
    spec: Any,
    body: Any,
    name: str,
    axis: tuple[float, float, float],
    limb: LimbParameters,
    range_rad: tuple[float, float],
) -> None:
    """Add a hinge with a servo of the same name, whose control is an angle, rad."""
    joint = body.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=axis, limited=True, range=range_rad)
    joint.armature = limb.armature_kg_m2
    servo = spec.add_actuator(name=name, trntype=mujoco.mjtTrn.mjTRN_JOINT, target=name)
    make_servo(servo, limb.stiffness_n_m, limb.damping_n_m_s, limb.torque_n_m)


def make_servo(servo: Any, stiffness: float, damping: float, largest: float) -> None:
    """Make an actuator a spring and damper toward its control, with a limit."""
    servo.gaintype = mujoco.mjtGain.mjGAIN_FIXED
    servo.biastype = mujoco.mjtBias.mjBIAS_AFFINE
    servo.gainprm[0] = stiffness
    servo.biasprm[:3] = (0.0, -stiffness, -damping)
    servo.forcelimited = True
    servo.forcerange = (-largest, largest)


START_S = 0.5
"""How long a robot stands before it walks, s."""
STRAIGHT_SHARE = 0.25
"""Share of a swing for which a foot only rises, and again only comes down. Assumed."""


@dataclass(frozen=True)
class Gait:
    """A gait, as seen from the hips."""

    speed_m_s: float
    period_s: float
    height_m: float
    """How high a foot is lifted."""
    touch_down_m_s: float
    """Speed at which it is put down."""
    bearing_share: float
    """Share of the period for which a foot stands."""
    push_m: float = 0.0
    """How much further down a foot is asked to be while it stands."""

    def grown(self, time_s: float) -> float:
        """Return the share of its speed that a walk has come to, 0 to 1: it grows over the first period."""
        return min(max((time_s - START_S) / self.period_s, 0.0), 1.0)

    def plan(self, time_s: float, phase: float) -> FootPlan:
        """Return what is planned of a foot that is ahead by a share of a period, at a time since the robot's start."""
        if time_s < START_S:
            return FootPlan(bears=True)
        at = self._phase(time_s, phase)
        return FootPlan(at < self.bearing_share, at)

    def place_m(self, time_s: float, phase: float) -> tuple[float, float]:
        """Return how far forward and up, m, an ankle is of where it stands still; both grow over the first period.

        While it stands it goes back as fast as the robot goes forward. It is lifted straight off its place and put
        down straight onto the next, so that it need not slide where legs give; in between it flies (smoothstep).
        """
        if time_s < START_S:
            return 0.0, -self.push_m
        grown = self.grown(time_s)
        speed_m_s = grown * self.speed_m_s
        at = self._phase(time_s, phase)
        half_m = speed_m_s * self.bearing_share * self.period_s / 2.0
        if at < self.bearing_share:
            return half_m - speed_m_s * at * self.period_s, -self.push_m
        swing_s = (1.0 - self.bearing_share) * self.period_s
        share = (at - self.bearing_share) / (1.0 - self.bearing_share)
        flown = min(max((share - STRAIGHT_SHARE) / (1.0 - 2.0 * STRAIGHT_SHARE), 0.0), 1.0)
        over_ground_m = speed_m_s * self.period_s * flown**2 * (3.0 - 2.0 * flown)
        forward_m = over_ground_m - half_m - speed_m_s * swing_s * share
        up_m = self.height_m * (1.0 - math.cos(2.0 * math.pi * share)) / 2.0
        up_m += self.touch_down_m_s * swing_s * share**2 * (1.0 - share)
        return forward_m, grown * up_m - self.push_m * abs(2.0 * share - 1.0)

    def _phase(self, time_s: float, phase: float) -> float:
        return ((time_s - START_S) / self.period_s + phase) % 1.0


class LimbControl:
    """What the controls of our robots have in common: servos, and a gait if they walk."""

    def __init__(
        self,
        model: Any,
        building: Building,
        limb: LimbParameters,
        servos: Sequence[str],
        phases: Mapping[str, float],
        bearing_share: float,
        push_m: float = 0.0,
    ) -> None:
        """Know where the controls are; phases say by which share of a period each ankle's foot is ahead."""
        options, ankle = building.options, building.ankle
        self.walks = options.behaviour == Behaviour.WALK.value
        self.gait = Gait(
            options.speed_m_s,
            options.step_period_s,
            options.step_height_m + toe_drop_m(ankle),
            options.touch_down_m_s,
            bearing_share,
            push_m,
        )
        self.servos = np.array([model.actuator(name).id for name in servos])
        self.slope_rad = math.radians(options.slope_deg)
        self.back_m = stance_back_m(ankle)
        self._phases, self._lead_s = phases, limb.lag_s

    def place_m(self, ankle: str, time_s: float) -> tuple[float, float]:
        """Return how far forward and up, m, along the ground and off it, an ankle shall be of where it stands still."""
        return self.gait.place_m(time_s + self._lead_s, self._phases[ankle]) if self.walks else (0.0, 0.0)

    def plan(self, ankle: str, time_s: float) -> FootPlan | None:
        """Return what the gait plans of a foot; None: the robot does not walk."""
        return self.gait.plan(time_s, self._phases[ankle]) if self.walks else None
