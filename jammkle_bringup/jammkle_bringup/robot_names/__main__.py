"""`python -m jammkle_bringup.robot_names` and `ros2 run jammkle_bringup robot_names`: the robot's own names."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from rclpy.executors import SingleThreadedExecutor

from jammkle_bringup.robot_names.node import RobotNamesNode
from jammkle_common.runner import run, spin

if TYPE_CHECKING:
    from rclpy.executors import Executor

    from jammkle_common.runner import StopFlag


def main() -> int:
    """Run the node until SIGINT or SIGTERM and return the exit code."""
    return run(RobotNamesNode, loop=_drive)


def _drive(node: RobotNamesNode, executor: Executor, stop: StopFlag) -> None:
    """Spin on rclpy's own executor: the events executor does not await what a service awaits."""
    executor.remove_node(node)
    awaiting = SingleThreadedExecutor()
    awaiting.add_node(node)
    spin(node, awaiting, stop)
    awaiting.shutdown()


if __name__ == "__main__":
    sys.exit(main())
