"""Rest detection: the IMU reads gravity and nothing else for a while."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

from jammkle_common.constants import NANOSECONDS_PER_SECOND, STANDARD_GRAVITY_M_S2

MIN_SAMPLES = 10
"""A window with fewer samples says nothing of rest."""


@dataclass(frozen=True)
class SettledSettings:
    """Length of the window, s, and the rms below which it is quiet, m/s^2 and rad/s."""

    settle_window_s: float
    settle_rms_m_s2: float
    settle_rms_rad_s: float


@dataclass(frozen=True)
class Rest:
    """A quiet window: rms of | |specific force| - g |, m/s^2, and how long it lasted, s."""

    rms_m_s2: float
    lasted_s: float


class RestDetector:
    """Slides a window over the stream and says when it is quiet."""

    def __init__(self, settings: SettledSettings) -> None:
        """Make a detector that has seen nothing."""
        self.settings = settings
        self._window: deque[tuple[int, float, float]] = deque()
        self._force_sum = 0.0
        self._rate_sum = 0.0

    def restart(self) -> None:
        """Begin a new window."""
        self._window.clear()
        self._force_sum = 0.0
        self._rate_sum = 0.0

    def on_ground(self, time_ns: int, force_m_s2: float, rate_squared: float) -> Rest | None:
        """Take the next |specific force|, m/s^2, and squared |angular velocity|, rad^2/s^2; return a rest if quiet."""
        deviation = force_m_s2 - STANDARD_GRAVITY_M_S2
        force_squared = deviation * deviation
        window = self._window
        window.append((time_ns, force_squared, rate_squared))
        self._force_sum += force_squared
        self._rate_sum += rate_squared
        lasted_s = (time_ns - window[0][0]) / NANOSECONDS_PER_SECOND
        settings = self.settings
        if lasted_s < settings.settle_window_s:
            return None
        samples = len(window)
        # The sums lose digits as large squares leave them; a tiny negative remainder means zero.
        force_mean = max(0.0, self._force_sum) / samples
        rate_mean = max(0.0, self._rate_sum) / samples
        _, oldest_force, oldest_rate = window.popleft()
        self._force_sum -= oldest_force
        self._rate_sum -= oldest_rate
        quiet = force_mean <= settings.settle_rms_m_s2**2 and rate_mean <= settings.settle_rms_rad_s**2
        if not quiet or samples < MIN_SAMPLES:
            return None
        return Rest(math.sqrt(force_mean), lasted_s)
