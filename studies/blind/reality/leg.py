"""The leg of the rigs that move: what of it was drawn, weighed and chosen beside the ankle's levers."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from studies.blind.reality.bodies import corners_m, turned_about_y
from studies.blind.reality.contact import SOLE_N_M15

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Leg:
    """Leg, foot, floor and slide of one machine. The paper gives the ankle's mass, no drawing; the rest is declared."""

    ankle_kg: float = 0.352
    """Ankle with its foot. Paper."""
    toe_m: float = 0.060
    """Forward of the joint. Assumed."""
    dropped_toe_m: float = 0.0506
    """The same where a foot lands toe-down on level ground: the rounded toe touches behind its tip. Chosen for the drop
    test."""
    heel_m: float = 0.045
    """Behind the joint. Assumed."""
    half_width_m: float = 0.030
    """Assumed."""
    hung_rad: float = 0.0
    """How much further toe-down than a plan tells the foot hangs on its tendons."""
    sole_m: float = 0.020
    """Joint above sole. Assumed."""
    corner_radius_m: float = 0.005
    """Assumed."""
    sole_n_m15: float = SOLE_N_M15
    """Of one corner, force over depth to the power of 1.5."""
    grip: float = 1.0
    """Factor on the friction of the floor that a plan tells."""
    payload_kg: float = 0.0
    """On the carriage, beyond what a plan tells."""
    mat_m_n: float = 0.0
    """How far a mat on the floor gives under each corner, per force."""
    floor_rad: float = 0.0
    """How much steeper the floor is than a plan tells, toe uphill."""
    pin_play_m: float = 0.0
    """How far the pins that hold the tendons can slide in worn holes."""
    cramped_rad: float = 0.0
    """How much earlier than drawn foot and leg meet."""
    bent_rad: float = 0.0
    """How far the toe is bent up."""
    twisted_rad: float = 0.0
    """How far the toe is twisted to the left."""
    plate_gap_m: float = 0.0
    """How far a loose plate on the foot can move; 0: it is screwed on."""
    rail_n: float = 0.0
    """Sliding friction of the carriage's rail. The paper: "no resistance against the platform's freefall"."""
    rail_tight_m: float = 0.0
    """Where the rail rubs."""
    rail_width_m: float = 0.0
    """How far that reaches; 0: all the way."""
    cable_n: float = 0.0
    """Upward pull of a cable on the carriage as the foot touches the floor."""
    cable_n_m: float = 0.0
    """By how much more it pulls per way down."""
    mount_s2: float = 0.0
    """How soft the IMU is mounted: way that it gives per acceleration."""

    def as_built(self) -> Leg:
        """Return the leg before its foot was bent: what the rig was set up with."""
        return dataclasses.replace(self, bent_rad=0.0, twisted_rad=0.0)

    def corners_m(self, toe_m: float) -> Floats:
        """Return the centres of the sole's corners: toe left, right, heel left, right, shape (4, 3)."""
        down, wide = self.corner_radius_m - self.sole_m, self.half_width_m
        up = toe_m * math.tan(self.bent_rad)
        twist = wide * math.tan(self.twisted_rad)
        toes = ((toe_m, wide, down + up + twist), (toe_m, -wide, down + up - twist))
        return corners_m(*toes, (-self.heel_m, wide, down), (-self.heel_m, -wide, down))

    def foot_inertia_kg_m2(self, foot_kg: float) -> Floats:
        """Return that of a plate of the foot's size about its centre, shape (3,)."""
        length, width, height = self.toe_m + self.heel_m, 2.0 * self.half_width_m, self.sole_m
        return foot_kg / 12.0 * np.array([width**2 + height**2, length**2 + height**2, length**2 + width**2])

    def touch_height_m(self, toe_m: float, pitch_rad: float, slope_rad: float) -> float:
        """Return how high the joint stands, straight above the floor, as the first corner of the foot touches it.

        Args:
            toe_m: Lever of the toe.
            pitch_rad: Of the foot, toe-down.
            slope_rad: Of the floor as told, toe uphill.

        """
        centres = self.corners_m(toe_m) @ turned_about_y(pitch_rad).T
        out = np.array([-math.sin(slope_rad), 0.0, math.cos(slope_rad)])
        return float((self.corner_radius_m - centres @ out).max() / out[2])


PLAIN = Leg()
"""As drawn."""
