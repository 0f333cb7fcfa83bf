"""A driver on a plant that can fail, brought to where a test of faults begins."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from jammkle_common.names import CHANNELS
from jammkle_driver.core.hardware import released
from jammkle_driver.fake.bench import FaultBench
from jammkle_driver.parameters import DriverParameters

if TYPE_CHECKING:
    from collections.abc import Callable

SET_POINT_PA = 50e3


def bench_of(seed: int = 1, **parameters: Any) -> FaultBench:
    """Return an ankle by `seed` whose driver has these parameters."""
    return FaultBench(DriverParameters(**parameters).settings(), seed)


def run(bench: FaultBench, duration_s: float, watch: Callable[[], None] = lambda: None) -> None:
    """Let time pass, and `watch` after each step."""
    end_s = bench.plant.time_s + duration_s
    while bench.plant.time_s < end_s:
        bench.step()
        watch()


def jammed_bench(**parameters: Any) -> FaultBench:
    """Return an ankle that has been jammed for 1.5 s, all channels, at `SET_POINT_PA`."""
    bench = bench_of(**parameters)
    run(bench, 1.0)
    bench.driver.jam((), SET_POINT_PA, "test")
    run(bench, 1.5)
    assert bench.driver.command != released(CHANNELS)
    return bench
