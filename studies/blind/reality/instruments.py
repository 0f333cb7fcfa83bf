"""Sensors, clocks and recorder of one specimen. Words for where a number comes from as in `machine`."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

from jammkle_common.names import CHANNELS


@dataclass(frozen=True)
class Sensor:
    """A channel of measurement."""

    white: float
    """Standard deviation of the noise that has no memory."""
    slow: float
    """Standard deviation of the noise that has."""
    memory_s: float
    """How long it has."""
    step: float
    """Smallest step of the converter."""
    lag_s: float = 0.0
    """First-order lag before the converter."""
    delay_s: float = 0.0
    """From the quantity to the reading."""
    gain: float = 1.0
    offset: float = 0.0
    limit: float = math.inf
    """Largest reading, both ways."""


@dataclass(frozen=True)
class Imu:
    """Accelerometer and gyro."""

    acceleration: Sensor = Sensor(0.012, 0.004, 0.05, 0.0024, limit=71.02 + 9.80665)
    """Noise: declared 80 ug/rtHz over 225 Hz. Range: paper. 16 bits of 8 g."""
    rate: Sensor = Sensor(0.0013, 0.0004, 0.05, 0.00053, limit=math.radians(900.0))
    """Noise: declared 0.005 deg/s/rtHz. Range: declared."""
    bandwidth_hz: float = 225.0
    """Declared. Here a Butterworth filter of the second order."""
    offset_m_s2: tuple[float, float, float] = (0.0, 0.0, 0.0)
    offset_rad_s: tuple[float, float, float] = (0.0, 0.0, 0.0)
    turn_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """How it sits on its mount: roll, then pitch, then yaw, about the mount's axes."""
    clip: float = 1.0
    """Factor on the range of the accelerometer."""
    delay_s: float = 0.0


@dataclass(frozen=True)
class Clock:
    """Stamps and the recorder."""

    skew: float = 0.0
    """How much faster the sensors' clock runs than the recorder's."""
    sample_jitter_s: float = 6e-5
    """Standard deviation of the moment of a sample. Assumed."""
    stamp_jitter_s: float = 2e-5
    """Standard deviation of its stamp. Assumed."""
    log_s: float = 0.0012
    """Shortest time from stamp to log. Assumed."""
    log_jitter_s: float = 0.0009
    """Mean of the exponential delay on top. Assumed."""
    dropped: float = 0.002
    """Share of the samples that are lost. Assumed."""
    command_delay_s: float = 0.0008
    """From a command to the coil. Assumed."""


@dataclass(frozen=True)
class Sensors:
    """All of them."""

    pressure: tuple[Sensor, ...] = (Sensor(40.0, 30.0, 0.03, 12.0, lag_s=0.0015),) * (1 + len(CHANNELS))
    """Manifold, then CHANNELS, Pa. Noise: declared 50 Pa."""
    load_cell: Sensor = Sensor(0.04, 0.03, 0.02, 0.015, lag_s=0.0012, limit=245.0)
    """Noise: declared 0.05 N. Range: paper. 15 bits."""
    tension: Sensor = Sensor(0.05, 0.03, 0.02, 0.02, lag_s=0.0012)
    """Gauge in the end plate of an instrumented tendon, N. Assumed: as the load cell."""
    extension: Sensor = Sensor(4e-6, 2e-6, 0.05, 2e-6)
    """Of a tendon, m. Assumed: a small linear encoder."""
    slide: Sensor = Sensor(3e-6, 1e-6, 0.05, 2.5e-6)
    """Crosshead or carriage, m. Assumed: a linear encoder."""
    angle: Sensor = Sensor(1.5e-4, 1e-4, 0.05, 2.0 * math.pi / 2**14)
    """Of a joint, rad. Assumed: 14 bits."""
    imu: Imu = dataclasses.field(default_factory=Imu)
    clock: Clock = dataclasses.field(default_factory=Clock)
    spikes_hz: float = 0.0
    """Electrical spikes on the load cell per second."""
    spike_n: float = 0.0
    """Size of a spike, N."""
    cell_creep: float = 0.0
    """Share by which the load cell reads on under a load that stays."""
    cell_creep_s: float = 2.0
    """Time in which it does."""
