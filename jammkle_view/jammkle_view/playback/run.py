"""`jammkle view`: read, run again, open the page, and play until asked to stop."""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

from jammkle_common.command.errors import InputError
from jammkle_common.command.results import progress_bar
from jammkle_view.page.server import address_of, is_watched, serve
from jammkle_view.playback.overlay import Overlay, overlay_of
from jammkle_view.playback.page import PlaybackPage
from jammkle_view.playback.player import Player
from jammkle_view.playback.recorded import read_recorded
from jammkle_view.playback.robot_overlay import is_robot, robot_overlay

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from jammkle_view.playback.recorded import Recorded

_FRAME_S = 1.0 / 30.0


@dataclass(frozen=True)
class Shown:
    """What is shown."""

    bag: Path
    namespace: str | None
    rig: str | None
    corrected: Path | None
    simulated: bool
    """Whether its simulation is laid over it."""


def run(shown: Shown, host: str, port: int, asked_to_stop: Callable[[], bool]) -> int:
    """Show a bag until asked to stop; return the exit code.

    Raises:
        InputError: no bag, an option that does not fit, or a port that is taken.

    """
    if shown.corrected is not None and not shown.simulated:
        msg = f"--corrected {shown.corrected} and --no-simulation exclude each other: give one of them"
        raise InputError(msg)
    with progress_bar(f"reading {shown.bag}") as show:
        recorded = read_recorded(shown.bag, shown.namespace, lambda share: show(share, ""))
    overlay, why_not = _simulated(shown, recorded)
    player = Player(recorded.duration_s)
    server = serve(host, port, "Jammkle")
    try:
        page = PlaybackPage(server, recorded, overlay, why_not, player)
        _say(f"page: {address_of(server)}; Ctrl-C stops")
        before_s = time.monotonic()
        while not asked_to_stop():
            now_s = time.monotonic()
            player.go_on(now_s - before_s)
            before_s = now_s
            if is_watched(server):
                page.show(now_s)
            time.sleep(_FRAME_S)
    finally:
        server.stop()
    return 0


def _simulated(shown: Shown, recorded: Recorded) -> tuple[Overlay | None, str]:
    """Return the simulation, and why there is none. What a user has asked for by name must work, or is refused."""
    if not shown.simulated:
        return None, ""
    try:
        if shown.rig is None and is_robot(recorded):
            return _robot(shown, recorded), ""
        with progress_bar("simulating the same"):
            return overlay_of(shown.bag, recorded, shown.rig, shown.corrected), ""
    except InputError as error:
        if shown.corrected is not None or shown.rig is not None:
            raise
        _say(f"without simulation: {error}")
        return None, f"without simulation: {error}"


def _robot(shown: Shown, recorded: Recorded) -> Overlay:
    """Return the simulation of a robot.

    Raises:
        InputError: it cannot be simulated again, or shall be corrected.

    """
    if shown.corrected is not None:
        msg = f"--corrected {shown.corrected} needs a recording of a rig: effects are of an ankle on its rig"
        raise InputError(msg)
    with progress_bar("simulating the same") as show:
        return robot_overlay(shown.bag, recorded, lambda share: show(share, ""))


def _say(text: str) -> None:
    """Write one line for people."""
    sys.stderr.write(f"jammkle: {text}\n")
    sys.stderr.flush()
