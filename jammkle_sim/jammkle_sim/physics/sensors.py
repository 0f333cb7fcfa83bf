"""What the sensors make of the truth: IMU, pressure sensors, load cell. One seed for all of them.

The IMU's noise is drawn once per time step, before its filter, whether somebody reads it or not; every other sensor's
noise is a function of seed, sensor and step. So readings do not depend on who reads what how often, and a reset brings
the same ones back.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from jammkle_common.constants import STANDARD_GRAVITY_M_S2
from jammkle_sim.physics import records

if TYPE_CHECKING:
    from numpy.typing import NDArray

_TWO_POLE_FACTOR = math.sqrt(math.sqrt(2.0) - 1.0)
"""Cut-off of two equal poles over that of each."""


CLIP_NET_M_S2 = 71.02
"""Largest upward acceleration, net of gravity, that the IMU of the paper's drops gives. Paper."""


@dataclass(frozen=True)
class SensorParameters:
    """Noise, range and bandwidth of the sensors."""

    seed: int = 0
    """Start of all noise."""
    acceleration_limit_m_s2: float = CLIP_NET_M_S2 + STANDARD_GRAVITY_M_S2
    """Range of the accelerometer, raw, per axis: 8.24 g. Paper: where its drops clip, with gravity."""
    acceleration_noise_m_s2_rthz: float = 80e-6 * STANDARD_GRAVITY_M_S2
    """Noise density. Assumed: 80 ug/rtHz, as small industrial IMUs state."""
    angular_rate_limit_rad_s: float = math.radians(900.0)
    """Range of the gyro. Assumed."""
    angular_rate_noise_rad_s_rthz: float = math.radians(0.005)
    """Noise density: 0.005 deg/s/rtHz. Assumed, as for the accelerometer."""
    imu_bandwidth_hz: float = 225.0
    """Frequency at which the IMU's two equal poles have lost 3 dB. Without overshoot, so that a clipped plateau
    stays one. Assumed: the paper names neither filter nor rate."""
    pressure_noise_pa: float = 50.0
    """Standard deviation of each pressure reading. Assumed: 0.05 % of an atmosphere."""
    pressure_offset_pa: float = 150.0
    """Standard deviation, over sensors, of their constant offset. Assumed."""
    load_cell_limit_n: float = 245.0
    """Range of the load cell, per axis, both ways; beyond it the reading stands still. Paper: a cell of 25 kg."""
    load_cell_noise_n: float = 0.05
    """Standard deviation of each axis of a load cell reading. Assumed: 0.02 % of the paper's 245 N cell."""


def imu_variance(parameters: SensorParameters) -> tuple[float, float]:
    """Return the variance of each axis of the IMU by its noise: m^2/s^4 of acceleration, rad^2/s^2 of angular rate.

    White noise behind two equal poles at f has the bandwidth pi/4 f (the integral of 1 / (1 + (x/f)^2)^2 over x).
    """
    bandwidth_hz = math.pi / 4.0 * parameters.imu_bandwidth_hz / _TWO_POLE_FACTOR
    return (
        parameters.acceleration_noise_m_s2_rthz**2 * bandwidth_hz,
        parameters.angular_rate_noise_rad_s_rthz**2 * bandwidth_hz,
    )


def imu_law(parameters: SensorParameters, timestep_s: float) -> NDArray[Any]:
    """Constants of the IMU filter for one time step, shape (1,) of IMU_LAW."""
    law = np.zeros(1, dtype=records.IMU_LAW)
    pole_rad_s = 2.0 * math.pi * parameters.imu_bandwidth_hz / _TWO_POLE_FACTOR
    law["smoothing"] = 1.0 - math.exp(-pole_rad_s * timestep_s)
    to_step = math.sqrt(0.5 / timestep_s)  # white noise up to half the step rate
    law["noise"][:, :3] = parameters.acceleration_noise_m_s2_rthz * to_step
    law["noise"][:, 3:] = parameters.angular_rate_noise_rad_s_rthz * to_step
    law["limit"][:, :3] = parameters.acceleration_limit_m_s2
    law["limit"][:, 3:] = parameters.angular_rate_limit_rad_s
    law["turn"] = np.eye(3)
    return law


class Noise:
    """All random numbers of one simulation."""

    _IMU, _PRESSURE, _OFFSET, _LOAD_CELL = range(4)

    def __init__(self, parameters: SensorParameters) -> None:
        """Start all streams from the seed of the parameters."""
        self._parameters = parameters
        self._imu = self._stream(self._IMU)
        offsets = self._stream(self._OFFSET).standard_normal(records.VOLUMES)
        self._pressure_offset_pa = parameters.pressure_offset_pa * offsets
        self._pressure_step = -1
        self._pressure_error_pa = self._pressure_offset_pa
        self._pressure = _Steps(self._stream(self._PRESSURE))
        self._load_cell = _Steps(self._stream(self._LOAD_CELL))

    def reset(self) -> None:
        """Start all streams again."""
        self._imu = self._stream(self._IMU)

    def imu_white(self, steps: int) -> NDArray[np.float64]:
        """Next standard normal numbers of the IMU, shape (steps, 6)."""
        return self._imu.standard_normal((steps, records.IMU_AXES))

    def pressure_pa(self, step: int) -> NDArray[np.float64]:
        """Error of manifold and channel pressure at a step, Pa, shape (4,)."""
        if step != self._pressure_step:  # both manifold and channels are asked for at one step
            white = self._pressure.standard_normal(step, records.VOLUMES)
            self._pressure_step = step
            self._pressure_error_pa = self._pressure_offset_pa + self._parameters.pressure_noise_pa * white
        return self._pressure_error_pa

    def load_cell_n(self, step: int) -> NDArray[np.float64]:
        """Error of the load cell at a step, N, shape (3,)."""
        return self._parameters.load_cell_noise_n * self._load_cell.standard_normal(step, 3)

    def _stream(self, sensor: int) -> np.random.Generator:
        return np.random.Generator(np.random.Philox(key=self._parameters.seed, counter=[0, 0, sensor, 0]))


class _Steps:
    """Random numbers of one sensor that are a function of the step.

    One generator is put to the step's counter: to make one takes 9.5 us where that takes 1.3, and a graph's load cell
    is read 500 times a second.
    """

    _STEP = 1
    """Which word of the counter is the step."""

    def __init__(self, stream: np.random.Generator) -> None:
        """Draw from this stream, which nothing was drawn from yet."""
        self._stream = stream
        self._state: Any = stream.bit_generator.state
        self._counter: NDArray[np.uint64] = self._state["state"]["counter"]

    def standard_normal(self, step: int, count: int) -> NDArray[np.float64]:
        """Return standard normal numbers of a step, shape (count,)."""
        self._counter[self._STEP] = step
        self._stream.bit_generator.state = self._state
        return self._stream.standard_normal(count)
