"""Run the driver: `python -m jammkle_driver` or `ros2 run jammkle_driver driver`."""

from __future__ import annotations

import sys

from jammkle_common.runner import run
from jammkle_driver.node import DriverNode


def main() -> int:
    """Run the driver node until SIGINT or SIGTERM; return the exit code."""
    return run(_make_node)


def _make_node() -> DriverNode:
    node = DriverNode()
    node.start()
    return node


if __name__ == "__main__":
    sys.exit(main())
