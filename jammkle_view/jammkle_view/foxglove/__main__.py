"""`python -m jammkle_view.foxglove` and `ros2 run jammkle_view foxglove`: a running graph in the Foxglove app."""

from __future__ import annotations

import sys

from jammkle_view.__main__ import run_loaded
from jammkle_view.parameters import NO_FOXGLOVE

LOADED_LATER = ("jammkle_view.foxglove.node",)
"""See `jammkle_common.processes`."""


def main() -> int:
    """Run the connection until SIGINT or SIGTERM and return the exit code."""
    return run_loaded("jammkle_view.foxglove.node", "FoxgloveNode", "foxglove", NO_FOXGLOVE)


if __name__ == "__main__":
    sys.exit(main())
