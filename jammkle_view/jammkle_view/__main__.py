"""`python -m jammkle_view` and `ros2 run jammkle_view viewer`: the page of a running graph."""

from __future__ import annotations

import importlib.util
import sys
from typing import TYPE_CHECKING

from jammkle_common.parameters import ParameterError
from jammkle_common.runner import run
from jammkle_view.parameters import NO_PAGE

if TYPE_CHECKING:
    from jammkle_view.node import ViewerNode

LOADED_LATER = ("jammkle_view.node",)
"""See `jammkle_common.processes`."""


def main() -> int:
    """Run the viewer until SIGINT or SIGTERM and return the exit code."""
    return run(
        _make_node,
        loop=lambda node, executor, stop: node.drive(executor, stop),
        shut_down=lambda node: node.shut_down(),
    )


def _make_node() -> ViewerNode:
    if importlib.util.find_spec("viser") is None:
        raise ParameterError(NO_PAGE)
    # Loading MuJoCo and viser takes a second; here it happens under the runner's signal handlers.
    from jammkle_view.node import ViewerNode  # noqa: PLC0415

    return ViewerNode()


if __name__ == "__main__":
    sys.exit(main())
