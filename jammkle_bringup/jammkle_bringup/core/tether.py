"""Tie this process to the life of its parent, then become the command that follows.

    python tether.py PARENT_PID COMMAND [ARGUMENT ...]

The kernel sends SIGTERM when the parent ends, however it ends, so that a node still releases its solenoids and a
recorder still completes its bag. A file of its own, run as a script: doing the same between fork and exec
(`preexec_fn`) is not safe in a process with threads, and DDS has some.
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys

_PR_SET_PDEATHSIG = 1  # linux/prctl.h
_EXIT_ORPHANED = 143  # what a shell reports for SIGTERM


def main() -> None:
    """Set the parent-death signal and replace this process by the command."""
    parent, *command = sys.argv[1:]
    ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM, 0, 0, 0)
    if os.getppid() != int(parent):  # the parent ended before the signal was set
        sys.exit(_EXIT_ORPHANED)
    os.execv(command[0], command)  # noqa: S606 - no shell is wanted; the command is the supervisor's own


if __name__ == "__main__":
    main()
