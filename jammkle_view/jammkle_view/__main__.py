"""`python -m jammkle_view` and `ros2 run jammkle_view viewer`: the page of a running graph."""

from __future__ import annotations

import importlib.util
import sys
from typing import TYPE_CHECKING

from jammkle_common.parameters import ParameterError
from jammkle_common.runner import run
from jammkle_view.parameters import NOT_INSTALLED

if TYPE_CHECKING:
    from rclpy.executors import Executor

    from jammkle_common.runner import StopFlag
    from jammkle_view.node import ViewerNode

LOADED_LATER = ("jammkle_view.node",)
"""See `jammkle_common.processes`."""


def main() -> int:
    """Run the viewer until SIGINT or SIGTERM and return the exit code."""
    return run(_make_node, loop=_drive, shut_down=_shut_down)


def _make_node() -> ViewerNode:
    if importlib.util.find_spec("viser") is None:
        raise ParameterError(NOT_INSTALLED)
    # Loading MuJoCo and viser takes a second; here it happens under the runner's signal handlers.
    from jammkle_view.node import ViewerNode  # noqa: PLC0415

    return ViewerNode()


def _drive(node: ViewerNode, executor: Executor, stop: StopFlag) -> None:
    node.drive(executor, stop)


def _shut_down(node: ViewerNode) -> None:
    node.shut_down()


if __name__ == "__main__":
    sys.exit(main())
