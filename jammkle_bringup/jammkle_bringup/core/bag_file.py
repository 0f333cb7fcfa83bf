"""Open a bag, or say in one line why it cannot be opened."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING

from rosbags.highlevel import AnyReader, AnyReaderError

from jammkle_bringup.core.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

_METADATA = "metadata.yaml"


@contextlib.contextmanager
def opened(path: Path) -> Iterator[AnyReader]:
    """Open a bag folder or a single bag file for reading.

    Raises:
        InputError: there is no bag, or it cannot be read.

    """
    if not path.exists():
        msg = f"bag {path} does not exist"
        raise InputError(msg)
    if path.is_dir() and not (path / _METADATA).is_file():
        msg = f"{path} is not a bag: it holds no {_METADATA}"
        raise InputError(msg)
    try:
        reader = AnyReader([path])
        reader.open()
    # The library lets errors of its parsers, of struct and of the file system through, depending on what is broken.
    except Exception as error:
        raise InputError(_unreadable(path, error)) from error
    try:
        yield reader
    except AnyReaderError as error:
        raise InputError(_unreadable(path, error)) from error
    finally:
        reader.close()


def _unreadable(path: Path, error: Exception) -> str:
    why = " ".join(str(error).split()) or type(error).__name__
    return f"bag {path} cannot be read: {why}"
