"""What the ankle is good for beside landings: the push that a stance withstands, and how rough ground shakes a body."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from sklearn.linear_model import LogisticRegression  # type: ignore[import-untyped]  # carries no types

from jammkle_sim.rigs.simulation import UnstableSimulationError
from jammkle_sim.robots.options import RobotOptions
from studies.contact.ways import FEET, Tried

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from jammkle_sim.rigs.simulation import Sample

_STOOD_S = 2.0
"""How long a robot has stood when it is pushed: at rest for 1 s, ankles are held, and that takes 0.4 s."""
PUSHED_S = 0.1
"""How long a push lasts."""
PUSH_M_S = (0.4, 1.8)
"""Pushes are drawn from here, evenly by their logarithm: impulse over mass."""
_WATCHED_S = 1.5
FALLEN_RAD = math.radians(45.0)
"""A body that has tilted by as much has fallen."""
_WALKED_S, _FROM_S = 5.0, 1.0
_RESAMPLES = 1000


class Pushed(NamedTuple):
    """What came of one push."""

    push_m_s: float
    """Its impulse over the robot's mass."""
    tilt_rad: float
    """Largest tilt of the body from how it stood."""
    slid_m: float
    """Mean way slid by a foot."""

    @property
    def fell(self) -> bool:
        """Whether the robot fell."""
        return self.tilt_rad > FALLEN_RAD


class Walked(NamedTuple):
    """What came of one walk."""

    roll_rad: float
    """Root mean square of the body's roll."""
    pitch_rad: float
    """Root mean square of its pitch."""
    speed_m_s: float
    slid_m: float
    """Mean way slid by a foot."""
    tilt_rad: float
    """Largest tilt of the body."""

    @property
    def fell(self) -> bool:
        """Whether the robot fell."""
        return self.tilt_rad > FALLEN_RAD


def draw_push(robot: str, seed: int) -> tuple[RobotOptions, float]:
    """Draw a stance on a slope of up to 15 degrees, at times rough, with a payload, and a push from left or right."""
    chance = np.random.default_rng([seed, 80])
    slope_deg = float(chance.uniform(0.0, 15.0))
    options = RobotOptions(
        behaviour="stand",
        imu="body",
        slope_deg=slope_deg,
        roughness_m=float(chance.choice([0.0, 0.0, 0.01, 0.02])),
        friction=math.tan(math.radians(slope_deg)) + float(chance.uniform(0.5, 1.0)),
        payload_kg=FEET[robot] * float(chance.uniform(0.0, 1.0)),
        seed=seed,
    )
    low, high = np.log(PUSH_M_S)
    return options, float(chance.choice([-1.0, 1.0]) * math.exp(chance.uniform(low, high)))


def push(robot: str, seed: int, way: str, vacuum_pa: float = 0.0) -> Pushed | None:
    """Push a robot that stands, at its base, from the side; None where the simulation blew up.

    Args:
        robot: One of FEET.
        seed: Of the stance and the push.
        way: One of WAYS.
        vacuum_pa: Of the way fixed.

    """
    options, push_m_s = draw_push(robot, seed)
    tried = Tried(robot, options, way, vacuum_pa)
    model, data = tried.simulation.machine.model, tried.simulation.data
    base = model.body(tried.simulation.machine.base).id
    force_n = float(model.body_mass.sum()) * push_m_s / PUSHED_S
    samples = tried.samples(_STOOD_S + _WATCHED_S)
    tilted_rad = way_m = 0.0
    try:
        stood = next(sample for sample in samples if sample.time_s >= _STOOD_S)
        for sample in samples:
            data.xfrc_applied[base, 1] = force_n * (sample.time_s < _STOOD_S + PUSHED_S)
            tilted_rad = max(tilted_rad, tilt_rad(sample, stood))
            way_m = slid_m(sample) - slid_m(stood)
    except UnstableSimulationError:
        return None
    return Pushed(abs(push_m_s), tilted_rad, way_m)


def draw_walk(robot: str, seed: int) -> RobotOptions:
    """Draw a walk on rough level ground, with a payload."""
    chance = np.random.default_rng([seed, 81])
    return RobotOptions(
        behaviour="walk",
        imu="body",
        roughness_m=float(chance.uniform(0.005, 0.025)),
        friction=float(chance.uniform(0.6, 1.0)),
        payload_kg=FEET[robot] * float(chance.uniform(0.0, 0.5)),
        speed_m_s=float(chance.uniform(0.05, 0.2)),
        seed=seed,
    )


def walk(robot: str, seed: int, way: str, vacuum_pa: float = 0.0) -> Walked | None:
    """Let a robot walk on rough ground; None where the simulation blew up. Arguments as of `push`."""
    samples = Tried(robot, draw_walk(robot, seed), way, vacuum_pa).samples(_WALKED_S)
    try:
        begun, *walked = (sample for sample in samples if sample.time_s >= _FROM_S)
    except UnstableSimulationError:
        return None
    forward, left, up = np.array([_up(sample) for sample in walked]).T
    angles_rad = np.array([np.arctan2(-left, up), np.arctan2(forward, up)])
    roll_rad, pitch_rad = np.sqrt(np.mean(angles_rad**2, axis=1)).tolist()
    last = walked[-1]
    speed_m_s = (last.base_position_m[0] - begun.base_position_m[0]) / (_WALKED_S - _FROM_S)
    tilted_rad = float(np.arccos(np.minimum(up, 1.0)).max())
    return Walked(roll_rad, pitch_rad, speed_m_s, slid_m(last) - slid_m(begun), tilted_rad)


def slid_m(sample: Sample) -> float:
    """Return how far a foot has slid since the start, m, in the mean over feet."""
    return float(np.mean([ankle.foot.sliding_distance_m for ankle in sample.ankles.values()]))


def _up(sample: Sample) -> NDArray[np.float64]:
    """Return the body's z axis in the world."""
    w, x, y, z = sample.base.rotation
    return np.array([2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)])


def tilt_rad(sample: Sample, before: Sample) -> float:
    """Return the angle between the body's z axes at two times, rad."""
    return math.acos(min(float(_up(sample) @ _up(before)), 1.0))


def push_of_half_m_s(pushes: Sequence[Pushed]) -> tuple[float, float, float] | None:
    """Return the push that half of the stances withstand, m/s, and its 95 % bootstrap interval.

    By logistic regression of falls on the push's logarithm (the method of Bliss 1934 for doses, with a logit); None
    where all fall, or none does.
    """
    logs, fell = np.log([each.push_m_s for each in pushes]), np.array([each.fell for each in pushes])
    if fell.all() or not fell.any():
        return None
    chance = np.random.default_rng(1)
    halves = []
    for _ in range(_RESAMPLES):
        drawn = chance.integers(len(fell), size=len(fell))
        if 0 < fell[drawn].sum() < len(fell):
            halves.append(_half_m_s(logs[drawn], fell[drawn]))
    low, high = np.percentile(halves, (2.5, 97.5))
    return _half_m_s(logs, fell), float(low), float(high)


def _half_m_s(logs: NDArray[np.float64], fell: NDArray[np.bool_]) -> float:
    fitted: Any = LogisticRegression(C=100.0).fit(logs[:, None], fell)
    return math.exp(-fitted.intercept_[0] / fitted.coef_[0, 0])
