"""Open a bag and read it, or say in one line why that cannot be done."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING

from rosbags.highlevel import AnyReader, AnyReaderError
from rosbags.typesys import Stores, get_typestore

from jammkle_graph.bags.recovery import files_of, is_unfinished, unfinished_text
from jammkle_graph.command.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator
    from pathlib import Path

    from rosbags.interfaces import Connection

_METADATA = "metadata.yaml"


@contextlib.contextmanager
def opened(path: Path) -> Iterator[AnyReader]:
    """Open a bag folder or a single bag file for reading; types without a definition in it are those of ROS 2 Jazzy.

    Raises:
        InputError: there is no bag, or it cannot be read.

    """
    try:
        there, whole = path.exists(), not path.is_dir() or (path / _METADATA).is_file() or bool(files_of(path))
        unfinished = there and is_unfinished(path)
    except OSError as error:  # a name too long, a folder that may not be looked into
        raise InputError(_unreadable(path, error)) from error
    if not there:
        msg = f"bag {path} does not exist"
        raise InputError(msg)
    if not whole:
        msg = f"{path} is not a bag: it holds no {_METADATA}"
        raise InputError(msg)
    if unfinished:
        raise InputError(unfinished_text(path))
    try:
        reader = AnyReader([path], default_typestore=get_typestore(Stores.ROS2_JAZZY))
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


def messages(
    reader: AnyReader, path: Path, connections: Collection[Connection] = ()
) -> Iterator[tuple[Connection, int, bytes]]:
    """Read connection, log time, ns, and data (CDR) of every message, by log time.

    A chunk that does not fit its checksum is noticed, if its recorder wrote one (rosbags writes none, hence `jammkle`),
    and so is whatever does not fit the lengths or the compression.

    Args:
        reader: The bag, open.
        path: Its name, for the error.
        connections: What is read; nothing stands for all.

    Raises:
        InputError: the bag is damaged.

    """
    count = 0
    try:
        for message in reader.messages(connections):
            count += 1
            yield message
    # As in `opened`: what comes out depends on what is broken. An error of who takes the messages does not come here.
    except Exception as error:
        msg = f"bag {path} is damaged after {count} messages: {_why(error)}"
        raise InputError(msg) from error
    if not connections and count != reader.message_count:
        msg = f"bag {path} is damaged: it holds {count} messages where its index says {reader.message_count}"
        raise InputError(msg)


def _why(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__


def _unreadable(path: Path, error: Exception) -> str:
    return f"bag {path} cannot be read: {_why(error)}"
