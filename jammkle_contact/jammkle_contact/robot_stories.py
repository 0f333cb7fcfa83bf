"""Stories of simulated robots: what their IMUs felt on each ankle, and what each foot truly did."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.signal import butter, lfilter  # type: ignore[import-untyped]  # carries no types

from jammkle_contact.sensing import CLOCK_START_S, Imu, read_with
from jammkle_contact.story import Slide, Story

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from jammkle_controller.core.imu import ImuSample
    from jammkle_controller.core.leg_load import LegReading
    from jammkle_sim.robots.simulation import RobotSample, RobotSimulation

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

    def keep(self, sample: RobotSample) -> None:
        """Keep a sample."""
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

    def traces(self) -> dict[str, Traces]:
        """Return what was kept, by ankle."""
        made = {}
        for name, rows in self._rows.items():
            table = np.array(rows, dtype=float)
            made[name] = Traces(
                table[:, :6], table[:, 6] > 0, table[:, 7], table[:, 8], *np.hsplit(table[:, 9:], (6, 18))
            )
        return made


def run(
    simulation: RobotSimulation, duration_s: float, act: Callable[[RobotSample], None] | None = None
) -> dict[str, Traces]:
    """Run a robot and keep what its ankles felt and did.

    Args:
        simulation: The robot.
        duration_s: How long.
        act: Called with every sample, to command the ankles; none: they stay vented.

    """
    keeper = Keeper()
    for sample in simulation.samples(duration_s, RATE_HZ):
        keeper.keep(sample)
        if act is not None:
            act(sample)
    return keeper.traces()


def story_of(
    name: str, mount: str, traces: Traces, imu: Imu, vibration_m_s2: float, chance: np.random.Generator
) -> Story:
    """Make a story of one ankle: its truth, and what an IMU that shakes with the robot's motors reads.

    Args:
        name: Of the story.
        mount: Where the IMU was.
        traces: Of the ankle.
        imu: How the IMU is built and read; what the simulated one reads is its truth.
        vibration_m_s2: Root mean square of what motors and gears add, which the simulation does not have.
        chance: For all that is drawn.

    """
    touchdowns, liftoffs = contact_changes(traces.stands)
    spans = spans_of(traces.stands)
    shaken = traces.imu.copy()
    for axis in range(3):
        shaken[:, axis] += vibration_m_s2 * _shaking(chance, len(shaken))
        shaken[:, 3 + axis] += 0.03 * vibration_m_s2 * _shaking(chance, len(shaken))
    return Story(
        name=name,
        mount=mount,
        samples=read_with(shaken, float(RATE_HZ), imu, chance),
        touchdowns_s=tuple(CLOCK_START_S + index / RATE_HZ for index in touchdowns),
        liftoffs_s=tuple(CLOCK_START_S + index / RATE_HZ for index in liftoffs),
        slides=slides_of(traces),
        duration_s=len(shaken) / RATE_HZ,
        touches_s=tuple(CLOCK_START_S + begin / RATE_HZ for begin, _ in spans),
        leaves_s=tuple(CLOCK_START_S + end / RATE_HZ for _, end in spans if end < len(traces.stands)),
    )


def as_simulated(name: str, mount: str, traces: Traces, samples: list[ImuSample]) -> Story:
    """Make a story of samples as they were felt in a loop."""
    touchdowns, liftoffs = contact_changes(traces.stands)
    return Story(
        name=name,
        mount=mount,
        samples=samples,
        touchdowns_s=tuple(index / RATE_HZ for index in touchdowns),
        liftoffs_s=tuple(index / RATE_HZ for index in liftoffs),
        slides=tuple(_moved(slide, -CLOCK_START_S) for slide in slides_of(traces)),
        duration_s=len(traces.stands) / RATE_HZ,
    )


def _moved(slide: Slide, by_s: float) -> Slide:
    return dataclasses.replace(
        slide, begin_s=slide.begin_s + by_s, end_s=slide.end_s + by_s, time_s=slide.time_s + by_s
    )


def of_the_body(ankles: Sequence[Traces]) -> Traces:
    """Return what a body does whose IMU feels all feet: carried if one stands, and sliding as they do on average."""
    stands = np.array([each.stands for each in ankles])
    share = stands / np.maximum(1, stands.sum(axis=0))
    sliding_m_s = np.sum(share * np.array([each.sliding_m_s for each in ankles]), axis=0)
    return Traces(
        imu=ankles[0].imu,
        stands=np.asarray(np.any(stands, axis=0)),
        sliding_m_s=sliding_m_s,
        way_m=np.cumsum(sliding_m_s) / RATE_HZ,
        leg=ankles[0].leg,
        pose=ankles[0].pose,
        twist=ankles[0].twist,
    )


def felt_on_the_body(
    story: Story, ankles: Sequence[Traces], legs: Sequence[list[tuple[int, LegReading]]] = ()
) -> Story:
    """Return a body's story with the touch-downs of all its feet, and a story of each foot if its leg is read.

    From the body nobody can tell whose foot it was, so that the truth of one foot is not what its IMU is judged by.
    Feet that come down within `LEAST_AIR_S` of each other are felt as one.
    """
    touchdowns_s: list[float] = []
    for at_s in sorted(CLOCK_START_S + index / RATE_HZ for each in ankles for index in contact_changes(each.stands)[0]):
        if not touchdowns_s or at_s - touchdowns_s[-1] >= LEAST_AIR_S:
            touchdowns_s.append(at_s)
    touches_s = sorted(CLOCK_START_S + begin / RATE_HZ for each in ankles for begin, _ in spans_of(each.stands))
    feet = tuple(with_truth_of(story, ankle, leg) for ankle, leg in zip(ankles, legs, strict=False))
    return dataclasses.replace(story, touchdowns_s=tuple(touchdowns_s), touches_s=tuple(touches_s), feet=feet)


def with_truth_of(story: Story, ankle: Traces, leg: list[tuple[int, LegReading]]) -> Story:
    """Return what the same IMU felt as the story of one foot, whose leg is read."""
    touchdowns, liftoffs = contact_changes(ankle.stands)
    spans = spans_of(ankle.stands)
    return dataclasses.replace(
        story,
        touchdowns_s=tuple(CLOCK_START_S + index / RATE_HZ for index in touchdowns),
        liftoffs_s=tuple(CLOCK_START_S + index / RATE_HZ for index in liftoffs),
        slides=slides_of(ankle),
        touches_s=tuple(CLOCK_START_S + begin / RATE_HZ for begin, _ in spans),
        leaves_s=tuple(CLOCK_START_S + end / RATE_HZ for _, end in spans if end < len(ankle.stands)),
        legs=leg,
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


def _shaking(chance: np.random.Generator, count: int) -> NDArray[np.float64]:
    b, a = butter(2, [25.0 / (0.5 * RATE_HZ), 150.0 / (0.5 * RATE_HZ)], btype="band")
    noise = lfilter(b, a, chance.normal(size=count))
    return np.asarray(noise / (np.std(noise) + 1e-12))
