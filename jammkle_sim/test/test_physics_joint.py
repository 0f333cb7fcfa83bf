"""Dry friction of the ankle's joint: it holds, slides, and only takes energy."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jammkle_sim.physics import kernels, records
from jammkle_sim.physics.ankle import joint_law
from jammkle_sim.rigs.rig import free

if TYPE_CHECKING:
    from numpy.typing import NDArray

STEP_S = 0.0005
INERTIA_KG_M2 = 1.3e-4
"""Of the foot about the joint."""


def body(speed: NDArray[np.float64]) -> records.Body:
    """MuJoCo's side, made up: three joint speeds and the torques on them."""
    none = np.zeros(0)
    return records.Body(
        addresses=np.zeros(4, dtype=np.intp),
        length_m=none,
        rate_m_s=none,
        pull_n=none,
        position=np.zeros(3),
        speed=speed,
        applied_n_m=np.zeros(3),
        joint_index=np.arange(3, dtype=np.intp),
        raw_imu=np.zeros(6),
        guide=free(),
        guide_at=np.zeros(1, dtype=np.int64),
    )


def turned_rad(torque_n_m: float, friction_n_m: float, breakaway: float, time_s: float) -> NDArray[np.float64]:
    """Angle of a joint from rest, after each step, as a torque comes up over half the time and then stays."""
    law, state = joint_law(STEP_S, friction_n_m, breakaway), np.zeros(1, dtype=records.JOINT_STATE)
    speed, angles = np.zeros(3), [0.0]
    side = body(speed)
    steps = round(time_s / STEP_S)
    for step in range(steps):
        kernels.rub_joint(law[0], state[0], side)
        given_n_m = torque_n_m * min(2.0 * step / steps, 1.0)
        speed[0] += STEP_S / INERTIA_KG_M2 * (given_n_m + side.applied_n_m[0])
        angles.append(angles[-1] + STEP_S * speed[0])
    return np.array(angles)


@pytest.mark.parametrize("friction_n_m", [0.002, 0.05, 0.5])
def test_a_joint_holds_below_its_friction_and_slides_above(friction_n_m: float) -> None:
    """With nine tenths of the torque it gives a little and then stays; with a tenth more it goes on."""
    held = turned_rad(0.9 * friction_n_m, friction_n_m, 0.0, 2.0)
    assert np.abs(held).max() < 0.01
    assert abs(held[-1000:].mean() - held[-2000:-1000].mean()) < 1e-4
    assert turned_rad(1.1 * friction_n_m, friction_n_m, 0.0, 2.0)[-1] > 0.5


def test_a_joint_that_sticks_needs_more_to_be_set_moving() -> None:
    """Between sliding and breaking away it stays; without breakaway the same torque moves it."""
    assert turned_rad(0.06, 0.05, 0.5, 1.0)[-1] < 0.02
    assert turned_rad(0.06, 0.05, 0.0, 1.0)[-1] > 1.0


@given(
    speeds=st.lists(st.tuples(*[st.floats(-20.0, 20.0)] * 3), min_size=2, max_size=40),
    breakaway=st.floats(0.0, 1.0),
)
def test_friction_only_takes_energy(speeds: list[tuple[float, float, float]], breakaway: float) -> None:
    """Whatever the motion, what it gives back is never more than it holds; its torque never passes its limit.

    The torque of a step is that at its end, so work is counted with the mean of both ends.
    """
    friction_n_m = 0.05
    law, state = joint_law(STEP_S, friction_n_m, breakaway), np.zeros(1, dtype=records.JOINT_STATE)
    stiffness_n_m = friction_n_m / float(law["presliding_rad"][0])
    taken_j, before_n_m = 0.0, np.zeros(3)
    for each in speeds:
        speed = np.array(each)
        side = body(speed)
        for _ in range(20):
            kernels.rub_joint(law[0], state[0], side)
            taken_j -= STEP_S * float((before_n_m + side.applied_n_m) @ speed) / 2.0
            before_n_m = side.applied_n_m.copy()
            held_j = stiffness_n_m * float((state["deflection_rad"][0] ** 2).sum()) / 2.0
            assert np.linalg.norm(before_n_m) <= friction_n_m * (1.0 + breakaway) * (1.0 + 1e-9)
            assert taken_j >= held_j * (1.0 - 1e-6) - 1e-9 - 0.02 * held_j


def test_friction_is_the_same_about_any_axis() -> None:
    """A ball has no axes: turning about two at once meets the torque that turning about one does."""
    torques = []
    for speed in (np.array([5.0, 0.0, 0.0]), np.array([3.0, 4.0, 0.0]), np.array([0.0, 3.0, -4.0])):
        law, state, side = joint_law(STEP_S, 0.05, 0.0), np.zeros(1, dtype=records.JOINT_STATE), body(speed)
        for _ in range(200):
            kernels.rub_joint(law[0], state[0], side)
        torques.append(float(np.linalg.norm(side.applied_n_m)))
        assert side.applied_n_m @ speed == pytest.approx(-0.05 * 5.0)
    assert torques == pytest.approx([0.05] * 3)
