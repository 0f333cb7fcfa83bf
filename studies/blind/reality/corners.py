"""What the ground does to one corner of the foot: Hunt and Crossley press, LuGre rubs, a mat gives."""

from __future__ import annotations

import math
from typing import Any

from studies.blind.reality.bodies import FOOT, LEG, PRESS_POINTS
from studies.blind.reality.compiled import compiled
from studies.blind.reality.pushes import push_foot
from studies.blind.reality.vectors import STILL, Vector, cross, dot, less, plus, row, scaled, turned, vector


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
