"""How a robot's own joints take a shank through an exercise, and where they have it. Pure functions of angles."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation  # type: ignore[import-untyped]  # carries no types

from jammkle_common.names import ANKLE_JOINTS, LEG_JOINTS
from jammkle_sim.physics.ankle import AnkleParameters, corner_m
from jammkle_sim.robots.limb import stance_back_m

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from jammkle_sim.rigs.rig import Rig
    from jammkle_sim.robots.limb import LimbParameters

    Floats = NDArray[np.float64]

ABDUCTION, HIP, KNEE = LEG_JOINTS
_EVERY_S = 0.02
"""Time between two points of a course. Chosen: straight lines between them follow 6 Hz to 7 parts in 1000."""
RETRACTED_M = 0.04
"""How much nearer to the hip than in the stance an ankle is that must touch nothing. Assumed: a toe that is turned down
by 40 degrees needs as much."""
_MOVES = 1e-3
"""Degrees, or mm, between two points from which on a shank moves: rounding is below."""
_STANDS_RAD = 1e-6
"""Turn between two points below which a shank stands: rounding."""
READY_S = 2.0
"""Time in which a robot goes to where an exercise begins."""


@dataclass(frozen=True)
class ShankCourse:
    """Poses of a shank over time, against level ground."""

    time_s: Floats
    """Rising from 0, shape (n,), s."""
    pitch_rad: Floats
    """Toe-down positive."""
    roll_rad: Floats
    height_m: Floats
    """Of the ankle's joint over the ground; it counts only where the ground does."""

    @property
    def lasts_s(self) -> float:
        """How long it takes, s."""
        return float(self.time_s[-1])


def course_of(rig: Rig, step_s: float) -> ShankCourse:
    """Return the course that a rig of an exercise guides its shank through by itself."""
    every = max(round(_EVERY_S / step_s), 1)
    rows = rig.guide[::every]
    turn = Rotation.from_quat(rows[:, [4, 5, 6, 3]]).as_euler("YXZ")
    time_s = np.arange(len(rows), dtype=np.float64) * np.float64(step_s * every)
    return ShankCourse(time_s, turn[:, 0], turn[:, 1], rows[:, 2])


def spoken(course: ShankCourse) -> list[tuple[float, str]]:
    """Return what is said to a person who moves the shank by hand, with the times, s."""
    poses = np.column_stack((np.degrees(course.pitch_rad), np.degrees(course.roll_rad), 1e3 * course.height_m))
    moves = np.abs(np.diff(poses, axis=0)).max(axis=1) > _MOVES
    edges = np.flatnonzero(np.diff(np.concatenate(([0], moves.astype(np.int8), [0]))))
    found = []
    for first, last in edges.reshape(-1, 2).tolist():
        lasts_s = float(course.time_s[last] - course.time_s[first])
        pitch_deg, roll_deg, height_mm = poses[last] - poses[first]
        if np.ptp(poses[first : last + 1, 0]) > 2.0 * abs(pitch_deg) + _MOVES:
            text = f"rock the shank to all sides, slowly and then faster and faster, for {lasts_s:.0f} s"
        elif max(abs(pitch_deg), abs(roll_deg)) > _MOVES:
            text = (
                f"tilt the shank to {poses[last, 0]:.0f} degrees toe-down and {poses[last, 1]:.0f} degrees to the right"
            )
        else:
            text = f"{'press down' if height_mm < 0.0 else 'lift'} by {abs(height_mm):.0f} mm, within {lasts_s:.1f} s"
        found.append((float(course.time_s[first]), text))
    return found


@dataclass(frozen=True)
class Limb:
    """A limb of one of our robots."""

    parameters: LimbParameters
    has_abduction: bool
    offset_m: float = 0.0
    """How far to the left of the abduction's axis its plane is."""
    ankle: AnkleParameters = field(default_factory=AnkleParameters)
    """What it stands on, and how that hangs."""

    @property
    def joints(self) -> tuple[str, ...]:
        """Its joints, in the order of the angles below."""
        return LEG_JOINTS if self.has_abduction else (HIP, KNEE)

    @property
    def lean_rad(self) -> float:
        """Lean of the shank as it stands, from which its pitch counts."""
        return self.parameters.lean_rad(stance_back_m(self.ankle))

    @property
    def _toe_m(self) -> float:
        """How much lower than that of a flat foot its toe hangs."""
        flat = dataclasses.replace(self.ankle, hang_pitch_rad=0.0)
        return corner_m(self.ankle, self.ankle.toe_m)[1] - corner_m(flat, self.ankle.toe_m)[1]

    def hanging_rad(self, course: ShankCourse) -> Floats:
        """Return the angles that take a shank through a course in the air, shape (n, joints); the thigh is at rest."""
        lean_rad, thigh_m, shank_m = self.lean_rad, self.parameters.thigh_m, self.parameters.shank_m
        down_m = self.parameters.stance_m - RETRACTED_M - self._toe_m - shank_m * math.cos(lean_rad)
        hip_rad = np.full(len(course.time_s), math.acos(down_m / thigh_m))
        return self._together(course.roll_rad, hip_rad, course.pitch_rad - lean_rad - hip_rad)

    def pressing_rad(self, course: ShankCourse, hip_height_m: float) -> Floats:
        """Return the angles that press a shank onto the ground straight down, shape (n, joints).

        It is tilted as asked above the ground. On its way down it turns with the leg, by a few degrees.

        Args:
            course: Poses.
            hip_height_m: Of the hip over the ground, m.

        """
        limb = self.parameters
        along_m = (course.height_m - hip_height_m - self.offset_m * np.sin(course.roll_rad)) / np.cos(course.roll_rad)
        highest_m = _highest(course, along_m)
        angles = np.zeros((len(course.time_s), 2))
        for i, (pitch_rad, up_m, above_m) in enumerate(zip(course.pitch_rad, along_m, highest_m, strict=True)):
            leaning = pitch_rad - self.lean_rad
            hip_rad = math.acos(min(max((-above_m - limb.shank_m * math.cos(leaning)) / limb.thigh_m, -1.0), 1.0))
            forward_m = -limb.thigh_m * math.sin(hip_rad) - limb.shank_m * math.sin(leaning)
            angles[i] = limb.segments.angles_rad(forward_m, up_m)
        return self._together(course.roll_rad, angles[:, 0], angles[:, 1])

    def place_m(self, angles_rad: dict[str, float], hip_height_m: float) -> tuple[float, float]:
        """Return how far the ankle's joint is forward of the hip and over the ground, m, by the joints' angles."""
        limb, roll_rad = self.parameters, angles_rad.get(ABDUCTION, 0.0)
        leaning = angles_rad[HIP] + angles_rad[KNEE]
        along_m = -limb.thigh_m * math.cos(angles_rad[HIP]) - limb.shank_m * math.cos(leaning)
        forward_m = -limb.thigh_m * math.sin(angles_rad[HIP]) - limb.shank_m * math.sin(leaning)
        return forward_m, hip_height_m + self.offset_m * math.sin(roll_rad) + along_m * math.cos(roll_rad)

    def _together(self, roll_rad: Floats, hip_rad: Floats, knee_rad: Floats) -> Floats:
        columns = (roll_rad, hip_rad, knee_rad) if self.has_abduction else (hip_rad, knee_rad)
        return np.column_stack(columns)


def _highest(course: ShankCourse, along_m: Floats) -> Floats:
    """Return for every moment the height before the press that it is part of: where the tilt last changed."""
    tilt_rad = np.column_stack((course.pitch_rad, course.roll_rad))
    turning = np.abs(np.diff(tilt_rad, axis=0, prepend=np.nan)).max(axis=1) > _STANDS_RAD
    turning[0] = True
    last = np.maximum.accumulate(np.where(turning, np.arange(len(turning)), 0))
    return along_m[last]


_PITCH = ANKLE_JOINTS[1]
_DROOPS_DEG = 10.0
"""How far from its pitch a foot may hang. Assumed: tendons that lost their pretension let it droop by less."""


def standing(joints: Mapping[str, Mapping[str, float]], hang_pitch_deg: float) -> list[str]:
    """Return a line for every ankle whose foot does not hang as it does when it is free.

    Args:
        joints: By ankle, position by joint, rad.
        hang_pitch_deg: Pitch at which the feet hang.

    """
    found = []
    for ankle, angles in joints.items():
        pitch_deg = math.degrees(angles.get(_PITCH, math.radians(hang_pitch_deg)))
        if abs(pitch_deg - hang_pitch_deg) > _DROOPS_DEG:
            found.append(
                f"the foot {ankle or 'of the robot'} is at {pitch_deg:.0f} degrees of pitch, and hangs at "
                f"{hang_pitch_deg:.0f}; if it stands, hoist the robot (simulated: jammkle up --robot ... -p "
                "sim:behaviour:=hang -p sim:drop_height_m:=0.01): exercises are of feet that hang"
            )
    return found
