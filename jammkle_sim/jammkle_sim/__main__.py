"""`python -m jammkle_sim` and `ros2 run jammkle_sim sim`: the landing rig on the graph."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from jammkle_common.runner import run

if TYPE_CHECKING:
    from jammkle_sim.node import SimNode

LOADED_LATER = ("jammkle_sim.kinds", "jammkle_sim.node")
"""See `jammkle_common.processes`."""


def main() -> int:
    """Run the sim node until SIGINT or SIGTERM and return the exit code."""
    return run_sim("RIG")


def run_sim(kind: str) -> int:
    """Run the sim node with a kind of `jammkle_sim.kinds`, by its name there, as `main` does."""

    def make_node() -> SimNode:
        # Loading the physics takes a second or more; here it happens under the runner's signal handlers, so that Ctrl-C
        # during the start ends the process as cleanly as later.
        from jammkle_sim import kinds  # noqa: PLC0415
        from jammkle_sim.node import SimNode  # noqa: PLC0415

        return SimNode(getattr(kinds, kind))

    return run(make_node)


if __name__ == "__main__":
    sys.exit(main())
