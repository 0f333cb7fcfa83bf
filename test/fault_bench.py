"""A driver's core on the fake plant, with a link that can fail: what the node does, without ROS and without waiting.

For the tests of faults, and for the study of them.
"""

from __future__ import annotations

import math
import random
from collections import deque
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from jammkle_common.constants import STANDARD_ATMOSPHERE_PA
from jammkle_common.names import CHANNELS
from jammkle_driver.core.driver import Driver
from jammkle_driver.core.faults import Reason
from jammkle_driver.core.hardware import MANIFOLD, LinkState, PressureSample, released
from jammkle_driver.core.requests import RequestError, SetPoint
from jammkle_driver.core.watch import Instant
from jammkle_driver.fake import FakeBoard, FakeFault, FakePlant, SensorErrors
from jammkle_driver.parameters import DriverParameters

if TYPE_CHECKING:
    from collections.abc import Callable

    from jammkle_driver.core.air import AirSettings
    from jammkle_driver.core.hardware import LinkStatus

    PlantBuilder = Callable[[AirSettings, random.Random, int], FakePlant]
    """Builds an ankle near what was declared, by what is drawn and a seed."""

PLACED = {
    Reason.LEAK: FakeFault.LEAK,
    Reason.BLOCKED_LINE: FakeFault.BLOCKED,
    Reason.VALVE_STUCK_OPEN: FakeFault.STUCK_OPEN,
    Reason.VALVE_STUCK_CLOSED: FakeFault.STUCK_CLOSED,
    Reason.PUMP_DEAD: FakeFault.PUMP_DEAD,
    Reason.PUMP_WEAK: FakeFault.PUMP_WEAK,
    Reason.SENSOR_DEAD: FakeFault.SENSOR_DEAD,
    Reason.SENSOR_STUCK: FakeFault.SENSOR_STUCK,
    Reason.SENSOR_DRIFTING: FakeFault.SENSOR_DRIFT,
    Reason.SENSOR_OUT_OF_RANGE: FakeFault.SENSOR_OUT_OF_RANGE,
}
"""Faults of the plant."""

ELSEWHERE = (
    Reason.BOARD_UNPLUGGED,
    Reason.BOARD_REBOOTED,
    Reason.BROWN_OUT,
    Reason.LINE_NOISE,
    Reason.COMMANDS_STALE,
    Reason.EXECUTOR_OVERLOADED,
)
"""Faults of the board, of the line to it, and of those who command."""

WITHIN_S = {
    Reason.LEAK: 0.5,
    Reason.BLOCKED_LINE: 1.5,
    Reason.VALVE_STUCK_OPEN: 1.0,
    Reason.VALVE_STUCK_CLOSED: 1.5,
    Reason.PUMP_DEAD: 2.0,
    Reason.PUMP_WEAK: 4.0,
    Reason.SENSOR_DEAD: 0.6,
    Reason.SENSOR_STUCK: 1.0,
    Reason.SENSOR_DRIFTING: 1.0,
    Reason.SENSOR_OUT_OF_RANGE: 0.06,
    Reason.BOARD_UNPLUGGED: 0.06,
    Reason.BOARD_REBOOTED: 0.06,
    Reason.BROWN_OUT: 0.06,
    Reason.LINE_NOISE: 1.5,
    Reason.COMMANDS_STALE: 0.6,
    Reason.EXECUTOR_OVERLOADED: 0.06,
}
"""Time from when a clear fault first matters, within which docs/faults.md has it reported, s; a sample to spare."""

SAMPLE_S = 0.01
_SAMPLES_PER_TICK = 5
_BUSY_CHANGES = 0.3
"""Share of samples at which a busy host comes to be more or less late."""


def built(declared: AirSettings, draw: random.Random) -> AirSettings:
    """Return an ankle as somebody would really build it: every part off by its tolerance, log-normal.

    Volumes by 10 %, conductances by 15 %, the pump by 12 % in flow and by 8 % in its end, healthy leaks by a
    factor of two, dead times of 5 to 20 ms.
    """

    def off(deviation: float) -> float:
        return math.exp(draw.gauss(0.0, deviation))

    return replace(
        declared,
        manifold_volume_m3=declared.manifold_volume_m3 * off(0.1),
        channel_volumes_m3=tuple(volume * off(0.1) for volume in declared.channel_volumes_m3),
        valve_conductance_m3_s_pa=declared.valve_conductance_m3_s_pa * off(0.15),
        leak_conductance_m3_s_pa=declared.leak_conductance_m3_s_pa * off(0.7),
        pump_free_flow_m3_s=declared.pump_free_flow_m3_s * off(0.12),
        valve_dead_time_s=draw.uniform(0.005, 0.02),
        pump_ultimate_vacuum_pa=declared.pump_ultimate_vacuum_pa * pump_end(draw),
    )


def pump_end(draw: random.Random) -> float:
    """Return where a pump ends, over that of its type: off by 8 %, and at most by 20 %. Assumed."""
    return min(max(math.exp(draw.gauss(0.0, 0.08)), 0.8), 1.2)


def fake_plant(declared: AirSettings, draw: random.Random, seed: int) -> FakePlant:
    """Return an ankle of the law that the driver judges by, off by its tolerances, with sensors off by 150 Pa."""
    ambient_pa = STANDARD_ATMOSPHERE_PA + draw.gauss(0.0, 800.0)
    offsets_pa = {place: draw.gauss(0.0, 150.0) for place in (MANIFOLD, *CHANNELS)}
    return FakePlant(built(declared, draw), ambient_pa, SensorErrors(offsets_pa=offsets_pa), seed)


_OF_THE_END = 0.9
"""Most vacuum that is asked for, over where the pump ends: beyond it a pump works for seconds, or for ever."""


class FaultBench:
    """A driver on a plant, stepped by 10 ms; somebody jams and vents it at random, by service or by stream."""

    def __init__(self, parameters: DriverParameters, seed: int, build: PlantBuilder = fake_plant) -> None:
        """Build an ankle by `seed`, and activate its driver.

        Args:
            parameters: Of the driver.
            seed: Of all that is random.
            build: Builds the ankle.

        """
        self.draw = random.Random(seed)  # noqa: S311 - a simulation and no secret
        self.plant = build(parameters.air(), self.draw, seed)
        self.board = FakeBoard(self.plant)
        self.driver = Driver(CHANNELS, parameters)
        self.noisy = False
        self.late_samples = 0
        """How many periods late a reading comes at the most, with the stamp of when it came: a host that is busy."""
        self.stands_still = False
        """Whether all behind the pins stands still while time goes on: each reading repeats the last one."""
        self._stood_still_s = 0.0
        self._readings: deque[dict[str, float]] = deque(maxlen=100)
        self._late = 0
        self.streams = False
        self.asks = True
        """Whether anybody asks for anything."""
        self.rests = 0.0
        """Share of the actions after which nothing is asked for a quarter of a minute or so."""
        self.steady_s = 0.0
        self._samples = 0
        self.set_point_pa = 0.0
        self._next_s = 1.5
        self._jammed_last = False
        self.driver.activate(self.now)

    @property
    def now(self) -> Instant:
        """The moment, on both clocks."""
        return Instant(self.steady_s, self.plant.time_s + self._stood_still_s)

    @property
    def link(self) -> LinkStatus:
        """What is known of the board."""
        return self.board.link

    def stand_still(self, duration_s: float) -> None:
        """Let the driver's process stand still; the plant goes on, and its board lets go."""
        self.board.advance(duration_s)
        self.steady_s += duration_s

    def hang(self, duration_s: float) -> None:
        """Let the driver's node hang; the board lets go, and every reading of that time waits."""
        waiting: list[PressureSample] = []
        for _ in range(round(duration_s / SAMPLE_S)):
            self.board.advance(SAMPLE_S)
            self.steady_s += SAMPLE_S
            self.driver.take_driven(self.board.driven, self.now.graph_s)
            waiting += self._samples_now()
        for each in waiting:
            self._look_at_link(self.now)
            self.driver.measure(each, self.now)

    def step(self) -> None:
        """Let 10 ms pass: samples, every fifth time a tick, and the command that follows."""
        if self.stands_still:
            self._stood_still_s += SAMPLE_S
        else:
            self.board.advance(SAMPLE_S)
        self.steady_s += SAMPLE_S
        now = self.now
        connected = self.link.state is LinkState.CONNECTED
        if connected:
            errors = int(self.noisy and self.draw.random() < 0.1)
            self.board.count(1 - errors, errors)
            if not errors:
                self.driver.take_driven(self.board.driven, now.graph_s)
                for sample in self._samples_now():
                    self.driver.measure(sample, now)
        self._samples += 1
        if self._samples % _SAMPLES_PER_TICK == 0:
            self._tick(now)
        if connected:
            self.hand_over()

    def hand_over(self, late_s: float = 0.0) -> None:
        """Give the driver's command to the board, whose outputs follow `late_s` s later."""
        self.board.take(self.driver.command, late_s)
        self.driver.take_driven(self.board.driven, self.now.graph_s)

    def _tick(self, now: Instant) -> None:
        if self.streams:
            self._ask(
                lambda: self.driver.follow([SetPoint(name, self.set_point_pa) for name in CHANNELS], now, "jam_command")
            )
        self.driver.tick(now)
        self._look_at_link(now)
        self.driver.link_watch.count(self.link, now.steady_s)

    def _look_at_link(self, now: Instant) -> None:
        if self.driver.look_at_link(self.link, now):
            self.board.acknowledge()

    def _samples_now(self) -> list[PressureSample]:
        repeats = self.stands_still and self._readings
        self._readings.appendleft(self._readings[0] if repeats else self.plant.readings_pa())
        if self.late_samples and self.draw.random() < _BUSY_CHANGES:
            self._late = self.draw.randint(0, self.late_samples)
        read = self._readings[min(self._late, len(self._readings) - 1)]
        return [PressureSample(place, pressure_pa, self.now.graph_s) for place, pressure_pa in read.items()]

    def wander(self) -> None:
        """Jam and vent at random: mostly all channels, now and then one or two."""
        if not self.asks or self.plant.time_s < self._next_s:
            return
        self._next_s += 0.3 + self.draw.expovariate(1.0 / (15.0 if self.draw.random() < self.rests else 0.9))
        several = list(CHANNELS) if self.draw.random() < 0.7 else self.draw.sample(CHANNELS, self.draw.choice([1, 2]))
        jam = self.draw.random() < (0.3 if self._jammed_last else 0.8)
        vacuum_pa = min(self.draw.uniform(15e3, 65e3), _OF_THE_END * self.plant.air.pump_ultimate_vacuum_pa)
        self._jammed_last = jam
        if self.streams:
            self.set_point_pa = vacuum_pa if jam else 0.0
        elif jam:
            self._ask(lambda: self.driver.jam(several, vacuum_pa, "test"))
        else:
            self._ask(lambda: self.driver.unjam(several, "test"))

    def reported(self) -> tuple[Reason, str]:
        """Return what the driver says is wrong, and where; (NONE, "") where nothing is."""
        trouble = self.driver.trouble.why
        if self.driver.ankle.findings:
            found = self.driver.ankle.findings[0]
            return found.reason, found.place
        if trouble.reason is not Reason.NONE:
            faulty = [channel.name for channel in self.driver.ankle.faulty]
            return trouble.reason, faulty[0] if faulty else MANIFOLD
        return Reason.NONE, ""

    @staticmethod
    def _ask(request: object) -> None:
        try:
            request()  # type: ignore[operator]
        except RequestError:
            return


SET_POINT_PA = 50e3


def bench_of(seed: int = 1, **parameters: Any) -> FaultBench:
    """Return an ankle by `seed` whose driver has these parameters."""
    return FaultBench(DriverParameters(**parameters), seed)


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


def alarms(seed: int, duration_s: float, build: PlantBuilder = fake_plant) -> list[str]:
    """Jam and vent a healthy ankle for a while; return every fault that was reported."""
    bench = FaultBench(DriverParameters(), seed, build)
    bench.rests = 0.1
    said: list[str] = []
    while bench.plant.time_s < duration_s:
        bench.wander()
        bench.step()
        reported, where = bench.reported()
        if reported is not Reason.NONE:
            said.append(f"seed {seed}, {bench.plant.time_s:.2f} s: {reported.name} {where}")
            bench.driver.clear_fault(bench.now)
    return said
