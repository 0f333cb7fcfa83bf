"""`python -m jammkle_view` and `ros2 run jammkle_view viewer`: the page of a running graph."""

from __future__ import annotations

import importlib
import importlib.util
import sys

from jammkle_common.parameters import ParameterError
from jammkle_common.runner import run
from jammkle_view.parameters import NO_PAGE

LOADED_LATER = ("jammkle_view.node",)
"""See `jammkle_common.processes`."""


def main() -> int:
    """Run the viewer until SIGINT or SIGTERM and return the exit code."""
    return run_loaded("jammkle_view.node", "ViewerNode", "viser", NO_PAGE)


def run_loaded(module: str, node: str, needs: str, way_out: str) -> int:
    """Run a node of a module, loaded under the runner's signal handlers, as that takes a second; it needs a library."""

    def make_node():  # noqa: ANN202 - what the module has
        if importlib.util.find_spec(needs) is None:
            raise ParameterError(way_out)
        return getattr(importlib.import_module(module), node)()

    return run(make_node)


if __name__ == "__main__":
    sys.exit(main())
