"""`jammkle record`: run the recorder node until it is asked to stop."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jammkle_bringup.core.log_times import TimeSource
from jammkle_bringup.recorder import Recorder, RecorderOptions, spin_and_close
from jammkle_bringup.up import say
from jammkle_common.bags.definitions import MessageDefinitions, share_folders
from jammkle_common.bags.writing import BagCounts, check_free
from jammkle_common.command.errors import InputError
from jammkle_common.runner import run

if TYPE_CHECKING:
    from pathlib import Path

_SOURCES = {"auto": TimeSource.UNDECIDED, "sim": TimeSource.SIMULATED, "system": TimeSource.SYSTEM}


def record(path: Path, namespace: str, clock: str) -> BagCounts:
    """Record until SIGINT or SIGTERM and return what is in the bag, which is complete then.

    Raises:
        InputError: the path exists or cannot be made, or the clock is unknown.

    """
    if clock not in _SOURCES:
        msg = f"--clock '{clock}' must be one of {', '.join(_SOURCES)}"
        raise InputError(msg)
    check_free(path)
    nodes: list[Recorder] = []

    def make_node() -> Recorder:
        node = Recorder(RecorderOptions(path, namespace, _SOURCES[clock]), MessageDefinitions(share_folders()))
        nodes.append(node)
        say(f"recording namespace {namespace} into {path}; Ctrl-C ends")
        return node

    run(make_node, [], loop=spin_and_close)
    counts = nodes[0].counts()
    say(f"{counts.messages} messages of {len(counts.by_topic)} topics are in {path}")
    return counts
