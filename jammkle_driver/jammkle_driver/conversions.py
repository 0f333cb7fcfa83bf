"""Every change of unit and sign in the driver, and the reading and building of its messages.

Inside: vacuum below ambient, Pa, gauge, positive; time in s. `sensor_msgs/FluidPressure` is absolute.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from sensor_msgs.msg import FluidPressure

from jammkle_common.constants import NANOSECONDS_PER_SECOND
from jammkle_driver.core.hardware import PressureSample
from jammkle_driver.core.requests import SetPoint
from jammkle_msgs.msg import ActuatorStates, ChannelJamState, Fault, JamCommand, JamState

if TYPE_CHECKING:
    import rclpy.time
    from builtin_interfaces.msg import Time

    from jammkle_common import wire
    from jammkle_driver.core.driver import Driver
    from jammkle_driver.core.hardware import ActuatorCommand


def seconds(time: rclpy.time.Time) -> float:
    """Return a clock's reading in s."""
    return float(time.nanoseconds / NANOSECONDS_PER_SECOND)


def stamp_seconds(stamp: Time) -> float:
    """Return a header's stamp in s, to the bit that of a clock that reads the same; 0 if it was not stamped."""
    return float((stamp.sec * NANOSECONDS_PER_SECOND + stamp.nanosec) / NANOSECONDS_PER_SECOND)


def pressure_sample(place: str, message: FluidPressure, received_s: float) -> PressureSample:
    """Return the reading in `message`; one without a stamp gets `received_s`, the graph's time of arrival, s."""
    return PressureSample(place, message.fluid_pressure, stamp_seconds(message.header.stamp) or received_s)


def measured_pressure(place: str, measured: wire.Measured) -> PressureSample:
    """Return the reading in a stamped message that was read from its bytes."""
    return PressureSample(place, measured.values[0], measured.time_ns / NANOSECONDS_PER_SECOND)


def pressure_message(absolute_pa: float, stamp: Time, frame_id: str) -> FluidPressure:
    """Return the message for one pressure, absolute, Pa, in a frame; its variance is not known."""
    message = FluidPressure(fluid_pressure=absolute_pa)
    message.header.frame_id = frame_id
    message.header.stamp = stamp
    return message


def actuator_states_message(taken: ActuatorCommand, stamp: Time) -> ActuatorStates:
    """Return what the hardware has taken as a message."""
    message = ActuatorStates(
        pump_duty=taken.pump_duty, channels=list(taken.solenoids), energised=list(taken.solenoids.values())
    )
    message.header.stamp = stamp
    return message


def set_points(message: JamCommand) -> tuple[SetPoint, ...]:
    """Return the set points in `message`, unchecked."""
    return tuple(SetPoint(entry.channel, entry.vacuum_pa) for entry in message.channels)


def jam_state_message(driver: Driver, stamp: Time, refused_command: str = "") -> JamState:
    """Return what is known of the channels as a message; what is not measured is NaN."""
    ankle, trouble, parameters = driver.ankle, driver.trouble, driver.parameters
    message = JamState()
    message.header.stamp = stamp
    message.emergency_stopped = bool(driver.stop.reason)
    message.manifold_vacuum_pa = _or_nan(ankle.manifold_vacuum_pa)
    message.channels = [
        ChannelJamState(
            channel=channel.name,
            state=channel.state.value,
            commanded_vacuum_pa=channel.set_point_pa,
            measured_vacuum_pa=_or_nan(channel.vacuum_pa),
            reason=channel.why.text,
            fault=channel.why.reason.value,
        )
        for channel in ankle.channels.values()
    ]
    message.fault = Fault(reason=trouble.why.reason.value, text=trouble.why.text, action=trouble.action)
    message.min_vacuum_pa, message.max_vacuum_pa = parameters.min_vacuum_pa, parameters.max_vacuum_pa
    message.refused_command = refused_command
    message.reservoir_volume_m3 = parameters.reservoir_volume_m3
    return message


def _or_nan(value: float | None) -> float:
    return math.nan if value is None else value
