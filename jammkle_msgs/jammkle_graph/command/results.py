"""Where results go: the screen, and a file for machines."""

from __future__ import annotations

import json
import sys
from typing import TYPE_CHECKING, Any

from rich.console import Console

from jammkle_graph.command.errors import InputError

if TYPE_CHECKING:
    from pathlib import Path

_PIPE_WIDTH = 1000  # tables take what they need of it


def console() -> Console:
    """Return where results go; pipes get plain text that is not cut."""
    return Console(highlight=False) if sys.stdout.isatty() else Console(highlight=False, width=_PIPE_WIDTH)


def write_json(path: Path | None, content: dict[str, Any]) -> None:
    """Write results for machines, if a file was asked for.

    Raises:
        InputError: the file cannot be written.

    """
    if path is None:
        return
    try:
        path.write_text(json.dumps(content, indent=2, allow_nan=False) + "\n", encoding="utf-8")
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
    if path is None:
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
