"""Measurements as bytes are what rclpy makes of the same message, in both directions."""

from __future__ import annotations

import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Vector3, Wrench, WrenchStamped
from rclpy.serialization import deserialize_message, serialize_message
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import FluidPressure, Imu
from std_msgs.msg import Header

from jammkle_common import wire

FRAMES = ("", "a", "imu", "lf_ankle/imu", "lf_ankle/manifold", "a_very_long_name/of_an_ankle/imu", "fuß")
"""Of every length of padding before the first double."""


def _imu(frame_id: str) -> tuple[Imu, list[float]]:
    values = [0.25 * index - 3.0 for index in range(wire.IMU_DOUBLES)]
    message = Imu(header=Header(frame_id=frame_id, stamp=Time(sec=1795413038, nanosec=123456789)))
    turn = message.orientation
    turn.x, turn.y, turn.z, turn.w = values[:4]
    message.orientation_covariance[:] = values[wire.IMU_ORIENTATION_COVARIANCE]
    rate, force = message.angular_velocity, message.linear_acceleration
    rate.x, rate.y, rate.z = values[wire.IMU_RATE]
    message.angular_velocity_covariance[:] = values[wire.IMU_RATE_COVARIANCE]
    force.x, force.y, force.z = values[wire.IMU_FORCE]
    message.linear_acceleration_covariance[:] = values[wire.IMU_FORCE_COVARIANCE]
    return message, values


@pytest.mark.parametrize("frame_id", FRAMES)
def test_an_imu_is_read_and_written_as_rclpy_does(frame_id: str) -> None:
    message, values = _imu(frame_id)
    time_ns = 1795413038_123456789
    assert wire.read(serialize_message(message), wire.IMU_DOUBLES) == (time_ns, frame_id, tuple(values))
    assert deserialize_message(wire.Writer(frame_id, wire.IMU_DOUBLES).write(time_ns, values), Imu) == message


@pytest.mark.parametrize("frame_id", FRAMES)
def test_a_pressure_is_read_and_written_as_rclpy_does(frame_id: str) -> None:
    header = Header(frame_id=frame_id, stamp=Time(sec=-1, nanosec=999999999))
    message = FluidPressure(header=header, fluid_pressure=61325.5, variance=4.0)
    assert wire.read(serialize_message(message), wire.PRESSURE_DOUBLES) == (-1, frame_id, (61325.5, 4.0))
    assert (
        deserialize_message(wire.Writer(frame_id, wire.PRESSURE_DOUBLES).write(-1, (61325.5, 4.0)), FluidPressure)
        == message
    )


@pytest.mark.parametrize("frame_id", FRAMES)
def test_a_header_alone_is_read_and_written_as_rclpy_does(frame_id: str) -> None:
    serialized = serialize_message(Header(frame_id=frame_id, stamp=Time(sec=7, nanosec=5)))
    assert wire.read(serialized, 0) == (7_000_000_005, frame_id, ())
    assert wire.Writer(frame_id, 0).write(7_000_000_005) == serialized


def test_a_force_is_read_as_rclpy_does() -> None:
    wrench = Wrench(force=Vector3(x=1.0, y=2.0, z=-40.5), torque=Vector3(x=3.0, y=4.0, z=5.0))
    message = WrenchStamped(header=Header(frame_id="load_cell", stamp=Time(sec=2, nanosec=1)), wrench=wrench)
    measured = wire.read(serialize_message(message), wire.WRENCH_DOUBLES)
    assert measured == (2_000_000_001, "load_cell", (1.0, 2.0, -40.5, 3.0, 4.0, 5.0))
    assert measured.values[wire.WRENCH_FORCE_Z] == message.wrench.force.z


def test_a_clock_is_read_as_rclpy_does() -> None:
    serialized = serialize_message(Clock(clock=Time(sec=-7, nanosec=999999999)))
    assert wire.read_clock(serialized) == (-7, 999999999)
    for other in (b"\x00\x00" + serialized[2:], serialized[:11], b""):
        assert wire.read_clock(other) is None


def test_a_writer_keeps_nothing_of_what_it_wrote_before() -> None:
    writer = wire.Writer("imu", wire.PRESSURE_DOUBLES)
    first = writer.write(1, (1.0, 2.0))
    second = writer.write(2, (3.0, 4.0))
    assert wire.read(first, wire.PRESSURE_DOUBLES) == (1, "imu", (1.0, 2.0))
    assert wire.read(second, wire.PRESSURE_DOUBLES) == (2, "imu", (3.0, 4.0))


def test_what_is_written_in_another_way_is_left_to_rclpy() -> None:
    serialized = serialize_message(FluidPressure(header=Header(frame_id="imu")))
    big_endian = b"\x00\x00" + serialized[2:]
    for other in (big_endian, b"", serialized[:10], serialized[:-1], b"\x00\x01" + b"\xff" * 30):
        assert wire.read(other, wire.PRESSURE_DOUBLES) is None
