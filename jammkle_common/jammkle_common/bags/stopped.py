"""Bags of exercises that were stopped on the way: they are moved into a folder of their own, and recorded anew."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from jammkle_common.bags.contents import contents_of
from jammkle_common.bags.run_sheet import FILE_NAME, read_sheet
from jammkle_common.command.errors import InputError
from jammkle_common.command.results import make_folder, say
from jammkle_common.names import SIM_PARAMETERS

if TYPE_CHECKING:
    from pathlib import Path

_UNFINISHED = "unfinished"
"""Folder beside the bags of exercises: holds those that were stopped on the way."""


def was_stopped(bag: Path) -> bool:
    """Return whether a bag has no run sheet: an exercise writes it as it ends, and bags of `jammkle rig` hold it."""
    if (bag / FILE_NAME).is_file():
        return False
    try:
        return not read_sheet(bag, contents_of(bag).custom_data.get(SIM_PARAMETERS.name)).rig
    except (InputError, OSError):
        return True


_WRITTEN_S = 5.0
"""Age of the last change of a bag from which on nobody is recording it. Chosen: recorders write every second."""


def refuse_written(bag: Path) -> None:
    """Refuse a bag that is still being recorded.

    Raises:
        InputError: as said.

    """
    changed_s = max(path.stat().st_mtime for path in (bag, *bag.iterdir()))
    if time.time() - changed_s < _WRITTEN_S:
        msg = f"{bag} was written to within the last {_WRITTEN_S:g} s: it is being recorded, or its exercise has just "
        msg += "been stopped; choose another --output, or try again in a moment"
        raise InputError(msg)


def set_aside(bag: Path) -> None:
    """Move a bag that has no run sheet out of the way, and say where to; nothing is overwritten.

    Raises:
        InputError: the folder that it is moved to cannot be made.

    """
    folder = bag.parent / _UNFINISHED
    make_folder(folder)
    aside = folder / bag.name
    aside = bag.rename(free_name(folder, bag.name) if aside.exists() else aside)
    say(
        f"{bag} has no run sheet, perhaps as its exercise was stopped: it was moved to {aside}, and is left out; "
        f"if it is whole, write {FILE_NAME} into it (`jammkle info` prints a template), and move it back"
    )


def free_name(folder: Path, name: str) -> Path:
    """Return the next name of a bag that is not taken."""
    number = 2
    while (folder / f"{name}_{number}").exists():
        number += 1
    return folder / f"{name}_{number}"
