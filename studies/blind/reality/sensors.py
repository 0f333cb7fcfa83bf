"""What the sensors make of the truth, when they sample it, and what a lab would hand over after a run."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy import signal as filters  # type: ignore[import-untyped]  # carries no types

from studies.blind.reality.machine import stream

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from studies.blind.reality.machine import Clock, Machine, Sensor, Sensors

Option = float | str | bool


@dataclass(frozen=True)
class Plan:
    """One run as a person sets it up."""

    rig: str
    """Such as `tensile`: a name that `jammkle rig` knows."""
    options: Mapping[str, Option]
    """Settings of that rig by the names that `jammkle rig` gives them; those not named are at its defaults."""


@dataclass(frozen=True)
class Track:
    """Samples of one topic, as they arrived."""

    columns: tuple[str, ...]
    """Name of each column with its unit, after the tendon or joint it belongs to and a dot, where there are several:
    `fluid_pressure_pa`, `force_z_n`, `achilles_left.tension_n`, `carriage.position`, `data`."""
    stamp_s: NDArray[np.float64]
    """When each was measured by the sensor's own clock, s since the start of the rig, shape (n,)."""
    log_s: NDArray[np.float64]
    """When each was written, s since the start of the rig, shape (n,), rising."""
    values: NDArray[np.float64]
    """SI, shape (n, columns)."""


@dataclass(frozen=True)
class RealRun:
    """One run of the real machine."""

    plan: Plan
    topics: Mapping[str, Track]
    """By relative name, such as `imu/data`; commands (`pump/duty`, `<channel>/solenoid`) as they were issued."""


SIMULATOR_ONLY = ("seed", "parameter_set", "timestep_s")
"""Settings of `jammkle rig` that mean nothing on a real machine; accepted and not looked at."""


class BadPlanError(ValueError):
    """A plan that nobody could carry out. The message names the value and the way out."""


def settings(
    plan: Plan, defaults: Mapping[str, Option], fixed: Mapping[str, Option] | None = None
) -> dict[str, Option]:
    """Return every setting of a plan.

    Args:
        plan: What was set.
        defaults: What can be set, and what it is otherwise.
        fixed: What `jammkle rig` lets one choose but a machine has or has not; to be left as here.

    Raises:
        BadPlanError: an unknown name, or something that cannot be set on it.

    """
    fixed = fixed or {}
    for name, value in plan.options.items():
        if name in SIMULATOR_ONLY or name in defaults:
            continue
        if name not in fixed:
            msg = f"rig '{plan.rig}' has no setting '{name}'; it has {', '.join(defaults)}"
            raise BadPlanError(msg)
        if value != fixed[name]:
            msg = f"'{name}' is {value}; a real machine has {fixed[name]}: set a fault instead"
            raise BadPlanError(msg)
    return {name: plan.options.get(name, default) for name, default in defaults.items()}


@dataclass(frozen=True)
class Truth:
    """What really happens, on even steps."""

    time_s: NDArray[np.float64]
    """Shape (n,), rising."""
    values: NDArray[np.float64]
    """Shape (n, columns)."""


def coloured(draw: np.random.Generator, sensor: Sensor, period_s: float, count: int) -> NDArray[np.float64]:
    """Return noise, shape (count,): a part with memory and one without."""
    keeps = math.exp(-period_s / sensor.memory_s)
    kicks = draw.standard_normal(count) * sensor.slow * math.sqrt(1.0 - keeps**2)
    kicks[:1] *= 1.0 / math.sqrt(1.0 - keeps**2)
    slow: NDArray[np.float64] = filters.lfilter([1.0], [1.0, -keeps], kicks)
    return slow + sensor.white * draw.standard_normal(count)


def lagged(values: NDArray[np.float64], lag_s: float, step_s: float) -> NDArray[np.float64]:
    """Return values, along the first axis, after a first-order lag that had settled before."""
    if lag_s <= 0.0:
        return values
    keeps = math.exp(-step_s / lag_s)
    start = np.atleast_1d(keeps * values[0])[None, ...] if values.ndim > 1 else np.atleast_1d(keeps * values[0])
    found: NDArray[np.float64]
    found, _ = filters.lfilter([1.0 - keeps], [1.0, -keeps], values, axis=0, zi=start)
    return found


def digitised(values: NDArray[np.float64], sensor: Sensor) -> NDArray[np.float64]:
    """Return values within the range of a sensor, rounded to the steps of its converter."""
    found: NDArray[np.float64] = np.round(np.clip(values, -sensor.limit, sensor.limit) / sensor.step) * sensor.step
    return found


@dataclass(frozen=True)
class Moments:
    """When the samples of one stream were taken, stamped and written, those lost left out."""

    kept: NDArray[np.bool_]
    """Of all samples, shape (count,)."""
    taken_s: NDArray[np.float64]
    """By the recorder's clock, shape (count,)."""
    stamp_s: NDArray[np.float64]
    """Shape (kept,)."""
    log_s: NDArray[np.float64]
    """Shape (kept,)."""


def moments(clock: Clock, seed: int, name: str, rate_hz: float, duration_s: float) -> Moments:
    """Return the moments of a stream over a run.

    Args:
        clock: Of the sensors.
        seed: Of the run.
        name: Of the stream; streams jitter independently.
        rate_hz: Samples per second; the first is taken one period after the start.
        duration_s: Of the run.

    """
    draw = stream(seed, f"moments of {name}")
    count = round(duration_s * rate_hz)
    even_s = np.arange(1, count + 1, dtype=np.float64) / rate_hz
    taken_s = even_s + np.clip(clock.sample_jitter_s * draw.standard_normal(count), -0.3 / rate_hz, 0.3 / rate_hz)
    stamp_jitter_s = clock.stamp_jitter_s * draw.standard_normal(count)
    late_s = clock.log_s + clock.log_jitter_s * draw.exponential(size=count)
    lost = draw.random(count) < clock.dropped
    lost[0] = False
    stamp_s = np.maximum.accumulate(np.maximum(taken_s + clock.skew * taken_s + stamp_jitter_s, 0.0))
    log_s = np.maximum.accumulate(taken_s + late_s)
    log_s += 1e-9 * np.arange(count)
    return Moments(~lost, taken_s, stamp_s[~lost], log_s[~lost])


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


def sensed(sensor: Sensor, seed: int, name: str, truth: Truth, when: Moments) -> NDArray[np.float64]:
    """Return readings of all columns of a truth by sensors of one kind, shape (all samples, columns), lost ones too.

    Args:
        sensor: Each of them.
        seed: Of the run.
        name: Of the sensor; sensors have noise of their own.
        truth: What they measure.
        when: The moments of their stream.

    """
    step_s = float(truth.time_s[1] - truth.time_s[0])
    found = np.zeros((when.taken_s.size, truth.values.shape[1]))
    period_s = float(np.median(np.diff(when.taken_s))) if when.taken_s.size > 1 else step_s
    for column in range(truth.values.shape[1]):
        draw = stream(seed, f"{name} {column}")
        noise = coloured(draw, sensor, period_s, when.taken_s.size)
        slow = lagged(truth.values[:, column], sensor.lag_s, step_s)
        raw = np.interp(when.taken_s - sensor.delay_s, truth.time_s, slow)
        found[:, column] = digitised(sensor.gain * raw + sensor.offset + noise, sensor)
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
    machine: Machine,
    seed: int,
    joints: Sequence[str],
    truth: Truth,
    duration_s: float,
    encoders: Sequence[Sensor],
) -> Track:
    """Return `joint_states`: positions of all joints, then their rates as firmware makes them.

    Args:
        machine: With its faults, on the day of the run.
        seed: Of the run.
        joints: Names.
        truth: Positions, one column per joint.
        duration_s: Of the run.
        encoders: Of each joint.

    """
    when = moments(machine.sensors.clock, seed, "joint states", STATE_HZ, duration_s)
    columns = [
        sensed(encoder, seed, f"encoder of {joint}", Truth(truth.time_s, truth.values[:, i : i + 1]), when)
        for i, (joint, encoder) in enumerate(zip(joints, encoders, strict=True))
    ]
    position = np.column_stack(columns)
    names = tuple(f"{joint}.{what}" for what in ("position", "velocity") for joint in joints)
    return track(names, when, np.column_stack([position, encoder_rate(position, STATE_HZ)]))


def tendon_track(
    machine: Machine,
    seed: int,
    tendons: Sequence[str],
    extension: Truth,
    tension: Truth,
    broken: Truth,
    duration_s: float,
) -> Track:
    """Return `tendon_states` of instrumented tendons.

    Args:
        machine: With its faults, on the day of the run.
        seed: Of the run.
        tendons: Names.
        extension: One column per tendon, m.
        tension: The same, N.
        broken: The same, 1 where torn.
        duration_s: Of the run.

    """
    when = moments(machine.sensors.clock, seed, "tendon states", STATE_HZ, duration_s)
    stretched = sensed(machine.sensors.extension, seed, "extension", extension, when)
    pulled = sensed(machine.sensors.tension, seed, "tension", tension, when)
    rate = encoder_rate(stretched, STATE_HZ)
    torn = np.column_stack([
        np.interp(when.taken_s, broken.time_s, broken.values[:, i]) >= 1.0 for i in range(len(tendons))
    ]).astype(np.float64)  # fmt: skip
    columns = [each[:, i] for i in range(len(tendons)) for each in (stretched, rate, pulled, torn)]
    names = tuple(f"{tendon}.{what}" for tendon in tendons for what in TENDON_COLUMNS)
    return track(names, when, np.column_stack(columns))


def load_cell_track(machine: Machine, seed: int, force: Truth, duration_s: float) -> Track:
    """Return `load_cell/wrench`.

    Args:
        machine: With its faults, on the day of the run.
        seed: Of the run.
        force: x, y, z, tension positive on z, N.
        duration_s: Of the run.

    """
    sensors = machine.sensors
    when = moments(sensors.clock, seed, "load cell", STATE_HZ, duration_s)
    step_s = float(force.time_s[1] - force.time_s[0])
    crept = force.values + sensors.cell_creep * lagged(force.values, sensors.cell_creep_s, step_s)
    found = sensed(sensors.load_cell, seed, "load cell", Truth(force.time_s, crept), when)
    return track(LOAD_CELL_COLUMNS, when, found + _spikes(sensors, seed, when.taken_s.size))


def _spikes(sensors: Sensors, seed: int, count: int) -> NDArray[np.float64]:
    """Return what sparks nearby add to the load cell, shape (count, 3); one lasts a sample or two."""
    draw = stream(seed, "spikes")
    chance, size = draw.random(count), draw.standard_normal((count, 3))
    found = np.zeros((count, 3))
    for i in np.flatnonzero(chance < sensors.spikes_hz / STATE_HZ):
        found[i] += sensors.spike_n * np.sign(size[i]) * (0.5 + np.abs(size[i]))
        if i + 1 < count:
            found[i + 1] -= 0.4 * found[i]
    return found


def imu_track(machine: Machine, seed: int, motion: Truth, duration_s: float) -> Track:
    """Return `imu/data`.

    Args:
        machine: With its faults, on the day of the run.
        seed: Of the run.
        motion: Specific force, m/s^2, and angular velocity, rad/s, x, y, z each, in the frame of the mount. Steps of
            1 ms or less.
        duration_s: Of the run.

    """
    when = moments(machine.sensors.clock, seed, "imu", IMU_HZ, duration_s)
    imu, step_s = machine.sensors.imu, float(motion.time_s[1] - motion.time_s[0])
    turn = _turn(imu.turn_rad)
    raw = np.column_stack([motion.values[:, :3] @ turn, motion.values[:, 3:] @ turn])
    raw += np.array([*imu.offset_m_s2, *imu.offset_rad_s])
    limits = np.array([imu.acceleration.limit * imu.clip] * 3 + [imu.rate.limit] * 3)
    raw = np.clip(raw, -limits, limits)
    # Butterworth; its overshoot stays within what the converter can give.
    sections = filters.butter(2, imu.bandwidth_hz, fs=1.0 / step_s, output="sos")
    start = filters.sosfilt_zi(sections)[:, :, None] * raw[0][None, None, :]
    smooth, _ = filters.sosfilt(sections, raw, axis=0, zi=start)
    found = np.zeros((when.taken_s.size, 6))
    for axis, sensor in enumerate((imu.acceleration,) * 3 + (imu.rate,) * 3):
        noise = coloured(stream(seed, f"imu {axis}"), sensor, 1.0 / IMU_HZ, when.taken_s.size)
        sampled = np.interp(when.taken_s - imu.delay_s, motion.time_s, smooth[:, axis])
        found[:, axis] = digitised(np.clip(sampled + noise, -limits[axis], limits[axis]), sensor)
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
