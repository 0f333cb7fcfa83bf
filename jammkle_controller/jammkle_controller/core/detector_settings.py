"""Where an IMU is, what a foot does, and the settings of every detector."""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from jammkle_controller.core.impact import ImpactSettings
    from jammkle_controller.core.liftoff import LiftoffSettings
    from jammkle_controller.core.raised import RaiseSettings
    from jammkle_controller.core.settled import SettledSettings
    from jammkle_controller.core.slip import SlipSettings
    from jammkle_controller.core.swing import SwingSettings
    from jammkle_controller.core.watch import WatchSettings


class Mount(enum.Enum):
    """Where the IMU is mounted."""

    FOOT = "foot"
    """On the foot, or at the end of a shank that ends in a ball."""
    SHANK = "shank"
    """On the lower leg, nearer to the knee."""
    BODY = "body"
    """On the trunk, or on what stands for it in a rig."""


class Phase(enum.Enum):
    """What the foot does, as far as the IMU tells."""

    GROUND = "on the ground, moving"
    """Something carries the body. So it is assumed at the start."""
    PLANTED = "on the ground, at rest"
    """The body has come to rest; slip is watched for."""
    FLIGHT = "in flight"
    """Nothing carries the body."""
    SWING = "in swing"
    """The foot is off the ground, and the body is carried by another, or hardly."""


@dataclass(frozen=True)
class DetectorSettings:
    """Settings of every detector, where the IMU is mounted, and the longest gap in the stream, s."""

    impact: ImpactSettings
    liftoff: LiftoffSettings
    raised: RaiseSettings
    settled: SettledSettings
    slip: SlipSettings
    swing: SwingSettings
    watch: WatchSettings
    mount: Mount
    touchdown_probability: float
    max_gap_s: float
