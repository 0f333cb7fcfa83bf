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


def end_with_parent(parent: int) -> None:
    """Have the kernel send SIGTERM to this process when its parent, whose process id is given, ends."""
    ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM, 0, 0, 0)
    if os.getppid() != parent:  # the parent ended before the signal was set
        sys.exit(_EXIT_ORPHANED)


def main() -> None:
    """Tie this process to its parent and replace it by the command."""
    parent, *command = sys.argv[1:]
    end_with_parent(int(parent))
    os.execv(command[0], command)  # noqa: S606 - no shell is wanted; the command is the supervisor's own


if __name__ == "__main__":
    main()
