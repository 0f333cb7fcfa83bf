"""The feet that the paper compares with its ankle: rigid ankle, standard foot, squash ball.

Each hangs on a leg whose origin is where the ankle's ball joint would be, so that the rigs treat all feet alike.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from jammkle_sim.physics.ankle import add_foot
from jammkle_sim.physics.engine import mujoco

if TYPE_CHECKING:
    from jammkle_sim.physics.ankle import AnkleParameters

RIGID_ANKLE, STANDARD, SQUASH_BALL, JAMMED, UNJAMMED = "rigid_ankle", "standard", "squash_ball", "jammed", "unjammed"
"""Names of the paper's feet; the last two are the ankle, with and without vacuum."""
SQUASH = "squash"
"""Joint of the squash ball: how far it is pressed, m."""


@dataclass(frozen=True)
class HardContact:
    """How a foot without any give meets the ground: an elastic blow, lightly damped."""

    time_s: float = 0.012
    """Time constant of its decay (MuJoCo's solref). Chosen, with the ratio, so that 1.8 kg from 50 mm clip the IMU for
    some milliseconds and bounce, as the paper says. With the ratio it is a stiffness of 140 N/mm under 1.8 kg: leg,
    platform and printed tip together."""
    damping_ratio: float = 0.3
    """As above."""


@dataclass(frozen=True)
class TipParameters:
    """A printed plastic tip on a carbon leg: the paper's standard foot."""

    length_m: float = 0.020
    """From the height of the joint to the ground. Assumed: as the ankle's sole."""
    radius_m: float = 0.010
    """Of the rounded tip. Assumed."""
    mass_kg: float = 0.020
    """Assumed."""


@dataclass(frozen=True)
class SquashBallParameters:
    """A squash ball under a carbon leg."""

    radius_m: float = 0.020
    """Of a ball by the rules of the World Squash Federation: 39.5 to 40.5 mm across."""
    mass_kg: float = 0.024
    """By the same rules: 23 to 25 g."""
    rubber_density_kg_m3: float = 1150.0
    """Of its wall. Assumed: filled natural rubber, 1100 to 1200. With radius and mass: a wall of 5.5 mm."""
    stiffness_n_m: float = 3.2e3
    """Linear. The same rules ask for 3.2 N/mm at 23 degC with a slow ball, and less for a hot one."""
    cubic_stiffness_n_m3: float = 1.6e7
    """Chosen so that the drop test's mean of 60.60 m/s^2 comes out, together with the damping."""
    damping_n_s_m: float = 35.0
    """Chosen, together with the cubic part, so that the drop test's mean comes out. The leg then rebounds to 22 % of
    the height; the rules ask a ball that falls by itself for 12 % at 23 degC. 50 N s/m and 2.58e7 N/m^3 would give the
    same mean and 12 %."""
    contact_time_s: float = 0.002
    """Time constant of the contact of its skin (MuJoCo's solref). Assumed: short against the squash itself."""

    @property
    def largest_squash_m(self) -> float:
        """How far it can be pressed before its walls meet, m: 28.9 mm, the hollow within a shell of its mass.

        Spring and cube, chosen for a drop that presses it by 16 mm, do not tell what it does beyond.
        """
        rubber_m3 = self.mass_kg / self.rubber_density_kg_m3
        hollow_m3 = 4.0 / 3.0 * math.pi * self.radius_m**3 - rubber_m3
        return 2.0 * math.pow(3.0 * hollow_m3 / (4.0 * math.pi), 1.0 / 3.0)

    def energy_j(self, squash_m: float) -> float:
        """Energy that spring and cube hold at a squash, J; the damper takes up more."""
        return self.stiffness_n_m * squash_m**2 / 2.0 + self.cubic_stiffness_n_m3 * squash_m**4 / 4.0


def add_rigid_ankle(leg: Any, ankle: AnkleParameters, contact: HardContact, friction: float, pitch_rad: float) -> None:
    """Add the ankle's foot with solid tendons: fixed to the leg.

    Args:
        leg: Body that it hangs on.
        ankle: Geometry and mass.
        contact: How it meets the ground.
        friction: Coefficient of sliding friction.
        pitch_rad: Pitch at which it is fixed, toe-down positive.

    """
    foot = add_foot(leg, ankle, friction)
    foot.quat = (math.cos(pitch_rad / 2.0), 0.0, math.sin(pitch_rad / 2.0), 0.0)
    _harden(foot, contact)


def add_standard_foot(leg: Any, tip: TipParameters, contact: HardContact, friction: float) -> None:
    """Add a rigid leg with a plastic tip.

    Args:
        leg: Body that it hangs on.
        tip: Geometry and mass.
        contact: How it meets the ground.
        friction: Coefficient of sliding friction.

    """
    foot = leg.add_body(name="foot", pos=(0.0, 0.0, tip.radius_m - tip.length_m))
    _add_ball(foot, tip.radius_m, tip.mass_kg, friction)
    _harden(foot, contact)


def add_squash_ball(leg: Any, ball: SquashBallParameters, friction: float) -> None:
    """Add a rigid leg with a squash ball under its end, which yields along it: spring, cube and damper.

    Args:
        leg: Body that it hangs on.
        ball: Geometry, mass and stiffness.
        friction: Coefficient of sliding friction.

    """
    foot = leg.add_body(name="foot", pos=(0.0, 0.0, -ball.radius_m))
    _add_ball(foot, ball.radius_m, ball.mass_kg, friction)
    foot.geoms[0].solref = (ball.contact_time_s, 1.0)
    foot.geoms[0].priority = 1  # the ball's contact counts, not the mean with the ground's
    squash = foot.add_joint(name=SQUASH, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=(0.0, 0.0, 1.0))
    # MuJoCo's polynomial is k0 + k1 |x| + k2 x^2, times x.
    squash.stiffness = (ball.stiffness_n_m, 0.0, ball.cubic_stiffness_n_m3)
    squash.damping = (ball.damping_n_s_m, 0.0, 0.0)


def _harden(foot: Any, contact: HardContact) -> None:
    for geom in foot.geoms:
        geom.solref = (contact.time_s, contact.damping_ratio)
        geom.priority = 1  # the foot's contact counts, not the mean with the ground's


def _add_ball(foot: Any, radius_m: float, mass_kg: float, friction: float) -> None:
    foot.mass = mass_kg
    foot.ipos = (0.0, 0.0, 0.0)  # else the mass is left out of a saved model
    foot.inertia = (0.4 * mass_kg * radius_m**2,) * 3
    foot.explicitinertial = True
    foot.add_geom(
        name="sole",
        type=mujoco.mjtGeom.mjGEOM_SPHERE,
        size=(radius_m, 0.0, 0.0),
        mass=0.0,
        friction=(friction, 0.0, 0.0),
        condim=3,
    )
