"""A leg on its way: bodies and tendons of a machine advanced together over all that changes, and recorded."""

from __future__ import annotations

import dataclasses
import itertools
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy import signal as filters  # type: ignore[import-untyped]  # carries no types

from jammkle_common import names
from studies.blind.reality.air import breathe
from studies.blind.reality.bodies import (
    BRISTLE_1_M,
    BRISTLE_S_M,
    MAT_S,
    SOLE_S_M,
    STATIC_SHARE,
    STRIBECK_M_S,
    TENDONS,
    Law,
    Press,
    ankle_angles_rad,
    ankle_rates_rad_s,
    compiled,
    corners_m,
    hertz,
    still,
    turned_about_y,
)
from studies.blind.reality.motion import advance, lengths_and_rates
from studies.blind.reality.sensors import RealRun, Truth, encoder_track, imu_track, load_cell_track, tendon_track
from studies.blind.reality.tendon import tendon_law, tendon_state, tendon_tension_n

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from studies.blind.reality.air import SetPoint
    from studies.blind.reality.machine import Ankle, Machine, Sensor
    from studies.blind.reality.sensors import Plan

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
    """Carriage, leg and foot as planned."""
    toe_m: float
    friction: float
    """Of sole on floor as planned: as it slides."""
    slope_rad: float
    """Of the floor as planned."""
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


_FORCE, _CELL, _HEIGHT, _RISE, _LEG, _FOOT, _SPIN, _LENGTH, _RATE, _PULL, _TORN = 0, 1, 4, 5, 6, 15, 24, 30, 34, 38, 42
"""Where things begin in a row."""
_WIDTH = 46
_PIN_N = 0.5
"""Tension below which a pin in a worn hole does not slide. Assumed: its dry friction."""
_PIN_N_S_M = 100.0
"""Tension beyond that per speed of sliding. Assumed: greased plastic."""
_PIN_BACK_S = 0.03
"""Time in which the pin of a slack tendon slides back. Assumed."""


@dataclass(frozen=True)
class Course:
    """What happened, at even times. Row i stands for the time from time_s[i] - step to time_s[i]."""

    time_s: Floats
    """Shape (n,)."""
    specific_force_m_s2: Floats
    """Of the carriage along the world's axes, mean over the row, shape (n, 3)."""
    cell_n: Floats
    """Load cell in its own axes, mean over the row; pulled is positive on z, shape (n, 3)."""
    height_m: Floats
    height_m_s: Floats
    angle_rad: Floats
    """Roll, pitch, yaw of the ankle, shape (n, 3)."""
    angle_rad_s: Floats
    leg_pitch_rad: Floats
    """Of the leg in the world."""
    extension_m: Floats
    """Of the tendons between their seats, shape (n, TENDONS)."""
    extension_m_s: Floats
    tension_n: Floats
    torn: Floats
    """1 where a tendon is torn."""


def truth(rows: Floats, free_m: Floats, time_s: Floats) -> Course:
    """Return the rows that `go` wrote, sorted.

    Args:
        rows: Shape (n, columns).
        free_m: Lengths at which the tendons begin to pull, shape (TENDONS,).
        time_s: At the end of each row, shape (n,).

    """
    count = len(rows)
    leg, foot = rows[:, _LEG:_FOOT].reshape(count, 3, 3), rows[:, _FOOT:_SPIN].reshape(count, 3, 3)
    angle_rad = ankle_angles_rad(leg, foot)
    spin_rad_s = rows[:, _SPIN + 3 : _LENGTH] - rows[:, _SPIN : _SPIN + 3]
    force = np.zeros((count, 3))
    force[:, 2] = rows[:, _FORCE]
    return Course(
        time_s=time_s,
        specific_force_m_s2=force,
        cell_n=rows[:, _CELL:_HEIGHT],
        height_m=rows[:, _HEIGHT],
        height_m_s=rows[:, _RISE],
        angle_rad=angle_rad,
        angle_rad_s=ankle_rates_rad_s(angle_rad, leg, spin_rad_s),
        leg_pitch_rad=np.arctan2(leg[:, 0, 2], leg[:, 2, 2]),
        extension_m=rows[:, _LENGTH:_RATE] - free_m,
        extension_m_s=rows[:, _RATE:_PULL],
        tension_n=rows[:, _PULL:_TORN],
        torn=rows[:, _TORN:],
    )


def new_rows(count: int) -> Floats:
    """Return room for what `go` writes."""
    return np.zeros((count, _WIDTH))


@compiled
def go(  # noqa: PLR0913, PLR0917  # plain numbers keep the door to compiled code cheap
    laws: Any,
    states: Any,
    tendon_laws: Any,
    tendon_states: Any,
    free_m: Any,
    pin_play_m: Any,
    pin_m: Any,
    vacuum_pa: Any,
    inner_steps: int,
    step_s: float,
    is_held: bool,  # noqa: FBT001  # numba takes no keyword
    drive_m: Any,
    has_tendons: bool,  # noqa: FBT001  # as above
    rows: Any,
) -> None:
    """Advance a leg by as many tendon steps as there are rows.

    Args:
        laws: `Law.packed`.
        states: Changed, shape (1,) of STATE.
        tendon_laws: One per tendon, for this step; a tuple.
        tendon_states: One per tendon, changed; a tuple.
        free_m: Lengths at which the tendons begin to pull, shape (TENDONS,).
        pin_play_m: How far the pin of each tendon can slide, shape (TENDONS,).
        pin_m: How far it has, changed, shape (TENDONS,).
        vacuum_pa: In each tendon at each row, shape (n, TENDONS).
        inner_steps: Of the bodies, per step of the tendons.
        step_s: Of the tendons.
        is_held: The carriage does not move.
        drive_m: Where the spindle is at each row, and one more, shape (n + 1,).
        has_tendons: Whether the tendons are there.
        rows: Written, from `new_rows`.

    """
    state = states[0]
    pull_n, length_m, rate_m_s = np.zeros(TENDONS), np.zeros(TENDONS), np.zeros(TENDONS)
    gravity = laws[0].gravity_m_s2
    for row in range(rows.shape[0]):
        lengths_and_rates(laws, states, length_m, rate_m_s)
        if has_tendons:
            for i in range(TENDONS):
                pin_m[i] = pinned_m(pin_m[i], pin_play_m[i], pull_n[i], step_s)
                extension_m = length_m[i] - free_m[i] - pin_m[i]
                pull_n[i] = tendon_tension_n(tendon_laws[i], tendon_states[i], extension_m, vacuum_pa[row, i])
        before_m_s = state.speed[0]
        speed_m_s = (drive_m[row + 1] - drive_m[row]) / step_s
        advance(laws, states, pull_n, inner_steps, step_s / inner_steps, is_held, drive_m[row], speed_m_s)
        lengths_and_rates(laws, states, length_m, rate_m_s)
        rows[row, _FORCE] = (state.speed[0] - before_m_s) / step_s + gravity
        note(state, length_m, rate_m_s, pull_n, rows[row])
        for i in range(TENDONS):
            rows[row, _TORN + i] = tendon_states[i].more[1]


@compiled
def pinned_m(pin_m: float, play_m: float, pull_n: float, step_s: float) -> float:
    """Return how far a pin has slid in its worn hole: pulled along, and back when its tendon is slack."""
    if play_m <= 0.0:
        return 0.0
    if pull_n > _PIN_N:
        return min(pin_m + (pull_n - _PIN_N) / _PIN_N_S_M * step_s, play_m)
    if pull_n <= 0.0:
        return pin_m * (1.0 - step_s / _PIN_BACK_S)
    return pin_m


@compiled
def note(state: Any, length_m: Any, rate_m_s: Any, pull_n: Any, out: Any) -> None:
    """Write what is seen of a state into a row."""
    out[_HEIGHT] = state.height_m
    out[_RISE] = state.speed[0]
    for i in range(3):
        out[_CELL + i] = state.cell_n[i]
        for j in range(3):
            out[_LEG + 3 * i + j] = state.leg_turn[i, j]
            out[_FOOT + 3 * i + j] = state.foot_turn[i, j]
    for i in range(6):
        out[_SPIN + i] = state.speed[1 + i]
    for i in range(TENDONS):
        out[_LENGTH + i] = length_m[i]
        out[_RATE + i] = rate_m_s[i]
        out[_PULL + i] = pull_n[i]


_BODY_S = 2e-5
"""Step of the bodies. Chosen: half of it moves no peak of a drop by 0.1 %."""
_COARSE_S = 1e-3
"""Step of the tendons while the carriage is held, and what all times are rounded to."""
_MOUNT_DAMPING = 0.06
"""Of a soft mount of the IMU. Assumed: rubber."""


@dataclass(frozen=True)
class Scene:
    """One run of a leg."""

    law: Law
    height_m: float
    """Where the carriage starts."""
    leg_pitch_rad: float
    """How the leg hangs."""
    foot_pitch_rad: float
    """How the foot hangs, against the leg."""
    free_m: Floats
    """Lengths at which the tendons begin to pull, shape (TENDONS,)."""
    has_tendons: bool
    schedule: tuple[SetPoint, ...]
    duration_s: float
    """A whole number of hundredths of a second."""
    release_s: float
    """When the carriage is let go."""
    drive_m: Callable[[Floats], Floats] | None
    """Where the spindle is at a time, if there is one."""
    step_s: float
    """Of the tendons, once released."""


def move(plan: Plan, scene: Scene, machine: Machine, seed: int) -> RealRun:
    """Run a scene, and return what was recorded.

    Args:
        plan: Kept with the run.
        scene: What is set up.
        machine: With its faults, on the day of the run.
        seed: Of the run.

    """
    air = breathe(machine, scene.schedule, scene.duration_s, seed)
    course = _course(scene, machine, air.time_s, air.vacuum_pa)
    time_s, duration_s = course.time_s, scene.duration_s
    force = _mounted(machine, course)
    imu = imu_track(machine, seed, Truth(time_s, np.column_stack([force, np.zeros_like(force)])), duration_s)
    joints: tuple[str, ...] = (names.CARRIAGE_JOINT,)
    places = course.height_m[:, None]
    encoders: tuple[Sensor, ...] = (machine.sensors.slide,)
    topics = {
        **air.topics,
        names.IMU.name: imu,
        names.LOAD_CELL.name: load_cell_track(machine, seed, Truth(time_s, course.cell_n), duration_s),
    }
    if scene.has_tendons:
        joints = (*names.ANKLE_JOINTS, *joints)
        places = np.column_stack([course.angle_rad, places])
        encoders = (*(machine.sensors.angle,) * len(names.ANKLE_JOINTS), *encoders)
        topics[names.TENDON_STATES.name] = tendon_track(
            machine,
            seed,
            names.TENDONS,
            Truth(time_s, course.extension_m),
            Truth(time_s, course.tension_n),
            Truth(time_s, course.torn),
            duration_s,
        )
    topics[names.JOINT_STATES.name] = encoder_track(machine, seed, joints, Truth(time_s, places), duration_s, encoders)
    return RealRun(plan, topics)


def _course(scene: Scene, machine: Machine, air_s: Floats, vacuum_pa: Floats) -> Course:
    """Advance the leg: coarsely while it is held, then in the steps of the scene."""
    stops = sorted({round(each / _COARSE_S) for each in (0.0, scene.release_s, scene.duration_s)})
    channel = [index for index, name in enumerate(names.CHANNELS) for _ in names.TENDONS_OF_CHANNEL[name]]
    state = still(scene.height_m, scene.leg_pitch_rad, scene.leg_pitch_rad + scene.foot_pitch_rad)
    law = scene.law.packed()
    length_m, rate_m_s = np.zeros(TENDONS), np.zeros(TENDONS)
    lengths_and_rates(law, state, length_m, rate_m_s)
    tendons = tuple(
        tendon_state(tendon_law(make, _COARSE_S), float(length))
        for make, length in zip(machine.tendons, length_m - scene.free_m, strict=True)
    )
    pin_m = np.zeros(TENDONS)
    stretches: list[tuple[Floats, Floats]] = []
    for start, end in itertools.pairwise(stops):
        start_s = start * _COARSE_S
        is_held = start_s < scene.release_s - _COARSE_S / 2.0
        step_s = _COARSE_S if is_held else scene.step_s
        count = round((end - start) * _COARSE_S / step_s)
        time_s: Floats = start_s + step_s * np.arange(count + 1, dtype=np.float64)
        held_pa = np.column_stack([np.interp(time_s[1:], air_s, vacuum_pa[:, each]) for each in channel])
        rows = new_rows(count)
        go(
            law,
            state,
            tuple(tendon_law(make, step_s) for make in machine.tendons),
            tendons,
            scene.free_m,
            np.full(TENDONS, machine.leg.pin_play_m),
            pin_m,
            held_pa,
            max(1, round(step_s / _BODY_S)),
            step_s,
            is_held,
            np.zeros(count + 1) if scene.drive_m is None else scene.drive_m(time_s),
            scene.has_tendons,
            rows,
        )
        stretches.append((time_s[1:], rows))
    even_s = scene.step_s * np.arange(1, round(scene.duration_s / scene.step_s) + 1, dtype=np.float64)
    return truth(_even(stretches, even_s, scene), scene.free_m, even_s)


def _even(stretches: Sequence[tuple[Floats, Floats]], even_s: Floats, scene: Scene) -> Floats:
    """Return rows at even times; those of coarse stretches, in which next to nothing moves, are filled in."""
    parts = []
    for time_s, rows in stretches:
        start_s = time_s[0] - (time_s[1] - time_s[0]) if len(time_s) > 1 else time_s[0] - scene.step_s
        chosen = even_s[(even_s > start_s + 1e-9) & (even_s < time_s[-1] + 1e-9)]
        if len(chosen) == len(time_s):
            parts.append(rows)
        else:
            parts.append(np.column_stack([np.interp(chosen, time_s, column) for column in rows.T]))
    return np.concatenate(parts)


def _mounted(machine: Machine, course: Course) -> Floats:
    """Return what the IMU feels: what the carriage does, through its mount where that is soft."""
    force, softness = course.specific_force_m_s2, machine.leg.mount_s2
    if softness <= 0.0:
        return force
    step_s = float(course.time_s[1] - course.time_s[0])
    damping = 2.0 * _MOUNT_DAMPING * math.sqrt(softness)
    numerator, denominator = filters.bilinear([damping, 1.0], [softness, damping, 1.0], 1.0 / step_s)
    swung: Floats = force[0] + filters.lfilter(numerator, denominator, force - force[0], axis=0)
    return swung
