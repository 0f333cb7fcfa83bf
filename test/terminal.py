"""A program on a terminal of its own, with somebody who reads and types."""

from __future__ import annotations

import contextlib
import os
import pty
import select
import subprocess
import sys
import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

_TIMEOUT_S = 60.0
_LOOK_S = 0.01
_TAKE_TERMINAL = (
    "import fcntl, os, sys, termios; fcntl.ioctl(0, termios.TIOCSCTTY, 0); os.execv(sys.argv[1], sys.argv[1:])"
)
"""Makes the terminal the controlling one, so that Ctrl-C and closing it are signals."""

CTRL_C = "\x03"


class Terminal:
    """Runs a program on a pseudo terminal until closed."""

    def __init__(self, command: Sequence[str]) -> None:
        self._ours, theirs = pty.openpty()
        self.process = subprocess.Popen(
            [sys.executable, "-c", _TAKE_TERMINAL, *command],
            stdin=theirs,
            stdout=theirs,
            stderr=theirs,
            start_new_session=True,
        )
        os.close(theirs)
        self.text = ""

    def __enter__(self) -> Terminal:  # noqa: PYI034 - Self is not in Python 3.10
        """Return itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """End the program, and close the terminal."""
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()
        self.hang_up()

    def read(self) -> None:
        """Take what was written meanwhile."""
        with contextlib.suppress(OSError):  # the other end was closed
            while select.select([self._ours], [], [], 0.0)[0]:
                came = os.read(self._ours, 4096)
                if not came:
                    return
                self.text += came.decode()

    def wait_until(self, holds: Callable[[], bool]) -> None:
        """Read until something holds."""
        deadline_s = time.monotonic() + _TIMEOUT_S
        while not holds():
            assert time.monotonic() < deadline_s, self.text
            self.read()
            time.sleep(_LOOK_S)

    def wait_for(self, words: str, times: int = 1) -> None:
        """Read until these words were there so many times."""
        self.wait_until(lambda: self.text.count(words) >= times)

    def type(self, text: str) -> None:
        """Type."""
        os.write(self._ours, text.encode())

    def hang_up(self) -> None:
        """Close the terminal."""
        if self._ours >= 0:
            os.close(self._ours)
        self._ours = -1

    def ended(self) -> int:
        """Wait for the program's end, and return its exit code."""
        self.wait_until(lambda: self.process.poll() is not None)
        self.read()
        return int(self.process.returncode)
