"""The speed of a sole by joints and odometry against MuJoCo's own, and the slips that it shows."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from jammkle_controller.core.slip import BodyTwist, LegPose, sole_velocity_m_s
from jammkle_sim.physics.ankle import AnkleParameters
from jammkle_sim.physics.engine import mujoco
from jammkle_sim.robots.catalogue import robot_simulation
from jammkle_sim.robots.options import RobotOptions
from studies.contact.labelled import CLOCK_START_S, LabelledRecording, read_body, read_leg, read_pose
from studies.contact.robots import POSE_JOINTS, Keeper, leg_of_robot, slides_of
from studies.contact.trial import detected_by_ours


@pytest.mark.parametrize("robot", ["leg", "quadruped"])
def test_the_sole_goes_as_fast_as_in_the_simulation(robot: str) -> None:
    """In random poses, with random speeds of everything, the middle of each sole has MuJoCo's velocity to 0.1 mm/s.

    It is that of finite differences of its place as well, to what a step of 10 us leaves.
    """
    simulation = robot_simulation(robot, RobotOptions())
    model, data, chance = simulation.model, simulation.data, np.random.default_rng(3)
    for _ in range(5):
        data.qpos[:] += chance.uniform(-0.3, 0.3, model.nq)
        mujoco.mj_normalizeQuat(model, data.qpos)
        data.qvel[:] = chance.uniform(-3.0, 3.0, model.nv)
        mujoco.mj_forward(model, data)
        base = simulation.base()
        for name, view in simulation.ankles.items():
            leg = leg_of_robot(robot, name)
            middle = dataclasses.replace(leg, toe_m=0.0, heel_m=0.0, half_width_m=0.0)
            columns = (view.joint_positions(), view.joint_velocities())
            pose = LegPose(*(column.get(joint, 0.0) for column in columns for joint in POSE_JOINTS))
            foot = f"{name}/foot"
            reported = sole_velocity_m_s(middle, pose, BodyTwist(0, base.linear_m_s, base.angular_rad_s))
            trunk = data.xmat[model.body_rootid[model.body(foot).id]].reshape(3, 3)
            assert reported == pytest.approx(tuple(trunk.T @ velocity_of(model, data, foot)), abs=1e-4)
            before, after = (place_after(model, data, foot, by_s) for by_s in (-1e-5, 1e-5))
            assert reported == pytest.approx(tuple(trunk.T @ (after - before) / 2e-5), abs=1e-4)


def sole_m(data: mujoco.MjData, foot: str) -> np.ndarray:
    """Return the middle of the sole in the world."""
    body = data.body(foot)
    return body.xpos - AnkleParameters().sole_m * body.xmat.reshape(3, 3)[:, 2]


def velocity_of(model: mujoco.MjModel, data: mujoco.MjData, foot: str) -> np.ndarray:
    """Return its velocity in the world, by MuJoCo's Jacobian."""
    jacobian = np.zeros((3, model.nv))
    mujoco.mj_jac(model, data, jacobian, None, sole_m(data, foot), model.body(foot).id)
    return jacobian @ data.qvel


def place_after(model: mujoco.MjModel, data: mujoco.MjData, foot: str, time_s: float) -> np.ndarray:
    """Return where it is when everything has gone on as it does for a while."""
    other = mujoco.MjData(model)
    other.qpos[:] = data.qpos
    mujoco.mj_integratePos(model, other.qpos, data.qvel, time_s)
    mujoco.mj_kinematics(model, other)
    return sole_m(other, foot)


def test_slips_of_a_quadruped_are_reported_with_odometry() -> None:
    """When the slope turns slippery under a quadruped, each foot reports it before it has slid by 20 mm, once.

    On the IMU at the body nothing is reported of it at that time.
    """
    options = RobotOptions(
        behaviour="slip", imu="body", slope_deg=15.0, slip_friction=0.1, friction=0.9, slip_time_s=0.6
    )
    keeper = Keeper()
    for sample in robot_simulation("quadruped", options).samples(0.9, 1000):
        keeper.keep(sample)
    chance = np.random.default_rng(1)
    for name, traces in keeper.traces().items():
        legs = read_leg(traces.leg, 1000.0, chance)
        (slide,) = (each for each in slides_of(traces) if each.begin_s > CLOCK_START_S + 0.55)
        recording = LabelledRecording(
            mount="body",
            samples=[],
            touchdowns_s=(),
            liftoffs_s=(),
            slides=(slide,),
            legs=legs,
            poses=read_pose(traces.pose, 1000.0, legs, chance),
            twists=read_body(traces.twist, 1000.0, chance),
            leg=leg_of_robot("quadruped", name),
        )
        reported_s = [
            at_s for at_s in detected_by_ours(recording, efforts=True, odometry=True)[0]["slip"] if at_s > 1.3
        ]
        assert len(reported_s) == 1
        assert 0.0 < slide.way_at_m(reported_s[0]) < 0.02
        assert detected_by_ours(recording, efforts=True)[0]["slip"] == []
