"""Loads on the seven speeds: drive, cable and rail, weight, tendons, joint, loose plate, ground."""

from __future__ import annotations

import math
from typing import Any

from studies.blind.reality.bodies import CORNERS, FOOT, LEG, SPEEDS, TENDONS
from studies.blind.reality.compiled import compiled
from studies.blind.reality.corners import corner_n
from studies.blind.reality.pushes import add_moment, push_foot, push_leg
from studies.blind.reality.vectors import STILL, Vector, cross, dot, less, plus, row, scaled, turned, vector


@compiled
def gather(law: Any, state: Any, pull_n: Any, step_s: float, drive_m: float, drive_m_s: float) -> Vector:
    """Gather the loads on every speed; return the force of the ground."""
    for i in range(SPEEDS):
        state.load[i] = 0.0
    to_ankle = turned(state.leg_turn, (law.ankle_m[0], law.ankle_m[1], law.ankle_m[2]))
    state.load[0] += _carriage_n(law, state, step_s, drive_m, drive_m_s)
    _add_weight(law, state, to_ankle)
    if law.foot_is_free > 0.0:
        for i in range(TENDONS):
            up = turned(state.leg_turn, row(law.seat_leg_m, i))
            down = turned(state.foot_turn, row(law.seat_foot_m, i))
            way = less(up, down)
            pull = scaled(way, pull_n[i] / math.sqrt(dot(way, way)))
            push_foot(state, to_ankle, down, pull)
            push_leg(state, plus(to_ankle, up), scaled(pull, -1.0))
        _add_joint(law, state, step_s)
    if law.plate_kg > 0.0:
        _add_plate(law, state, to_ankle, step_s)
    for i in range(3):
        state.load[LEG + i] -= law.pivot_viscous_n_m_s * state.speed[LEG + i]
    total = (0.0, 0.0, 0.0)
    for i in range(CORNERS):
        total = plus(total, corner_n(law, state, i, to_ankle, step_s))
    return total


@compiled
def _carriage_n(law: Any, state: Any, step_s: float, drive_m: float, drive_m_s: float) -> float:
    speed = state.speed[0]
    force = -law.drive_n_m * (state.height_m - drive_m) - law.drive_n_s_m * (speed - drive_m_s)
    if law.cable_n != 0.0 or law.cable_n_m != 0.0:
        force += max(law.cable_n + law.cable_n_m * (law.cable_m - state.height_m), 0.0)
    if law.rail_static_n > 0.0:
        tight = 1.0
        if law.rail_width_m > 0.0:
            tight = math.exp(-(((state.height_m - law.rail_tight_m) / law.rail_width_m) ** 2))
        slower = math.exp(-((speed / law.rail_stribeck_m_s) ** 2))
        level_n = tight * (law.rail_sliding_n + (law.rail_static_n - law.rail_sliding_n) * slower)
        if level_n > STILL:
            bending = state.rail_bristle_m + speed * step_s
            state.rail_bristle_m = bending / (1.0 + law.rail_bristle_n_m * abs(speed) * step_s / level_n)
            force -= law.rail_bristle_n_m * state.rail_bristle_m
        else:
            state.rail_bristle_m = 0.0
    pull_n: float = force
    return pull_n


@compiled
def _add_weight(law: Any, state: Any, to_ankle: Vector) -> None:
    """Add gravity, and what turning asks for beside acceleration."""
    leg_spin, foot_spin = vector(state.speed, LEG), vector(state.speed, FOOT)
    gravity = (0.0, 0.0, -law.gravity_m_s2)
    state.load[0] -= law.carriage_kg * law.gravity_m_s2
    to_leg = turned(state.leg_turn, (law.leg_centre_m[0], law.leg_centre_m[1], law.leg_centre_m[2]))
    inward = cross(leg_spin, cross(leg_spin, to_leg))
    push_leg(state, to_leg, scaled(less(gravity, inward), law.leg_kg))
    to_foot = turned(state.foot_turn, (law.foot_centre_m[0], law.foot_centre_m[1], law.foot_centre_m[2]))
    inward = plus(
        cross(leg_spin, cross(leg_spin, to_ankle)),
        cross(foot_spin, cross(foot_spin, to_foot)),
    )
    push_foot(state, to_ankle, to_foot, scaled(less(gravity, inward), law.foot_kg))
    add_moment(state, LEG, scaled(_gyroscopic(state.leg_turn, law.leg_inertia_kg_m2, leg_spin), -1.0))
    add_moment(state, FOOT, scaled(_gyroscopic(state.foot_turn, law.foot_inertia_kg_m2, foot_spin), -1.0))


@compiled
def _add_joint(law: Any, state: Any, step_s: float) -> None:
    """Add friction of the ball joint by LuGre, and its stop."""
    spin = less(vector(state.speed, FOOT), vector(state.speed, LEG))
    fast = math.sqrt(dot(spin, spin))
    moment = scaled(spin, -law.joint_viscous_n_m_s)
    if law.joint_static_n_m > 0.0:
        slower = math.exp(-((fast / law.joint_stribeck_rad_s) ** 2))
        level = law.joint_sliding_n_m + (law.joint_static_n_m - law.joint_sliding_n_m) * slower
        give = 1.0 + law.joint_bristle_n_m_rad * fast * step_s / level
        for i in range(3):
            state.joint_bristle_rad[i] = (state.joint_bristle_rad[i] + spin[i] * step_s) / give
        moment = less(moment, scaled(vector(state.joint_bristle_rad, 0), law.joint_bristle_n_m_rad))
    leg, foot = state.leg_turn, state.foot_turn
    trace = 0.0
    for i in range(3):
        for j in range(3):
            trace += leg[i, j] * foot[i, j]
    if trace < 1.0 + 2.0 * math.cos(law.stop_rad):
        angle = math.acos(max((trace - 1.0) / 2.0, -1.0))
        axis = (0.0, 0.0, 0.0)
        for j in range(3):  # foot = turn leg: the turn's axis from its skew part
            axis = plus(axis, cross((leg[0, j], leg[1, j], leg[2, j]), (foot[0, j], foot[1, j], foot[2, j])))
        size = max(math.sqrt(dot(axis, axis)), STILL)
        moment = less(moment, scaled(axis, law.stop_n_m_rad * (angle - law.stop_rad) / size))
    add_moment(state, FOOT, moment)
    add_moment(state, LEG, scaled(moment, -1.0))


@compiled
def _add_plate(law: Any, state: Any, to_ankle: Vector, step_s: float) -> None:
    """Let the loose plate strike the ends of its gap."""
    at = turned(state.foot_turn, (law.plate_at_m[0], law.plate_at_m[1], law.plate_at_m[2]))
    across = (state.foot_turn[0, 2], state.foot_turn[1, 2], state.foot_turn[2, 2])
    half_m = law.plate_gap_m / 2.0
    over_m = state.plate_m - min(max(state.plate_m, -half_m), half_m)
    force = 0.0
    if over_m != 0.0:
        force = -law.plate_n_m * over_m - law.plate_n_s_m * state.plate_m_s
        if force * over_m > 0.0:  # ends push, they never pull
            force = 0.0
    carried = plus(
        (0.0, 0.0, state.change[0] + law.gravity_m_s2),
        plus(cross(vector(state.change, LEG), to_ankle), cross(vector(state.change, FOOT), at)),
    )
    state.plate_m_s += (force / law.plate_kg - dot(carried, across)) * step_s
    push_foot(state, to_ankle, at, scaled(across, -force))


@compiled
def _gyroscopic(turn: Any, inertia: Any, spin: Vector) -> Vector:
    """Return spin cross angular momentum."""
    x, y, z = 0.0, 0.0, 0.0
    for k in range(3):
        share = inertia[k] * (turn[0, k] * spin[0] + turn[1, k] * spin[1] + turn[2, k] * spin[2])
        x += turn[0, k] * share
        y += turn[1, k] * share
        z += turn[2, k] * share
    return cross(spin, (x, y, z))
