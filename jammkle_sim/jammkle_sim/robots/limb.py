"""A limb of our robots: thigh and shank with servos at hip and knee, and an ankle at its end."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from jammkle_common.names import LEG_JOINTS
from jammkle_sim.physics.engine import mujoco
from jammkle_sim.robots.attach import AnkleFitting, attach_ankle
from jammkle_sim.robots.kinematics import Segments
from jammkle_sim.robots.options import AnkleKind, ImuPlace

if TYPE_CHECKING:
    from jammkle_sim.physics.ankle import AnkleParameters
    from jammkle_sim.physics.sensors import SensorParameters
    from jammkle_sim.robots.attach import AttachedAnkle
    from jammkle_sim.robots.options import RobotOptions

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

    @property
    def lean_rad(self) -> float:
        """How far the shank's lower end is ahead of its upper one in the stance, as an angle."""
        hip_rad, knee_rad = self.segments.angles_rad(0.0, -self.stance_m)
        return -(hip_rad + knee_rad)


@dataclass(frozen=True)
class Fitting:
    """What a limb is built with."""

    limb: LimbParameters
    ankle: AnkleParameters
    sensors: SensorParameters
    options: RobotOptions
    base: str
    """Body that carries the IMU, if that is on the body."""


def add_limb(
    spec: Any, parent: Any, fitting: Fitting, ankle_name: str, position_m: tuple[float, float, float], side: str = ""
) -> AttachedAnkle:
    """Add thigh, shank, servos and ankle.

    Args:
        spec: The mujoco.MjSpec.
        parent: Body that the limb hangs on.
        fitting: What it is built with.
        ankle_name: Name of its ankle.
        position_m: Of the hip, in the parent's frame.
        side: What the names of its bodies and joints begin with, as `lf_`.

    Returns:
        The ankle, whose leg's joints are hip and knee, and the abduction if `parent` has one of that name.

    """
    limb = fitting.limb
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
        pitch_rad=limb.lean_rad,
        fitting=AnkleFitting(
            parameters=fitting.ankle,
            friction=fitting.options.friction,
            imu=ImuPlace(fitting.options.imu),
            imu_body=fitting.base,
            leg_joints={joint: f"{side}{joint}" for joint in joints},
            sensors=fitting.sensors,
            rigid=fitting.options.ankle == AnkleKind.RIGID.value,
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
