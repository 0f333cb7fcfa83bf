"""The ways that are compared: a robot with controller and driver around each ankle, set up in one of them."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

from jammkle_controller.parameters import ControllerParameters, PolicyMode
from jammkle_driver.parameters import DriverParameters
from jammkle_sim.rigs.simulation import Simulation
from jammkle_sim.robots.catalogue import robot as made
from jammkle_sim.robots.options import ROBOTS, AnkleKind, RobotOptions
from studies.contact.loop import AnkleLoop
from studies.contact.mini_cheetah import mini_cheetah

if TYPE_CHECKING:
    from collections.abc import Iterator

    from jammkle_sim.rigs.simulation import Sample
    from jammkle_sim.robots.robot import Robot

AUTO, BLIND, KNOWING, FIXED, SOFT, JAMMED, RIGID, HINDSIGHT = (
    "auto",
    "auto, payload not known",
    "auto, slope known",
    "fixed",
    "always soft",
    "always jammed",
    "rigid",
    "hindsight",
)
WAYS = (AUTO, BLIND, KNOWING, FIXED, SOFT, JAMMED, RIGID, HINDSIGHT)
"""Of landings. Auto; auto that does not know the payload, and that knows the slope; one vacuum for every landing; the
ankle never jammed; always jammed; the same foot on a locked joint; and in hindsight the vacuum that was best for that
very landing."""
HELD_PA = ControllerParameters().hold_vacuum_pa
FEET = {"leg": 1, "quadruped": 4, "mini_cheetah": 4}
"""Robots that are tried, and on how many ankles they stand."""
RATE_HZ = 500
FILLED_S, JAMMED_S = 3.2, 1.2
"""When a trial may begin: with the reservoir full, or, where one vacuum is held without one, once that stands."""


def robot_of(name: str, options: RobotOptions) -> Robot:
    """Build one of FEET."""
    return made(name, options) if name in ROBOTS else mini_cheetah(options)


class Tried:
    """A robot in one way, at its start."""

    def __init__(self, robot: str, options: RobotOptions, way: str, vacuum_pa: float = 0.0) -> None:
        """Set it up.

        Args:
            robot: One of FEET.
            options: What it does, where; its reservoir counts for auto alone, and its kind of ankle is that of the way.
            way: One of WAYS but the last.
            vacuum_pa: Of the way fixed; 0: soft.

        """
        reservoir_m3 = options.reservoir_volume_m3 if by_policy(way) else 0.0
        kind = AnkleKind.RIGID if way == RIGID else AnkleKind.JAMMABLE
        options = dataclasses.replace(options, ankle=kind.value, reservoir_volume_m3=reservoir_m3)
        mode = PolicyMode.AUTO if by_policy(way) else PolicyMode.FIXED if way == FIXED else PolicyMode.ALWAYS_JAMMED
        if way == SOFT or (way == FIXED and vacuum_pa == 0.0):
            mode = PolicyMode.ALWAYS_SOFT
        self.simulation = Simulation(robot_of(robot, options))
        mass_kg = float(self.simulation.machine.model.body_mass.sum()) - options.payload_kg * (way == BLIND)
        controller = ControllerParameters(
            imu_mount=options.imu,
            policy=mode.value,
            hang_pitch_deg=options.hang_pitch_deg,
            landing_vacuum_pa=vacuum_pa or HELD_PA,
            load_kg=mass_kg / FEET[robot],
            slope_deg=options.slope_deg * (way == KNOWING),
        )
        # faults are not of concern, and take time
        driver = DriverParameters(reservoir_volume_m3=reservoir_m3, diagnose=False)
        ankles = () if way == RIGID else self.simulation.ankles.values()
        self._loops = [AnkleLoop(view, controller, driver) for view in ankles]

    def samples(self, duration_s: float) -> Iterator[Sample]:
        """Let it run, and give its samples at `RATE_HZ`.

        Raises:
            UnstableSimulationError: it blew up.

        """
        for sample in self.simulation.samples(duration_s, RATE_HZ):
            for loop in self._loops:
                loop.step(sample.time_s)
            yield sample


def by_policy(way: str) -> bool:
    """Whether the controller decides by itself, with a reservoir."""
    return way in (AUTO, BLIND, KNOWING)
