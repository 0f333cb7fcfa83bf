"""What the sensors make of the truth: lag, gain, offset, coloured noise, steps of the converter, jitter, lost samples.

Each reading is taken a little beside its time, stamped a little beside that, and written later. All functions are of
the truth, the machine over time and a seed; noise of one sensor never depends on another.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from scipy import signal as filters  # type: ignore[import-untyped]  # carries no types

from studies.blind.reality.faults import era_at
from studies.blind.reality.machine import stream
from studies.blind.reality.record import Track
from studies.blind.reality.sampling import Moments, Truth, coloured, digitised, lagged, moments

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from studies.blind.reality.faults import Era
    from studies.blind.reality.instruments import Sensor
    from studies.blind.reality.machine import Machine

__all__ = ["Truth", "encoder_track", "imu_track", "load_cell_track", "sensed", "tendon_track", "track"]

STATE_HZ = 500.0
"""Joints, tendons and load cell."""
IMU_HZ = 1000.0
PRESSURE_HZ = 100.0
IMU_COLUMNS = (
    "linear_acceleration_x_m_s2",
    "linear_acceleration_y_m_s2",
    "linear_acceleration_z_m_s2",
    "angular_velocity_x_rad_s",
    "angular_velocity_y_rad_s",
    "angular_velocity_z_rad_s",
)
LOAD_CELL_COLUMNS = ("force_x_n", "force_y_n", "force_z_n")
TENDON_COLUMNS = ("extension_m", "extension_rate_m_s", "tension_n", "broken")
_RATE_WINDOW = 9
"""Readings over which an encoder's rate is taken: a straight line through them."""


def sensed(
    periods: Sequence[Era],
    seed: int,
    name: str,
    truth: Truth,
    when: Moments,
    choose: Callable[[Machine], Sensor],
) -> NDArray[np.float64]:
    """Return readings of all columns of a truth by sensors of one kind, shape (all samples, columns), lost ones too.

    Args:
        periods: The machine over time.
        seed: Of the run.
        name: Of the sensor; sensors have noise of their own.
        truth: What they measure.
        when: The moments of their stream.
        choose: Finds the sensor in a machine.

    """
    step_s = float(truth.time_s[1] - truth.time_s[0])
    found = np.zeros((when.taken_s.size, truth.values.shape[1]))
    period_s = float(np.median(np.diff(when.taken_s))) if when.taken_s.size > 1 else step_s
    for column in range(truth.values.shape[1]):
        draw = stream(seed, f"{name} {column}")
        unit = coloured(draw, choose(periods[0].machine), period_s, when.taken_s.size)
        for place, period in enumerate(periods):
            sensor = choose(period.machine)
            end_s = periods[place + 1].start_s if place + 1 < len(periods) else math.inf
            chosen = (when.taken_s >= period.start_s) & (when.taken_s < end_s)
            slow = lagged(truth.values[:, column], sensor.lag_s, step_s)
            raw = np.interp(when.taken_s[chosen] - sensor.delay_s, truth.time_s, slow)
            found[chosen, column] = digitised(sensor.gain * raw + sensor.offset + unit[chosen], sensor)
    return found


def track(columns: tuple[str, ...], when: Moments, values: NDArray[np.float64]) -> Track:
    """Return a track of all samples that were not lost."""
    return Track(columns, when.stamp_s, when.log_s, values[when.kept])


def encoder_rate(values: NDArray[np.float64], rate_hz: float) -> NDArray[np.float64]:
    """Return the rate that firmware makes of encoder readings, along the first axis: it lags by half its window."""
    half = (_RATE_WINDOW - 1) / 2.0
    weights = (np.arange(_RATE_WINDOW) - half)[::-1]
    weights = weights / (weights**2).sum() * rate_hz
    padded = np.concatenate([np.repeat(values[:1], _RATE_WINDOW - 1, axis=0), values])
    found: NDArray[np.float64] = np.apply_along_axis(lambda column: np.convolve(column, weights, "valid"), 0, padded)
    return found


def encoder_track(
    periods: Sequence[Era],
    seed: int,
    joints: Sequence[str],
    truth: Truth,
    duration_s: float,
    choices: Sequence[Callable[[Machine], Sensor]],
) -> Track:
    """Return `joint_states`: positions of all joints, then their rates as firmware makes them.

    Args:
        periods: The machine over time.
        seed: Of the run.
        joints: Names.
        truth: Positions, one column per joint.
        duration_s: Of the run.
        choices: Finds each joint's encoder in a machine.

    """
    when = moments(periods, seed, "joint states", STATE_HZ, duration_s)
    columns = [
        sensed(periods, seed, f"encoder of {joint}", Truth(truth.time_s, truth.values[:, i : i + 1]), when, choose)
        for i, (joint, choose) in enumerate(zip(joints, choices, strict=True))
    ]
    position = np.column_stack(columns)
    names = tuple(f"{joint}.{what}" for what in ("position", "velocity") for joint in joints)
    return track(names, when, np.column_stack([position, encoder_rate(position, STATE_HZ)]))


def tendon_track(
    periods: Sequence[Era],
    seed: int,
    tendons: Sequence[str],
    extension: Truth,
    tension: Truth,
    broken: Truth,
    duration_s: float,
) -> Track:
    """Return `tendon_states` of instrumented tendons.

    Args:
        periods: The machine over time.
        seed: Of the run.
        tendons: Names.
        extension: One column per tendon, m.
        tension: The same, N.
        broken: The same, 1 where torn.
        duration_s: Of the run.

    """
    when = moments(periods, seed, "tendon states", STATE_HZ, duration_s)
    stretched = sensed(periods, seed, "extension", extension, when, lambda machine: machine.sensors.extension)
    pulled = sensed(periods, seed, "tension", tension, when, lambda machine: machine.sensors.tension)
    rate = encoder_rate(stretched, STATE_HZ)
    torn = np.column_stack([
        np.interp(when.taken_s, broken.time_s, broken.values[:, i]) >= 1.0 for i in range(len(tendons))
    ]).astype(np.float64)  # fmt: skip
    columns = [each[:, i] for i in range(len(tendons)) for each in (stretched, rate, pulled, torn)]
    names = tuple(f"{tendon}.{what}" for tendon in tendons for what in TENDON_COLUMNS)
    return track(names, when, np.column_stack(columns))


def load_cell_track(periods: Sequence[Era], seed: int, force: Truth, duration_s: float) -> Track:
    """Return `load_cell/wrench`.

    Args:
        periods: The machine over time.
        seed: Of the run.
        force: x, y, z, tension positive on z, N.
        duration_s: Of the run.

    """
    when = moments(periods, seed, "load cell", STATE_HZ, duration_s)
    step_s = float(force.time_s[1] - force.time_s[0])
    crept = force.values.copy()
    for period in periods:
        sensors = period.machine.sensors
        if sensors.cell_creep != 0.0:
            later = force.time_s >= period.start_s
            slow = lagged(force.values * later[:, None], sensors.cell_creep_s, step_s)
            crept = np.where(later[:, None], force.values + sensors.cell_creep * slow, crept)
    found = sensed(
        periods, seed, "load cell", Truth(force.time_s, crept), when, lambda machine: machine.sensors.load_cell
    )
    return track(LOAD_CELL_COLUMNS, when, found + _spikes(periods, seed, when.taken_s))


def _spikes(periods: Sequence[Era], seed: int, taken_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return what sparks nearby add to the load cell, shape (n, 3); one lasts a sample or two."""
    draw = stream(seed, "spikes")
    chance, size = draw.random(taken_s.size), draw.standard_normal((taken_s.size, 3))
    found = np.zeros((taken_s.size, 3))
    for i, time_s in enumerate(taken_s.tolist()):
        sensors = era_at(periods, time_s).sensors
        if sensors.spikes_hz > 0.0 and chance[i] < sensors.spikes_hz / STATE_HZ:
            found[i] += sensors.spike_n * np.sign(size[i]) * (0.5 + np.abs(size[i]))
            if i + 1 < taken_s.size:
                found[i + 1] -= 0.4 * found[i]
    return found


def imu_track(periods: Sequence[Era], seed: int, motion: Truth, duration_s: float) -> Track:
    """Return `imu/data`.

    Args:
        periods: The machine over time.
        seed: Of the run.
        motion: Specific force, m/s^2, and angular velocity, rad/s, x, y, z each, in the frame of the mount. Steps of
            1 ms or less.
        duration_s: Of the run.

    """
    when = moments(periods, seed, "imu", IMU_HZ, duration_s)
    step_s = float(motion.time_s[1] - motion.time_s[0])
    found = np.zeros((when.taken_s.size, 6))
    first = periods[0].machine.sensors.imu
    draws = [stream(seed, f"imu {axis}") for axis in range(6)]
    noise = np.column_stack(
        [
            coloured(draw, first.acceleration if axis < 3 else first.rate, 1.0 / IMU_HZ, when.taken_s.size)  # noqa: PLR2004
            for axis, draw in enumerate(draws)
        ]
    )
    for place, period in enumerate(periods):
        imu = period.machine.sensors.imu
        end_s = periods[place + 1].start_s if place + 1 < len(periods) else math.inf
        chosen = (when.taken_s >= period.start_s) & (when.taken_s < end_s)
        turn = _turn(imu.turn_rad)
        raw = np.column_stack([motion.values[:, :3] @ turn, motion.values[:, 3:] @ turn])
        raw += np.array([*imu.offset_m_s2, *imu.offset_rad_s])
        limits = np.array([imu.acceleration.limit * imu.clip] * 3 + [imu.rate.limit] * 3)
        raw = np.clip(raw, -limits, limits)
        # Butterworth; its overshoot stays within what the converter can give.
        sections = filters.butter(2, imu.bandwidth_hz, fs=1.0 / step_s, output="sos")
        start = filters.sosfilt_zi(sections)[:, :, None] * raw[0][None, None, :]
        smooth, _ = filters.sosfilt(sections, raw, axis=0, zi=start)
        for axis in range(6):
            sensor = imu.acceleration if axis < 3 else imu.rate  # noqa: PLR2004  # accelerations, then rates
            sampled = np.interp(when.taken_s[chosen] - imu.delay_s, motion.time_s, smooth[:, axis])
            within = np.clip(sampled + noise[chosen, axis], -limits[axis], limits[axis])
            found[chosen, axis] = digitised(within, sensor)
    return track(IMU_COLUMNS, when, found)


def _turn(angles_rad: tuple[float, float, float]) -> NDArray[np.float64]:
    """Return the matrix that turns a row vector of the mount into the IMU's own frame."""
    found = np.eye(3)
    for axis, angle_rad in enumerate(angles_rad):
        cosine, sine = math.cos(angle_rad), math.sin(angle_rad)
        first, second = (axis + 1) % 3, (axis + 2) % 3
        about = np.eye(3)
        about[first, first] = about[second, second] = cosine
        about[first, second], about[second, first] = -sine, sine
        found = about @ found
    return found
