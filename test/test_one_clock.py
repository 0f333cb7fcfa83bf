"""A second simulation on the same graph gives way with one line, and never are there two clocks for long."""

from __future__ import annotations

import subprocess
import sys
import time
from typing import TYPE_CHECKING

from graph import Probe, environment
from jammkle_bringup.core.namespace_lock import ClockLock
from jammkle_graph.names import CLOCK

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

PATIENCE_S = 60.0


def test_of_two_simulations_started_together_one_gives_way(domain_id: int, make_probe: Callable[..., Probe]) -> None:
    """Exactly one ends, by itself, with exit code 2 and one line; the other makes the clock alone."""
    probe = make_probe()
    both = [
        subprocess.Popen(
            [sys.executable, "-m", "jammkle_sim"], env=environment(domain_id), stderr=subprocess.PIPE, text=True
        )
        for _ in range(2)
    ]
    try:
        end_s = time.monotonic() + PATIENCE_S
        while all(each.poll() is None for each in both) and time.monotonic() < end_s:
            probe.executor.spin_once(timeout_sec=0.1)
        gave_way = [each for each in both if each.poll() is not None]
        assert len(gave_way) == 1
        assert gave_way[0].returncode == 2
        said = gave_way[0].stderr.read().strip().splitlines() if gave_way[0].stderr else []
        assert len(said) == 1
        assert "/clock is made by another simulation, /sim: stop that one" in said[0]
        probe.listen(CLOCK)
        probe.spin_until(lambda: len(probe.heard[CLOCK.name]) > 10, "the clock ticks")
        assert any(each.poll() is None for each in both)
    finally:
        for each in both:
            each.terminate()
            each.communicate(timeout=PATIENCE_S)


def test_one_lock_is_for_one_clock(tmp_path: Path) -> None:
    """Who comes second gets none while the first has it; another domain is another clock."""
    with ClockLock("5", tmp_path) as first, ClockLock("5", tmp_path) as second, ClockLock("6", tmp_path) as other:
        assert first.take()
        assert not second.take()
        assert other.take()
    with ClockLock("5", tmp_path) as again:
        assert again.take()
