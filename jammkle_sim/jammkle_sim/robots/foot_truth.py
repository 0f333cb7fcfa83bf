"""What a simulated foot truly does on the ground."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class FootTruth:
    """What the foot truly does on the ground. No robot can measure it."""

    stands: bool
    """Whether it presses on the ground with more than its own weight."""
    normal_force_n: float
    """Sum over its contacts."""
    sliding_speed_m_s: float
    """Tangential speed of its contacts on the ground, each by its share of the force; 0 where it does not stand."""
    sliding_distance_m: float
    """Way that it has slid since the robot's start, whichever way and however often."""
