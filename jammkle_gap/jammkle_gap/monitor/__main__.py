"""`python -m jammkle_gap.monitor` and `ros2 run jammkle_gap gap_monitor`: the live gap to the simulator."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from jammkle_common.runner import run

if TYPE_CHECKING:
    from jammkle_gap.monitor.node import GapMonitorNode


def main() -> int:
    """Run the gap monitor until SIGINT or SIGTERM and return the exit code."""
    return run(_make_node)


def _make_node() -> GapMonitorNode:
    # Loading the physics takes a second or more; here it happens under the runner's signal handlers.
    from jammkle_gap.monitor.node import GapMonitorNode  # noqa: PLC0415

    return GapMonitorNode()


if __name__ == "__main__":
    sys.exit(main())
