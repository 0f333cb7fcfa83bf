"""How a verb ends otherwise than well: bad input, a graph that fails, a request to stop. Each is one line."""

from __future__ import annotations

import contextlib
import signal
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator
    from types import FrameType


class InputError(ValueError):
    """Something that was asked for cannot be done. The message is one line: the value, the limit, the way out."""


class GraphError(RuntimeError):
    """The graph did not do what was asked for. The message is one line; the command exits with 1."""


_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class Interrupted(Exception):  # noqa: N818 - not an error: a person asked for it
    """The command was asked to stop while it waited for something."""


class StopRequest:
    """Callable that returns True once the process was asked to stop."""

    def __init__(self) -> None:
        """Make an unset request and listen for signals."""
        self._asked = False
        self._raised: type[Exception] | None = None
        for number in _SIGNALS:
            signal.signal(number, self._ask)

    def __call__(self) -> bool:
        """Return True once the process was asked to stop."""
        return self._asked

    @contextlib.contextmanager
    def at_once(self, raised: type[Exception]) -> Iterator[None]:
        """Raise something in the block where it is when the process is asked to stop, and if it was before."""
        self._raised = raised
        try:
            if self._asked:
                raise raised
            yield
        finally:
            self._raised = None

    def _ask(self, _signal: int, _frame: FrameType | None) -> None:
        self._asked = True
        raised, self._raised = self._raised, None
        if raised is not None:
            raise raised
