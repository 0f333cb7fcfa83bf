"""A fresh folder for every run."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jammkle_common.command.errors import InputError

if TYPE_CHECKING:
    import datetime as dt
    from pathlib import Path


def fresh_folder(parent: Path, day: dt.date) -> Path:
    """Make and return `parent/<date>-<n>` with the first n from 1 on that is free.

    Raises:
        InputError: it cannot be made.

    """
    number = 1
    while True:
        folder = parent / f"{day.isoformat()}-{number}"
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            number += 1
        except OSError as error:
            msg = f"folder {folder} cannot be made: {error.strerror}"
            raise InputError(msg) from error
        else:
            return folder
