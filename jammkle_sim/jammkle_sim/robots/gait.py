"""When each foot steps and where it goes: a periodic gait without feedback from the ground."""

from __future__ import annotations

import math
from dataclasses import dataclass

START_S = 0.5
"""How long a robot stands before it walks, s."""
STRAIGHT_SHARE = 0.25
"""Share of a swing for which a foot only rises, and again only comes down. Assumed."""


@dataclass(frozen=True)
class FootPlan:
    """What a gait plans of one foot, at one time."""

    bears: bool
    """Whether it has the foot on the ground."""
    phase: float | None = None
    """From 0 at touch-down to 1 at the next; None: it has not begun to step."""


@dataclass(frozen=True)
class Gait:
    """A gait, as seen from the hips."""

    speed_m_s: float
    period_s: float
    height_m: float
    """How high a foot is lifted."""
    touch_down_m_s: float
    """Speed at which it is put down."""
    bearing_share: float
    """Share of the period for which a foot stands."""
    push_m: float = 0.0
    """How much further down a foot is asked to be while it stands."""

    def plan(self, time_s: float, phase: float) -> FootPlan:
        """Return what is planned of a foot.

        Args:
            time_s: Since the robot's start.
            phase: Of the foot: by which share of a period it is ahead.

        """
        if time_s < START_S:
            return FootPlan(bears=True)
        at = self._phase(time_s, phase)
        return FootPlan(at < self.bearing_share, at)

    def place_m(self, time_s: float, phase: float) -> tuple[float, float]:
        """Return how far forward and up, m, an ankle is of where it stands still; both grow over the first period.

        While it stands it goes back as fast as the robot goes forward. It is lifted straight off its place and put
        down straight onto the next, so that it need not slide where legs give; in between it flies (smoothstep).

        Args:
            time_s: Since the robot's start.
            phase: As for `plan`.

        """
        if time_s < START_S:
            return 0.0, -self.push_m
        grown = min((time_s - START_S) / self.period_s, 1.0)
        speed_m_s = grown * self.speed_m_s
        at = self._phase(time_s, phase)
        half_m = speed_m_s * self.bearing_share * self.period_s / 2.0
        if at < self.bearing_share:
            return half_m - speed_m_s * at * self.period_s, -self.push_m
        swing_s = (1.0 - self.bearing_share) * self.period_s
        share = (at - self.bearing_share) / (1.0 - self.bearing_share)
        flown = min(max((share - STRAIGHT_SHARE) / (1.0 - 2.0 * STRAIGHT_SHARE), 0.0), 1.0)
        over_ground_m = speed_m_s * self.period_s * flown**2 * (3.0 - 2.0 * flown)
        forward_m = over_ground_m - half_m - speed_m_s * swing_s * share
        up_m = self.height_m * (1.0 - math.cos(2.0 * math.pi * share)) / 2.0
        up_m += self.touch_down_m_s * swing_s * share**2 * (1.0 - share)
        return forward_m, grown * up_m - self.push_m * abs(2.0 * share - 1.0)

    def _phase(self, time_s: float, phase: float) -> float:
        return ((time_s - START_S) / self.period_s + phase) % 1.0
