"""Slip detection: a body that stood still picks up speed while the ground still carries it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from jammkle_controller.core.events import M_S, ContactEvent, ContactKind
from jammkle_graph.constants import NANOSECONDS_PER_SECOND, STANDARD_GRAVITY_M_S2

if TYPE_CHECKING:
    from jammkle_controller.core.imu import ImuSample

LEAK_TIME_S = 0.05
"""Time constant with which the speed is forgotten, s. Sensor bias then stays harmless (0.2 m/s^2 reads 0.01 m/s), and
motion below 1 / (2 pi 0.05) = 3 Hz, that of a body swaying over its feet, is damped."""

REFERENCE_TIME_S = 1.0
"""Time constant with which the direction of gravity follows the accelerometer, s; the gyro carries it in between."""

LOADED_M_S2 = 0.5 * STANDARD_GRAVITY_M_S2
"""Below this |specific force| the foot is leaving the ground, not sliding, m/s^2. On a slope of angle a without any
friction the ground still carries g cos(a): half of g is 60 deg."""

UPWARD = 0.5
"""A speed whose upward part is more than this is pushing off or stepping, not sliding; cosine, 60 deg off the
vertical."""

_ONSET_FRACTION = 0.1


@dataclass(frozen=True)
class SlipSettings:
    """Speed at which a foot that stood still is said to slide, m/s."""

    slip_speed_m_s: float


class SlipDetector:
    """Integrates what gravity does not explain.

    Watched only after rest (`plant`), which gives the direction of gravity. From then on

        r' = -w x r + (f - r) / REFERENCE_TIME_S       reference: specific force at rest, in the IMU's frame
        v' = -w x v + (f - r) - v / LEAK_TIME_S        speed since rest

    A steady unexplained acceleration a reads LEAK_TIME_S * a in the end: sliding at constant speed is invisible to an
    IMU, and so is any acceleration below slip_speed_m_s / LEAK_TIME_S.
    """

    def __init__(self, settings: SlipSettings) -> None:
        """Make a detector that is not watching yet."""
        self.settings = settings
        self._reference = (0.0, 0.0, 0.0)
        self._velocity = (0.0, 0.0, 0.0)
        self._onset_ns: int | None = None

    def plant(self, sample: ImuSample) -> None:
        """Begin to watch: the body rests, so `sample` shows gravity."""
        self._reference = (sample.force_x, sample.force_y, sample.force_z)
        self._stand_still()

    def planted(self, sample: ImuSample, interval_s: float, force_m_s2: float) -> ContactEvent | None:
        """Take the next sample and its |specific force|, m/s^2; return a slip if the body moves too fast."""
        if force_m_s2 < LOADED_M_S2:
            self._stand_still()
            return None
        time_ns, force_x, force_y, force_z, rate_x, rate_y, rate_z = sample
        reference_x, reference_y, reference_z = self._reference
        speed_x, speed_y, speed_z = self._velocity
        excess_x, excess_y, excess_z = force_x - reference_x, force_y - reference_y, force_z - reference_z
        follow = 1.0 / (interval_s + REFERENCE_TIME_S)
        self._reference = (
            reference_x + interval_s * (rate_z * reference_y - rate_y * reference_z + excess_x * follow),
            reference_y + interval_s * (rate_x * reference_z - rate_z * reference_x + excess_y * follow),
            reference_z + interval_s * (rate_y * reference_x - rate_x * reference_y + excess_z * follow),
        )
        keep = LEAK_TIME_S / (interval_s + LEAK_TIME_S)
        speed_x, speed_y, speed_z = (
            keep * (speed_x + interval_s * (rate_z * speed_y - rate_y * speed_z + excess_x)),
            keep * (speed_y + interval_s * (rate_x * speed_z - rate_z * speed_x + excess_y)),
            keep * (speed_z + interval_s * (rate_y * speed_x - rate_x * speed_y + excess_z)),
        )
        self._velocity = (speed_x, speed_y, speed_z)
        speed = math.sqrt(speed_x * speed_x + speed_y * speed_y + speed_z * speed_z)
        if speed < _ONSET_FRACTION * self.settings.slip_speed_m_s:
            self._onset_ns = None
            return None
        if self._onset_ns is None:
            self._onset_ns = time_ns
        if speed <= self.settings.slip_speed_m_s or self._upward() > UPWARD * speed:
            return None
        return ContactEvent(ContactKind.SLIP, time_ns, speed, M_S, (time_ns - self._onset_ns) / NANOSECONDS_PER_SECOND)

    def _upward(self) -> float:
        """Part of the speed along the reference, which points up, m/s."""
        reference_x, reference_y, reference_z = self._reference
        speed_x, speed_y, speed_z = self._velocity
        length = math.sqrt(reference_x * reference_x + reference_y * reference_y + reference_z * reference_z)
        return (speed_x * reference_x + speed_y * reference_y + speed_z * reference_z) / length if length else 0.0

    def _stand_still(self) -> None:
        self._velocity = (0.0, 0.0, 0.0)
        self._onset_ns = None
