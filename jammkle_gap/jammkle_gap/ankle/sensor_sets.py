"""Which sensors a diagnosis may use: those that a robot has, those of a rig, those of instrumented tendons."""

from __future__ import annotations

import dataclasses
import enum
from typing import TYPE_CHECKING

from jammkle_gap.ankle.instruments import EXTENSION, FORCE, SLIDE, TENSION, quantity_of
from jammkle_gap.november.recording import BadRecordingError

if TYPE_CHECKING:
    from jammkle_gap.november.recording import Recording


class SensorSet(enum.Enum):
    """Sets of sensors, each with those of the one before. Commands and driven motion are inputs in all of them."""

    ROBOT = "robot"
    """Pressures, IMU, angles of the ankle."""
    RIG = "rig"
    """And the load cell, and the carriage where it is not driven."""
    INSTRUMENTED = "instrumented"
    """And tension and extension of every tendon, which a simulator knows and no robot measures."""


_ADDED = {
    FORCE: SensorSet.RIG,
    SLIDE: SensorSet.RIG,
    TENSION: SensorSet.INSTRUMENTED,
    EXTENSION: SensorSet.INSTRUMENTED,
}
"""Set from which on a quantity is used; those not named are in all."""
_ORDER = tuple(SensorSet)


def set_of(signal: str) -> SensorSet:
    """Return the smallest set that a signal, by its name, is in."""
    return _ADDED.get(quantity_of(signal), SensorSet.ROBOT)


def selected(recording: Recording, sensors: SensorSet) -> Recording:
    """Return a recording with the signals of a set alone; its inputs stay.

    Raises:
        BadRecordingError: it has none of them.

    """
    allowed = _ORDER[: _ORDER.index(sensors) + 1]
    signals = tuple(signal for signal in recording.signals if set_of(signal.name) in allowed)
    if not signals:
        own = sorted({set_of(signal.name).value for signal in recording.signals})
        msg = f"recording {recording.name} has no signal of the sensor set '{sensors.value}', only of {', '.join(own)}"
        msg += "; record pressures, imu/data and joint_states, or use a larger set"
        raise BadRecordingError(msg)
    return dataclasses.replace(recording, signals=signals)


def headline_set(recording: Recording) -> SensorSet:
    """Return the set that a diagnosis uses unless asked otherwise: that of a rig where its load cell was recorded."""
    has_cell = any(quantity_of(signal.name) == FORCE for signal in recording.signals)
    return SensorSet.RIG if has_cell else SensorSet.ROBOT
