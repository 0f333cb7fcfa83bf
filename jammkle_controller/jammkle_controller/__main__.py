"""`python -m jammkle_controller` and `ros2 run jammkle_controller controller`."""

from __future__ import annotations

import sys

from jammkle_common.runner import run
from jammkle_controller.node import ControllerNode


def main() -> int:
    """Run the controller until SIGINT or SIGTERM and return the exit code."""
    return run(ControllerNode)


if __name__ == "__main__":
    sys.exit(main())
