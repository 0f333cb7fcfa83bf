"""`python -m jammkle_sim` and `ros2 run jammkle_sim sim`: the landing rig on the graph."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from jammkle_common.runner import run

if TYPE_CHECKING:
    from rclpy.executors import Executor

    from jammkle_common.runner import StopFlag
    from jammkle_sim.node import SimNode

LOADED_LATER = ("jammkle_sim.kinds", "jammkle_sim.node")
"""See `jammkle_common.processes`."""


def main() -> int:
    """Run the sim node until SIGINT or SIGTERM and return the exit code."""
    return run(_make_node, loop=drive, shut_down=shut_down)


def _make_node() -> SimNode:
    # Loading the physics takes a second or more; here it happens under the runner's signal handlers, so that Ctrl-C
    # during the start ends the process as cleanly as later.
    from jammkle_sim.kinds import make_simulation  # noqa: PLC0415
    from jammkle_sim.node import SimNode  # noqa: PLC0415

    return SimNode(make_simulation)


def drive(node: SimNode, executor: Executor, stop: StopFlag) -> None:
    """Let the node drive itself."""
    node.drive(executor, stop)


def shut_down(node: SimNode) -> None:
    """Let the node answer whoever waits."""
    node.shut_down()


if __name__ == "__main__":
    sys.exit(main())
