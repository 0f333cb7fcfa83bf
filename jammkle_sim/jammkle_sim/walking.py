"""The robot that the sim node simulates, from the node's parameters."""

from __future__ import annotations

from dataclasses import fields
from typing import TYPE_CHECKING

from jammkle_sim.robots.catalogue import robot_simulation
from jammkle_sim.robots.options import RobotOptions

if TYPE_CHECKING:
    from jammkle_sim.parameters import RobotParameters
    from jammkle_sim.robots.simulation import RobotSimulation


def make_robot(parameters: RobotParameters) -> RobotSimulation:
    """Build the robot.

    Args:
        parameters: The node's parameters.

    Raises:
        ParameterError: the robot refuses a value.

    """
    options = robot_options(parameters)
    # The first step of a process compiles or loads the laws, or else simulated time would start with a backlog.
    robot_simulation(parameters.robot, options).advance(1)
    return robot_simulation(parameters.robot, options)


def robot_options(parameters: RobotParameters) -> RobotOptions:
    """Return what the parameters say of the robot; speed and rates are none of its business."""
    return RobotOptions(**{field.name: getattr(parameters, field.name) for field in fields(RobotOptions)})
