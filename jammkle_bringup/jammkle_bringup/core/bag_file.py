"""Open a bag, or say in one line why it cannot be opened."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING

from jammkle_bringup.core.errors import InputError
from jammkle_sim.gap.ankle import bag
from jammkle_sim.gap.recording import BadRecordingError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from rosbags.highlevel import AnyReader


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
