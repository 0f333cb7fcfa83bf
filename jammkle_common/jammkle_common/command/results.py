"""Where results go: the screen, and a file for machines."""

from __future__ import annotations

import json
import shlex
import sys
from dataclasses import dataclass
from datetime import datetime, timezone
from typing import TYPE_CHECKING, Any

from jammkle_common.command.errors import InputError
from jammkle_common.version import VERSION

if TYPE_CHECKING:
    from pathlib import Path
    from typing import TextIO

    from rich.console import Console

STDOUT = "-"
"""As a file's name: JSON goes to stdout, and all that is for people to stderr."""
_PIPE_WIDTH = 1000  # tables take what they need of it


def console() -> Console:
    """Return where results go; pipes get plain text that is not cut."""
    from rich.console import Console  # noqa: PLC0415 - `jammkle --help` shall not wait for it

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
        InputError: the file cannot be written.

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
        raise InputError(msg) from error


_said: set[str] = set()


def note(line: str) -> None:
    """Say one line on stderr that is no error; what was said before is not said again."""
    if line not in _said:
        _said.add(line)
        sys.stderr.write(f"jammkle: note: {' '.join(line.split())}\n")


def check_writable(path: Path | None, option: str = "--json") -> None:
    """Refuse a results file that could not be written, before the work is done; `option` is what asked for it.

    Raises:
        InputError: its folder does not exist, or it is a folder.

    """
    if path is None or (str(path) == STDOUT and option == "--json"):
        return
    why = ""
    try:
        if path.is_dir():
            why = "it is a folder"
        elif not path.absolute().parent.is_dir():
            why = f"there is no folder {path.absolute().parent}"
    except OSError as error:
        why = error.strerror or str(error)
    if why:
        msg = f"{option} {path} cannot be written: {why}"
        raise InputError(msg)
