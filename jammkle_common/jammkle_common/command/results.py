"""Where results go: the screen, a progress bar, a file for machines, and the colours of every figure.

Rich is loaded where something is shown, so that `jammkle --help` need not wait for it.
"""

# ruff: noqa: PLC0415 - as said above

from __future__ import annotations

import contextlib
import json
import os
import shlex
import sys
from contextvars import ContextVar
from dataclasses import dataclass
from datetime import datetime, timezone
from typing import TYPE_CHECKING, Any

from jammkle_common import VERSION
from jammkle_common.command.errors import GraphError, InputError
from jammkle_common.names import ACHILLES, PERONEAL_LEFT, PERONEAL_RIGHT

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path
    from typing import TextIO

    from rich.console import Console

STDOUT = "-"
"""As a file's name: JSON goes to stdout, and all that is for people to stderr."""
_PIPE_WIDTH = 1000  # tables take what they need of it


def console() -> Console:
    """Return where results go; pipes get plain text that is not cut."""
    from rich.console import Console

    return Console(highlight=False) if sys.stdout.isatty() else Console(highlight=False, width=_PIPE_WIDTH)


_for_json: TextIO | None = None


def keep_stdout_for_json() -> None:
    """Let what is said to people go to stderr, so that stdout holds JSON alone; `main` puts it back."""
    global _for_json
    _for_json, sys.stdout = sys.stdout, sys.stderr


@dataclass(frozen=True)
class Origin:
    """What made a result, so that it can be made again."""

    version: str
    """Of Jammkle."""
    date: str
    """UTC, ISO 8601, to the second."""
    command: str
    """As it may be pasted into a shell."""


def origin() -> Origin:
    """Return what makes the result at hand: this version, now, and the command of this process."""
    now = datetime.now(timezone.utc).isoformat(sep=" ", timespec="seconds")
    return Origin(VERSION, now, shlex.join(["jammkle", *sys.argv[1:]]))


def write_json(path: Path | None, content: dict[str, Any]) -> None:
    """Write results for machines, if a file was asked for; `-` is stdout.

    Raises:
        GraphError: the file cannot be written.

    """
    if path is None:
        return
    text = json.dumps(content, indent=2, allow_nan=False) + "\n"
    if str(path) == STDOUT:
        (_for_json or sys.stdout).write(text)
        return
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        msg = f"--json {path} cannot be written: {error.strerror}"
        raise GraphError(msg) from error


def say(text: str) -> None:
    """Write one line for people; results alone go to the standard output."""
    sys.stderr.write(f"jammkle: {text}\n")
    sys.stderr.flush()


_said: set[str] = set()
_kept: ContextVar[list[str] | None] = ContextVar("_kept", default=None)


def note(line: str) -> None:
    """Say one line on stderr that is no error; what was said before is not said again."""
    kept = _kept.get()
    if kept is not None:
        kept.append(line)
    elif line not in _said:
        _said.add(line)
        sys.stderr.write(f"jammkle: note: {' '.join(line.split())}\n")


@contextlib.contextmanager
def notes_kept() -> Iterator[list[str]]:
    """Keep the notes of the block instead of saying them, for the process that this one works for.

    Yields:
        The notes, in order, as they come.

    """
    notes: list[str] = []
    token = _kept.set(notes)
    try:
        yield notes
    finally:
        _kept.reset(token)


def make_folder(folder: Path) -> None:
    """Make a folder for results, and those above it, where it is not there yet.

    Raises:
        InputError: it cannot be made, or a file has its name.

    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        msg = f"folder {folder} cannot be made: {error.strerror}"
        raise InputError(msg) from error


@contextlib.contextmanager
def folder_made(folder: Path) -> Iterator[None]:
    """Make a folder for results; where the block fails before it has written any, what was made is taken away again.

    Raises:
        InputError: it cannot be made, or a file has its name.

    """
    made = [each for each in (folder, *folder.parents) if not os.path.exists(each)]  # noqa: PTH110 - raises nothing
    try:
        make_folder(folder)
        yield
    except BaseException:
        with contextlib.suppress(OSError):  # it holds something
            for each in made:
                each.rmdir()
        raise


def check_writable(path: Path | None, option: str = "--json") -> None:
    """Refuse a results file that could not be written, before the work is done; `option` is what asked for it.

    Raises:
        InputError: its folder does not exist, it is a folder, or nobody lets us write there.

    """
    if path is None or (str(path) == STDOUT and option == "--json"):
        return
    why = ""
    try:
        if path.is_dir():
            why = "it is a folder"
        elif not path.absolute().parent.is_dir():
            why = f"there is no folder {path.absolute().parent}"
        elif not os.access(path if path.exists() else path.absolute().parent, os.W_OK):
            why = "there is no permission to write it"
    except OSError as error:
        why = error.strerror or str(error)
    if why:
        msg = f"{option} {path} cannot be written: {why}"
        raise InputError(msg)


@contextlib.contextmanager
def progress_bar(title: str) -> Iterator[Callable[[float, str], None]]:
    """Show a bar with a title on stderr while the block runs; it is gone afterwards, and not there at all in a pipe.

    Yields:
        A function to call with the share that is done, 0 to 1, and what is being done.

    """
    from rich import progress
    from rich.console import Console

    columns = (
        progress.TextColumn("{task.description}"),
        progress.BarColumn(),
        progress.TaskProgressColumn(),
        progress.TextColumn("{task.fields[detail]}"),
        progress.TimeElapsedColumn(),
        progress.TextColumn("left:"),
        progress.TimeRemainingColumn(elapsed_when_finished=False),
    )
    screen = Console(stderr=True)
    with progress.Progress(*columns, console=screen, transient=True, disable=not screen.is_terminal) as bar:
        task = bar.add_task(title, total=1.0, detail="")

        def update(share: float, detail: str) -> None:
            bar.update(task, completed=share, detail=detail)

        yield update


STYLE: dict[Any, Any] = {
    "svg.hashsalt": "jammkle",
    "font.size": 9.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.alpha": 0.25,
    "legend.fontsize": 8.0,
    "legend.frameon": False,
    "axes.titlesize": 9.5,
    "lines.linewidth": 1.1,
}
"""For matplotlib; the salt makes the same picture the same bytes."""

STATE_COLOURS = {
    "UNKNOWN": "#969696",
    "UNJAMMED": "#e8b478",
    "JAMMING": "#f0a014",
    "JAMMED": "#196eeb",
    "VENTING": "#3cb9af",
    "FAULT": "#d72828",
}
"""Of the states of a channel, in every picture, page and table, by the constants of ChannelJamState."""

EVENT_COLOURS = {
    "IMPACT": "#d72828",
    "SLIP": "#f08c14",
    "LIFTOFF": "#1e78dc",
    "SETTLED": "#32963c",
    "SWING": "#825ac8",
    "UNKNOWN": "#969696",
}
"""Of what the controller felt, by the constants of ContactEvent."""

LINE_COLOURS = {
    PERONEAL_LEFT: "#d66024",
    PERONEAL_RIGHT: "#1e82be",
    ACHILLES: "#3c9646",
    "achilles_left": "#3c9646",
    "achilles_right": "#8cbe3c",
    "manifold": "#787878",
    "x": "#008c8c",
    "y": "#966e3c",
    "z": "#3c3c46",
}
"""Of channels, tendons and axes over time; axes share their plots with events, and no colour."""
