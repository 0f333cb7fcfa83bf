"""`python -m jammkle_sim.robot` and `ros2 run jammkle_sim robot`: a leg or a quadruped on the graph."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from jammkle_common.runner import run
from jammkle_sim.__main__ import LOADED_LATER, drive, shut_down

if TYPE_CHECKING:
    from jammkle_sim.node import SimNode

__all__ = ["LOADED_LATER", "main"]


def main() -> int:
    """Run the sim node until SIGINT or SIGTERM and return the exit code."""
    return run(_make_node, loop=drive, shut_down=shut_down)


def _make_node() -> SimNode:
    # As in __main__: physics is loaded under the runner's signal handlers.
    from jammkle_sim.kinds import ROBOT, make_robot  # noqa: PLC0415
    from jammkle_sim.node import SimNode  # noqa: PLC0415

    return SimNode(make_robot, ROBOT)


if __name__ == "__main__":
    sys.exit(main())
