"""Randomised runs of the simulated robots: steps, landings and slips, for learning and for the trial."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np

from jammkle_contact.robot_stories import RATE_HZ, felt_on_the_body, of_the_body, run, story_of
from jammkle_contact.sensing import Drives, Estimator, draw_imu, read_body, read_leg, read_pose
from jammkle_controller.core.detector_settings import Mount
from jammkle_graph.names import CHANNELS
from jammkle_sim.rigs.simulation import UnstableSimulationError
from jammkle_sim.robots.catalogue import robot_simulation
from jammkle_sim.robots.options import RobotOptions
from jammkle_sim.robots.places import place_of

if TYPE_CHECKING:
    from jammkle_contact.story import Story

BEHAVIOURS = ("walk", "walk", "walk", "slip", "drop")
"""Drawn from; a walk holds many steps, a drop one landing."""
_DURATION_S = {"walk": 5.0, "slip": 2.5, "drop": 2.5}
_HELD_SHARE = 0.5
_LEVEL_SHARE = 0.5


def draw_options(chance: np.random.Generator, mount: str, *, wide: bool) -> RobotOptions:
    """Draw what a robot does; `wide` draws from the ranges of the held-out part."""
    behaviour = str(chance.choice(BEHAVIOURS))
    slips = behaviour == "slip"
    largest_deg = 35.0 if wide else 20.0
    slope_deg = 0.0 if chance.random() < _LEVEL_SHARE and not slips else float(chance.uniform(0.0, largest_deg))
    low, high = (0.08, 1.2) if wide else (0.15, 0.9)
    if behaviour == "walk":
        slope_deg = min(slope_deg, 12.0 if wide else 8.0)
    return RobotOptions(
        behaviour=behaviour,
        imu=mount,
        slope_deg=slope_deg,
        roughness_m=float(chance.choice([0.0, 0.0, 0.01, 0.02] if wide else [0.0, 0.0, 0.01])),
        friction=max(0.9, float(np.tan(np.radians(slope_deg))) + 0.3) if slips else float(chance.uniform(low, high)),
        slip_friction=float(chance.uniform(0.02, 0.8)) * float(np.tan(np.radians(slope_deg))),
        slip_time_s=float(chance.uniform(0.9, 1.3)),
        drop_height_m=float(chance.uniform(0.02, 0.12)),
        release_time_s=float(chance.uniform(0.5, 0.9)),
        speed_m_s=float(chance.uniform(-0.15, 0.4) if wide else chance.uniform(-0.1, 0.3)),
        step_period_s=float(chance.choice([0.36, 0.55, 0.8, 1.2]) if wide else chance.uniform(0.4, 0.9)),
        step_height_m=float(chance.uniform(0.015, 0.06) if wide else chance.uniform(0.02, 0.045)),
        touch_down_m_s=float(chance.uniform(0.0, 0.4) if wide else chance.uniform(0.02, 0.3)),
        payload_kg=float(chance.uniform(0.0, 3.0 if wide else 1.0)),
        seed=int(chance.integers(0, 2**31 - 1)),
    )


def robot_stories(robot: str, seed: int, mount: str, *, wide: bool = False) -> list[Story]:
    """Run a robot once, and return a story per ankle, or one of its body; none where it blew up.

    Args:
        robot: Name.
        seed: Everything is drawn from it.
        mount: Where the IMUs are: a value of `Mount`.
        wide: Whether it is of the held-out part.

    """
    chance = np.random.default_rng([seed, int(wide), 78])
    options = draw_options(chance, mount, wide=wide)
    simulation = robot_simulation(robot, options)
    if chance.random() < _HELD_SHARE:
        for view in simulation.ankles.values():
            view.hold_vacuum(dict.fromkeys(CHANNELS, 40e3))
    try:
        traces = run(simulation, _DURATION_S[options.behaviour])
    except UnstableSimulationError:
        return []
    feet, names = list(traces.values()), list(traces)
    if mount == Mount.BODY.value:
        traces = {"body": of_the_body(feet)}
    drives = np.random.default_rng([seed, int(wide), 79])  # of their own: the rest is drawn as before there were any
    legs = [read_leg(each.leg, RATE_HZ, Drives(), drives) for each in feet]
    joints = np.random.default_rng([seed, int(wide), 80])
    poses = [read_pose(each.pose, RATE_HZ, Drives(), leg, joints) for each, leg in zip(feet, legs, strict=True)]
    twists = read_body(feet[0].twist, RATE_HZ, Estimator(), joints)
    vibration = float(10.0 ** chance.uniform(-1.3, 0.0 if wide else -0.2))
    stories = [
        story_of(
            f"{robot} {options.behaviour} {seed} {name}", mount, each, draw_imu(chance, wide=wide), vibration, chance
        )
        for name, each in traces.items()
    ]
    if mount == Mount.BODY.value:
        stories = [felt_on_the_body(story, feet, legs) for story in stories]
    told = [
        dataclasses.replace(foot, legs=leg, poses=pose, twists=twists, place=place_of(name))
        for foot, leg, pose, name in zip(stories[0].feet or stories, legs, poses, names, strict=True)
    ]
    return told if not stories[0].feet else [dataclasses.replace(stories[0], feet=tuple(told))]
