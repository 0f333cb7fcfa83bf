"""`python -m jammkle_view.foxglove` and `ros2 run jammkle_view foxglove`: a running graph in the Foxglove app."""

from __future__ import annotations

import importlib.util
import sys
from typing import TYPE_CHECKING

from jammkle_common.parameters import ParameterError
from jammkle_common.runner import run
from jammkle_view.parameters import NO_FOXGLOVE

if TYPE_CHECKING:
    from jammkle_view.foxglove.node import FoxgloveNode

LOADED_LATER = ("jammkle_view.foxglove.node",)
"""See `jammkle_common.processes`."""


def main() -> int:
    """Run the connection until SIGINT or SIGTERM and return the exit code."""
    return run(
        _make_node,
        loop=lambda node, executor, stop: node.drive(executor, stop),
        shut_down=lambda node: node.shut_down(),
    )


def _make_node() -> FoxgloveNode:
    if importlib.util.find_spec("foxglove") is None:
        raise ParameterError(NO_FOXGLOVE)
    # The bag library is loaded under the runner's signal handlers.
    from jammkle_view.foxglove.node import FoxgloveNode  # noqa: PLC0415

    return FoxgloveNode()


if __name__ == "__main__":
    sys.exit(main())
