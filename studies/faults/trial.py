"""Random faults into random ankles, and what the driver says of them; healthy ankles, and what it says of those."""

from __future__ import annotations

import math
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

from fault_bench import ELSEWHERE, PLACED, SAMPLE_S, FaultBench, alarms, fake_plant
from jammkle_common.names import CHANNELS
from jammkle_driver.core.faults import Reason
from jammkle_driver.core.hardware import MANIFOLD
from jammkle_driver.fake import FakeFault, LinkFault
from jammkle_driver.parameters import DriverParameters

if TYPE_CHECKING:
    import random
    from collections.abc import Iterator

    from fault_bench import PlantBuilder
    from jammkle_driver.core.hardware import ActuatorCommand

ONSET_S = (3.0, 6.0)
"""When a fault begins, s."""

LONGEST_S = 20.0
"""How long is waited for it to be reported while the ankle is jammed and vented, s."""

_EACH_S = 100.0
"""How long each healthy ankle is jammed and vented, s."""

_SETTLED_S = 0.3
"""How long after the first word the last one is read, s."""

REASONS = (*PLACED, *ELSEWHERE)


@dataclass(frozen=True)
class Outcome:
    """One injection.

    Attributes:
        seed: Of the ankle, the fault and all that was asked.
        injected: What failed.
        place: Where.
        size: How much; see `FakeFault`.
        reported: What was said; NONE: nothing.
        reported_place: Where it was said to be.
        delay_s: From when it first mattered to the first word, s; infinite if there was none; negative: before that.

    """

    seed: int
    injected: Reason
    place: str
    size: float
    reported: Reason
    reported_place: str
    delay_s: float

    @property
    def right(self) -> bool:
        """Whether reason and place are right."""
        return self.reported is self.injected and self.reported_place == self.place


def drawn_fault(reason: Reason, draw: random.Random) -> tuple[FakeFault, float]:
    """Return what fails in the plant and how much, over the whole range that counts as a fault.

    Leaks of 4 to 50 % of a valve, lines with 0.3 to 30 % left, pumps with 12 to 45 %, drifts of 0.3 to 5 kPa/s, jumps
    of 1.5 to 20 kPa.
    """
    fault = PLACED[reason]
    if reason is Reason.LEAK:
        return fault, math.exp(draw.uniform(math.log(4e-11), math.log(5e-10)))
    if reason is Reason.BLOCKED_LINE:
        return fault, math.exp(draw.uniform(math.log(0.003), math.log(0.3)))
    if reason is Reason.PUMP_WEAK:
        return fault, draw.uniform(0.12, 0.45)
    if reason is Reason.SENSOR_DRIFTING:
        jumps, sign = draw.random() < 0.5, draw.choice([-1.0, 1.0])  # noqa: PLR2004 - every other one
        least, most = (1.5e3, 20e3) if jumps else (300.0, 5e3)
        size = sign * math.exp(draw.uniform(math.log(least), math.log(most)))
        return (FakeFault.SENSOR_BIAS if jumps else fault), size
    return fault, draw.choice([-5e3, 130e3])


def inject(
    seed: int, reason: Reason, build: PlantBuilder = fake_plant, parameters: DriverParameters | None = None
) -> Outcome:
    """Let one thing fail in one ankle, and read what the driver, with its own defaults or these parameters, says."""
    bench = FaultBench(parameters or DriverParameters(), seed, build)
    draw = bench.draw
    bench.streams = reason in {Reason.COMMANDS_STALE, Reason.EXECUTOR_OVERLOADED}
    place = _place(reason, draw)
    fault, size = drawn_fault(reason, draw) if reason in PLACED else (None, 0.0)
    onset_s = draw.uniform(*ONSET_S)
    begun = False
    mattered_s = first_s = None
    at_onset = bench.board.driven
    while bench.plant.time_s < onset_s + LONGEST_S:
        if not begun and bench.plant.time_s >= onset_s and _ripe(bench, reason):
            begun, onset_s, at_onset = True, bench.plant.time_s, bench.board.driven
            if fault is not None:
                bench.plant.inject(fault, place, size)
            else:
                _begin(bench, reason)
        bench.wander()
        bench.step()
        if begun and mattered_s is None and matters(reason, place, bench.board.driven, at_onset):
            mattered_s = max(bench.plant.time_s - SAMPLE_S, onset_s)
        reported, where = bench.reported()
        if reported is not Reason.NONE and first_s is None:
            first_s = bench.plant.time_s
        if first_s is not None and bench.plant.time_s > first_s + _SETTLED_S:
            break
    reported, where = bench.reported()
    where = place if reason in ELSEWHERE else where
    since_s = onset_s if mattered_s is None else mattered_s
    return Outcome(seed, reason, place, size, reported, where, math.inf if first_s is None else first_s - since_s)


def matters(reason: Reason, place: str, driven: ActuatorCommand, at_onset: ActuatorCommand) -> bool:
    """Whether a fault can have an effect yet, by what the outputs are and were when it began.

    A pump that works; a leak into what is connected; a valve that shall be where it is not, and there is vacuum; a line
    or a stuck sensor once its channel has moved or is connected. Every other fault matters at once.
    """
    connected = any(driven.solenoids.values()) if place == MANIFOLD else driven.solenoids[place]
    if reason in {Reason.PUMP_DEAD, Reason.PUMP_WEAK}:
        return driven.pump_duty > 0.0
    if reason in {Reason.LEAK, Reason.VALVE_STUCK_CLOSED}:
        return connected
    if reason is Reason.VALVE_STUCK_OPEN:
        return not connected and (at_onset.solenoids[place] or any(driven.solenoids.values()))
    if reason is Reason.BLOCKED_LINE:
        return driven.solenoids[place] is not at_onset.solenoids[place]
    if reason is Reason.SENSOR_STUCK:
        return connected or driven.solenoids != at_onset.solenoids
    return True


def run(
    count: int, seed: int, workers: int, build: PlantBuilder = fake_plant, parameters: DriverParameters | None = None
) -> Iterator[Outcome]:
    """Yield the outcomes of `count` injections, all reasons in turn."""
    seeds = range(seed, seed + count)
    reasons = [REASONS[number % len(REASONS)] for number in range(count)]
    with ProcessPoolExecutor(workers) as pool:
        yield from pool.map(partial(inject, build=build, parameters=parameters), seeds, reasons, chunksize=4)


def healthy(hours: float, seed: int, workers: int, build: PlantBuilder = fake_plant) -> list[str]:
    """Return every false alarm in so many hours of healthy jamming, of ankles of `_EACH_S` each."""
    ankles = max(1, round(3600.0 * hours / _EACH_S))
    with ProcessPoolExecutor(workers) as pool:
        said = pool.map(partial(alarms, duration_s=_EACH_S, build=build), range(seed, seed + ankles))
        return [line for lines in said for line in lines]


def _place(reason: Reason, draw: random.Random) -> str:
    if reason in {
        Reason.LEAK,
        Reason.SENSOR_STUCK,
        Reason.SENSOR_DRIFTING,
        Reason.SENSOR_OUT_OF_RANGE,
        Reason.SENSOR_DEAD,
    }:
        return draw.choice((MANIFOLD, *CHANNELS))
    if reason in PLACED and reason not in {Reason.PUMP_DEAD, Reason.PUMP_WEAK}:
        return draw.choice(CHANNELS)
    return MANIFOLD


def _ripe(bench: FaultBench, reason: Reason) -> bool:
    """Whether a fault that matters only to a jammed ankle can begin."""
    return reason not in ELSEWHERE or reason is Reason.LINE_NOISE or bench.driver.ankle.jammed


def _begin(bench: FaultBench, reason: Reason) -> None:
    if reason is Reason.BOARD_UNPLUGGED:
        bench.board.inject(LinkFault.UNPLUGGED)
    elif reason is Reason.BOARD_REBOOTED:
        bench.board.reboot()
    elif reason is Reason.BROWN_OUT:
        bench.board.inject(LinkFault.BROWN_OUT)
    elif reason is Reason.LINE_NOISE:
        bench.noisy = True
    elif reason is Reason.COMMANDS_STALE:
        bench.streams = False
        bench.asks = False
    else:
        bench.stand_still(1.5)
