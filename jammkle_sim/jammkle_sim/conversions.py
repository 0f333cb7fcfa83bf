"""Between the simulation's values and ROS messages: stamps, units, frames, and checks at the border.

Outgoing messages are made once and filled again for every publication: rclpy copies a message while it publishes,
so nobody sees the next contents too early, and filling costs a tenth of making. Those that are most of what is said,
IMU, pressures and load cell, are made as bytes at once. All values are SI on both sides.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import yaml

from jammkle_common import wire
from jammkle_common.constants import NANOSECONDS_PER_SECOND
from jammkle_common.messages import message_class
from jammkle_common.names import BASE_FRAME, FOOT_FRAME, IMU_FRAME, LOAD_CELL_FRAME, ODOM_FRAME, TENDONS, frame
from jammkle_sim.physics.sensors import SensorParameters, imu_variance
from jammkle_sim.robots.robot import JointCourse

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from builtin_interfaces.msg import Duration
    from std_msgs.msg import Float32
    from trajectory_msgs.msg import JointTrajectory

    from jammkle_sim.rigs.simulation import BaseSample, FootTruth, ImuSample, TendonSample

# Those of ROS for the node; a rig without the graph fills the same where no ROS is installed.
ActuatorStates = message_class("jammkle_msgs/msg/ActuatorStates")
Clock = message_class("rosgraph_msgs/msg/Clock")
Header = message_class("std_msgs/msg/Header")
JointState = message_class("sensor_msgs/msg/JointState")
Odometry = message_class("nav_msgs/msg/Odometry")
String = message_class("std_msgs/msg/String")
TendonState = message_class("jammkle_msgs/msg/TendonState")
TendonStates = message_class("jammkle_msgs/msg/TendonStates")
Time = message_class("builtin_interfaces/msg/Time")
TrueContact = message_class("jammkle_msgs/msg/TrueContact")

_NO_ORIENTATION = -1.0
"""REP-145 and sensor_msgs/Imu: the first element of a covariance that belongs to nothing measured."""

_DIAGONAL = (0, 4, 8)
_TRAJECTORY_AHEAD_S = 60.0
"""How far ahead a trajectory may be stamped, s: beyond it the stamp is taken for one of another clock."""


class NotFiniteError(ArithmeticError):
    """The simulation gave NaN or infinity, which must not leave it. The message names the output."""


class BadCommandError(ValueError):
    """A command that cannot be followed. The message names topic, value and limit."""


class OutgoingMessages:
    """The messages that the sim node publishes at a rate, each made once and filled again and again."""

    def __init__(self, tendons: Sequence[str] = TENDONS, namespace: str = "/") -> None:
        """Make the messages, tendon_states for these tendons, with frames of an ankle in a namespace."""
        self._namespace = namespace
        self._clock = Clock()
        sensors = SensorParameters()  # what the data sheet of a sensor states, whatever is wrong with this one
        self._imu = wire.Writer(frame(namespace, IMU_FRAME), wire.IMU_DOUBLES)
        self._imu_values = _imu_values(sensors)
        self._pressure_variance_pa2 = sensors.pressure_noise_pa**2
        self._pressures: dict[str, wire.Writer] = {}
        self._wrench = wire.Writer(frame(namespace, LOAD_CELL_FRAME), wire.WRENCH_DOUBLES)
        self._joints = JointState()
        self._tendons = TendonStates(tendons=[TendonState(name=name) for name in tendons])
        self._odometry = Odometry(
            header=Header(frame_id=frame(namespace, ODOM_FRAME)), child_frame_id=frame(namespace, BASE_FRAME)
        )
        self._contact = TrueContact(header=Header(frame_id=frame(namespace, FOOT_FRAME)))

    def clock(self, time_ns: int) -> Clock:
        """Return the tick of a simulated time, ns."""
        return _stamped(self._clock, self._clock.clock, time_ns)

    def imu(self, time_ns: int, sample: ImuSample) -> bytes:
        """Return specific force, m/s^2, and angular velocity, rad/s, in the frame of the IMU (REP-145), serialized."""
        _check_finite("the IMU", (*sample.specific_force_m_s2, *sample.angular_velocity_rad_s))
        self._imu_values[wire.IMU_FORCE] = sample.specific_force_m_s2
        self._imu_values[wire.IMU_RATE] = sample.angular_velocity_rad_s
        return self._imu.write(time_ns, self._imu_values)

    def pressure(self, time_ns: int, pressure_pa: float, place: str) -> bytes:
        """Return one absolute pressure, Pa, in a place: channel or manifold; serialized, with its noise's variance."""
        _check_finite("a pressure", (pressure_pa,))
        if place not in self._pressures:
            self._pressures[place] = wire.Writer(frame(self._namespace, place), wire.PRESSURE_DOUBLES)
        return self._pressures[place].write(time_ns, (pressure_pa, self._pressure_variance_pa2))

    def wrench(self, time_ns: int, force_n: tuple[float, float, float]) -> bytes:
        """Return the force between rig and leg, N, tension positive on z, serialized; the cell measures no torque."""
        _check_finite("the load cell", force_n)
        return self._wrench.write(time_ns, (*force_n, 0.0, 0.0, 0.0))

    def joint_states(
        self,
        time_ns: int,
        positions: Mapping[str, float],
        velocities: Mapping[str, float],
        efforts: Mapping[str, float] | None = None,
    ) -> JointState:
        """Return joint angles, rad, and slides, m, with their rates, and efforts, N m and N, where they are known.

        All mappings have the same names.
        """
        _check_finite("a joint", positions.values())
        _check_finite("a joint's rate", velocities.values())
        _check_finite("a joint's effort", () if efforts is None else efforts.values())
        self._joints.name = list(positions)
        self._joints.position = list(positions.values())
        self._joints.velocity = [velocities[name] for name in positions]
        self._joints.effort = [] if efforts is None else [efforts[name] for name in positions]
        return _stamped(self._joints, self._joints.header.stamp, time_ns)

    def tendon_states(self, time_ns: int, tendons: Sequence[TendonSample]) -> TendonStates:
        """Return extension, m, rate, m/s, and tension, N, of every tendon, in the order given at the start."""
        for message, tendon in zip(self._tendons.tendons, tendons, strict=True):
            _check_finite(f"tendon '{tendon.name}'", (tendon.extension_m, tendon.extension_rate_m_s, tendon.tension_n))
            message.name = tendon.name
            message.condition = TendonState.BROKEN if tendon.broken else TendonState.INTACT
            message.extension_m = tendon.extension_m
            message.extension_rate_m_s = tendon.extension_rate_m_s
            message.tension_n = tendon.tension_n
        return _stamped(self._tendons, self._tendons.header.stamp, time_ns)

    def true_contact(self, time_ns: int, foot: FootTruth) -> TrueContact:
        """Return what the foot truly does on the ground: N, m/s, m."""
        _check_finite("a foot", (foot.normal_force_n, foot.sliding_speed_m_s, foot.sliding_distance_m))
        self._contact.stands = foot.stands
        self._contact.normal_force_n = foot.normal_force_n
        self._contact.sliding_speed_m_s = foot.sliding_speed_m_s
        self._contact.sliding_distance_m = foot.sliding_distance_m
        return _stamped(self._contact, self._contact.header.stamp, time_ns)

    def odometry(self, time_ns: int, base: BaseSample) -> Odometry:
        """Return where the base is, m, and how it moves in its own frame, m/s and rad/s. No covariance: it is true."""
        _check_finite("the base", (*base.position_m, *base.rotation, *base.linear_m_s, *base.angular_rad_s))
        pose, twist = self._odometry.pose.pose, self._odometry.twist.twist
        _fill_vector(pose.position, base.position_m)
        turn = pose.orientation
        turn.w, turn.x, turn.y, turn.z = base.rotation
        _fill_vector(twist.linear, base.linear_m_s)
        _fill_vector(twist.angular, base.angular_rad_s)
        return _stamped(self._odometry, self._odometry.header.stamp, time_ns)


def time_message(time_ns: int) -> Time:
    """Return a simulated time, ns, as a stamp."""
    seconds, nanoseconds = divmod(time_ns, NANOSECONDS_PER_SECOND)
    return Time(sec=seconds, nanosec=nanoseconds)


def actuator_states(
    time_ns: int, duty: float, energised: Mapping[str, bool], restarts: int, *, host_silent: bool, paused: bool
) -> ActuatorStates:
    """Return what pump, 0 to 1, and solenoids, by channel, are commanded from a simulated time, ns, on.

    Args:
        time_ns: Simulated time, ns.
        duty: Of the pump, 0 to 1.
        energised: Per channel.
        restarts: How often the simulated plant was put back to its start.
        host_silent: Whether the simulated board has let go, as no command of the driver came.
        paused: Whether the plant stands still although the clock may go on.

    """
    message = ActuatorStates(pump_duty=duty, channels=list(energised), energised=list(energised.values()))
    message.host_silent = host_silent
    message.plant_restarts = restarts
    message.plant_paused = paused
    message.header.stamp = time_message(time_ns)
    return message


def parameters_message(description: Mapping[str, object]) -> String:
    """Return all parameters of rig and simulation as YAML, for people and for a bag."""
    return String(data=yaml.safe_dump(dict(description), sort_keys=False, allow_unicode=True))


def duty_from(message: Float32) -> float:
    """Return the pump's duty, 0 to 1, from its message.

    Raises:
        BadCommandError: NaN or out of range.

    """
    duty = float(message.data)
    if not 0.0 <= duty <= 1.0:  # false for NaN as well
        msg = f"pump/duty is {duty:g}; it must be 0 to 1; the last good value is kept"
        raise BadCommandError(msg)
    return duty


def joint_course(message: JointTrajectory, run_began_s: float, now_s: float) -> JointCourse | None:
    """Return what a robot's joints are asked to do; None: to do what they do by themselves again.

    As for joint_trajectory_controller, it begins at its stamp, or when it comes where the stamp is zero.

    Args:
        message: The trajectory.
        run_began_s: Time on /clock at which the run began, s.
        now_s: Time of the run, s.

    Raises:
        BadCommandError: a point with another number of positions than there are joints, a time that does not rise, or
            a stamp from which it would be over by now, or begin in more than a minute.

    """
    if not message.joint_names or not message.points:
        return None
    time_s = [_seconds(each.time_from_start) for each in message.points]
    for place, (point, at_s) in enumerate(zip(message.points, time_s, strict=True)):
        if not all(map(math.isfinite, point.positions)):
            msg = f"point {place} of joint_trajectory is at {list(point.positions)}; positions must be finite, in rad"
            raise BadCommandError(msg)
        if len(point.positions) != len(message.joint_names):
            msg = f"point {place} of joint_trajectory has {len(point.positions)} positions"
            msg += f"; it must have {len(message.joint_names)}, one number for each joint"
            raise BadCommandError(msg)
        if at_s <= (time_s[place - 1] if place else 0.0):
            msg = f"point {place} of joint_trajectory is {at_s:g} s from the start; times must be above 0 and rise"
            raise BadCommandError(msg)
    stamp_s = _seconds(message.header.stamp)
    begins_s = stamp_s - run_began_s if stamp_s else None
    if begins_s is not None and not now_s - time_s[-1] <= begins_s <= now_s + _TRAJECTORY_AHEAD_S:
        msg = f"joint_trajectory begins {begins_s - now_s:g} s from now, by its stamp, and lasts {time_s[-1]:g} s"
        msg += f"; it must not be over, and begin within {_TRAJECTORY_AHEAD_S:g} s: stamp it by /clock, or with zero"
        raise BadCommandError(msg)
    angles_rad = np.array([list(point.positions) for point in message.points])
    return JointCourse(tuple(message.joint_names), np.array(time_s), angles_rad, begins_s)


def _seconds(given: Time | Duration) -> float:
    return given.sec + given.nanosec / NANOSECONDS_PER_SECOND


def _imu_values(sensors: SensorParameters) -> list[float]:
    """Return the numbers of a sensor_msgs/Imu in their order; what is measured is still to be filled in."""
    values = [0.0] * wire.IMU_DOUBLES
    values[3] = 1.0  # w of the message's default orientation
    values[wire.IMU_ORIENTATION_COVARIANCE.start] = _NO_ORIENTATION
    acceleration, angular_rate = imu_variance(sensors)
    for covariance, variance in ((wire.IMU_FORCE_COVARIANCE, acceleration), (wire.IMU_RATE_COVARIANCE, angular_rate)):
        for place in _DIAGONAL:
            values[covariance.start + place] = variance
    return values


def _stamped(message, stamp: Time, time_ns: int):  # noqa: ANN001, ANN202 - any message, and the very same back
    stamp.sec, stamp.nanosec = divmod(time_ns, NANOSECONDS_PER_SECOND)
    return message


def _fill_vector(vector, values: tuple[float, float, float]) -> None:  # noqa: ANN001 - geometry_msgs Vector3
    vector.x, vector.y, vector.z = values


def _check_finite(what: str, values: Iterable[float]) -> None:
    # A sum is finite only if every term is; this costs a fifth of asking each.
    if not math.isfinite(sum(values)):
        msg = f"{what} gave a value that is not finite"
        raise NotFiniteError(msg)
