"""`python -m jammkle_common.command`: the command, with handlers of signals from the first moment on.

Loading the command and ROS takes a second or two. A signal in that time would end Python with a traceback, or end the
process by the signal itself, although nothing has begun that would have to be stopped.
"""

from __future__ import annotations

import os
import signal
import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from types import FrameType

_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_ENDED_BY_SIGNAL = ("up", "record", "view")
"""Subcommands that run until a signal comes: one that comes early is no failure of theirs."""

_EXIT_INTERRUPTED = 130


def main() -> int:
    """Run the command and return its exit code."""
    for number in _SIGNALS:
        signal.signal(number, _end)
    from jammkle_common.command.main import main as run  # noqa: PLC0415 - after the handlers; see above
    from jammkle_common.processes import talk_by_udp  # noqa: PLC0415 - as above

    talk_by_udp(os.environ)
    return run()


def _end(_signal: int, _frame: FrameType | None) -> None:
    """End at once: what a subcommand starts, it starts under handlers of its own."""
    os.write(2, b"jammkle: interrupted\n")
    os._exit(0 if sys.argv[1:2] and sys.argv[1] in _ENDED_BY_SIGNAL else _EXIT_INTERRUPTED)


if __name__ == "__main__":
    sys.exit(main())
