"""What an IMU makes of a true motion: filter, noise, bias, range, rate, held readings, lost and late samples."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.signal import butter, lfilter, lfilter_zi  # type: ignore[import-untyped]  # carries no types

from jammkle_controller.core.imu import ImuSample
from jammkle_controller.core.leg_load import LegReading
from jammkle_controller.core.sole_speed import BodyTwist, LegPose
from jammkle_graph.constants import NANOSECONDS_PER_SECOND, STANDARD_GRAVITY_M_S2

if TYPE_CHECKING:
    from numpy.typing import NDArray


READ_HZ = 500.0
"""At which a slower IMU is often read."""
HELD_SHARE = 0.5


@dataclass(frozen=True)
class Imu:
    """One IMU as it is built and read."""

    rate_hz: float
    """At which it measures."""
    read_hz: float
    """At which it is read: readings in between are repeated."""
    bandwidth_hz: float
    range_m_s2: float
    rate_range_rad_s: float
    noise_m_s2: float
    rate_noise_rad_s: float
    bias_m_s2: NDArray[np.float64]
    rate_bias_rad_s: NDArray[np.float64]
    turn: NDArray[np.float64]
    """Rotation, 3 x 3, in which it is mounted."""
    lost: float
    """Share of samples that never come."""
    jitter_s: float


def draw_imu(chance: np.random.Generator, *, wide: bool = False) -> Imu:
    """Draw an IMU; `wide` draws from the range of the held-out part: other rates, ranges and noise."""
    turn, upper = np.linalg.qr(chance.normal(size=(3, 3)))
    turn *= np.sign(np.diag(upper))
    turn *= np.linalg.det(turn)
    rates = [200.0, 333.0, 800.0] if wide else [140.0, 250.0, 500.0, 1000.0]
    rate_hz = float(chance.choice(rates))
    held = rate_hz < READ_HZ and chance.random() < HELD_SHARE
    ranges_g = [3.0, 6.0, 12.0] if wide else [4.0, 8.0, 16.0]
    return Imu(
        rate_hz=rate_hz,
        read_hz=READ_HZ if held else rate_hz,
        bandwidth_hz=min(0.45 * rate_hz, float(chance.uniform(60.0, 260.0) if wide else chance.uniform(80.0, 225.0))),
        range_m_s2=float(chance.choice(ranges_g)) * STANDARD_GRAVITY_M_S2,
        rate_range_rad_s=float(np.radians(chance.choice([1000.0, 2000.0]))),
        noise_m_s2=float(10.0 ** chance.uniform(-2.0, -1.0 if wide else -1.2)),
        rate_noise_rad_s=float(10.0 ** chance.uniform(-3.0, -1.8)),
        bias_m_s2=chance.normal(0.0, 0.2, 3),
        rate_bias_rad_s=chance.normal(0.0, 0.01, 3),
        turn=turn,
        lost=float(chance.choice([0.0, 0.02, 0.05])),
        jitter_s=float(chance.choice([0.0, 0.0002, 0.0005])),
    )


def sense(
    force: NDArray[np.float64], rate: NDArray[np.float64], fine_hz: float, imu: Imu, chance: np.random.Generator
) -> list[ImuSample]:
    """Read true specific force, m/s^2, and angular velocity, rad/s, both n x 3 at `fine_hz`, with an IMU."""
    return read_with(np.hstack([force, rate]), fine_hz, imu, chance)


def read_with(motion: NDArray[np.float64], fine_hz: float, imu: Imu, chance: np.random.Generator) -> list[ImuSample]:
    """Read a true motion, specific force and angular velocity in one table of shape (n, 6), as `sense` does."""
    true = np.hstack([motion[:, :3] @ imu.turn.T, motion[:, 3:] @ imu.turn.T])
    b, a = butter(2, min(0.99, imu.bandwidth_hz / (0.5 * fine_hz)))
    start = lfilter_zi(b, a)[:, None] * true[0]
    filtered, _ = lfilter(b, a, true, axis=0, zi=start)
    times_s = np.arange(0.0, len(true) / fine_hz, 1.0 / imu.rate_hz)
    read = filtered[np.minimum(len(true) - 1, np.round(times_s * fine_hz).astype(int))]
    read[:, :3] += imu.bias_m_s2 + chance.normal(0.0, imu.noise_m_s2, read[:, :3].shape)
    read[:, 3:] += imu.rate_bias_rad_s + chance.normal(0.0, imu.rate_noise_rad_s, read[:, 3:].shape)
    read[:, :3] = np.clip(read[:, :3], -imu.range_m_s2, imu.range_m_s2)
    read[:, 3:] = np.clip(read[:, 3:], -imu.rate_range_rad_s, imu.rate_range_rad_s)
    if imu.read_hz > imu.rate_hz:
        polls_s = np.arange(0.0, times_s[-1], 1.0 / imu.read_hz)
        read = read[np.searchsorted(times_s, polls_s, side="right") - 1]
        times_s = polls_s
    kept = chance.uniform(size=len(times_s)) >= imu.lost
    stamps = times_s + chance.uniform(-imu.jitter_s, imu.jitter_s, len(times_s)) + 1.0
    rows = zip(stamps[kept].tolist(), read[kept].tolist(), strict=True)
    return [ImuSample(round(at_s * NANOSECONDS_PER_SECOND), *row) for at_s, row in rows]


@dataclass(frozen=True)
class Drives:
    """The drives of a leg as they are read: hip and knee. All assumed: encoders of 12 bits, currents for torques."""

    rate_hz: float = 100.0
    """As joint_states of our robots."""
    angle_noise_rad: float = 0.0005
    rate_noise_rad_s: float = 0.02
    effort_noise_n_m: float = 0.05
    gain_spread: float = 0.05
    """Standard deviation of the ratio of measured to applied torque, drawn for each drive."""
    offset_n_m: float = 0.05
    """Standard deviation of what a drive tells at rest: friction of its gear."""


def read_leg(
    leg: NDArray[np.float64], fine_hz: float, drives: Drives, chance: np.random.Generator
) -> list[tuple[int, LegReading]]:
    """Read true angles, rates and efforts of hip and knee, shape (n, 6) at `fine_hz`, with its drives."""
    rows = leg[round(fine_hz / drives.rate_hz) - 1 :: round(fine_hz / drives.rate_hz)].copy()
    times_s = CLOCK_START_S + np.arange(1, len(rows) + 1) / drives.rate_hz - 1.0 / fine_hz
    rows[:, 4:] *= chance.normal(1.0, drives.gain_spread, 2)
    rows[:, 4:] += chance.normal(0.0, drives.offset_n_m, 2)
    spreads = (drives.angle_noise_rad, drives.rate_noise_rad_s, drives.effort_noise_n_m)
    rows += chance.normal(0.0, np.repeat(spreads, 2), rows.shape)
    stamps = np.round(times_s * NANOSECONDS_PER_SECOND).astype(int).tolist()
    return [(stamp, LegReading(*row)) for stamp, row in zip(stamps, rows.tolist(), strict=True)]


def read_pose(
    pose: NDArray[np.float64],
    fine_hz: float,
    drives: Drives,
    legs: list[tuple[int, LegReading]],
    chance: np.random.Generator,
) -> list[tuple[int, LegPose]]:
    """Read true angles and rates of a leg and its ankle, shape (n, 12) at `fine_hz`, at the times of its readings.

    Hip and knee are as those readings have them; all encoders are alike.
    """
    rows = pose[round(fine_hz / drives.rate_hz) - 1 :: round(fine_hz / drives.rate_hz)].copy()
    rows += chance.normal(0.0, np.repeat((drives.angle_noise_rad, drives.rate_noise_rad_s), 6), rows.shape)
    rows[:, [1, 2, 7, 8]] = [reading[:4] for _, reading in legs]
    return [(stamp, LegPose(*row)) for (stamp, _), row in zip(legs, rows.tolist(), strict=True)]


@dataclass(frozen=True)
class Estimator:
    """What a legged robot's state estimator tells of its body. All assumed.

    Noise and drift are of the size that estimators from legs and IMU are known to leave in the velocity, some
    centimetres a second (Bloesch et al., IROS 2013; Camurri et al., RA-L 2(2), 2017). That a real one believes in feet
    that stand, and so errs by a share of the slide itself, is left out.
    """

    rate_hz: float = 100.0
    noise_m_s: float = 0.03
    """White, per axis."""
    drift_m_s: float = 0.025
    """Standard deviation, per axis, of an error that goes on for `drift_time_s` (Ornstein and Uhlenbeck)."""
    drift_time_s: float = 2.0
    turning_noise_rad_s: float = 0.01
    latency_s: float = 0.01


def read_body(
    twist: NDArray[np.float64], fine_hz: float, estimator: Estimator, chance: np.random.Generator
) -> list[tuple[int, BodyTwist]]:
    """Read a true twist, shape (n, 6) at `fine_hz`, as an odometry tells it: times of hearing, ns, and what is told."""
    rows = twist[round(fine_hz / estimator.rate_hz) - 1 :: round(fine_hz / estimator.rate_hz)].copy()
    times_s = CLOCK_START_S + np.arange(1, len(rows) + 1) / estimator.rate_hz - 1.0 / fine_hz
    kept = np.exp(-1.0 / (estimator.rate_hz * estimator.drift_time_s))
    steps = chance.normal(0.0, estimator.drift_m_s, (len(rows), 3))
    steps[1:] *= np.sqrt(1.0 - kept**2)
    rows[:, :3] += lfilter([1.0], [1.0, -kept], steps, axis=0)
    spreads = (estimator.noise_m_s, estimator.turning_noise_rad_s)
    rows += chance.normal(0.0, np.repeat(spreads, 3), rows.shape)
    late_ns = round(estimator.latency_s * NANOSECONDS_PER_SECOND)
    stamps = np.round(times_s * NANOSECONDS_PER_SECOND).astype(int).tolist()
    return [
        (stamp + late_ns, BodyTwist(stamp, (x, y, z), (p, q, r)))
        for stamp, (x, y, z, p, q, r) in zip(stamps, rows.tolist(), strict=True)
    ]


CLOCK_START_S = 1.0
"""What the IMU's clock shows as a recording begins, s."""
