"""How long after each mishap everything is off at the pins: driver process, real bytes, firmware as a process."""

from __future__ import annotations

import statistics
import tempfile
from dataclasses import dataclass
from pathlib import Path

from board_scene import EVENTS, Scene, all_off, repair
from boards import board_command
from domains import own_domain

ROUNDS = 7
STALE = "commands stale (last jam_command)"
STALE_BOUND_S = 0.56
"""command_timeout_s, one tick, one cycle of the line."""


@dataclass(frozen=True)
class SafeState:
    """What happened, the bound, and the median and the longest time until all was off at the pins, s."""

    event: str
    rounds: int
    bound_s: float
    median_s: float
    longest_s: float


def measure_safe_states() -> list[SafeState]:
    """Let everything happen, round after round; every round has a board, a driver and a domain of its own."""
    took_s: dict[str, list[float]] = {STALE: [], **{name: [] for name in EVENTS}}
    with tempfile.TemporaryDirectory() as folder:
        command = board_command(Path(folder))
        for each in range(ROUNDS):
            with own_domain() as domain_id:
                scene = Scene(command, Path(folder, f"board_{each}"), domain_id)
                try:
                    took_s[STALE].append(scene.delay_s(scene.stream_jam(), all_off))
                    for name, event in EVENTS.items():
                        event.jam(scene)
                        took_s[name].append(scene.delay_s(event.happen(scene), all_off))
                        repair(scene)
                finally:
                    scene.close()
    bounds_s = {STALE: STALE_BOUND_S, **{name: event.bound_s for name, event in EVENTS.items()}}
    return [
        SafeState(name, ROUNDS, bounds_s[name], statistics.median(values), max(values))
        for name, values in took_s.items()
    ]
