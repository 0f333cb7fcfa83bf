"""Labelled recordings of simulated robots, and how robots, walks and landings are drawn."""

from __future__ import annotations

import dataclasses
import functools
import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from jammkle_common.names import CHANNELS
from jammkle_controller.core.leg import leg_of
from jammkle_controller.parameters import ControllerParameters, Mount
from jammkle_sim.rigs.simulation import UnstableSimulationError
from jammkle_sim.robots.catalogue import robot as made
from jammkle_sim.robots.catalogue import robot_simulation
from jammkle_sim.robots.options import RobotOptions
from jammkle_sim.robots.urdf import robot_urdf
from studies.contact.labelled import (
    CLOCK_START_S,
    Imu,
    LabelledRecording,
    Slide,
    band_noise,
    draw_imu,
    read_body,
    read_leg,
    read_pose,
    read_with,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from jammkle_controller.core.leg import Leg
    from jammkle_sim.rigs.simulation import Sample

RATE_HZ = 1000
LEG_JOINTS = ("hip", "knee")
POSE_JOINTS = ("abduction", "hip", "knee", "ankle_pitch", "ankle_roll", "ankle_yaw")
"""In the order of `LegPose`; a leg on a boom has no abduction."""
LEAST_AIR_S = 0.06
"""A foot that loses touch for less than this rebounds, and has not lifted: one that bounces off at 0.3 m/s, as fast as
feet are put down here, is back after 2 v / g = 61 ms. The times in the air of simulated feet have a gap there."""
LEAST_STAND_S = 0.06
"""A foot that touches for less than this has grazed the ground, and does not stand: fibres that are evacuated from its
touch on begin to grip after 36 to 44 ms."""
SLIDING_M_S = 0.03
"""Speed from which on a foot slides: below it soles creep, in simulation as in rubber."""
JOINED_S = 0.03
"""Two slides with less than this between them are one."""
LEAST_WAY_M = 0.004
"""A shorter way is no slip that anybody need act on: less than half of the aim of 10 mm."""
FALLEN_RAD = math.radians(45.0)
"""Beyond this tilt against the ground a robot has fallen over, and its feet wave in the air."""


@dataclass(frozen=True)
class Traces:
    """What was kept of one ankle of a run, a row per sample of `RATE_HZ`."""

    imu: NDArray[np.float64]
    """Specific force and angular velocity, shape (n, 6)."""
    stands: NDArray[np.bool_]
    sliding_m_s: NDArray[np.float64]
    way_m: NDArray[np.float64]
    leg: NDArray[np.float64]
    """Angles, rates and efforts of hip and knee, shape (n, 6)."""
    pose: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 12)))
    """Angles and rates of POSE_JOINTS, shape (n, 12)."""
    twist: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 6)))
    """Velocity and angular velocity of the base in its own frame, shape (n, 6)."""


class Keeper:
    """Keeps what is needed of each sample of a robot."""

    def __init__(self) -> None:
        """Keep nothing yet."""
        self._rows: dict[str, list[tuple[Any, ...]]] = {}
        self._tilts_rad: list[float] = []

    def keep(self, sample: Sample) -> None:
        """Keep a sample."""
        self._tilts_rad.append(sample.base_tilt_rad)
        for name, ankle in sample.ankles.items():
            foot = ankle.foot
            row = (
                *ankle.imu.specific_force_m_s2,
                *ankle.imu.angular_velocity_rad_s,
                foot.stands,
                foot.sliding_speed_m_s,
                foot.sliding_distance_m,
                *(each[joint] for each in (ankle.positions, ankle.velocities, ankle.efforts) for joint in LEG_JOINTS),
                *(each.get(joint, 0.0) for each in (ankle.positions, ankle.velocities) for joint in POSE_JOINTS),
                *sample.base.linear_m_s,
                *sample.base.angular_rad_s,
            )
            self._rows.setdefault(name, []).append(row)

    def fell_s(self, slope_rad: float) -> float:
        """Return when the robot fell over on ground of a slope, on the IMU's clock, s; infinite: it did not."""
        fallen = np.flatnonzero(np.array(self._tilts_rad) - slope_rad > FALLEN_RAD)
        return CLOCK_START_S + float(fallen[0]) / RATE_HZ if len(fallen) else math.inf

    def traces(self) -> dict[str, Traces]:
        """Return what was kept, by ankle."""
        made = {}
        for name, rows in self._rows.items():
            table = np.array(rows, dtype=float)
            made[name] = Traces(
                table[:, :6], table[:, 6] > 0, table[:, 7], table[:, 8], *np.hsplit(table[:, 9:], (6, 18))
            )
        return made


def recording_of(
    mount: str, traces: Traces, imu: Imu, vibration_m_s2: float, chance: np.random.Generator
) -> LabelledRecording:
    """Make a recording of one ankle: its truth, and what an IMU that shakes with the robot's motors reads.

    Args:
        mount: Where the IMU was.
        traces: Of the ankle.
        imu: How the IMU is built and read; what the simulated one reads is its truth.
        vibration_m_s2: Root mean square of what motors and gears add, which the simulation does not have.
        chance: For all that is drawn.

    """
    shaken = traces.imu.copy()
    for axis in range(3):
        for column, share in ((axis, 1.0), (3 + axis, 0.03)):
            shaken[:, column] += share * vibration_m_s2 * band_noise(chance, len(shaken), RATE_HZ, *SHAKING_HZ)
    return LabelledRecording(
        mount=mount,
        samples=read_with(shaken, float(RATE_HZ), imu, chance),
        **truth_of(traces),
    )


def truth_of(traces: Traces) -> dict[str, Any]:
    """Return what really happened to a foot, as fields of its recording."""
    touchdowns, liftoffs = contact_changes(traces.stands)
    spans = spans_of(traces.stands)
    return {
        "touchdowns_s": _times_s(touchdowns),
        "liftoffs_s": _times_s(liftoffs),
        "slides": slides_of(traces),
        "touches_s": _times_s([begin for begin, _ in spans]),
        "leaves_s": _times_s([end for _, end in spans if end < len(traces.stands)]),
    }


def _times_s(indices: Sequence[int]) -> tuple[float, ...]:
    """Return when samples were taken, on the IMU's clock."""
    return tuple(CLOCK_START_S + index / RATE_HZ for index in indices)


def of_the_body(ankles: Sequence[Traces]) -> Traces:
    """Return what a body does whose IMU feels all feet: carried if one stands, and sliding as they do on average."""
    stands = np.array([each.stands for each in ankles])
    share = stands / np.maximum(1, stands.sum(axis=0))
    sliding_m_s = np.sum(share * np.array([each.sliding_m_s for each in ankles]), axis=0)
    return dataclasses.replace(
        ankles[0],
        stands=np.asarray(np.any(stands, axis=0)),
        sliding_m_s=sliding_m_s,
        way_m=np.cumsum(sliding_m_s) / RATE_HZ,
    )


def felt_on_the_body(
    recording: LabelledRecording, ankles: Sequence[Traces], feet: Sequence[LabelledRecording]
) -> LabelledRecording:
    """Return a body's recording with the touch-downs of all its feet, and the recording of each foot.

    From the body nobody can report whose foot it was, so that the truth of one foot is not what its IMU is judged by.
    Feet that come down within `LEAST_AIR_S` of each other are felt as one.
    """
    touchdowns_s: list[float] = []
    for at_s in sorted(at_s for each in ankles for at_s in _times_s(contact_changes(each.stands)[0])):
        if not touchdowns_s or at_s - touchdowns_s[-1] >= LEAST_AIR_S:
            touchdowns_s.append(at_s)
    touches_s = sorted(at_s for foot in feet for at_s in foot.touches_s)
    return dataclasses.replace(
        recording,
        touchdowns_s=tuple(touchdowns_s),
        touches_s=tuple(touches_s),
        feet=tuple(feet),
        fell_s=min(foot.fell_s for foot in feet),
    )


def contact_changes(stands: NDArray[np.bool_]) -> tuple[list[int], list[int]]:
    """Return the indices of touch-downs and lift-offs, without chatter."""
    spans = joined_contacts(stands, RATE_HZ)
    touchdowns = [begin for begin, _ in spans if begin > 0]
    liftoffs = [end for _, end in spans if end < len(stands)]
    return touchdowns, liftoffs


def joined_contacts(stands: NDArray[np.bool_], rate_hz: float) -> list[tuple[int, int]]:
    """Return begin and end of each contact as indices, without rebounds, and without grazes of a foot that swings."""
    spans = _joined(spans_of(stands), round(LEAST_AIR_S * rate_hz))
    least = LEAST_STAND_S * rate_hz
    return [(begin, end) for begin, end in spans if end - begin >= least or begin == 0 or end == len(stands)]


def slides_of(traces: Traces) -> tuple[Slide, ...]:
    """Return every time that the foot slid by more than `LEAST_WAY_M`."""
    slides = []
    moves = traces.stands & (traces.sliding_m_s > SLIDING_M_S)
    for begin, end in _joined(spans_of(moves), round(JOINED_S * RATE_HZ)):
        way_m = traces.way_m[begin:end] - traces.way_m[begin]
        if way_m[-1] < LEAST_WAY_M:
            continue
        times_s = CLOCK_START_S + np.arange(begin, end) / RATE_HZ
        slides.append(Slide(float(times_s[0]), float(times_s[-1]), times_s, way_m))
    return tuple(slides)


def spans_of(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return begin and end, as indices, of each run of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(int)))
    return [(int(begin), int(end)) for begin, end in zip(edges[::2], edges[1::2], strict=True)]


def _joined(spans: list[tuple[int, int]], gap: int) -> list[tuple[int, int]]:
    made: list[tuple[int, int]] = []
    for begin, end in spans:
        if made and begin - made[-1][1] < gap:
            made[-1] = (made[-1][0], end)
        else:
            made.append((begin, end))
    return made


BEHAVIOURS = ("walk", "walk", "walk", "slip", "drop")
"""Drawn from; a walk holds many steps, a drop one landing."""
_DURATION_S = {"walk": 5.0, "slip": 2.5, "drop": 2.5}
SHAKING_HZ = (25.0, 150.0)
"""Band in which motors and gears shake."""
_HELD_SHARE = 0.5
_LEVEL_SHARE = 0.5


def draw_options(chance: np.random.Generator, mount: str, *, wide: bool) -> RobotOptions:
    """Draw what a robot does; `wide` draws from the ranges of the held-out part."""
    behaviour = str(chance.choice(BEHAVIOURS))
    slips = behaviour == "slip"
    largest_deg = 35.0 if wide else 20.0
    slope_deg = 0.0 if chance.random() < _LEVEL_SHARE and not slips else float(chance.uniform(0.0, largest_deg))
    low, high = (0.08, 1.2) if wide else (0.15, 0.9)
    if behaviour == "walk":
        slope_deg = min(slope_deg, 12.0 if wide else 8.0)
    return RobotOptions(
        behaviour=behaviour,
        imu=mount,
        slope_deg=slope_deg,
        roughness_m=float(chance.choice([0.0, 0.0, 0.01, 0.02] if wide else [0.0, 0.0, 0.01])),
        friction=max(0.9, float(np.tan(np.radians(slope_deg))) + 0.3) if slips else float(chance.uniform(low, high)),
        slip_friction=float(chance.uniform(0.02, 0.8)) * float(np.tan(np.radians(slope_deg))),
        slip_time_s=float(chance.uniform(0.9, 1.3)),
        drop_height_m=float(chance.uniform(0.02, 0.12)),
        release_time_s=float(chance.uniform(0.5, 0.9)),
        speed_m_s=float(chance.uniform(-0.15, 0.4) if wide else chance.uniform(-0.1, 0.3)),
        step_period_s=float(chance.choice([0.36, 0.55, 0.8, 1.2]) if wide else chance.uniform(0.4, 0.9)),
        step_height_m=float(chance.uniform(0.015, 0.06) if wide else chance.uniform(0.02, 0.045)),
        touch_down_m_s=float(chance.uniform(0.0, 0.4) if wide else chance.uniform(0.02, 0.3)),
        payload_kg=float(chance.uniform(0.0, 3.0 if wide else 1.0)),
        seed=int(chance.integers(0, 2**31 - 1)),
    )


@functools.cache
def leg_of_robot(robot: str, ankle: str = "ankle") -> Leg:
    """Return the leg above an ankle of a simulated robot, as its controller reads it from robot_description."""
    prefix = ankle.removesuffix("ankle")
    return leg_of(robot_urdf(made(robot, RobotOptions())), ControllerParameters(joint_prefix=prefix))


def robot_recordings(
    robot: str, seed: int, mount: str, *, wide: bool = False, hang_pitch_deg: float | None = None
) -> list[LabelledRecording]:
    """Run a robot once, and return a recording per ankle, or one of its body; none where it blew up.

    Args:
        robot: Name.
        seed: Everything is drawn from it.
        mount: Where the IMUs are: a value of `Mount`.
        wide: Whether it is of the held-out part.
        hang_pitch_deg: How its feet hang; None: as the robot is built.

    """
    chance = np.random.default_rng([seed, int(wide), 78])
    options = draw_options(chance, mount, wide=wide)
    if hang_pitch_deg is not None:
        options = dataclasses.replace(options, hang_pitch_deg=hang_pitch_deg)
    simulation = robot_simulation(robot, options)
    if chance.random() < _HELD_SHARE:
        for view in simulation.ankles.values():
            view.hold_vacuum(dict.fromkeys(CHANNELS, 40e3))
    keeper = Keeper()
    try:
        for sample in simulation.samples(_DURATION_S[options.behaviour], RATE_HZ):
            keeper.keep(sample)
    except UnstableSimulationError:
        return []
    traces, fell_s = keeper.traces(), keeper.fell_s(math.radians(options.slope_deg))
    feet, names = list(traces.values()), list(traces)
    if mount == Mount.BODY.value:
        traces = {"body": of_the_body(feet)}
    drives = np.random.default_rng([seed, int(wide), 79])  # of their own: the rest is drawn as before there were any
    legs = [read_leg(each.leg, RATE_HZ, drives) for each in feet]
    joints = np.random.default_rng([seed, int(wide), 80])
    poses = [read_pose(each.pose, RATE_HZ, leg, joints) for each, leg in zip(feet, legs, strict=True)]
    twists = read_body(feet[0].twist, RATE_HZ, joints)
    vibration = float(10.0 ** chance.uniform(-1.3, 0.0 if wide else -0.2))
    recordings = [recording_of(mount, each, draw_imu(chance, wide=wide), vibration, chance) for each in traces.values()]
    body = recordings[0] if mount == Mount.BODY.value else None
    if body is not None:
        recordings = [dataclasses.replace(body, **truth_of(each)) for each in feet]
    recordings = [
        dataclasses.replace(foot, legs=leg, poses=pose, twists=twists, leg=leg_of_robot(robot, name), fell_s=fell_s)
        for foot, leg, pose, name in zip(recordings, legs, poses, names, strict=True)
    ]
    return recordings if body is None else [felt_on_the_body(body, feet, recordings)]
