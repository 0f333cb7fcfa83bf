"""What the policy is good for: the same landings and slips with it, always soft, always jammed, and rigid."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from jammkle_controller.parameters import ControllerParameters
from jammkle_sim.rigs.simulation import UnstableSimulationError
from jammkle_sim.robots.catalogue import robot_simulation
from jammkle_sim.robots.options import AnkleKind, RobotOptions
from studies.contact.loop import AnkleLoop
from studies.contact.robots import RATE_HZ
from studies.contact.trial import median_with_interval, wilson

if TYPE_CHECKING:
    from collections.abc import Callable

WAYS = ("auto", "always_soft", "always_jammed", "rigid")
ROBOTS = ("leg", "quadruped")
BEHAVIOURS = ("drop", "slip")
_DURATION_S = 2.5
_SMOOTHED_S = 0.005
"""A peak of the base's acceleration is one of its mean over this time, s."""
_FALLEN_RAD = math.radians(45.0)


@dataclass(frozen=True)
class BenefitRow:
    """Figures of one robot, run and way: medians and shares with their intervals."""

    robot: str
    behaviour: str
    way: str
    runs: int
    peak_m_s2: tuple[float, float, float]
    slid_m: tuple[float, float, float]
    absorbed_j: tuple[float, float, float]
    falls: tuple[float, float, float]

    def as_dict(self) -> dict[str, Any]:
        """Return it for machines; NaN becomes None."""
        return {
            name: None if isinstance(value, tuple) and any(map(math.isnan, value)) else value
            for name, value in dataclasses.asdict(self).items()
        }


class Measured(NamedTuple):
    """What came of one run, from the release or the slip on."""

    peak_m_s2: float
    """Largest deceleration of the base."""
    slid_m: float
    """Mean way slid by a foot."""
    absorbed_j: float
    """Work done on the tendons of all ankles, less what they gave back: the integral of tension by extension."""
    fell: bool


def draw(behaviour: str, seed: int) -> RobotOptions:
    """Draw one landing or slip."""
    chance = np.random.default_rng([seed, 79])
    slope_deg = float(chance.uniform(0.0, 15.0) if behaviour == "drop" else chance.uniform(8.0, 20.0))
    grip = math.tan(math.radians(slope_deg))
    return RobotOptions(
        behaviour=behaviour,
        imu="body",
        slope_deg=slope_deg,
        friction=grip + 0.4,
        slip_friction=float(chance.uniform(0.5, 1.1)) * grip,
        slip_time_s=1.0,
        drop_height_m=float(chance.uniform(0.03, 0.1)),
        release_time_s=0.8,
        payload_kg=float(chance.uniform(0.0, 1.0)),
        seed=seed,
    )


def measure(robot: str, options: RobotOptions, way: str) -> Measured:
    """Run a robot once.

    Raises:
        UnstableSimulationError: it blew up.

    """
    kind = AnkleKind.RIGID if way == "rigid" else AnkleKind.JAMMABLE
    simulation = robot_simulation(robot, dataclasses.replace(options, ankle=kind.value))
    mode = "auto" if way == "rigid" else way
    controller = ControllerParameters(imu_mount=options.imu, policy=mode)
    loops = [] if way == "rigid" else [AnkleLoop(view, controller) for view in simulation.ankles.values()]
    begin_s = options.release_time_s if options.behaviour == "drop" else options.slip_time_s
    speeds, slid, absorbed_j, fell = [], 0.0, 0.0, False
    for sample in simulation.samples(_DURATION_S, RATE_HZ):
        for loop in loops:
            loop.step(sample.time_s)
        if sample.time_s >= begin_s:
            speeds.append(sample.base_velocity_m_s[2])
            tendons = (tendon for ankle in sample.ankles.values() for tendon in ankle.tendons)
            absorbed_j += sum(tendon.tension_n * tendon.extension_rate_m_s for tendon in tendons) / RATE_HZ
        fell |= sample.base_tilt_rad > _FALLEN_RAD
        slid = float(np.mean([ankle.foot.sliding_distance_m for ankle in sample.ankles.values()]))
    window = round(_SMOOTHED_S * RATE_HZ)
    rises = np.array(speeds)[window:] - np.array(speeds)[:-window]
    return Measured(float(rises.max() / _SMOOTHED_S), slid, absorbed_j, fell)


def _measured(robot: str, options: RobotOptions, way: str) -> Measured | None:
    """Measure; None where the simulation blew up."""
    try:
        return measure(robot, options, way)
    except UnstableSimulationError:
        return None


def benefit(seed: int, runs: int, on_progress: Callable[[float, str], None]) -> list[BenefitRow]:
    """Measure every robot, run and way on the same `runs` draws."""
    rows = []
    for number, (robot, behaviour) in enumerate((r, b) for r in ROBOTS for b in BEHAVIOURS):
        for way in WAYS:
            on_progress(number / (len(ROBOTS) * len(BEHAVIOURS)), f"{robot} {behaviour} {way}")
            tries = (_measured(robot, draw(behaviour, 1000 * seed + index), way) for index in range(runs))
            measured = [each for each in tries if each is not None]
            rows.append(
                BenefitRow(
                    robot,
                    behaviour,
                    way,
                    len(measured),
                    median_with_interval([each.peak_m_s2 for each in measured]),
                    median_with_interval([each.slid_m for each in measured]),
                    median_with_interval([each.absorbed_j for each in measured]),
                    wilson(sum(each.fell for each in measured), len(measured)),
                )
            )
    return rows
