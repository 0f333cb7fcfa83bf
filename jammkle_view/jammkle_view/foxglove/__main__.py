"""`python -m jammkle_view.foxglove` and `ros2 run jammkle_view foxglove`: a running graph in the Foxglove app."""

from __future__ import annotations

import importlib.util
import sys
from typing import TYPE_CHECKING

from jammkle_common.parameters import ParameterError
from jammkle_common.runner import run
from jammkle_view.foxglove.parameters import NOT_INSTALLED

if TYPE_CHECKING:
    from rclpy.executors import Executor

    from jammkle_common.runner import StopFlag
    from jammkle_view.foxglove.node import FoxgloveNode

LOADED_LATER = ("jammkle_view.foxglove.node",)
"""See `jammkle_common.processes`."""


def main() -> int:
    """Run the connection until SIGINT or SIGTERM and return the exit code."""
    return run(_make_node, loop=_drive, shut_down=_shut_down)


def _make_node() -> FoxgloveNode:
    if importlib.util.find_spec("foxglove") is None:
        raise ParameterError(NOT_INSTALLED)
    # The bag library is loaded under the runner's signal handlers.
    from jammkle_view.foxglove.node import FoxgloveNode  # noqa: PLC0415

    return FoxgloveNode()


def _drive(node: FoxgloveNode, executor: Executor, stop: StopFlag) -> None:
    node.drive(executor, stop)


def _shut_down(node: FoxgloveNode) -> None:
    node.shut_down()


if __name__ == "__main__":
    sys.exit(main())
