"""`python -m jammkle_sim.robot` and `ros2 run jammkle_sim robot`: a leg or a quadruped on the graph."""

from __future__ import annotations

import sys

from jammkle_sim.__main__ import LOADED_LATER, run_sim

__all__ = ["LOADED_LATER", "main"]


def main() -> int:
    """Run the sim node until SIGINT or SIGTERM and return the exit code."""
    return run_sim("ROBOT")


if __name__ == "__main__":
    sys.exit(main())
