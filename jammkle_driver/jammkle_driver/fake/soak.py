"""Half an hour of jamming with a random fault every few seconds."""

from __future__ import annotations

import resource
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from jammkle_driver.core.channel import ChannelState
from jammkle_driver.core.hardware import LinkState, LinkStatus, released
from jammkle_driver.core.requests import RequestError
from jammkle_driver.fake.bench import FaultBench
from jammkle_driver.fake.trial import PLACED, drawn_size
from jammkle_driver.parameters import DriverParameters
from jammkle_graph.names import CHANNELS

if TYPE_CHECKING:
    import random

_BETWEEN_S = (2.0, 8.0)
_RECOVERY_S = 4.0
_SETTLE_S = 1.5


@dataclass(frozen=True)
class SoakResult:
    """What came of a soak.

    Attributes:
        simulated_s: Time that passed, s.
        faults: Faults that were injected.
        told: Faults that were told.
        missed: Moments at which something was on that had to be off, or a channel that did not recover.
        grown_kib: How much more memory the process has come to hold after the first tenth, KiB.

    """

    simulated_s: float
    faults: int
    told: int
    missed: tuple[str, ...]
    grown_kib: float


def soak(duration_s: float, seed: int) -> SoakResult:
    """Jam and vent while something fails every few seconds, is told or not, and is repaired."""
    bench = FaultBench(DriverParameters().settings(), seed)
    draw, missed = bench.draw, []
    faults = told = 0
    base_kib = None
    while bench.plant.time_s < duration_s:
        _run(bench, draw.uniform(*_BETWEEN_S), missed)
        _break_something(bench, draw)
        faults += 1
        _run(bench, draw.uniform(*_BETWEEN_S), missed)
        told += bool(bench.told()[0].value)
        missed += _recover(bench)
        if base_kib is None and bench.plant.time_s > duration_s / 10.0:
            base_kib = _most_held_kib()
    grown_kib = _most_held_kib() - (base_kib or 0.0)
    return SoakResult(bench.plant.time_s, faults, told, tuple(missed), grown_kib)


def _run(bench: FaultBench, duration_s: float, missed: list[str]) -> None:
    end_s = bench.plant.time_s + duration_s
    while bench.plant.time_s < end_s:
        bench.wander()
        bench.step()
        command, faulty = bench.driver.command, bench.driver.ankle.faulty
        if faulty and command != released(CHANNELS):
            missed.append(f"{bench.plant.time_s:.2f} s: {faulty[0].name} is in FAULT, and {command} goes on")


def _break_something(bench: FaultBench, draw: random.Random) -> None:
    if draw.random() < 0.2:  # noqa: PLR2004 - a share
        bench.link = replace(bench.link, state=LinkState.LOST, detail="no such device")
        return
    reason = draw.choice(list(PLACED))
    bench.plant.inject(PLACED[reason], draw.choice(CHANNELS), drawn_size(reason, draw))


def _recover(bench: FaultBench) -> list[str]:
    """Repair everything, clear, and jam all; return what did not come back."""
    bench.plant.heal()
    bench.link = LinkStatus(LinkState.CONNECTED)
    bench.driver.unjam((), "soak")
    for _ in range(round(_SETTLE_S / 0.01)):
        bench.step()
    bench.guard.clear()
    bench.driver.clear_fault(bench.now)
    for _ in range(round(_SETTLE_S / 0.01)):
        bench.step()
    try:
        bench.driver.jam((), 40e3, "soak")
    except RequestError as error:
        return [f"{bench.plant.time_s:.2f} s: {error}"]
    for _ in range(round(_RECOVERY_S / 0.01)):
        bench.step()
        if all(channel.state is ChannelState.JAMMED for channel in bench.driver.ankle.channels.values()):
            return []
    return [f"{bench.plant.time_s:.2f} s: not jammed after the repair: {bench.driver.status.trouble.text}"]


def _most_held_kib() -> float:
    return float(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
