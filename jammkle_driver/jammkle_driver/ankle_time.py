"""The time that the driver goes by: the steady clock, and of a simulated ankle the graph's, if somebody keeps that."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from jammkle_driver.conversions import seconds
from jammkle_driver.core.watchdog import Instant

if TYPE_CHECKING:
    from jammkle_graph.heard_clock import ClockHearer

CLOCK_TIMEOUT_S = 1.5
"""Silence of /clock after which its maker is gone, s: a paused simulation repeats it every 0.5 s."""


def ankle_time(node: ClockHearer, *, simulated: bool) -> Instant:
    """Return both clocks now; a real ankle does not stand still while somebody pauses the graph's clock."""
    steady_s = time.monotonic()
    if not simulated:
        return Instant(steady_s, steady_s)
    clock = node.get_clock()
    runs = not clock.ros_time_is_active or steady_s - node.clock_heard_s < CLOCK_TIMEOUT_S
    return Instant(steady_s, seconds(clock.now()), runs)
