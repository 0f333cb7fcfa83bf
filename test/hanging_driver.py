"""The driver's own process, whose node hangs for a while at SIGUSR1: its threads live on."""

from __future__ import annotations

import signal
import sys
import time

from jammkle_driver.__main__ import main

HANG_S = 2.0

if __name__ == "__main__":
    signal.signal(signal.SIGUSR1, lambda *_: time.sleep(HANG_S))
    sys.exit(main())
