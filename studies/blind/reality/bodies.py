"""Rigid bodies of the rigs: carriage on its slide, leg, foot on a ball joint; what feet and floors do to each other."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar, cast

import numba
import numpy as np

from jammkle_common.constants import STANDARD_ATMOSPHERE_PA, STANDARD_GRAVITY_M_S2

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

P = ParamSpec("P")
R = TypeVar("R")


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function of numbers, arrays and tuples of them; functions compiled so may call one another.

    They are written into their callers: handing over tuples of arrays takes longer than what most of them compute.
    Numba itself looks only at the age of the file that holds a function. Here the loops of one file call those of
    others, so what is kept is thrown away when any source of this package is another one.
    """
    try:
        kept: Any = numba.njit(function, cache=True, error_model="numpy", nogil=True, forceinline=True)
        kept._cache._cache_file._source_stamp = _stamp()  # noqa: SLF001  # numba has no other way to say it
    except RuntimeError:  # "no locator available": no folder for what is kept
        kept = numba.njit(function, error_model="numpy", nogil=True, forceinline=True)
    return cast("Callable[P, R]", kept)


def _stamp() -> tuple[tuple[str, int, int], ...]:
    """Name, age and size of every source of this package."""
    files = sorted(Path(__file__).parent.glob("*.py"))
    return tuple((file.name, status.st_mtime_ns, status.st_size) for file in files for status in (file.stat(),))


Vector = tuple[float, float, float]

STILL = 1e-12
"""Turns, speeds and forces below it are none, in SI."""


@compiled
def vector(values: Any, at: int) -> Vector:
    """Return three numbers of an array, from an index on."""
    return (values[at], values[at + 1], values[at + 2])


@compiled
def row(values: Any, at: int) -> Vector:
    """Return a row of an array of shape (n, 3)."""
    return (values[at, 0], values[at, 1], values[at, 2])


@compiled
def turned(matrix: Any, arm: Vector) -> Vector:
    """Return a vector of a body's frame in the world's, by the body's turn of shape (3, 3)."""
    return (
        matrix[0, 0] * arm[0] + matrix[0, 1] * arm[1] + matrix[0, 2] * arm[2],
        matrix[1, 0] * arm[0] + matrix[1, 1] * arm[1] + matrix[1, 2] * arm[2],
        matrix[2, 0] * arm[0] + matrix[2, 1] * arm[1] + matrix[2, 2] * arm[2],
    )


@compiled
def cross(a: Vector, b: Vector) -> Vector:
    """Return a cross b."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@compiled
def dot(a: Vector, b: Vector) -> float:
    """Return a times b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled
def plus(a: Vector, b: Vector) -> Vector:
    """Return a plus b."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


@compiled
def less(a: Vector, b: Vector) -> Vector:
    """Return a less b."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


@compiled
def scaled(a: Vector, factor: float) -> Vector:
    """Return a vector made longer by a factor."""
    return (a[0] * factor, a[1] * factor, a[2] * factor)


@compiled
def turn(matrix: Any, spin: Vector, step_s: float) -> None:
    """Turn a body on by Rodrigues' formula, in place."""
    fast = math.sqrt(dot(spin, spin))
    angle = fast * step_s
    if angle < STILL:
        return
    axis = scaled(spin, 1.0 / fast)
    sine, less = math.sin(angle), 1.0 - math.cos(angle)
    for j in range(3):
        column = (matrix[0, j], matrix[1, j], matrix[2, j])
        first = cross(axis, column)
        second = cross(axis, first)
        for i in range(3):
            matrix[i, j] = column[i] + sine * first[i] + less * second[i]


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


_DEEPEST_M = 0.008
"""A corner's table ends here; beyond it the force goes on straight."""


@dataclass(frozen=True)
class Press:
    """Force over depth of one corner."""

    force_n: NDArray[np.float64]
    """At depths in even steps from 0, shape (PRESS_POINTS,)."""
    step_m: float
    damping_s_m: float
    """Hunt and Crossley: share of the force that comes on top per speed of pressing, s/m."""


def hertz(stiffness_n_m15: float, damping_s_m: float) -> Press:
    """Return a round corner on a flat: force grows with depth to the power of 1.5."""
    depth_m = np.linspace(0.0, _DEEPEST_M, PRESS_POINTS)
    return Press(stiffness_n_m15 * depth_m**1.5, _DEEPEST_M / (PRESS_POINTS - 1), damping_s_m)


SOLE_N_M15, SOLE_S_M = 2e5, 1.5
"""One corner of the ankle's printed sole: 30 N press it by 2.8 mm. Chosen, with friction and damping of the joint, so
that the drop test's means of both ankles come out, 42.52 and 31.26 m/s^2, and that the first touch stays below them: a
stiffer corner makes it the peak of the unjammed ankle."""
WOOD_N_M15, WOOD_S_M = 1e7, 1.5
"""One corner of the sole on a plywood slope: 30 N press it by 0.2 mm. Assumed: the edge of a print on wood, where the
platform of the drop rig meets the soft rounded toe tip first. The damping is assumed: it returns a quarter of 1 m/s."""
HARD_N_M15, HARD_S_M = 2.5e7, 1.6
"""A foot without any give, corner or tip: 140 N press it by 0.3 mm. Assumed: hard plastic on the platform. The damping
is chosen so that it rebounds to a fifth of its fall: the paper says "bouncing significantly", and no more."""
STRIBECK_M_S = 0.005
"""Speed at which friction has gone down from static to sliding. Assumed: plastic on a floor."""
STATIC_SHARE = 1.06
"""Static over sliding friction. Assumed: plastic on a floor. What is planned is taken as the sliding one."""
BRISTLE_1_M = 2e4
"""Share of the load per bending of the sole: with a coefficient of 0.5 it gives by 25 um before it slides. Assumed."""
BRISTLE_S_M = 2.0
"""Share of the load per speed of bending. Assumed: a stuck toe under 30 N swings out in a few swings."""
MAT_S = 0.003
"""Damping over stiffness of a mat on the floor. Assumed: foam."""


@dataclass(frozen=True)
class SquashBall:
    """A hollow rubber ball: its shell bends, its air is pressed."""

    radius_m: float = 0.020
    """By the rules of the World Squash Federation: 39.5 to 40.5 mm across."""
    mass_kg: float = 0.024
    """By the same rules: 23 to 25 g."""
    wall_m: float = 0.0055
    """What radius, mass and the density of filled rubber leave."""
    shell_n_m: float = 3.2e3
    """The same rules: 3.2 N/mm at 23 degC with a slow ball."""
    air_share: float = 0.552
    """How much of the volume of the two caps that are pressed flat is taken from the air: the ball bulges. Chosen, with
    the damping, so that the drop test's mean of 60.60 m/s^2 comes out."""
    air_exponent: float = 1.4
    """Fast: the air keeps its heat."""
    damping_s_m: float = 0.9
    """Chosen as above; the leg then rebounds to a half of the height that it fell."""

    def press(self) -> Press:
        """Return the force of the whole ball between leg and floor over its squash."""
        deepest_m = 2.0 * (self.radius_m - self.wall_m) * 0.98
        squash_m = np.linspace(0.0, deepest_m, PRESS_POINTS)
        hollow_m3 = 4.0 / 3.0 * math.pi * (self.radius_m - self.wall_m) ** 3
        cap_m = squash_m / 2.0
        caps_m3 = 2.0 / 3.0 * math.pi * cap_m**2 * (3.0 * self.radius_m - cap_m)
        taken_m3 = np.minimum(self.air_share * caps_m3, 0.9 * hollow_m3)
        pressure_pa = STANDARD_ATMOSPHERE_PA * ((1.0 - taken_m3 / hollow_m3) ** -self.air_exponent - 1.0)
        force_n = self.shell_n_m * squash_m + pressure_pa * np.gradient(taken_m3, squash_m)
        return Press(np.maximum.accumulate(force_n), deepest_m / (PRESS_POINTS - 1), self.damping_s_m)
