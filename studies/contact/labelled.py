"""Labelled recordings: steps, slips and landings of a foot, drawn at random, and the sensors that measure them.

The motion is that of a two-link leg whose foot stands, slides, lifts, swings and hits the ground, by inverse kinematics
of hip, knee and foot; blows, ringing, motors and sliding are added to the acceleration that follows from it. It is no
dynamics: what matters is that everything a detector must separate is in it, in wide ranges. Speeds of a touch-down and
stride times after small quadrupeds (0.1 to 0.6 m/s, 0.35 to 1.2 s); assumed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import gaussian_filter1d  # type: ignore[import-untyped]  # carries no types
from scipy.signal import butter, lfilter, lfilter_zi  # type: ignore[import-untyped]  # carries no types

from jammkle_common.constants import NANOSECONDS_PER_SECOND, STANDARD_GRAVITY_M_S2
from jammkle_controller.core.imu import ImuSample
from jammkle_controller.core.leg_contact import AnkleReading, LegReading
from jammkle_controller.core.slip import BodyTwist, LegPose

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from jammkle_controller.core.leg import Leg


@dataclass(frozen=True)
class Slide:
    """One time that a foot slid: when it began and ended, s, and how far it had come, m, over time, s."""

    begin_s: float
    end_s: float
    time_s: NDArray[np.float64]
    way_m: NDArray[np.float64]

    def way_at_m(self, time_s: float) -> float:
        """Way slid by a time, m."""
        return float(np.interp(time_s, self.time_s, self.way_m))


@dataclass(frozen=True)
class LabelledRecording:
    """A stretch of motion as an IMU felt it, and what really happened; times in s on the IMU's clock."""

    mount: str
    """Where the IMU was: a value of `Mount`."""
    samples: list[ImuSample]
    touchdowns_s: tuple[float, ...]
    liftoffs_s: tuple[float, ...]
    slides: tuple[Slide, ...]
    touches_s: tuple[float, ...] = ()
    """Every time that the foot met the ground: touch-downs, rebounds, and grazes of a foot that swings."""
    legs: list[tuple[int, LegReading]] = field(default_factory=list)
    """Stamps, ns, and readings of the leg, where the robot has servos."""
    poses: list[tuple[int, LegPose]] = field(default_factory=list)
    """Stamps, ns, and angles and rates of all joints from the body to the foot."""
    twists: list[tuple[int, BodyTwist]] = field(default_factory=list)
    """Times at which an odometry is received, ns, and what it reports of the body."""
    leg: Leg | None = None
    """The leg above the ankle, for efforts and odometry."""
    feet: tuple[LabelledRecording, ...] = ()
    """Of a body: the recording of each foot, whose leg is read."""
    leaves_s: tuple[float, ...] = ()
    """Every time that the foot lost touch: lift-offs, rebounds, and the ends of grazes."""
    fell_s: float = math.inf
    """When the robot fell over; infinite: it did not."""

    def ankle_readings(self) -> list[tuple[int, AnkleReading]]:
        """Return what the controller reads of the ankle, with stamps, ns, where its joints are measured."""
        return [
            (
                at_ns,
                AnkleReading(
                    pose.pitch_rad, pose.roll_rad, pose.pitch_rad_s, pose.roll_rad_s, pose.hip_rad_s, pose.knee_rad_s
                ),
            )
            for at_ns, pose in self.poses
        ]

    def in_contact(self, time_s: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether the foot stands at times, s; it does at the start."""
        changes = sorted([(t, True) for t in self.touchdowns_s] + [(t, False) for t in self.liftoffs_s])
        result = np.ones(len(time_s), dtype=bool)
        for at_s, stands in changes:
            result[time_s >= at_s] = stands
        return result


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


def read_with(motion: NDArray[np.float64], fine_hz: float, imu: Imu, chance: np.random.Generator) -> list[ImuSample]:
    """Read a true motion, specific force, m/s^2, and angular velocity, rad/s, shape (n, 6) at `fine_hz`."""
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


DRIVE_RATE_HZ = 100.0
"""At which the drives of hip and knee are read, as joint_states of our robots."""
ANGLE_NOISE_RAD, ANGLE_RATE_NOISE_RAD_S, EFFORT_NOISE_N_M = 0.0005, 0.02, 0.05
"""Of a drive. Assumed, as all of it: encoders of 12 bits, currents for torques."""
GAIN_SPREAD = 0.05
"""Standard deviation of the ratio of measured to applied torque, drawn for each drive."""
EFFORT_OFFSET_N_M = 0.05
"""Standard deviation of what a drive reports at rest: friction of its gear."""


def read_leg(leg: NDArray[np.float64], fine_hz: float, chance: np.random.Generator) -> list[tuple[int, LegReading]]:
    """Read true angles, rates and efforts of hip and knee, shape (n, 6) at `fine_hz`, with its drives."""
    rows, stamps = _read_at(leg, fine_hz, DRIVE_RATE_HZ)
    rows[:, 4:] *= chance.normal(1.0, GAIN_SPREAD, 2)
    rows[:, 4:] += chance.normal(0.0, EFFORT_OFFSET_N_M, 2)
    spreads = (ANGLE_NOISE_RAD, ANGLE_RATE_NOISE_RAD_S, EFFORT_NOISE_N_M)
    rows += chance.normal(0.0, np.repeat(spreads, 2), rows.shape)
    return [(stamp, LegReading(*row)) for stamp, row in zip(stamps, rows.tolist(), strict=True)]


def read_pose(
    pose: NDArray[np.float64],
    fine_hz: float,
    legs: list[tuple[int, LegReading]],
    chance: np.random.Generator,
) -> list[tuple[int, LegPose]]:
    """Read true angles and rates of a leg and its ankle, shape (n, 12) at `fine_hz`, at the times of its readings.

    Hip and knee are as those readings have them; all encoders are alike.
    """
    rows, stamps = _read_at(pose, fine_hz, DRIVE_RATE_HZ)
    rows += chance.normal(0.0, np.repeat((ANGLE_NOISE_RAD, ANGLE_RATE_NOISE_RAD_S), 6), rows.shape)
    rows[:, [1, 2, 7, 8]] = [reading[:4] for _, reading in legs]
    return [(stamp, LegPose(*row)) for stamp, row in zip(stamps, rows.tolist(), strict=True)]


ODOMETRY_RATE_HZ = 100.0
SPEED_NOISE_M_S, SPEED_DRIFT_M_S, DRIFT_TIME_S = 0.03, 0.025, 2.0
"""What a legged robot's state estimator errs by, per axis: white noise, and an error that goes on for a while (standard
deviation; Ornstein and Uhlenbeck). Assumed, as all of it, of the size that estimators from legs and IMU are known to
leave in the velocity, some centimetres a second (Bloesch et al., IROS 2013; Camurri et al., RA-L 2(2), 2017). That a
real one believes in feet that stand, and so errs by a share of the slide itself, is left out."""
TURNING_NOISE_RAD_S, ODOMETRY_LATENCY_S = 0.01, 0.01


def read_body(twist: NDArray[np.float64], fine_hz: float, chance: np.random.Generator) -> list[tuple[int, BodyTwist]]:
    """Read a true twist, shape (n, 6) at `fine_hz`, as an odometry has it: times of arrival, ns, and its reports."""
    rows, stamps = _read_at(twist, fine_hz, ODOMETRY_RATE_HZ)
    kept = np.exp(-1.0 / (ODOMETRY_RATE_HZ * DRIFT_TIME_S))
    steps = chance.normal(0.0, SPEED_DRIFT_M_S, (len(rows), 3))
    steps[1:] *= np.sqrt(1.0 - kept**2)
    rows[:, :3] += lfilter([1.0], [1.0, -kept], steps, axis=0)
    rows += chance.normal(0.0, np.repeat((SPEED_NOISE_M_S, TURNING_NOISE_RAD_S), 3), rows.shape)
    late_ns = round(ODOMETRY_LATENCY_S * NANOSECONDS_PER_SECOND)
    return [
        (stamp + late_ns, BodyTwist(stamp, (x, y, z), (p, q, r)))
        for stamp, (x, y, z, p, q, r) in zip(stamps, rows.tolist(), strict=True)
    ]


def _read_at(true: NDArray[np.float64], fine_hz: float, rate_hz: float) -> tuple[NDArray[np.float64], list[int]]:
    """Return the rows that are read at a rate, and their stamps, ns."""
    rows = true[round(fine_hz / rate_hz) - 1 :: round(fine_hz / rate_hz)].copy()
    times_s = CLOCK_START_S + np.arange(1, len(rows) + 1) / rate_hz - 1.0 / fine_hz
    return rows, np.round(times_s * NANOSECONDS_PER_SECOND).astype(int).tolist()


CLOCK_START_S = 1.0
"""What the IMU's clock shows as a recording begins, s."""


FINE_HZ = 4000.0
_LINK_M = 0.21
FLAT_SHARE = 0.5
"""Of the legs that have an ankle and a foot; the others end in a ball."""
STRIDES_AT_ONCE = 5
SLIP_SHARE = 0.35
"""Of the stances in which the foot slides."""
AT_ONCE_SHARE, BACK_SHARE = 0.4, 0.7
"""Of the slides that begin with the touch-down, and that go back."""
SLIDE_MIN_S = 0.04
_SLIDES_MIN_M = 0.002
"""A way below it is no slip: the sole's own give."""


@dataclass
class _Track:
    """What becomes of the foot and body, as lists of stretches."""

    foot_x: list[NDArray[np.float64]] = field(default_factory=list)
    foot_z: list[NDArray[np.float64]] = field(default_factory=list)
    pitch: list[NDArray[np.float64]] = field(default_factory=list)
    stands: list[NDArray[np.bool_]] = field(default_factory=list)
    touchdowns: list[tuple[int, float]] = field(default_factory=list)
    """Index and speed, m/s."""
    liftoffs: list[int] = field(default_factory=list)
    slides: list[tuple[int, NDArray[np.float64]]] = field(default_factory=list)
    """Index of the start, and way, m, from there."""
    walks: list[NDArray[np.float64]] = field(default_factory=list)
    """1 in a stride, 0 as it rests."""

    @property
    def count(self) -> int:
        """How many fine steps there are so far."""
        return sum(len(part) for part in self.foot_x)


@dataclass(frozen=True)
class Gait:
    """What is drawn of a walk."""

    stride_s: float
    stance_share: float
    speed_m_s: float
    lift_m: float
    hardness: float
    """Share of a cubic in the lift, which ends with a speed: how fast the foot comes down."""
    flat: bool
    """Whether there is a foot that stands flat below an ankle, or a ball at the end of the shank."""
    vibration_m_s2: float
    slope_rad: float


def draw_gait(chance: np.random.Generator, *, wide: bool) -> Gait:
    """Draw a walk; `wide` draws from the ranges of the held-out part."""
    return Gait(
        stride_s=chance.uniform(0.35, 1.2) if not wide else chance.choice([0.3, 0.45, 0.7, 1.4]),
        stance_share=chance.uniform(0.45, 0.7) if not wide else chance.uniform(0.4, 0.75),
        speed_m_s=chance.uniform(0.1, 0.8) if not wide else chance.uniform(0.05, 1.0),
        lift_m=chance.uniform(0.03, 0.10) if not wide else chance.uniform(0.025, 0.13),
        hardness=chance.uniform(0.05, 0.7),
        flat=bool(chance.random() < FLAT_SHARE),
        vibration_m_s2=10.0 ** chance.uniform(-1.0, 0.5),
        slope_rad=math.radians(chance.uniform(0.0, 20.0) if not wide else chance.uniform(0.0, 35.0)),
    )


def walk(seed: int, mount: str, strides: int, *, wide: bool = False) -> LabelledRecording:
    """Make a walk of some strides with standing before, between and after.

    Args:
        seed: Everything is drawn from it.
        mount: A value of `Mount`.
        strides: How many.
        wide: Whether it is of the held-out part.

    """
    chance = np.random.default_rng([seed, int(wide), 77])
    gait = draw_gait(chance, wide=wide)
    track = _Track()
    _stand(track, chance.uniform(0.5, 1.0))
    for index in range(strides):
        _stride(track, gait, chance)
        if index % STRIDES_AT_ONCE == STRIDES_AT_ONCE - 1:
            _stand(track, chance.uniform(0.3, 1.0))
    _stand(track, 0.5)
    return _felt(track, gait, mount, chance, wide=wide)


def _stand(track: _Track, lasts_s: float) -> None:
    count = round(lasts_s * FINE_HZ)
    last_x = track.foot_x[-1][-1] if track.foot_x else 0.0
    track.foot_x.append(np.full(count, last_x))
    track.foot_z.append(np.zeros(count))
    track.pitch.append(np.zeros(count))
    track.stands.append(np.ones(count, dtype=bool))
    track.walks.append(np.zeros(count))


def _stride(track: _Track, gait: Gait, chance: np.random.Generator) -> None:
    vary = chance.normal(1.0, 0.05)
    swing = round(gait.stride_s * (1.0 - gait.stance_share) * vary * FINE_HZ)
    stance = round(gait.stride_s * gait.stance_share * vary * FINE_HZ)
    length_m = gait.speed_m_s * gait.stride_s
    share = np.linspace(0.0, 1.0, swing)
    begin = track.count
    x0 = track.foot_x[-1][-1]
    hardness = float(np.clip(gait.hardness * chance.normal(1.0, 0.2), 0.02, 0.9))
    lift = (1.0 - hardness) * np.sin(math.pi * share) ** 2 + hardness * 6.75 * share**2 * (1.0 - share)
    track.liftoffs.append(begin)
    track.foot_x.append(x0 + length_m * (share - np.sin(2.0 * math.pi * share) / (2.0 * math.pi)))
    track.foot_z.append(gait.lift_m * lift)
    pitch_amplitude = chance.uniform(0.1, 0.6) if gait.flat else 0.0
    track.pitch.append(pitch_amplitude * np.sin(math.pi * share) ** 2 * np.sin(2.0 * math.pi * share + 0.3))
    track.stands.append(np.zeros(swing, dtype=bool))
    track.walks.append(np.ones(swing))
    speed = 6.75 * hardness * gait.lift_m / (swing / FINE_HZ)
    track.touchdowns.append((begin + swing, max(0.05, speed)))
    x = np.full(stance, track.foot_x[-1][-1])
    if chance.uniform() < SLIP_SHARE:
        _slide(track, x, begin + swing, chance)
    track.foot_x.append(x)
    track.foot_z.append(np.zeros(stance))
    track.pitch.append(np.zeros(stance))
    track.stands.append(np.ones(stance, dtype=bool))
    track.walks.append(np.ones(stance))


def _slide(track: _Track, x: NDArray[np.float64], begin: int, chance: np.random.Generator) -> None:
    """Let the foot break away: a step of the acceleration, as of Coulomb friction, and a stop by friction."""
    stance_s = len(x) / FINE_HZ
    at_once = chance.random() < AT_ONCE_SHARE
    from_s = chance.uniform(0.0, 0.01) if at_once else chance.uniform(0.25, 0.7) * stance_s
    lasts_s = min(chance.uniform(0.06, 0.2), stance_s - from_s - 0.02)
    if lasts_s < SLIDE_MIN_S:
        return
    gain, loss = chance.uniform(0.8, 7.0), chance.uniform(1.0, 8.0)
    time_s = np.arange(len(x)) / FINE_HZ - from_s
    turn_s = lasts_s * loss / (gain + loss)
    acceleration = np.where((time_s > 0) & (time_s < turn_s), gain, 0.0)
    acceleration = np.where((time_s >= turn_s) & (time_s < lasts_s), -loss, acceleration)
    way = np.cumsum(np.cumsum(acceleration)) / FINE_HZ**2
    if way[-1] < _SLIDES_MIN_M:
        return
    first = max(0, round(from_s * FINE_HZ))
    sign = -1.0 if chance.random() < BACK_SHARE else 1.0
    x += sign * way
    track.slides.append((begin + first, way[first:]))


def _felt(track: _Track, gait: Gait, mount: str, chance: np.random.Generator, *, wide: bool) -> LabelledRecording:
    foot_x, foot_z = np.concatenate(track.foot_x), np.concatenate(track.foot_z)
    pitch, stands = np.concatenate(track.pitch), np.concatenate(track.stands)
    count = len(foot_x)
    time_s = np.arange(count) / FINE_HZ
    # The body follows the mean way of the foot, and heaves; over a stand it rests.
    body_x = gaussian_filter1d(foot_x, 0.35 * gait.stride_s * FINE_HZ, mode="nearest")
    walks = gaussian_filter1d(np.concatenate(track.walks), 0.1 * FINE_HZ)
    heave_m_s2 = chance.uniform(0.5, 5.0)
    heave_rad_s = 2.0 * math.pi * 2.0 / gait.stride_s
    sway = chance.uniform(0.0, 0.01) * np.sin(2.0 * math.pi * chance.uniform(0.5, 3.0) * time_s + chance.uniform(0, 6))
    body_z = 0.33 + walks * heave_m_s2 / heave_rad_s**2 * np.cos(heave_rad_s * time_s)
    body_x = body_x + sway
    shank, imu_x, imu_z = _leg(body_x, body_z, foot_x, foot_z, mount, chance)
    if mount == "body":
        angle = walks * chance.uniform(0.0, 0.05) * np.sin(heave_rad_s * time_s)
    elif mount == "foot" and gait.flat:
        angle, imu_x, imu_z = pitch, foot_x, foot_z + 0.02
    else:
        angle = shank
    # A blow is added below; here the corners of the path are rounded so much that they make none.
    smooth = 0.002 * FINE_HZ
    ax = _second(gaussian_filter1d(imu_x, smooth, mode="nearest"))
    az = _second(gaussian_filter1d(imu_z, smooth, mode="nearest"))
    limit = 60.0
    force = np.zeros((count, 3))
    force[:, 0] = np.clip(ax, -limit, limit) + STANDARD_GRAVITY_M_S2 * math.sin(gait.slope_rad)
    force[:, 2] = np.clip(az, -limit, limit) + STANDARD_GRAVITY_M_S2 * math.cos(gait.slope_rad)
    _soften_corners(force, track, ax, az)
    _add_blows(force, track, gait, mount, chance)
    _add_vibration(force, stands, gait, mount, chance)
    cos, sin = np.cos(angle), np.sin(angle)
    x, z = force[:, 0].copy(), force[:, 2].copy()
    # The sensor is turned by +angle about y, so that the world turns the other way in its frame.
    force[:, 0], force[:, 2] = cos * x - sin * z, sin * x + cos * z
    rate = np.zeros((count, 3))
    rate[:, 1] = np.gradient(gaussian_filter1d(angle, smooth, mode="nearest")) * FINE_HZ
    rate += band_noise(chance, count, FINE_HZ, 20.0, 120.0)[:, None] * 0.05 * gait.vibration_m_s2
    samples = read_with(np.hstack([force, rate]), FINE_HZ, draw_imu(chance, wide=wide), chance)
    return LabelledRecording(
        mount=mount,
        samples=samples,
        touchdowns_s=tuple(CLOCK_START_S + index / FINE_HZ for index, _ in track.touchdowns),
        liftoffs_s=tuple(CLOCK_START_S + index / FINE_HZ for index in track.liftoffs),
        slides=tuple(_slide_of(begin, way) for begin, way in track.slides),
    )


def _slide_of(begin: int, way: NDArray[np.float64]) -> Slide:
    times_s = CLOCK_START_S + (begin + np.arange(len(way))) / FINE_HZ
    moves = np.flatnonzero(np.diff(way) > 0.0)
    first, last = int(moves[0]), int(moves[-1])
    return Slide(float(times_s[first]), float(times_s[last]), times_s, way)


def _leg(
    body_x: NDArray[np.float64],
    body_z: NDArray[np.float64],
    foot_x: NDArray[np.float64],
    foot_z: NDArray[np.float64],
    mount: str,
    chance: np.random.Generator,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Solve the leg and return the shank's angle from the vertical, rad, and where the IMU is, m."""
    if mount == "body":
        return np.zeros_like(body_x), body_x, body_z
    dx, dz = foot_x - body_x, foot_z - body_z
    reach = np.clip(np.hypot(dx, dz), 0.05, 1.999 * _LINK_M)
    bend = np.arccos(np.clip(reach / (2.0 * _LINK_M), -1.0, 1.0))
    shank = np.arctan2(dx, -dz) - bend
    up_m = chance.uniform(0.0, 0.03) if mount == "foot" else chance.uniform(0.08, 0.2)
    return shank, foot_x - up_m * np.sin(shank), foot_z + up_m * np.cos(shank)


def _second(way: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(np.gradient(np.gradient(way)) * FINE_HZ**2)


def _soften_corners(
    force: NDArray[np.float64], track: _Track, ax: NDArray[np.float64], az: NDArray[np.float64]
) -> None:
    """Take out what the corner of the path makes at touch-down: the blow itself is added with its own shape."""
    for index, _ in track.touchdowns:
        before, after = slice(max(0, index - 30), index), slice(index, min(len(force), index + 30))
        for axis, way in ((0, ax), (2, az)):
            made = np.clip(way, -60.0, 60.0)
            force[before, axis] += made[before.start] - made[before]
            force[after, axis] -= made[after]


def _add_blows(force: NDArray[np.float64], track: _Track, gait: Gait, mount: str, chance: np.random.Generator) -> None:
    passed = {"foot": 1.0, "shank": chance.uniform(0.3, 0.7), "body": chance.uniform(0.04, 0.15)}[mount]
    ring_hz, decay_s = chance.uniform(25.0, 90.0), chance.uniform(0.005, 0.025)
    contact_s = chance.uniform(0.003, 0.012) * (2.0 if mount == "body" else 1.0)

    def blow(index: int, speed: float, lasts_s: float = contact_s) -> None:
        last = min(len(force), index + round(0.15 * FINE_HZ))
        if index >= last:
            return
        time_s = np.arange(last - index) / FINE_HZ
        peak = 0.5 * math.pi * speed / lasts_s
        pulse = np.where(time_s < lasts_s, peak * np.sin(math.pi * time_s / lasts_s), 0.0)
        ring = chance.uniform(0.1, 0.5) * peak * np.exp(-time_s / decay_s) * np.sin(2.0 * math.pi * ring_hz * time_s)
        way = np.array([chance.normal(0.0, 0.35), chance.normal(0.0, 0.2), 1.0])
        way /= np.linalg.norm(way)
        force[index:last] += pulse[:, None] * way
        force[index:last] += ring[:, None] * (way + chance.normal(0.0, 0.3, 3))

    others = [(index + round(0.5 * gait.stride_s * FINE_HZ), speed) for index, speed in track.touchdowns]
    shares = [1.0 if mount == "body" else chance.uniform(0.03, 0.25) for _ in others]
    for (index, speed), share in zip([*track.touchdowns, *others], [1.0] * len(others) + shares, strict=True):
        blow(index, passed * share * speed)
    for (index, speed), lifted in zip(track.touchdowns, track.liftoffs, strict=True):
        # Joints that reverse, cables that strike, feet that scrape: jolts of a swing and of a stance.
        for _ in range(int(chance.integers(0, 3))):
            at = int(chance.uniform(lifted, index + (index - lifted)))
            blow(at, 0.25 * passed * speed * chance.uniform())
    for index in track.liftoffs:
        blow(index, -0.1 * passed * chance.uniform(0.2, 2.0), 0.015)


def _add_vibration(
    force: NDArray[np.float64], stands: NDArray[np.bool_], gait: Gait, mount: str, chance: np.random.Generator
) -> None:
    moving = gaussian_filter1d((~stands).astype(float), 0.03 * FINE_HZ)
    quiet = chance.uniform(0.1, 0.5) if mount == "foot" else chance.uniform(0.3, 0.8)
    for axis in range(3):
        noise = band_noise(chance, len(force), FINE_HZ, 25.0, 150.0)
        force[:, axis] += gait.vibration_m_s2 * noise * (quiet + (1.0 - quiet) * moving)


def band_noise(
    chance: np.random.Generator, count: int, rate_hz: float, low_hz: float, high_hz: float
) -> NDArray[np.float64]:
    """Draw noise of a band, with a root mean square of 1, shape (count,) at `rate_hz`."""
    b, a = butter(2, [low_hz / (0.5 * rate_hz), high_hz / (0.5 * rate_hz)], btype="band")
    noise = lfilter(b, a, chance.normal(size=count))
    return np.asarray(noise / (np.std(noise) + 1e-12))
