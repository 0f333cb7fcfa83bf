"""Open a bag and read it, or say in one line why that cannot be done."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING

from jammkle_bringup.core.errors import InputError
from jammkle_sim.gap.ankle import bag
from jammkle_sim.gap.recording import BadRecordingError

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator
    from pathlib import Path

    from rosbags.highlevel import AnyReader
    from rosbags.interfaces import Connection


@contextlib.contextmanager
def opened(path: Path) -> Iterator[AnyReader]:
    """Open a bag folder or a single bag file for reading.

    Raises:
        InputError: there is no bag, or it cannot be read.

    """
    try:
        with bag.opened(path) as reader:
            yield reader
    except BadRecordingError as error:
        raise InputError(str(error)) from error


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
