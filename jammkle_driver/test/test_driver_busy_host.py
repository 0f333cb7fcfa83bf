"""A host that stands still, or delivers late and in any order, makes no fault; what truly fails is reported."""

from __future__ import annotations

import math
import random
from collections import deque
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import pytest

from fault_bench import SAMPLE_S, SET_POINT_PA, FaultBench, jammed_bench, run
from jammkle_common.constants import STANDARD_ATMOSPHERE_PA
from jammkle_common.names import CHANNELS
from jammkle_driver.core.diagnosis import LONGEST_UNKNOWN_S, Evidence
from jammkle_driver.core.driver import Driver
from jammkle_driver.core.faults import Reason
from jammkle_driver.core.hardware import MANIFOLD, ActuatorCommand, LinkState, LinkStatus, PressureSample, released
from jammkle_driver.core.requests import RequestError
from jammkle_driver.core.watch import Instant
from jammkle_driver.fake import FakeFault
from jammkle_driver.parameters import TICK_PERIOD_S, DriverParameters

if TYPE_CHECKING:
    from jammkle_driver.core.faults import Finding

PASSING = {Reason.NONE, Reason.EXECUTOR_OVERLOADED, Reason.BOARD_LET_GO, Reason.COMMANDS_STALE}
"""What a busy host brings about, and what passes by itself."""
_QUEUE = 100
"""Messages that wait in each queue, as the driver subscribes."""


@dataclass(frozen=True)
class Starved:
    """How a host is short of time.

    Attributes:
        pause_share: Of the moments at which it runs, those after which it stands still.
        pauses_s: For how long, s.
        latest_s: How late a command reaches the board at the most, s.
        lost_share: Of the readings, those that are lost.

    """

    pause_share: float
    pauses_s: tuple[float, ...]
    latest_s: float = 0.06
    lost_share: float = 0.0


STARVED = {
    "late commands": Starved(0.0, (), 0.15),
    "stopped and continued": Starved(0.15, (0.03, 0.06, 0.12, 0.18, 0.3, 0.6)),
    "slices": Starved(0.5, (0.01, 0.04, 0.08, 0.15)),
    "lossy": Starved(0.15, (0.03, 0.06, 0.12, 0.18, 0.3, 0.6), lost_share=0.3),
}


class Host:
    """Runs a driver with too little time: its board and plant go on, and their messages wait, each in its queue."""

    def __init__(self, seed: int, starved: Starved) -> None:
        self.bench = FaultBench(DriverParameters(), seed)
        self._draw = random.Random(seed)  # noqa: S311 - when a host is busy is no secret
        self._starved = starved
        self._queues = {place: deque[Any](maxlen=_QUEUE) for place in ("driven", MANIFOLD, *CHANNELS)}
        self._commands: deque[tuple[float, ActuatorCommand]] = deque()
        self._paused_until_s = self._tick_s = 0.0

    @property
    def reported(self) -> Reason:
        return self.bench.driver.trouble.why.reason

    def run(self, duration_s: float, *, wander: bool = True) -> None:
        end_s = self.bench.plant.time_s + duration_s
        while self.bench.plant.time_s < end_s and self.reported in PASSING:
            self._let_the_hardware_work()
            if self.bench.plant.time_s >= self._paused_until_s:
                self._work(wander=wander)

    def _let_the_hardware_work(self) -> None:
        board, time_s = self.bench.board, self.bench.plant.time_s + SAMPLE_S
        board.advance(SAMPLE_S)
        while self._commands and self._commands[0][0] <= time_s:
            board.take(self._commands.popleft()[1])
        self._queues["driven"].append((board.driven, time_s))
        for place, pressure_pa in self.bench.plant.readings_pa().items():
            if self._draw.random() >= self._starved.lost_share:
                self._queues[place].append(PressureSample(place, pressure_pa, time_s))

    def _work(self, *, wander: bool) -> None:
        driver, time_s, draw = self.bench.driver, self.bench.plant.time_s, self._draw
        now = Instant(time_s, time_s)
        if wander:
            self.bench.wander()
        while any(self._queues.values()):
            kind = draw.choice([name for name, queue in self._queues.items() if queue])
            message = self._queues[kind].popleft()
            self._look_at_link(now)
            if kind == "driven":
                driver.take_driven(*message)
            else:
                driver.measure(message, now)
        if time_s >= self._tick_s:
            self._tick_s = time_s + TICK_PERIOD_S
            driver.tick(now)
            self._look_at_link(now)
        due_s = time_s + draw.uniform(0.0, self._starved.latest_s)
        self._commands.append((max(due_s, self._commands[-1][0]) if self._commands else due_s, driver.command))
        if draw.random() < self._starved.pause_share:
            self._paused_until_s = time_s + draw.choice(self._starved.pauses_s)

    def _look_at_link(self, now: Instant) -> None:
        if self.bench.driver.look_at_link(self.bench.link, now):
            self.bench.board.acknowledge()


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("starved", STARVED.values(), ids=STARVED)
def test_a_healthy_ankle_behind_a_starved_host_has_no_fault(starved: Starved, seed: int) -> None:
    """Jamming and venting for 15 s: pumps, valves, lines, sensors and board are well all the time."""
    host = Host(seed, starved)
    host.run(15.0)
    assert host.reported in PASSING


@pytest.mark.parametrize("fault", [FakeFault.LEAK, FakeFault.SENSOR_BIAS], ids=lambda each: each.name)
@pytest.mark.parametrize("starved", STARVED.values(), ids=STARVED)
def test_a_true_fault_behind_a_starved_host_is_reported(starved: Starved, fault: FakeFault) -> None:
    """However little time the host has; a vented channel that reads 8 kPa is reported as not vented, too."""
    host = Host(1, starved)
    host.run(4.0)
    host.bench.plant.inject(fault, "achilles", 3e-10 if fault is FakeFault.LEAK else -8e3)
    host.run(40.0)
    biased = {Reason.SENSOR_DRIFTING, Reason.NOT_VENTED}
    assert host.reported in {FakeFault.LEAK: {Reason.LEAK}, FakeFault.SENSOR_BIAS: biased}[fault]


def test_readings_count_once_it_is_known_what_was_driven() -> None:
    """A moment waits for the acknowledgement of its time; after a silence nothing is known of what led to the next."""
    evidence, off = Evidence(("left",)), released(("left",))
    on = replace(off, solenoids={"left": True})
    evidence.command(on, 0.0)  # what the host asks for does not count where the hardware says what it does
    evidence.acknowledge(off, 1.0)
    evidence.read("left", 1e5, 1.01)
    assert list(evidence.due()) == []
    evidence.acknowledge(on, 1.01)
    (moment,) = evidence.due()
    assert (moment.stamp_s, moment.driven, moment.known) == (1.01, ((1.0, off), (1.01, on)), True)
    after_s = 1.01 + 1.5 * LONGEST_UNKNOWN_S
    evidence.read("left", 1e5, 1.02)
    evidence.read("left", 1e5, after_s)
    evidence.acknowledge(on, after_s)
    (moment,) = evidence.due()
    assert (moment.stamp_s, moment.known) == (after_s, False)
    evidence.acknowledge(off, 0.5)  # a simulation that was started anew
    evidence.read("left", 1e5, 0.5)
    assert [each.driven for each in evidence.due()] == [((0.5, off),)]


def test_a_reading_of_unsure_time_is_no_evidence() -> None:
    """Of a cycle in which the host stood still: it regulates, and the diagnosis does not see it."""
    bench = jammed_bench()
    strange: list[Finding] = []
    for _ in range(100):
        bench.step()
        now = bench.now
        for place in (MANIFOLD, *CHANNELS):
            sample = PressureSample(place, 60e3, now.graph_s + 0.005, timely=False)
            bench.driver.measure(sample, now)
        strange += bench.driver.ankle.findings
    assert strange == []
    assert bench.driver.ankle.channels["achilles"].vacuum_pa == pytest.approx(SET_POINT_PA, abs=SET_POINT_PA)
    run(bench, 0.1)


def test_a_pump_at_full_duty_is_counted_once_however_readings_come() -> None:
    """Late readings of one place after newer ones of another are no further time: no NOT_REACHED after a second."""
    host = Host(0, Starved(0.3, (0.3,)))
    host.bench.plant.inject(FakeFault.PUMP_WEAK, MANIFOLD, 0.5)
    host.run(0.5, wander=False)
    host.bench.driver.jam((), 60e3, "test")
    host.run(2.0, wander=False)
    assert host.reported in PASSING


class AskedBoard:
    """A driver that ticks on time, and a board that is asked; its answers come or not."""

    def __init__(self) -> None:
        self.driver = Driver(CHANNELS, DriverParameters())
        self.driver.activate(Instant(0.0, 0.0))
        self.link = LinkStatus(LinkState.CONNECTED)
        self._ticks = 0

    def run(self, duration_s: float, *, broken: str = "", answers: bool = True) -> None:
        for _ in range(round(duration_s / TICK_PERIOD_S)):
            self._ticks += 1
            time_s = self._ticks * TICK_PERIOD_S
            now = Instant(time_s, time_s)
            if answers:
                self.link = replace(self.link, exchanges=self.link.exchanges + 5)
                for place in (MANIFOLD, *CHANNELS):
                    pressure_pa = math.nan if place == broken else STANDARD_ATMOSPHERE_PA
                    self.driver.measure(PressureSample(place, pressure_pa, time_s), now)
            self.driver.tick(now)
            self.driver.look_at_link(self.link, now)

    @property
    def reasons(self) -> set[Reason]:
        return {channel.why.reason for channel in self.driver.ankle.faulty}


def test_a_board_whose_answers_come_too_late_is_no_fault() -> None:
    """The driver ticks on time, and the board is starved: jammed it is let go of, vented it is waited for.

    A sensor without a number in what the board does answer is a fault within its time all the same.
    """
    asked = AskedBoard()
    asked.run(1.0)
    asked.driver.jam((), SET_POINT_PA, "test")
    asked.run(DriverParameters().pressure_timeout_s + 2.0 * TICK_PERIOD_S, answers=False)
    assert asked.reasons == set()
    assert asked.driver.trouble.why.reason is Reason.BOARD_LET_GO
    assert asked.driver.command == released(CHANNELS)
    asked.run(30.0, answers=False)
    assert asked.reasons == set()
    asked.run(1.0)
    asked.driver.jam((), SET_POINT_PA, "test")
    asked.run(0.4, broken="achilles")
    assert asked.reasons == set()
    asked.run(0.2, broken="achilles")
    assert asked.reasons == {Reason.SENSOR_DEAD}


def test_a_board_that_is_lost_while_vented_comes_back_without_anybody() -> None:
    """It is reported, and nothing jams meanwhile; jammed, the same is latched."""
    asked = AskedBoard()
    asked.run(1.0)
    asked.link = replace(asked.link, state=LinkState.LOST, detail="no reply")
    asked.run(5.0, answers=False)
    assert asked.driver.trouble.why.reason is Reason.BOARD_UNPLUGGED
    with pytest.raises(RequestError, match="does not answer"):
        asked.driver.jam((), SET_POINT_PA, "test")
    asked.link = replace(asked.link, state=LinkState.CONNECTED)
    asked.run(0.2)
    assert asked.driver.trouble.why.reason is Reason.NONE
    asked.driver.jam((), SET_POINT_PA, "test")
    asked.link = replace(asked.link, state=LinkState.LOST)
    asked.run(TICK_PERIOD_S, answers=False)
    assert asked.reasons == {Reason.BOARD_UNPLUGGED}
