"""Our robots by name."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jammkle_common.parameters import ParameterError
from jammkle_sim.robots.leg import leg
from jammkle_sim.robots.options import ROBOTS
from jammkle_sim.robots.quadruped import quadruped
from jammkle_sim.robots.simulation import RobotSimulation

if TYPE_CHECKING:
    from collections.abc import Callable

    from jammkle_sim.robots.options import RobotOptions
    from jammkle_sim.robots.robot import Robot

_BUILT_BY: dict[str, Callable[[RobotOptions], Robot]] = dict(zip(ROBOTS, (leg, quadruped), strict=True))


def robot(name: str, options: RobotOptions) -> Robot:
    """Build one of our robots.

    Raises:
        ParameterError: there is no such robot, or an option out of range.

    """
    if name not in _BUILT_BY:
        msg = f"robot '{name}' does not exist; known are: {', '.join(ROBOTS)}"
        raise ParameterError(msg)
    return _BUILT_BY[name](options)


def robot_simulation(name: str, options: RobotOptions) -> RobotSimulation:
    """Build one of our robots, ready to run; as `robot` otherwise."""
    return RobotSimulation(robot(name, options))
