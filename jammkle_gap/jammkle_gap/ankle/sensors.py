"""Sensors of an ankle: units, scatter when nothing is wrong, and which of them a diagnosis may use.

Noise of pressure, load cell and IMU is that of the simulated sensors (`physics.sensors`). The others are assumed.
"""

from __future__ import annotations

import dataclasses
import enum
import math
from typing import TYPE_CHECKING

import numpy as np

from jammkle_common import names
from jammkle_common.names import CARRIAGE_JOINT
from jammkle_gap.core.data import BadRecordingError
from jammkle_sim.physics.sensors import SensorParameters, imu_law

if TYPE_CHECKING:
    from collections.abc import Container, Iterable

    from jammkle_gap.core.data import Recording
    from jammkle_sim.rigs.rig import Rig

_HALF_RISE = 1.678
"""Time, in time constants, at which two equal poles have come half way: `1 - (1 + t) exp(-t) = 1 / 2`."""
_TENSION_N = 0.05
"""Standard deviation of a tendon's tension. Assumed: as of the load cell."""

PRESSURE, ANGLE, SLIDE, EXTENSION, TENSION, FORCE, ACCELERATION, RATE = (
    "pressure",
    "angle",
    "slide",
    "extension",
    "tension",
    "force",
    "acceleration",
    "rate",
)
UNITS = {
    PRESSURE: "Pa",
    ANGLE: "rad",
    SLIDE: "m",
    EXTENSION: "m",
    TENSION: "N",
    FORCE: "N",
    ACCELERATION: "m/s^2",
    RATE: "rad/s",
}
"""Unit by quantity."""
RESOLUTION = {ANGLE: 2.0 * math.pi / 4096, SLIDE: 5e-5, EXTENSION: 5e-5}
"""Smallest step by quantity, in its unit. Assumed: 12-bit encoders, and linear scales of 0.05 mm.

Of angles it stands in for the error of the simulator's tendons too: with the finer step that readings may show, no more
causes are found."""


def quantity_of(signal: str) -> str:
    """Return what a signal measures, by its name."""
    column = signal.rpartition("/")[2]
    if column == "position":
        return SLIDE if signal.startswith(CARRIAGE_JOINT) else ANGLE
    if column.startswith("force"):
        return FORCE
    if column.startswith("specific_force"):
        return ACCELERATION
    if column.startswith("angular_velocity"):
        return RATE
    return column


def declared_noise(rig: Rig, timestep_s: float) -> dict[str, float]:
    """Return the standard deviation from reading to reading by quantity, SI.

    Args:
        rig: Its sensors.
        timestep_s: Of its simulation, s.

    """
    sensors: SensorParameters = rig.sensors
    law = imu_law(sensors, timestep_s)[0]
    passed = _noise_gain(float(law["smoothing"]))
    return {
        PRESSURE: sensors.pressure_noise_pa,
        ANGLE: 0.0,
        SLIDE: 0.0,
        EXTENSION: 0.0,
        TENSION: _TENSION_N,
        FORCE: sensors.load_cell_noise_n,
        ACCELERATION: passed * float(law["noise"][0]),
        RATE: passed * float(law["noise"][3]),
    }


def declared_bias(rig: Rig) -> dict[str, float]:
    """Return the standard deviation of a sensor's constant offset by quantity, SI; those not named have none."""
    return {PRESSURE: rig.sensors.pressure_offset_pa}


def half_rise_s(rig: Rig) -> float:
    """Return how long the IMU's filter, of two equal poles, takes to come half way to a step, s."""
    timestep_s = float(rig.model.opt.timestep)
    pole_s = -timestep_s / math.log1p(-float(imu_law(rig.sensors, timestep_s)["smoothing"][0]))
    return _HALF_RISE * pole_s


def _noise_gain(smoothing: float) -> float:
    """Return how much of white noise two equal poles let through."""
    taps = np.arange(400)
    response = smoothing**2 * (taps + 1) * (1.0 - smoothing) ** taps
    return float(np.sqrt((response**2).sum()))


class SensorSet(enum.Enum):
    """Sets of sensors, each with those of the one before. Commands and driven motion are inputs in all of them."""

    ROBOT = "robot"
    """Pressures, IMU, angles of the ankle."""
    RIG = "rig"
    """And the load cell, and the carriage where it is not driven."""
    INSTRUMENTED = "instrumented"
    """And tension and extension of every tendon, which a simulator knows and no robot measures."""

    def __lt__(self, other: SensorSet) -> bool:
        """Return whether the other set has more sensors."""
        order = tuple(SensorSet)
        return order.index(self) < order.index(other)


_ADDED = {
    FORCE: SensorSet.RIG,
    SLIDE: SensorSet.RIG,
    TENSION: SensorSet.INSTRUMENTED,
    EXTENSION: SensorSet.INSTRUMENTED,
}
"""Set from which on a quantity is used; those not named are in all."""


def set_of(signal: str) -> SensorSet:
    """Return the smallest set that a signal, by its name, is in."""
    return _ADDED.get(quantity_of(signal), SensorSet.ROBOT)


def selected(recording: Recording, sensors: SensorSet) -> Recording:
    """Return a recording with the signals of a set alone; its inputs stay.

    Raises:
        BadRecordingError: it has none of them.

    """
    signals = tuple(signal for signal in recording.signals if not sensors < set_of(signal.name))
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


def largest_set(recordings: Iterable[Recording]) -> SensorSet:
    """Return the smallest set that has every signal of recordings."""
    return max((set_of(signal.name) for each in recordings for signal in each.signals), default=SensorSet.ROBOT)


def pressure_signals(present: Container[str]) -> dict[str, str]:
    """Return the pressure signals that are there, by channel, and `manifold`."""
    sources = {"manifold": names.MANIFOLD_PRESSURE.name, **{c: t.name for c, t in names.PRESSURES.items()}}
    return {where: name for where, name in sources.items() if name in present}
