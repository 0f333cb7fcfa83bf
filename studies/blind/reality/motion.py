"""Equations of motion of `bodies`: loads on the seven speeds, the matrix of inertia, Newton and Euler in space."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from studies.blind.reality.bodies import (
    CORNERS,
    FOOT,
    LEG,
    PRESS_POINTS,
    SPEEDS,
    STILL,
    TENDONS,
    Vector,
    compiled,
    cross,
    dot,
    less,
    plus,
    row,
    scaled,
    turn,
    turned,
    vector,
)

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


@compiled
def push_leg(state: Any, at: Vector, force: Vector) -> None:
    """Add a force on the leg; `at` is from the pivot, axes of the world."""
    state.load[0] += force[2]
    add_moment(state, LEG, cross(at, force))


@compiled
def push_foot(state: Any, to_ankle: Vector, at: Vector, force: Vector) -> None:
    """Add a force on the foot; `at` is from the ankle's joint, axes of the world."""
    push_leg(state, to_ankle, force)
    add_moment(state, FOOT, cross(at, force))


@compiled
def add_moment(state: Any, at: int, moment: Vector) -> None:
    """Add a moment on the body whose turning begins at a speed."""
    for i in range(3):
        state.load[at + i] += moment[i]


@compiled
def corner_n(law: Any, state: Any, corner: int, to_ankle: Vector, step_s: float) -> Vector:
    """Add what the ground does to one corner, and return it."""
    sine, cosine = math.sin(law.slope_rad), math.cos(law.slope_rad)
    out, along = (-sine, 0.0, cosine), (cosine, 0.0, sine)
    arm = turned(state.foot_turn, row(law.corner_m, corner))
    centre = plus(to_ankle, arm)
    pivot_m = state.height_m - law.ankle_m[2]
    depth_m = law.corner_radius_m - dot(out, centre) - out[2] * pivot_m
    pressed_m = depth_m - state.mat_m[corner]
    if pressed_m <= 0.0:
        state.bristle_m[corner, 0] = state.bristle_m[corner, 1] = 0.0
        for i in range(3):
            state.ground_n[corner, i] = 0.0
        _press_mat(law, state, corner, 0.0)
        return (0.0, 0.0, 0.0)
    arm = less(arm, scaled(out, law.corner_radius_m - depth_m))
    speed = plus(
        (0.0, 0.0, state.speed[0]),
        plus(cross(vector(state.speed, LEG), to_ankle), cross(vector(state.speed, FOOT), arm)),
    )
    pressing_m_s = -dot(out, speed) - state.mat_m_s[corner]
    load_n = max(_pressed_n(law, pressed_m) * (1.0 + law.press_damping_s_m * pressing_m_s), 0.0)
    _press_mat(law, state, corner, load_n)
    first, second = dot(along, speed), speed[1]
    fast = math.sqrt(first * first + second * second)
    slower = math.exp(-((fast / law.friction_stribeck_m_s) ** 2))
    level = max(law.friction_sliding + (law.friction_static - law.friction_sliding) * slower, STILL)
    give = 1.0 + law.friction_bristle_1_m * fast * step_s / level
    rub_first = _rubbed(law, state, corner, 0, first, give, step_s)
    rub_second = _rubbed(law, state, corner, 1, second, give, step_s)
    size = math.sqrt(rub_first * rub_first + rub_second * rub_second)
    most = max(law.friction_static, level)
    scale = -load_n * (1.0 if size <= most else most / size)
    force = plus(plus(scaled(along, scale * rub_first), (0.0, scale * rub_second, 0.0)), scaled(out, load_n))
    state.ground_n[corner, 0] = scale * rub_first
    state.ground_n[corner, 1] = scale * rub_second
    state.ground_n[corner, 2] = load_n
    push_foot(state, to_ankle, arm, force)
    return force


@compiled
def _rubbed(law: Any, state: Any, corner: int, way: int, speed: float, give: float, step_s: float) -> float:
    """Bend the bristles of one corner one way on, and return their force per load."""
    before = state.bristle_m[corner, way]
    after = (before + speed * step_s) / give
    state.bristle_m[corner, way] = after
    rub: float = law.friction_bristle_1_m * after + law.friction_bristle_s_m * (after - before) / step_s
    return rub


@compiled
def _press_mat(law: Any, state: Any, corner: int, load_n: float) -> None:
    if law.mat_n_m > 0.0:
        state.mat_m_s[corner] = (load_n - law.mat_n_m * state.mat_m[corner]) / law.mat_n_s_m


@compiled
def _pressed_n(law: Any, depth_m: float) -> float:
    place = depth_m / law.press_step_m
    index = min(int(place), PRESS_POINTS - 2)
    below = law.press_n[index]
    pressed_n: float = below + (law.press_n[index + 1] - below) * (place - index)
    return pressed_n


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


@compiled
def _weigh_bodies(law: Any, state: Any) -> None:
    """Fill the matrix of inertia."""
    matrix = state.matrix
    to_ankle = turned(state.leg_turn, (law.ankle_m[0], law.ankle_m[1], law.ankle_m[2]))
    to_leg = turned(state.leg_turn, (law.leg_centre_m[0], law.leg_centre_m[1], law.leg_centre_m[2]))
    to_foot = turned(state.foot_turn, (law.foot_centre_m[0], law.foot_centre_m[1], law.foot_centre_m[2]))
    matrix[0, 0] = law.carriage_kg + law.leg_kg + law.foot_kg
    reach = dot(to_ankle, to_foot)
    for i in range(3):
        for j in range(3):
            same = 1.0 if i == j else 0.0
            leg = law.leg_kg * (dot(to_leg, to_leg) * same - to_leg[i] * to_leg[j])
            leg += law.foot_kg * (dot(to_ankle, to_ankle) * same - to_ankle[i] * to_ankle[j])
            foot = law.foot_kg * (dot(to_foot, to_foot) * same - to_foot[i] * to_foot[j])
            for k in range(3):
                leg += state.leg_turn[i, k] * law.leg_inertia_kg_m2[k] * state.leg_turn[j, k]
                foot += state.foot_turn[i, k] * law.foot_inertia_kg_m2[k] * state.foot_turn[j, k]
            matrix[LEG + i, LEG + j] = leg
            matrix[FOOT + i, FOOT + j] = foot
            both = law.foot_kg * (reach * same - to_foot[i] * to_ankle[j])
            matrix[LEG + i, FOOT + j] = both
            matrix[FOOT + j, LEG + i] = both
    leg_lever = plus(scaled(to_leg, law.leg_kg), scaled(to_ankle, law.foot_kg))
    foot_lever = scaled(to_foot, law.foot_kg)
    _border(matrix, LEG, leg_lever)
    _border(matrix, FOOT, foot_lever)


@compiled
def solve(law: Any, state: Any, count: int) -> None:
    """Solve for the change of the speeds that are free."""
    _weigh_bodies(law, state)
    matrix, load = state.matrix, state.load
    if law.foot_is_free <= 0.0 and law.leg_is_free > 0.0:
        _fold(matrix, load)
    _eliminate(matrix, load, state.active, count)
    for i in range(SPEEDS):
        state.change[i] = 0.0
    for a in range(count):
        state.change[state.active[a]] = load[state.active[a]]
    if law.foot_is_free <= 0.0:
        for i in range(3):
            state.change[FOOT + i] = state.change[LEG + i]


@compiled
def _fold(matrix: Any, load: Any) -> None:
    """Let the foot turn as the leg does."""
    for i in range(3):
        load[LEG + i] += load[FOOT + i]
        matrix[0, LEG + i] += matrix[0, FOOT + i]
        matrix[LEG + i, 0] = matrix[0, LEG + i]
        for j in range(3):
            both = matrix[LEG + i, FOOT + j] + matrix[FOOT + i, LEG + j]
            matrix[LEG + i, LEG + j] += both + matrix[FOOT + i, FOOT + j]


@compiled
def _border(matrix: Any, at: int, lever: Vector) -> None:
    """Couple a body's turning to the carriage: what rises per turn, lever cross z."""
    for i, value in enumerate((lever[1], -lever[0], 0.0)):
        matrix[0, at + i] = value
        matrix[at + i, 0] = value


@compiled
def _eliminate(matrix: Any, load: Any, active: Any, count: int) -> None:
    """Solve the symmetric system of the active rows in place; the solution stands in load."""
    for a in range(count):
        row = active[a]
        for b in range(a + 1, count):
            below = active[b]
            factor = matrix[below, row] / matrix[row, row]
            for c in range(a, count):
                matrix[below, active[c]] -= factor * matrix[row, active[c]]
            load[below] -= factor * load[row]
    for a in range(count - 1, -1, -1):
        row = active[a]
        value = load[row]
        for c in range(a + 1, count):
            value -= matrix[row, active[c]] * load[active[c]]
        load[row] = value / matrix[row, row]


@compiled
def advance(
    laws: NDArray[Any],
    states: NDArray[Any],
    pull_n: NDArray[np.float64],
    steps: int,
    step_s: float,
    is_held: bool,  # noqa: FBT001  # numba takes no keyword
    drive_m: float,
    drive_m_s: float,
) -> None:
    """Advance one machine.

    Args:
        laws: `Law.packed`.
        states: Changed, shape (1,) of STATE.
        pull_n: Of each tendon, the same through all steps, shape (TENDONS,).
        steps: How many.
        step_s: Length of each.
        is_held: The carriage does not move.
        drive_m: Where the spindle is at the start, if there is one.
        drive_m_s: Its speed.

    """
    law, state = laws[0], states[0]
    active = _find_active(law, state, is_held)
    for i in range(3):
        state.cell_n[i] = 0.0
    free = -1.0 if is_held else 1.0
    if state.freedom != free:  # what is let go accelerates from the first moment
        state.freedom = free
        gather(law, state, pull_n, step_s, drive_m, drive_m_s)
        solve(law, state, active)
    for step in range(steps):
        for i in range(SPEEDS):
            state.speed[i] += state.change[i] * step_s / 2.0
        _drift(state, step_s)
        for i in range(SPEEDS):  # what depends on speed looks at the end of the step
            state.speed[i] += state.change[i] * step_s / 2.0
        at_m = drive_m + drive_m_s * step_s * (step + 1)
        ground = gather(law, state, pull_n, step_s, at_m, drive_m_s)
        for i in range(SPEEDS):
            state.speed[i] -= state.change[i] * step_s / 2.0
        solve(law, state, active)
        for i in range(SPEEDS):
            state.speed[i] += state.change[i] * step_s / 2.0
        _weigh(law, state, ground, steps)


@compiled
def lengths_and_rates(
    laws: NDArray[Any],
    states: NDArray[Any],
    length_m: NDArray[np.float64],
    rate_m_s: NDArray[np.float64],
) -> None:
    """Write length and rate of every tendon from seat to seat, each of shape (TENDONS,)."""
    law, state = laws[0], states[0]
    leg_spin = vector(state.speed, LEG)
    foot_spin = vector(state.speed, FOOT)
    for i in range(TENDONS):
        up = turned(state.leg_turn, row(law.seat_leg_m, i))
        down = turned(state.foot_turn, row(law.seat_foot_m, i))
        way = less(up, down)
        length_m[i] = math.sqrt(dot(way, way))
        rate_m_s[i] = dot(way, less(cross(leg_spin, up), cross(foot_spin, down))) / length_m[i]


@compiled
def _find_active(law: Any, state: Any, is_held: bool) -> int:  # noqa: FBT001  # as above
    count = 0
    for i in range(SPEEDS):
        free = (
            (i == 0 and not is_held)
            or (LEG <= i < FOOT and law.leg_is_free > 0.0)
            or (i >= FOOT and law.foot_is_free > 0.0)
        )
        if free:
            state.active[count] = i
            count += 1
    return count


@compiled
def _drift(state: Any, step_s: float) -> None:
    state.height_m += state.speed[0] * step_s
    turn(state.leg_turn, vector(state.speed, LEG), step_s)
    turn(state.foot_turn, vector(state.speed, FOOT), step_s)
    state.plate_m += state.plate_m_s * step_s
    for i in range(CORNERS):
        state.mat_m[i] = max(state.mat_m[i] + state.mat_m_s[i] * step_s, 0.0)


@compiled
def _weigh(law: Any, state: Any, ground: Vector, steps: int) -> None:
    """Add to the mean of what the load cell bears: mass times acceleration of all below it, less gravity and ground."""
    leg_spin, foot_spin = vector(state.speed, LEG), vector(state.speed, FOOT)
    leg_change, foot_change = vector(state.change, LEG), vector(state.change, FOOT)
    to_ankle = turned(state.leg_turn, (law.ankle_m[0], law.ankle_m[1], law.ankle_m[2]))
    to_leg = turned(state.leg_turn, (law.leg_centre_m[0], law.leg_centre_m[1], law.leg_centre_m[2]))
    to_foot = turned(state.foot_turn, (law.foot_centre_m[0], law.foot_centre_m[1], law.foot_centre_m[2]))
    up = (0.0, 0.0, state.change[0] + law.gravity_m_s2)
    leg = plus(up, _carried(leg_spin, leg_change, to_leg))
    foot = plus(up, plus(_carried(leg_spin, leg_change, to_ankle), _carried(foot_spin, foot_change, to_foot)))
    total = plus(scaled(leg, law.leg_kg), plus(scaled(foot, law.foot_kg), scaled(up, law.cell_kg)))
    total = less(total, ground)
    for i in range(3):
        state.cell_n[i] += total[i] / steps


@compiled
def _carried(spin: Vector, change: Vector, arm: Vector) -> Vector:
    return plus(cross(change, arm), cross(spin, cross(spin, arm)))


@compiled
def advance_guided(
    laws: NDArray[Any],
    states: NDArray[Any],
    pull_n: NDArray[np.float64],
    steps: int,
    step_s: float,
    guide_speed: NDArray[np.float64],
    guide_change: NDArray[np.float64],
) -> None:
    """Advance the foot of a leg that is guided: carriage and leg move as they are made to, whatever hangs on them.

    Args:
        laws: `Law.packed`.
        states: Changed, shape (1,) of STATE.
        pull_n: Of each tendon, the same through all steps, shape (TENDONS,).
        steps: How many.
        step_s: Length of each.
        guide_speed: Of carriage and leg at the start, shape (FOOT,).
        guide_change: Its rate, the same through all steps, shape (FOOT,).

    """
    law, state = laws[0], states[0]
    for i in range(FOOT):
        state.speed[i] = guide_speed[i]
        state.change[i] = guide_change[i]
    for _ in range(steps):
        for i in range(SPEEDS):
            state.speed[i] += state.change[i] * step_s / 2.0
        _drift(state, step_s)
        for i in range(SPEEDS):  # what depends on speed looks at the end of the step
            state.speed[i] += state.change[i] * step_s / 2.0
        gather(law, state, pull_n, step_s, state.height_m, state.speed[0])
        for i in range(SPEEDS):
            state.speed[i] -= state.change[i] * step_s / 2.0
        _weigh_bodies(law, state)
        for i in range(FOOT, SPEEDS):
            for j in range(FOOT):
                state.load[i] -= state.matrix[i, j] * state.change[j]
            state.active[i - FOOT] = i
        _eliminate(state.matrix, state.load, state.active, SPEEDS - FOOT)
        for i in range(FOOT, SPEEDS):
            state.change[i] = state.load[i]
        for i in range(SPEEDS):
            state.speed[i] += state.change[i] * step_s / 2.0
