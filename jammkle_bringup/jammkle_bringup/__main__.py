"""`jammkle`, `python -m jammkle_bringup` and `ros2 run jammkle_bringup jammkle`: the command."""

from __future__ import annotations

import sys

from jammkle_common.command.__main__ import main

if __name__ == "__main__":
    sys.exit(main())
