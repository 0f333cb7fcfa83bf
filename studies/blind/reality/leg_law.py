"""The law of a machine's leg: its bodies, contacts and frictions as the equations of motion take them."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from studies.blind.reality.bodies import Law, corners_m, turned_about_y
from studies.blind.reality.contact import (
    BRISTLE_1_M,
    BRISTLE_S_M,
    MAT_S,
    SOLE_S_M,
    STATIC_SHARE,
    STRIBECK_M_S,
    Press,
    hertz,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from studies.blind.reality.machine import Ankle, Machine

    Floats = NDArray[np.float64]

_STICTION = 1.4
"""Static over sliding friction of joint and rail. Assumed: dry plastic."""
_STOP_RAD = 1.2
"""Angle from which on foot and leg meet. Declared."""
_PLATE_SHARE = 0.25
"""Share of the foot's mass that a loose plate has. Assumed."""
_LEAST_KG = 0.1
"""What a carriage keeps, whatever is taken off it."""


def seats_m(ankle: Ankle) -> Floats:
    """Return where the tendons meet foot and leg, x and y, shape (4, 2)."""
    front, side = ankle.peroneal_forward_m, ankle.peroneal_spread_m
    back, spread = -ankle.achilles_arm_m, ankle.achilles_spread_m
    return np.array([(front, side), (front, -side), (back, spread), (back, -spread)])


def free_lengths_m(ankle: Ankle, pitch_rad: float, pretension_m: float) -> Floats:
    """Return the length at which each tendon begins to pull, shape (4,).

    Args:
        ankle: Levers.
        pitch_rad: Pitch at which the foot hangs.
        pretension_m: Extension of the Achilles tendons there; the others get as much more as balances the foot.

    """
    x_m, y_m = seats_m(ankle).T
    below = np.stack([x_m, y_m, np.zeros(4)], axis=1) @ turned_about_y(pitch_rad).T
    ways = np.stack([x_m, y_m, np.full(4, ankle.tendon_length_m)], axis=1) - below
    front_m = pretension_m * ankle.achilles_arm_m / ankle.peroneal_forward_m
    lengths: Floats = np.sqrt((ways**2).sum(axis=1)) - np.array([front_m, front_m, pretension_m, pretension_m])
    return lengths


@dataclass(frozen=True)
class Stand:
    """What a plan makes of a leg."""

    mass_kg: float
    """Carriage, leg and foot as told."""
    toe_m: float
    friction: float
    """Of sole on floor as told: as it slides."""
    slope_rad: float
    """Of the floor as told."""
    touch_m: float
    """Where the carriage is, about, as the foot touches the floor."""
    pivot_m: float = 0.0
    """From the ankle's joint up to where the leg hangs; 0 where it does not turn."""


def ankle_law(machine: Machine, stand: Stand, press: Press | None = None) -> Law:
    """Return the law of a leg with an ankle; the foot is free, the leg upright.

    Args:
        machine: Levers and leg.
        stand: What the plan says.
        press: Of each corner; none: the sole's own.

    """
    ankle, leg, corner = machine.ankle, machine.leg, press or hertz(machine.leg.sole_n_m15, SOLE_S_M)
    seats, leg_kg = seats_m(ankle), leg.ankle_kg - ankle.foot_kg
    along, about = leg_kg * ankle.tendon_length_m**2 / 12.0, leg_kg * leg.half_width_m**2 / 2.0
    plate_kg = _PLATE_SHARE * ankle.foot_kg if leg.plate_gap_m > 0.0 else 0.0
    has_mat = leg.mat_m_n > 0.0
    return Law(
        carriage_kg=max(stand.mass_kg - leg.ankle_kg + leg.payload_kg, _LEAST_KG),
        leg_kg=leg_kg,
        leg_inertia_kg_m2=np.array([along, along, about]),
        leg_centre_m=np.array([0.0, 0.0, ankle.tendon_length_m / 2.0 - stand.pivot_m]),
        ankle_m=np.array([0.0, 0.0, -stand.pivot_m]),
        foot_kg=ankle.foot_kg - plate_kg,
        foot_inertia_kg_m2=leg.foot_inertia_kg_m2(ankle.foot_kg - plate_kg),
        foot_centre_m=np.array(ankle.foot_centre_m),
        foot_is_free=1.0,
        leg_is_free=0.0,
        seat_leg_m=np.column_stack([seats, np.full(4, ankle.tendon_length_m)]),
        seat_foot_m=np.column_stack([seats, np.zeros(4)]),
        corner_m=leg.corners_m(stand.toe_m),
        corner_radius_m=leg.corner_radius_m,
        press_n=corner.force_n,
        press_step_m=corner.step_m,
        press_damping_s_m=corner.damping_s_m,
        friction_static=STATIC_SHARE * stand.friction * leg.grip,
        friction_sliding=stand.friction * leg.grip,
        friction_stribeck_m_s=STRIBECK_M_S,
        friction_bristle_1_m=BRISTLE_1_M,
        friction_bristle_s_m=BRISTLE_S_M,
        slope_rad=stand.slope_rad + leg.floor_rad,
        mat_n_m=1.0 / leg.mat_m_n if has_mat else 0.0,
        mat_n_s_m=MAT_S / leg.mat_m_n if has_mat else 1.0,
        joint_static_n_m=_STICTION * ankle.joint_dry_n_m,
        joint_sliding_n_m=ankle.joint_dry_n_m,
        joint_viscous_n_m_s=ankle.joint_viscous_n_m_s,
        stop_rad=_STOP_RAD - leg.cramped_rad,
        rail_static_n=_STICTION * leg.rail_n,
        rail_sliding_n=leg.rail_n,
        rail_tight_m=leg.rail_tight_m,
        rail_width_m=leg.rail_width_m,
        cable_n=leg.cable_n,
        cable_n_m=leg.cable_n_m,
        cable_m=stand.touch_m,
        plate_kg=plate_kg,
        plate_gap_m=leg.plate_gap_m,
    )


def tip_law(machine: Machine, stand: Stand, foot_kg: float, radius_m: float, press: Press) -> Law:
    """Return the law of a leg that ends in a ball instead of an ankle.

    Args:
        machine: Leg.
        stand: What the plan says; the ball's centre is where the toe would be, below the joint by `stand.toe_m`.
        foot_kg: Of the ball.
        radius_m: Of the ball.
        press: Of the ball.

    """
    law = ankle_law(machine, stand, press)
    return dataclasses.replace(
        law,
        carriage_kg=law.carriage_kg + machine.ankle.foot_kg - foot_kg,
        foot_kg=foot_kg,
        foot_is_free=0.0,
        corner_m=corners_m((0.0, 0.0, -stand.toe_m)),
        corner_radius_m=radius_m,
        plate_kg=0.0,
    )
