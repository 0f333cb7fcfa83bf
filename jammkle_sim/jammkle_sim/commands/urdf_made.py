"""`jammkle urdf`: a robot description, printed."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

from jammkle_common.command.errors import InputError
from jammkle_common.parameters import ParameterError, as_typed, from_mapping
from jammkle_sim.robots.alone import ANKLE, ankle_alone
from jammkle_sim.robots.catalogue import robot as robot_of_ours
from jammkle_sim.robots.options import ROBOTS, RobotOptions
from jammkle_sim.robots.urdf import robot_urdf

if TYPE_CHECKING:
    from collections.abc import Mapping


def urdf(robot: str, namespace: str, options: Mapping[str, Any]) -> int:
    """Print the URDF.

    Args:
        robot: An ankle by itself, or one of our robots.
        namespace: Normalised ROS namespace that the frames begin with.
        options: Of the robot, by name; an ankle has none, and may be given the defaults alone.

    Raises:
        InputError: there is no such robot, or an option out of range.

    """
    if robot not in {ANKLE, *ROBOTS}:
        msg = f"ROBOT '{robot}' does not exist; it must be {', '.join((ANKLE, *ROBOTS))}"
        raise InputError(msg)
    try:
        chosen = from_mapping(RobotOptions, options)
    except ParameterError as error:
        raise InputError(as_typed(error)) from error
    if robot == ANKLE and chosen != RobotOptions():
        msg = "--imu and --payload-kg need ROBOT leg or quadruped: an ankle by itself carries nothing but its IMU"
        raise InputError(msg)
    sys.stdout.write(robot_urdf(ankle_alone() if robot == ANKLE else robot_of_ours(robot, chosen), namespace))
    return 0
