"""The load on a foot, from angles, rates and efforts of hip and knee: what moving the leg does not explain."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from jammkle_common.constants import NANOSECONDS_PER_SECOND, STANDARD_GRAVITY_M_S2

FOLLOW_TIME_S = 0.003
"""Time constant with which the load follows, s: two looks at 500 Hz, so that the noise of one rate does not count."""
LONGEST_S = 0.05
"""Readings further apart than this are not compared, s: a torque changes in between."""
LEAST_BEND = 0.1
"""Sine of the knee's angle below which a straight leg hides the load: torques do not tell it there. Six degrees."""
_HIGHEST = 1e4
"""Angles, rates and efforts beyond it are none, rad, rad/s, N m."""


class LegReading(NamedTuple):
    """Angles, rad, rates, rad/s, and efforts, N m, of hip and knee: counted from straight down and from the thigh.

    An angle about y, to the left, turns what hangs down backward. An effort is that of the servo on the joint, in the
    mean since the last control step, as drives tell it.
    """

    hip_rad: float
    knee_rad: float
    hip_rad_s: float
    knee_rad_s: float
    hip_n_m: float
    knee_n_m: float


@dataclass(frozen=True)
class LegModel:
    """What a leg of two links is, as far as its load is concerned; both links are taken for rods."""

    thigh_m: float
    """From hip to knee."""
    shank_m: float
    """From knee to ankle."""
    thigh_kg: float
    shank_kg: float
    """With ankle and foot."""
    shank_centre_m: float
    """From the knee to the centre of that mass."""
    armature_kg_m2: float
    """Inertia of a motor behind its gear, the same for both."""


class LegLoad:
    """Observes the force on a foot by the generalised momentum of its leg.

    With p = M(q) q' of a double pendulum, the torques that no servo makes are a first-order low-pass of
    p' - tau - C^T q' + g (De Luca, Albu-Schaeffer, Haddadin, Hirzinger, "Collision Detection and Safe Reaction with the
    DLR-III Lightweight Manipulator Arm", IROS 2006), here over the interval between two readings:

        r <- r + ((p1 - p0) / dt - mean(tau + C^T q' - g) - r) dt / (dt + FOLLOW_TIME_S),    r = J^T F

    The hip is taken as unaccelerated and upright, which leaves some newtons in a swing (`contact_load.SPREAD_N`), and
    the force as acting at the ankle: what its tendons bear of a force at toe or heel is some newtons in a stance.
    """

    def __init__(self, model: LegModel) -> None:
        """Know the leg, and have heard nothing of it."""
        self._model = model
        rod = 4.0 / 3.0  # of a rod about its end, in units of its mass by its centre's distance squared
        self._coupling = model.shank_kg * model.thigh_m * model.shank_centre_m
        self._shank = rod * model.shank_kg * model.shank_centre_m**2
        self._both = model.thigh_m**2 * (model.thigh_kg / 3.0 + model.shank_kg) + self._shank + model.armature_kg_m2
        self._thigh_weight_n_m = STANDARD_GRAVITY_M_S2 * model.thigh_m * (model.thigh_kg / 2.0 + model.shank_kg)
        self._shank_weight_n_m = STANDARD_GRAVITY_M_S2 * model.shank_kg * model.shank_centre_m
        self._before: tuple[int, float, float, float, float] | None = None
        self._hip_n_m = self._knee_n_m = 0.0

    def update(self, reading: LegReading, time_ns: int) -> float | None:
        """Return how hard the ground presses up on the foot, N, at a reading; None: it cannot be told now."""
        if not all(abs(value) < _HIGHEST for value in reading):  # a NaN is not less than anything
            return None
        hip, knee, hip_rate, knee_rate, hip_n_m, knee_n_m = reading
        sine, cosine = math.sin(knee), math.cos(knee)
        cross = self._shank + self._coupling * cosine
        momentum = (self._both + 2.0 * self._coupling * cosine) * hip_rate + cross * knee_rate
        knee_momentum = cross * hip_rate + (self._shank + self._model.armature_kg_m2) * knee_rate
        weight_n_m = self._shank_weight_n_m * math.sin(hip + knee)
        pull = hip_n_m - self._thigh_weight_n_m * math.sin(hip) - weight_n_m
        knee_pull = knee_n_m - weight_n_m - self._coupling * sine * hip_rate * (hip_rate + knee_rate)
        before, self._before = self._before, (time_ns, momentum, knee_momentum, pull, knee_pull)
        if before is None:
            return None
        elapsed_s = (time_ns - before[0]) / NANOSECONDS_PER_SECOND
        if not 0.0 < elapsed_s <= LONGEST_S:
            return None
        share = elapsed_s / (elapsed_s + FOLLOW_TIME_S)
        unexplained = (momentum - before[1]) / elapsed_s - (pull + before[3]) / 2.0
        knee_unexplained = (knee_momentum - before[2]) / elapsed_s - (knee_pull + before[4]) / 2.0
        self._hip_n_m += (unexplained - self._hip_n_m) * share
        self._knee_n_m += (knee_unexplained - self._knee_n_m) * share
        # r = J^T F solved for the upward part, with both torques: what rubs along the ground does not count.
        if abs(sine) < LEAST_BEND:
            return None
        model = self._model
        shank_m = model.shank_m * math.cos(hip + knee)
        both_m = model.thigh_m * math.cos(hip) + shank_m
        return (both_m * self._knee_n_m - shank_m * self._hip_n_m) / (model.thigh_m * model.shank_m * sine)
