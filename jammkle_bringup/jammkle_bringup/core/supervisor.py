"""Start the processes of a graph, watch them, say which one died, and stop them in order."""

from __future__ import annotations

import collections
import contextlib
import os
import signal
import subprocess
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from jammkle_common import processes
from jammkle_common.constants import NANOSECONDS_PER_SECOND

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from types import TracebackType

    from typing_extensions import Self

STOP_TIMEOUT_S = 10.0
"""How long a process may take to end after SIGTERM before it is killed, without the time for which it waited for a
core. Assumed: nodes need about 0.2 s, and 20 s of real time were seen where twenty processes wanted two cores."""

LAST_WORDS_S = 5.0
"""What a process said longer than this before its end, s, is not about it: an error of an hour ago may be long cleared.
Chosen: a traceback comes milliseconds before, and who hangs before it ends does so for a few seconds."""

_STACKS_END = ("  File ", "Extension modules: ")
"""How the last line of what faulthandler writes begins: the outermost call, or the modules that are not Python's."""
_KEPT_LINES = 5
_READER_TIMEOUT_S = 1.0
_LAST_WORDS_TIMEOUT_S = 2.0
"""How long a process that hangs may take to say where. Chosen: writing that takes milliseconds."""
_LOOK_PERIOD_S = 0.1


@dataclass(frozen=True)
class ChildSpec:
    """One process to start: its name for people and its command, whose first entry is an absolute path.

    `stop_timeout_s` is how long it may take to end before it is killed, without the time for which it waits for a core
    of a busy machine. What only `looks_on` may die, once all has started, without taking the others along. Those of one
    `kind` that start one after the other, such as the drivers of several ankles, are stopped together; without a kind a
    process is stopped alone.
    """

    name: str
    command: tuple[str, ...]
    stop_timeout_s: float = STOP_TIMEOUT_S
    looks_on: bool = False
    kind: str = ""


@dataclass(frozen=True)
class Death:
    """A process that ended without being asked to, or badly when asked.

    `last_lines` is the end of its output, as far as it said that within `LAST_WORDS_S` before its end.
    """

    name: str
    exit_code: int
    last_lines: tuple[str, ...]

    def text(self) -> str:
        """Return one line for people: who, how, and the last thing it said, where that was at its end."""
        said = f"; it said: {self.last_lines[-1]}" if self.last_lines else ""
        if self.last_lines and self.last_lines[-1].startswith(_STACKS_END):
            said = "; where it was stands above"
        return f"{self.name} died with {exit_text(self.exit_code)}{said}"


def exit_text(exit_code: int) -> str:
    """Return `exit code 3`, or `signal SIGKILL` for the negative codes of the subprocess module."""
    if exit_code >= 0:
        return f"exit code {exit_code}"
    try:
        return f"signal {signal.Signals(-exit_code).name}"
    except ValueError:
        return f"signal {-exit_code}"


@dataclass(frozen=True)
class _CoreTime:
    """What the threads of a process got of the cores so far, of the one that got or wanted most, s.

    Linux counts it (Documentation/scheduler/sched-stats.rst, the first two numbers of schedstat), and a wait for a core
    once it is over; where it does not, all is zero.
    """

    used_s: float
    waited_s: float
    waits: bool
    """Whether a thread runs or waits for a core now."""

    @classmethod
    def of(cls, process_id: int) -> Self:
        """Return that of a process; of one that has ended, none."""
        used_ns, waited_ns, waits = [0], [0], False
        for thread in Path(f"/proc/{process_id}/task").glob("*"):
            with contextlib.suppress(OSError):  # the thread has ended
                used, waited, _ = (thread / "schedstat").read_text().split()
                used_ns.append(int(used))
                waited_ns.append(int(waited))
                waits |= (thread / "stat").read_text().rpartition(")")[2].split()[0] == "R"
        return cls(max(used_ns) / NANOSECONDS_PER_SECOND, max(waited_ns) / NANOSECONDS_PER_SECOND, waits)


class _Child:
    def __init__(self, spec: ChildSpec, on_line: Callable[[str, str], None], *, held: bool) -> None:
        self.spec = spec
        command = processes.held(spec.command) if held else spec.command
        self._lines: collections.deque[tuple[float, str]] = collections.deque(maxlen=_KEPT_LINES)
        self._ended_s: float | None = None
        self._asked_s, self._had = 0.0, _CoreTime(0.0, 0.0, waits=False)
        self._on_line = on_line
        self.process = subprocess.Popen(  # noqa: S603 - the command is the caller's own, and no shell reads it
            processes.tied(command),
            stdin=subprocess.PIPE if held else subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            bufsize=1,
            start_new_session=True,  # Ctrl-C in the terminal reaches the parent alone, which then stops in order
        )
        self._reader = threading.Thread(target=self._read, name=f"read {spec.name}", daemon=True)
        self._reader.start()

    def _read(self) -> None:
        if self.process.stdout is None:
            return
        for line in self.process.stdout:
            stripped = line.rstrip()
            if stripped:
                self._lines.append((time.monotonic(), stripped))
                with contextlib.suppress(OSError, ValueError):  # who reads on our end is gone: the child must not block
                    self._on_line(self.spec.name, stripped)
        self._ended_s = time.monotonic()

    def release(self) -> None:
        """Let a process start that was held; one that has died meanwhile is reported later."""
        if self.process.stdin is not None:
            with contextlib.suppress(OSError):
                self.process.stdin.write("\n")
                self.process.stdin.close()
            self.process.stdin = None

    def death(self) -> Death:
        """Return how the ended process ended, after all that it said was read."""
        self._read_to_the_end()
        ended_s = time.monotonic() if self._ended_s is None else self._ended_s
        last = tuple(line for said_s, line in tuple(self._lines) if ended_s - said_s <= LAST_WORDS_S)
        return Death(self.spec.name, self.process.returncode, last)

    def ask_to_end(self) -> None:
        """Send SIGTERM to what still runs."""
        if self.process.poll() is None:
            self._asked_s, self._had = time.monotonic(), _CoreTime.of(self.process.pid)
            self.process.terminate()

    def wait_or_kill(self) -> None:
        """Wait for what was asked to end; at last end it and its session by force."""
        while self.process.poll() is None:
            has, limit_s = _CoreTime.of(self.process.pid), self.spec.stop_timeout_s
            waited_s = has.waited_s - self._had.waited_s
            left_s = limit_s + waited_s - (time.monotonic() - self._asked_s)
            if left_s > 0.0 or (has.waits and has.used_s - self._had.used_s < limit_s):
                with contextlib.suppress(subprocess.TimeoutExpired):
                    self.process.wait(max(left_s, _LOOK_PERIOD_S))
            else:
                self._kill()
        self._read_to_the_end()

    def _kill(self) -> None:
        """End what hangs: first by SIGABRT, upon which Python says where each thread is (faulthandler)."""
        self.process.send_signal(signal.SIGABRT)
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.process.wait(_LAST_WORDS_TIMEOUT_S)
        with contextlib.suppress(ProcessLookupError):  # nothing of its session is left
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()

    def _read_to_the_end(self) -> None:
        """Hand on what the ended process said last; a process of its own that outlives it may hold the line open."""
        self._reader.join(_READER_TIMEOUT_S)


class Supervisor:
    """Processes that belong together: all run, or all are stopped.

    They are started in the order given and stopped in the reverse order, one kind after the other, so that what starts
    first (a recorder) sees all of what the others do when they stop, and no ankle waits for another to be let go.
    """

    def __init__(
        self,
        specs: Sequence[ChildSpec],
        on_line: Callable[[str, str], None],
        *,
        held: bool = False,
        on_loss: Callable[[Death], None] = lambda _: None,
    ) -> None:
        """Prepare; nothing is started yet.

        Args:
            specs: What to start, in order.
            on_line: Called with the name and every line that a process writes, from another thread.
            held: Whether the processes, each a `python -m MODULE`, only load until `release` is called.
            on_loss: Called once with a process that only looked on, and has died after all was loaded.

        """
        self._held = held
        self._specs = tuple(specs)
        self._on_line = on_line
        self._children: list[_Child] = []
        self._loading = True
        self._on_loss = on_loss

    def __enter__(self) -> Self:
        """Start all processes."""
        try:
            for spec in self._specs:
                self._children.append(_Child(spec, self._on_line, held=self._held))
        except BaseException:
            self.stop()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """Stop what still runs."""
        self.stop()

    def release(self) -> None:
        """Let the processes start that were held, in order."""
        for child in self._children:
            child.release()

    def begin_anew(self, specs: Sequence[ChildSpec]) -> None:
        """Stop what is held, and hold these processes instead."""
        self.stop()
        self._specs = tuple(specs)
        self.__enter__()

    def loaded(self) -> None:
        """Note that every process runs: from now on one that ends by the signal itself has not done its last duty."""
        self._loading = False

    def process_ids(self) -> dict[str, int]:
        """Return the process id of everything that was started and not stopped, by name."""
        return {child.spec.name: child.process.pid for child in self._children}

    def first_death(self) -> Death | None:
        """Return a process that has ended although nobody asked it to, or None while all run.

        Of those that only look on, one that ends after all was loaded is given up, and reported once.
        """
        for child in tuple(self._children):
            if child.process.poll() is None:
                continue
            if self._loading or not child.spec.looks_on:
                return child.death()
            self._children.remove(child)
            self._on_loss(child.death())
        return None

    def watch(self, stop: Callable[[], bool], period_s: float = 0.1) -> Death | None:
        """Wait until `stop` returns True (then None) or a process dies (then how)."""
        while not stop():
            death = self.first_death()
            if death is not None:
                return death
            time.sleep(period_s)
        return None

    def stop(self) -> tuple[Death, ...]:
        """Stop everything in reverse order and return those that ended badly. Safe to call twice.

        Before `loaded` was called, ending by the SIGTERM that was sent is no bad end: a process that is still loading
        has no handler yet. Later it is: a driver that ends so has not released its solenoids.
        """
        bad: list[Death] = []
        well = {0, -signal.SIGTERM} if self._loading else {0}
        while self._children:
            together = [self._children.pop()]
            while self._children and together[0].spec.kind and self._children[-1].spec.kind == together[0].spec.kind:
                together.append(self._children.pop())
            for child in together:
                child.ask_to_end()
            for child in together:
                child.wait_or_kill()
                if child.process.returncode not in well:
                    bad.append(child.death())
        return tuple(bad)
