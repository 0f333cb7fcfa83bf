"""What a trial knows of a recording: samples of an IMU, and the truth beside them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from jammkle_controller.core.imu import ImuSample
    from jammkle_controller.core.leg_load import LegReading
    from jammkle_controller.core.sole_speed import BodyTwist, LegPose


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
class Story:
    """A stretch of motion as an IMU felt it, and what really happened; times in s on the IMU's clock."""

    name: str
    mount: str
    """Where the IMU was: a value of `Mount`."""
    samples: list[ImuSample]
    touchdowns_s: tuple[float, ...]
    liftoffs_s: tuple[float, ...]
    slides: tuple[Slide, ...]
    duration_s: float
    touches_s: tuple[float, ...] = ()
    """Every time that the foot met the ground: touch-downs, rebounds, and grazes of a foot that swings."""
    legs: list[tuple[int, LegReading]] = field(default_factory=list)
    """Stamps, ns, and readings of the leg, where the robot has servos."""
    poses: list[tuple[int, LegPose]] = field(default_factory=list)
    """Stamps, ns, and angles and rates of all joints from the body to the foot."""
    twists: list[tuple[int, BodyTwist]] = field(default_factory=list)
    """Times at which an odometry is heard, ns, and what it tells of the body."""
    place: dict[str, float] = field(default_factory=dict)
    """Where the leg is on the body: parameters of the controller."""
    feet: tuple[Story, ...] = ()
    """Of a body: the story of each foot, whose leg is read."""
    leaves_s: tuple[float, ...] = ()
    """Every time that the foot lost touch: lift-offs, rebounds, and the ends of grazes."""
    phase: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None
    """Times, s, and gait phase, 0 at touch-down to 1, where the robot has a gait."""
    facts: dict[str, float] = field(default_factory=dict)
    """What was drawn, by name with unit."""

    def in_contact(self, time_s: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether the foot stands at times, s; it does at the start."""
        changes = sorted([(t, True) for t in self.touchdowns_s] + [(t, False) for t in self.liftoffs_s])
        result = np.ones(len(time_s), dtype=bool)
        for at_s, stands in changes:
            result[time_s >= at_s] = stands
        return result
