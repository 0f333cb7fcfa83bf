"""Rigid bodies of the rigs: carriage on its slide, leg, foot on a ball joint; what is told of them, and their state.

The equations stand in `motion`. Frame: z up, x where the toe points, y to the left.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from jammkle_common.constants import STANDARD_GRAVITY_M_S2

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

SPEEDS = 7
"""Carriage, leg about x, y, z, foot about x, y, z; axes of the world."""
LEG, FOOT = 1, 4
"""Where the turning of each begins among the speeds."""
CORNERS = 4
"""Round corners of a foot: toe left and right, heel left and right."""
TENDONS = 4
"""Peroneal left and right, Achilles left and right."""
PRESS_POINTS = 400
"""Entries of the table of a corner's force over its depth."""
_NOWHERE_M = 10.0
"""So far above a foot lie corners that it does not have."""


@dataclass(frozen=True)
class Law:
    """Constants of one machine on one rig, SI. Vectors of a body are in its own frame. Null values: not there."""

    carriage_kg: float
    leg_kg: float
    leg_inertia_kg_m2: Floats
    """About its centre, shape (3,)."""
    leg_centre_m: Floats
    """From the pivot under the carriage, shape (3,)."""
    ankle_m: Floats
    """The ankle's joint, from the pivot, shape (3,)."""
    foot_kg: float
    foot_inertia_kg_m2: Floats
    """About its centre, shape (3,)."""
    foot_centre_m: Floats
    """From the ankle's joint, shape (3,)."""
    foot_is_free: float
    """1: on its ball joint; 0: the foot turns with the leg."""
    leg_is_free: float
    """1: on a ball joint under the carriage; 0: upright."""
    seat_leg_m: Floats
    """Upper ends of the tendons, from the ankle's joint in the leg's frame, shape (TENDONS, 3)."""
    seat_foot_m: Floats
    """Lower ends, from the ankle's joint in the foot's frame, shape (TENDONS, 3)."""
    corner_m: Floats
    """Centres of the corners, in the foot's frame, shape (CORNERS, 3)."""
    corner_radius_m: float
    press_n: Floats
    """Force of one corner over its depth, slowly pressed, shape (PRESS_POINTS,)."""
    press_step_m: float
    """Depth between two entries."""
    press_damping_s_m: float
    """Hunt and Crossley: share of the force that comes on top per speed of pressing."""
    friction_static: float
    friction_sliding: float
    friction_stribeck_m_s: float
    """Speed at which friction has gone down from static to sliding."""
    friction_bristle_1_m: float
    """LuGre: share of the load per bending of the bristles."""
    friction_bristle_s_m: float
    """The same, per speed of bending."""
    slope_rad: float = 0.0
    cell_kg: float = 0.0
    """What hangs on the load cell beside the leg, part of carriage_kg."""
    mat_n_m: float = 0.0
    """Stiffness under each corner of what lies on the ground."""
    mat_n_s_m: float = 1.0
    joint_static_n_m: float = 0.0
    """Friction of the ball joint as it begins to turn."""
    joint_sliding_n_m: float = 0.0
    joint_stribeck_rad_s: float = 0.1
    joint_bristle_n_m_rad: float = 20.0
    joint_viscous_n_m_s: float = 0.0
    pivot_viscous_n_m_s: float = 0.0
    """Of the ball joint at the top of the leg."""
    stop_rad: float = 3.1
    """Angle from which on foot and leg meet."""
    stop_n_m_rad: float = 50.0
    """Assumed."""
    rail_static_n: float = 0.0
    """What it takes to move the carriage where its rail is tight."""
    rail_sliding_n: float = 0.0
    rail_stribeck_m_s: float = 0.02
    rail_bristle_n_m: float = 2e5
    rail_tight_m: float = 0.0
    """Height where the rail is tight."""
    rail_width_m: float = 0.0
    """How far that reaches; 0: all the way."""
    cable_n: float = 0.0
    """Upward pull of a cable on the carriage at cable_m."""
    cable_n_m: float = 0.0
    """By how much more it pulls per way down; it never pushes."""
    cable_m: float = 0.0
    plate_kg: float = 0.0
    """Of a plate on the foot that is loose, across the sole."""
    plate_at_m: Floats = dataclasses.field(default_factory=lambda: np.array([0.030, 0.0, -0.015]))
    plate_gap_m: float = 0.001
    plate_n_m: float = 1e5
    plate_n_s_m: float = 5.0
    drive_n_m: float = 0.0
    """Stiffness of the spindle that drives the carriage."""
    drive_n_s_m: float = 0.0
    gravity_m_s2: float = STANDARD_GRAVITY_M_S2

    def packed(self) -> NDArray[Any]:
        """Return the same as one record, shape (1,), for `motion`."""
        values = {field.name: np.asarray(getattr(self, field.name), dtype=float) for field in dataclasses.fields(self)}
        record = np.zeros(1, dtype=np.dtype([(name, "f8", value.shape) for name, value in values.items()], align=True))
        for name, value in values.items():
            record[name][0] = value
        return record


STATE = np.dtype(
    [
        ("height_m", "f8"),  # of the ankle's joint, were the leg upright
        ("leg_turn", "f8", (3, 3)),  # from the leg's frame to the world's
        ("foot_turn", "f8", (3, 3)),  # from the foot's frame to the world's
        ("speed", "f8", (SPEEDS,)),
        ("change", "f8", (SPEEDS,)),  # rate of the speed
        ("freedom", "f8"),  # 1: the carriage was free in the last call, -1: it was held, 0: there was none
        ("bristle_m", "f8", (CORNERS, 2)),  # along and across the slope
        ("mat_m", "f8", (CORNERS,)),  # how far the mat is pressed
        ("mat_m_s", "f8", (CORNERS,)),
        ("joint_bristle_rad", "f8", (3,)),
        ("rail_bristle_m", "f8"),
        ("plate_m", "f8"),  # of the loose plate, from the middle of its gap
        ("plate_m_s", "f8"),
        (
            "cell_n",
            "f8",
            (3,),
        ),  # what the carriage did to all below the load cell, mean over the last call, world's axes
        ("ground_n", "f8", (CORNERS, 3)),  # along and across the slope, and out of it
        ("matrix", "f8", (SPEEDS, SPEEDS)),  # workspace
        ("load", "f8", (SPEEDS,)),  # workspace
        ("active", "i8", (SPEEDS,)),  # workspace
    ],
    align=True,
)
"""All that changes; one record per machine."""


def still(height_m: float, leg_pitch_rad: float, foot_pitch_rad: float) -> NDArray[Any]:
    """Return a state that stands still, shape (1,) of STATE.

    Args:
        height_m: Of the ankle's joint, were the leg upright.
        leg_pitch_rad: Of the leg in the world; positive swings its foot to the heel's side.
        foot_pitch_rad: Of the foot in the world; toe-down positive.

    """
    state = np.zeros(1, dtype=STATE)
    state["height_m"] = height_m
    state["leg_turn"][0] = turned_about_y(leg_pitch_rad)
    state["foot_turn"][0] = turned_about_y(foot_pitch_rad)
    return state


def turned_about_y(angle_rad: float) -> Floats:
    """Return the matrix of a turn about y, which lowers the toe."""
    cosine, sine = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([[cosine, 0.0, sine], [0.0, 1.0, 0.0], [-sine, 0.0, cosine]])


def corners_m(*places_m: tuple[float, float, float]) -> Floats:
    """Return corners at these places, and the missing ones where they never touch, shape (CORNERS, 3)."""
    corners = np.full((CORNERS, 3), _NOWHERE_M)
    corners[: len(places_m)] = places_m
    return corners


def energy_j(law: Law, state: NDArray[Any]) -> float:
    """Return kinetic energy and that of height; what springs, bristles and mat hold is not in it."""
    one = state[0]
    leg_turn, foot_turn, speed = one["leg_turn"], one["foot_turn"], one["speed"]
    to_ankle = leg_turn @ law.ankle_m
    centres = (leg_turn @ law.leg_centre_m, to_ankle + foot_turn @ law.foot_centre_m)
    rise = np.array([0.0, 0.0, speed[0]])
    speeds = (
        rise + np.cross(speed[1:4], centres[0]),
        rise + np.cross(speed[1:4], to_ankle) + np.cross(speed[4:7], centres[1] - to_ankle),
    )
    pivot_m = one["height_m"] - law.ankle_m[2]
    total = law.carriage_kg * (speed[0] ** 2 / 2.0 + law.gravity_m_s2 * pivot_m)
    bodies = (
        (law.leg_kg, law.leg_inertia_kg_m2, leg_turn, speed[1:4]),
        (law.foot_kg, law.foot_inertia_kg_m2, foot_turn, speed[4:7]),
    )
    for (mass, inertia, turn, spin), centre, velocity in zip(bodies, centres, speeds, strict=True):
        own = turn.T @ spin
        total += mass * (velocity @ velocity / 2.0 + law.gravity_m_s2 * (pivot_m + centre[2]))
        total += (inertia * own**2).sum() / 2.0
    return float(total)


def ankle_angles_rad(leg_turn: Floats, foot_turn: Floats) -> Floats:
    """Return roll, pitch and yaw of the foot against the leg: pitched first, then rolled, then yawed.

    Args:
        leg_turn: Shape (n, 3, 3).
        foot_turn: Shape (n, 3, 3).

    Returns:
        Shape (n, 3).

    """
    turn = np.swapaxes(leg_turn, 1, 2) @ foot_turn
    roll = -np.arcsin(np.clip(turn[:, 1, 2], -1.0, 1.0))
    return np.stack([roll, np.arctan2(turn[:, 0, 2], turn[:, 2, 2]), np.arctan2(turn[:, 1, 0], turn[:, 1, 1])], axis=1)


def ankle_rates_rad_s(angles_rad: Floats, leg_turn: Floats, spin_rad_s: Floats) -> Floats:
    """Return rates of roll, pitch and yaw.

    Args:
        angles_rad: Roll, pitch, yaw, shape (n, 3).
        leg_turn: Shape (n, 3, 3).
        spin_rad_s: Of the foot less that of the leg, world's axes, shape (n, 3).

    Returns:
        Shape (n, 3).

    """
    own = np.einsum("nij,ni->nj", leg_turn, spin_rad_s)
    roll, pitch = angles_rad[:, 0], angles_rad[:, 1]
    yaw_rate = (own[:, 0] * np.sin(pitch) + own[:, 2] * np.cos(pitch)) / np.cos(roll)
    roll_rate = own[:, 0] * np.cos(pitch) - own[:, 2] * np.sin(pitch)
    return np.stack([roll_rate, own[:, 1] + yaw_rate * np.sin(roll), yaw_rate], axis=1)
