"""Conversions: what a message says is what the simulation had, in SI, in the right frame, at the right time."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest
import yaml
from builtin_interfaces.msg import Duration, Time
from geometry_msgs.msg import WrenchStamped
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import FluidPressure, Imu
from std_msgs.msg import Float32, Header
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from jammkle_common import names
from jammkle_common.parameters import ParameterError
from jammkle_msgs.msg import TendonState
from jammkle_sim.conversions import (
    BadCommandError,
    NotFiniteError,
    OutgoingMessages,
    duty_from,
    joint_course,
    parameters_message,
    time_message,
)
from jammkle_sim.kinds import make_simulation
from jammkle_sim.parameters import SimParameters
from jammkle_sim.physics.engine import mujoco
from jammkle_sim.physics.sensors import SensorParameters, imu_variance
from jammkle_sim.rigs.simulation import ImuSample, TendonSample
from jammkle_sim.robots.catalogue import robot
from jammkle_sim.robots.options import RobotOptions
from jammkle_sim.robots.robot import FollowingControl

if TYPE_CHECKING:
    from collections.abc import Sequence

FINITE = st.floats(-1e6, 1e6)
VECTOR = st.tuples(FINITE, FINITE, FINITE)
BAD = [math.nan, math.inf, -math.inf]
TIME_NS = st.integers(0, 2**31 * 10**9 - 1)


def tendons(tension_n: float, broken: str = "") -> tuple[TendonSample, ...]:
    """All four tendons alike, apart from one that may be broken."""
    return tuple(TendonSample(name, -0.001, 0.5, tension_n, name == broken) for name in names.TENDONS)


@given(TIME_NS)
def test_stamps_are_exact(time_ns: int) -> None:
    """A stamp holds every nanosecond of the simulated time, in /clock and in headers."""
    messages = OutgoingMessages()
    imu = deserialize_message(messages.imu(time_ns, ImuSample((0.0, 0.0, 9.81), (0.0, 0.0, 0.0))), Imu)
    for stamp in (time_message(time_ns), messages.clock(time_ns).clock, imu.header.stamp):
        assert stamp.sec * 10**9 + stamp.nanosec == time_ns


@given(VECTOR, VECTOR)
def test_the_imu_follows_rep_145(force: tuple[float, float, float], rate: tuple[float, float, float]) -> None:
    """Specific force and angular velocity as they are, in the IMU's frame; no orientation, and it says so."""
    message = deserialize_message(OutgoingMessages().imu(0, ImuSample(force, rate)), Imu)
    vectors = [message.linear_acceleration, message.angular_velocity]
    assert [(v.x, v.y, v.z) for v in vectors] == [force, rate]
    assert message.header.frame_id == names.IMU_FRAME
    assert message.orientation == Imu().orientation
    assert message.orientation_covariance.tolist() == [-1.0, *[0.0] * 8]
    for covariance, variance in zip(
        (message.linear_acceleration_covariance, message.angular_velocity_covariance),
        imu_variance(SensorParameters()),
        strict=True,
    ):
        assert (covariance.reshape(3, 3) == variance * np.eye(3)).all()


@given(TIME_NS, st.floats(0.0, 2e5))
def test_pressures_are_absolute(time_ns: int, pressure_pa: float) -> None:
    """A pressure leaves as it is, absolute, Pa, in the frame of its place, with the variance of its noise."""
    for place in (names.MANIFOLD_FRAME, "achilles"):
        data = OutgoingMessages(namespace="/lf_ankle").pressure(time_ns, pressure_pa, place)
        header = Header(stamp=time_message(time_ns), frame_id=f"lf_ankle/{place}")
        variance = SensorParameters().pressure_noise_pa ** 2
        expected = FluidPressure(header=header, fluid_pressure=pressure_pa, variance=variance)
        assert deserialize_message(data, FluidPressure) == expected


def test_joints_keep_name_position_and_rate_together() -> None:
    """The three lists belong together, also if the rates come in another order."""
    message = OutgoingMessages().joint_states(0, {"a": 1.0, "b": 2.0}, {"b": 20.0, "a": 10.0})
    rows = zip(message.name, message.position, message.velocity, strict=True)
    assert list(rows) == [("a", 1.0, 10.0), ("b", 2.0, 20.0)]


def test_tendons_carry_their_condition() -> None:
    """Every tendon in the graph's order, whole or broken, never unknown."""
    message = OutgoingMessages().tendon_states(0, tendons(3.0, broken="achilles_left"))
    assert [tendon.name for tendon in message.tendons] == list(names.TENDONS)
    broken = [tendon.name for tendon in message.tendons if tendon.condition == TendonState.BROKEN]
    assert broken == ["achilles_left"]
    assert {tendon.condition for tendon in message.tendons} == {TendonState.INTACT, TendonState.BROKEN}
    first = message.tendons[0]
    assert (first.extension_m, first.extension_rate_m_s, first.tension_n) == (-0.001, 0.5, 3.0)


def test_the_load_cell_keeps_its_sign() -> None:
    """Tension stays positive on z, in the frame of the cell."""
    message = deserialize_message(OutgoingMessages().wrench(0, (1.0, -2.0, 17.7)), WrenchStamped)
    assert (message.wrench.force.x, message.wrench.force.y, message.wrench.force.z) == (1.0, -2.0, 17.7)
    assert message.wrench.torque == WrenchStamped().wrench.torque
    assert message.header.frame_id == names.LOAD_CELL_FRAME


@pytest.mark.parametrize("bad", BAD)
def test_what_is_not_finite_does_not_leave(bad: float) -> None:
    """NaN and infinity are refused by every message, and the error names what gave them."""
    messages = OutgoingMessages()
    attempts = [
        ("IMU", lambda: messages.imu(0, ImuSample((0.0, bad, 0.0), (0.0, 0.0, 0.0)))),
        ("pressure", lambda: messages.pressure(0, bad, names.MANIFOLD_FRAME)),
        ("joint", lambda: messages.joint_states(0, {"a": 0.0}, {"a": bad})),
        ("tendon 'peroneal_left'", lambda: messages.tendon_states(0, tendons(bad))),
        ("load cell", lambda: messages.wrench(0, (0.0, 0.0, bad))),
    ]
    for what, attempt in attempts:
        with pytest.raises(NotFiniteError, match=what):
            attempt()


@given(st.floats(width=32, allow_nan=True))
def test_a_duty_is_taken_or_refused_with_its_limit(value: float) -> None:
    """0 to 1 is taken as it is; everything else, NaN included, is refused with value and limit."""
    message = Float32(data=value)
    if 0.0 <= value <= 1.0:
        assert duty_from(message) == value
    else:
        with pytest.raises(BadCommandError, match=r"pump/duty is .* must be 0 to 1"):
            duty_from(message)


def trajectory(stamp_s: int) -> JointTrajectory:
    """One second to half a radian, from its stamp on."""
    point = JointTrajectoryPoint(positions=[0.5], time_from_start=Duration(sec=1))
    return JointTrajectory(header=Header(stamp=Time(sec=stamp_s)), joint_names=["hip"], points=[point])


def test_a_trajectory_begins_at_its_stamp_however_late_it_comes() -> None:
    """The joint stays until the stamp and is halfway half a second later; without a stamp it begins at once.

    Simulated time is 10 s ahead of the run's. A run that starts anew begins the trajectory with its first command.
    """
    leg = robot("leg", RobotOptions(behaviour="hang"))

    def hips_rad(stamp_s: int, came_s: float, times_s: Sequence[float]) -> list[float]:
        control, data = FollowingControl(leg.model, leg.control), mujoco.MjData(leg.model)
        data.actuator("hip").ctrl[0] = 0.1
        control.follow(joint_course(trajectory(stamp_s), run_began_s=10.0, now_s=came_s))
        found = []
        for time_s in times_s:
            control.command(time_s, data)
            found.append(float(data.actuator("hip").ctrl[0]))
        return found

    assert hips_rad(12, 1.5, [1.6, 2.0, 2.5, 3.0, 4.0]) == pytest.approx([0.1, 0.1, 0.3, 0.5, 0.5])
    assert hips_rad(12, 2.25, [2.5, 3.0]) == pytest.approx([0.3, 0.5])
    assert hips_rad(0, 1.5, [1.6, 2.1, 2.6]) == pytest.approx([0.1, 0.3, 0.5])
    assert hips_rad(12, 1.5, [2.5, 0.0, 0.5, 1.0]) == pytest.approx([0.3, 0.3, 0.4, 0.5])


def test_joints_that_a_later_trajectory_does_not_name_go_on_with_theirs() -> None:
    """The hip alone is asked anew, the knee ends where it was sent; empty ends both."""
    leg = robot("leg", RobotOptions(behaviour="hang"))
    control, data = FollowingControl(leg.model, leg.control), mujoco.MjData(leg.model)

    def asked_rad(time_s: float) -> list[float]:
        control.command(time_s, data)
        return [float(data.actuator(joint).ctrl[0]) for joint in ("hip", "knee")]

    def send(hips_and_knees_rad: dict[str, float], now_s: float) -> None:
        points = [JointTrajectoryPoint(positions=[*hips_and_knees_rad.values()], time_from_start=Duration(sec=1))]
        message = JointTrajectory(joint_names=[*hips_and_knees_rad], points=points if hips_and_knees_rad else [])
        control.follow(joint_course(message, run_began_s=0.0, now_s=now_s))

    own_rad = asked_rad(0.0)
    send({"knee": own_rad[1] + 0.2, "hip": own_rad[0] + 0.4}, 0.0)
    assert asked_rad(0.0) == pytest.approx(own_rad)
    assert asked_rad(0.5) == pytest.approx([own_rad[0] + 0.2, own_rad[1] + 0.1])
    send({"hip": own_rad[0]}, 0.5)
    assert asked_rad(0.5) == pytest.approx([own_rad[0] + 0.2, own_rad[1] + 0.1])
    assert asked_rad(1.0) == pytest.approx([own_rad[0] + 0.1, own_rad[1] + 0.2])
    assert asked_rad(2.0) == pytest.approx([own_rad[0], own_rad[1] + 0.2])
    send({}, 2.0)
    assert asked_rad(2.1) == pytest.approx(own_rad)


@pytest.mark.parametrize("stamp_s", [5, 1_700_000_000])
def test_a_trajectory_of_another_clock_is_refused(stamp_s: int) -> None:
    """One that is over, or begins in fifty years, says how far off it is and how to stamp it."""
    with pytest.raises(BadCommandError, match=r"begins .* s from now, .* stamp it by /clock, or with zero"):
        joint_course(trajectory(stamp_s), run_began_s=0.0, now_s=10.0)


@pytest.mark.parametrize(
    ("joints", "positions", "said"),
    [
        (["hip"], [float("nan")], r"point 0 of joint_trajectory is at \[nan\]; positions must be finite"),
        (["hip"], [0.1, 0.2], "has 2 positions; it must have 1"),
        (["hip"], [100.0], r"joint 'hip' shall go from 100 to 100 rad; it must stay within"),
        (["hip", "hip"], [0.1, 0.2], "joint 'hip' is named twice"),
        (["ankle/achilles_left"], [5.0], "joint 'ankle/achilles_left' has no servo; this robot's are: hip, knee$"),
    ],
)
def test_a_trajectory_that_cannot_be_followed_is_refused(joints: list[str], positions: list[float], said: str) -> None:
    """Angles that are none, or in degrees; a joint twice; a tendon, which is no joint."""
    leg = robot("leg", RobotOptions(behaviour="hang"))
    point = JointTrajectoryPoint(positions=positions, time_from_start=Duration(sec=1))
    asked = JointTrajectory(joint_names=joints, points=[point])
    with pytest.raises((BadCommandError, ParameterError), match=said):
        FollowingControl(leg.model, leg.control).follow(joint_course(asked, run_began_s=0.0, now_s=0.0))


def test_sim_parameters_are_yaml_that_reads_back() -> None:
    """A bag's reader gets every parameter of the rig back from the text."""
    description = yaml.safe_load(parameters_message(make_simulation(SimParameters(seed=7)).machine.description()).data)
    assert description["rig"] == "landing"
    assert description["options"]["seed"] == 7
