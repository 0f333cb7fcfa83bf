"""The ankle as a MuJoCo model: ball joint in the foot, four tendons, foot with contact points.

Frame of the foot: x to the toe, y to the left, z up; the origin is the centre of the ball joint.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from jammkle_common.names import ANKLE_JOINTS, TENDONS
from jammkle_sim.physics import records
from jammkle_sim.physics.engine import mujoco

if TYPE_CHECKING:
    from numpy.typing import NDArray

ROLL, PITCH, YAW = ANKLE_JOINTS

_STRIBECK_RAD_S = 1.5
"""Speed at which the joint's friction has fallen from breaking away to sliding. Assumed: surfaces that slide at 10 mm/s
(Armstrong-Helouvry et al., 1994, give 1 to 100 for greased ones) on a ball of 7 mm radius."""
_PRESLIDING_RAD = 0.005
"""Angle by which the joint gives before it slides. Assumed: 35 um on that ball, as printed surfaces and a printed
socket give; a stiffer one would ask for a shorter time step."""


@dataclass(frozen=True)
class AnkleParameters:
    """Geometry, mass and contact of one ankle. The paper gives the mass and the tendon's length, no drawing."""

    mass_kg: float = 0.352
    """Whole ankle. Paper."""
    foot_mass_kg: float = 0.120
    """Share of it that turns with the foot. Assumed."""
    foot_centre_m: tuple[float, float, float] = (0.008, 0.0, -0.008)
    """Centre of the foot's mass. Assumed: middle of the sole, half way down."""
    toe_m: float = 0.060
    """Lever of the toe's contact, forward of the joint. Assumed; the drop rig has its own, 49.4 mm, chosen for its rows
    (`rigs.drop.DROP_ANKLE`)."""
    heel_m: float = 0.045
    """Lever of the heel's contact, behind the joint. Assumed: just behind the Achilles tendons."""
    half_width_m: float = 0.030
    """Contacts to the left and right of the middle. Assumed."""
    sole_m: float = 0.020
    """Height of the joint above the sole. Assumed: the socket is printed into the foot."""
    contact_radius_m: float = 0.005
    """Radius of the rounded corners that touch the ground. Assumed."""
    tendon_length_m: float = 0.118
    """End plate to end plate at the neutral pose. Paper."""
    achilles_arm_m: float = 0.0374
    """Achilles tendons behind the joint. Chosen for the drop test, so that its jammed and unjammed rows come out; the
    paper gives no drawing."""
    achilles_spread_m: float = 0.015
    """Achilles tendons left and right of the middle. Assumed."""
    peroneal_forward_m: float = 0.025
    """Peroneal tendons forward of the joint. Assumed: what pulls the toe up against the Achilles pair."""
    peroneal_spread_m: float = 0.030
    """Peroneal tendons left and right of the middle. Assumed."""
    achilles_pretension_m: float = 0.0015
    """Extension of the Achilles tendons at the neutral pose. Assumed: enough to hold the foot up in the air. The
    peroneal tendons get as much more as balances the foot."""
    hang_pitch_rad: float = 0.0
    """Pitch at which the foot hangs, toe-down positive, where the pretension holds. Assumed: the neutral pose; the drop
    rig has its own."""
    joint_damping_n_m_s: float = 0.01
    """Viscous friction of the ball joint, per axis. Assumed."""
    joint_limit_rad: float = 1.2
    """Angle at which foot meets leg, per axis. Assumed."""
    contact_time_s: float = 0.004
    """Time constant of the contact (MuJoCo's solref), critically damped. Assumed: the softest that
    still counts as stiff plastic on wood. The first peak of a landing depends on it: twice the time, a third less."""

    contact_impedance: tuple[float, float] = (0.001, 0.95)
    """Share of the contact's own dynamics in what happens at the surface and 1 mm deep (first two of MuJoCo's solimp).
    Chosen to come in softly, as a rounded corner does (Hertz; Hunt and Crossley): with MuJoCo's default of 0.9 at the
    surface a blow depends on where in a time step it is found, and a landing from 0.05 mm higher jumps by up to ten
    times what half a millimetre makes; with this by as much at most. Lower is softer: MuJoCo leaves out how a turning
    foot carries its corners off the ground, and only a contact with some depth left makes up for it."""


def tendon_sites_m(parameters: AnkleParameters) -> dict[str, tuple[float, float]]:
    """Where each tendon meets the foot: x and y in the frame of the foot, m, at the height of the joint."""
    back, spread = -parameters.achilles_arm_m, parameters.achilles_spread_m
    front, side = parameters.peroneal_forward_m, parameters.peroneal_spread_m
    return dict(zip(TENDONS, ((front, side), (front, -side), (back, spread), (back, -spread)), strict=True))


def free_lengths_m(parameters: AnkleParameters) -> NDArray[np.float64]:
    """Free length of each tendon, in the order of TENDONS, m; shorter than as the foot hangs by the pretension."""
    peroneal_pretension_m = parameters.achilles_pretension_m * parameters.achilles_arm_m / parameters.peroneal_forward_m
    pretension = (peroneal_pretension_m,) * 2 + (parameters.achilles_pretension_m,) * 2
    lengths_m: NDArray[np.float64] = tendon_lengths_m(parameters, parameters.hang_pitch_rad) - np.array(pretension)
    return lengths_m


def tendon_lengths_m(parameters: AnkleParameters, pitch_rad: float) -> NDArray[np.float64]:
    """Length of each tendon, in the order of TENDONS, m, with the foot pitched, rad, toe-down positive."""
    x_m = np.array([x for x, _ in tendon_sites_m(parameters).values()])
    forward_m = x_m * (1.0 - math.cos(pitch_rad))
    up_m = parameters.tendon_length_m + x_m * math.sin(pitch_rad)
    lengths_m: NDArray[np.float64] = np.hypot(forward_m, up_m)
    return lengths_m


def corner_m(parameters: AnkleParameters, lever_m: float) -> tuple[float, float]:
    """Centre of a rounded corner of the hanging foot's sole: how far forward of the joint and how far below it, m.

    Args:
        parameters: Geometry and pose.
        lever_m: How far forward of the joint it is on a level foot, m.

    """
    sine, cosine = math.sin(parameters.hang_pitch_rad), math.cos(parameters.hang_pitch_rad)
    below_m = parameters.sole_m - parameters.contact_radius_m
    return lever_m * cosine - below_m * sine, lever_m * sine + below_m * cosine


def joint_law(timestep_s: float, friction_n_m: float = 0.0, breakaway: float = 0.0) -> NDArray[Any]:
    """Constants of the joint's dry friction for one time step, shape (1,) of JOINT_LAW.

    Args:
        timestep_s: Time step, s.
        friction_n_m: Torque at which it slides, whatever the axis; 0 is none.
        breakaway: By which share of that it takes more to set it moving.

    """
    law = np.zeros(1, dtype=records.JOINT_LAW)
    law["friction_n_m"], law["breakaway"] = friction_n_m, breakaway
    law["stribeck_rad_s"], law["presliding_rad"] = _STRIBECK_RAD_S, _PRESLIDING_RAD
    law["step_s"] = timestep_s
    return law


def add_ankle(spec: Any, leg: Any, parameters: AnkleParameters, friction: float) -> None:
    """Add foot, joints, tendons and their pulls to a leg whose origin is the centre of the ball joint.

    The joint is three hinges through one point, in the order pitch, roll, yaw, so that angles and rates can be read
    as they are; the limit of each keeps it away from gimbal lock. Each tendon gets an actuator of its name whose
    control is its pull, N.

    Args:
        spec: The mujoco.MjSpec that `leg` belongs to.
        leg: Body that the foot hangs on.
        parameters: Geometry, mass and contact.
        friction: Coefficient of sliding friction of the foot.

    """
    spec.compiler.degree = False
    foot = add_foot(leg, parameters, friction)
    limit = parameters.joint_limit_rad
    for name, axis in ((PITCH, (0, 1, 0)), (ROLL, (1, 0, 0)), (YAW, (0, 0, 1))):
        joint = foot.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=axis)
        joint.damping = (parameters.joint_damping_n_m_s, 0.0, 0.0)  # linear; then quadratic and cubic
        joint.limited = True
        joint.range = (-limit, limit)
    for name, (x, y) in tendon_sites_m(parameters).items():
        foot.add_site(name=f"{name}_foot", pos=(x, y, 0.0))
        leg.add_site(name=f"{name}_leg", pos=(x, y, parameters.tendon_length_m))
        tendon = spec.add_tendon(name=name)
        tendon.wrap_site(f"{name}_leg")
        tendon.wrap_site(f"{name}_foot")
        pull = spec.add_actuator(name=name, trntype=mujoco.mjtTrn.mjTRN_TENDON, target=name)
        pull.gear = (-1.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def add_foot(leg: Any, parameters: AnkleParameters, friction: float) -> Any:
    """Add the foot alone, fixed to a leg whose origin is the centre of the ball joint, and return its body.

    Args:
        leg: Body that the foot hangs on.
        parameters: Geometry, mass and contact.
        friction: Coefficient of sliding friction of the foot.

    """
    foot = leg.add_body(name="foot")
    length_m = parameters.toe_m + parameters.heel_m
    box_m = np.array([length_m, 2.0 * parameters.half_width_m, parameters.sole_m])
    foot.mass = parameters.foot_mass_kg
    foot.ipos = parameters.foot_centre_m
    foot.inertia = parameters.foot_mass_kg / 12.0 * ((box_m**2).sum() - box_m**2)
    foot.explicitinertial = True
    _add_contacts(foot, parameters, friction)
    return foot


def _add_contacts(foot: Any, parameters: AnkleParameters, friction: float) -> None:
    """Round the four corners of the sole; nothing else of the foot touches the ground."""
    radius = parameters.contact_radius_m
    for end, x in (("toe", parameters.toe_m), ("heel", -parameters.heel_m)):
        for side, y in (("left", parameters.half_width_m), ("right", -parameters.half_width_m)):
            foot.add_geom(
                name=f"{end}_{side}",
                type=mujoco.mjtGeom.mjGEOM_SPHERE,
                size=(radius, 0.0, 0.0),
                pos=(x, y, radius - parameters.sole_m),
                mass=0.0,
                friction=(friction, 0.0, 0.0),
                condim=3,
                solref=(parameters.contact_time_s, 1.0),
                solimp=(*parameters.contact_impedance, 0.001, 0.5, 2.0),
                priority=1,  # the foot's contact counts, whatever the ground's is
            )
