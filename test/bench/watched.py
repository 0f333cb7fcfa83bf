"""The page beside a quadruped: frames per second that reach a browser, and what it takes from the real-time factor."""

from __future__ import annotations

import re
import statistics
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import psutil
from page_client import PageClient
from rosgraph_msgs.msg import Clock

from domains import own_domain
from graph import Probe, Up, cpu_s
from jammkle_common.names import CLOCK
from jammkle_common.qos import subscriber_qos

if TYPE_CHECKING:
    from collections.abc import Callable

ROUNDS = 3
SETTLE_S = 4.0
MEASURED_S = 8.0
ROBOT = ("up", "--robot", "quadruped", "-p", "sim:behaviour:=walk")
MOVED = b"batched_positions"
"""Every frame moves the tendons, all of them in one message."""


@dataclass(frozen=True)
class Watched:
    """A walking quadruped, four ankles at 500 Hz, without a page and with one that is watched, in turn.

    The browser is a client that takes every message and draws nothing: whoever looks, looks from a machine of his own.
    """

    frames_per_s: float
    """Median over rounds."""
    frames_per_s_lowest: float
    factor_alone: float
    """Real-time factor without a page, median over rounds."""
    factor_watched: float
    ratio: float
    """Of the two, median over rounds taken in turn."""
    ratio_lowest: float
    viewer_percent_of_one_core: float
    viewer_mib: float
    load_before: float
    """Processes that wanted a core in the minute before."""


@dataclass(frozen=True)
class _Round:
    factor: float
    frames_per_s: float = 0.0
    share: float = 0.0
    mib: float = 0.0


def measure_watched() -> Watched:
    """Run both in turn."""
    load_before = psutil.getloadavg()[0]
    pairs = [(_round(watched=False), _round(watched=True)) for _ in range(ROUNDS)]
    ratios = [watched.factor / alone.factor for alone, watched in pairs]
    frames = [watched.frames_per_s for _, watched in pairs]
    return Watched(
        statistics.median(frames),
        min(frames),
        statistics.median(alone.factor for alone, _ in pairs),
        statistics.median(watched.factor for _, watched in pairs),
        statistics.median(ratios),
        min(ratios),
        100.0 * statistics.median(watched.share for _, watched in pairs),
        statistics.median(watched.mib for _, watched in pairs),
        load_before,
    )


def _round(*, watched: bool) -> _Round:
    with own_domain() as domain_id, tempfile.TemporaryDirectory() as folder:
        up = Up(domain_id, Path(folder), *ROBOT, *(("--view",) if watched else ()))
        probe = Probe(domain_id)
        try:
            probe.spin_until(lambda: "jammkle: up\n" in up.text(), "the graph is up")
            if not watched:
                return _Round(real_time_factor(probe, time.sleep))
            probe.spin_until(lambda: "page: " in up.text(), "there is a page")
            address = re.findall(r"page: (http://localhost:\d+)", up.text())[0]
            return _watch(probe, up.child("jammkle_view"), address)
        finally:
            probe.close()
            up.stop()


def _watch(probe: Probe, viewer: psutil.Process, address: str) -> _Round:
    with PageClient(address) as page:
        frames = 0

        def take(left_s: float) -> None:
            nonlocal frames
            if page.receive(left_s):
                frames += page.raw.count(MOVED)

        end_s = time.monotonic() + SETTLE_S
        while time.monotonic() < end_s:
            take(end_s - time.monotonic())
        frames, before_s, begin_s = 0, cpu_s(viewer), time.perf_counter()
        factor = real_time_factor(probe, take, settle_s=0.0)
        elapsed_s = time.perf_counter() - begin_s
        spent_s = cpu_s(viewer) - before_s
        return _Round(factor, frames / elapsed_s, spent_s / elapsed_s, viewer.memory_info().rss / 2**20)


def real_time_factor(probe: Probe, meanwhile: Callable[[float], None], settle_s: float = SETTLE_S) -> float:
    """Simulated seconds per second, by /clock at the start and the end; nobody listens to it in between.

    Args:
        probe: Node to receive it with.
        meanwhile: Called again and again with the time that is left, s, for no longer than that.
        settle_s: How long to wait before.

    """
    time.sleep(settle_s)
    first_s, begin_s = _clock_s(probe), time.perf_counter()
    while (left_s := begin_s + MEASURED_S - time.perf_counter()) > 0.0:
        meanwhile(left_s)
    return (_clock_s(probe) - first_s) / (time.perf_counter() - begin_s)


def _clock_s(probe: Probe) -> float:
    """Simulated time now."""
    received: list[Clock] = []
    subscription = probe.node.create_subscription(Clock, CLOCK.name, received.append, subscriber_qos(CLOCK))
    probe.spin_until(lambda: bool(received), "/clock ticks")
    probe.node.destroy_subscription(subscription)
    return received[-1].clock.sec + 1e-9 * received[-1].clock.nanosec
