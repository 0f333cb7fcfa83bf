"""Engine and run state: what advances when, with a simulation and a clock made of numbers."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jammkle_sim.core.engine import (
    AS_FAST_AS_POSSIBLE,
    MAX_STEPS,
    STATES,
    Engine,
    Output,
    Pacer,
    RefusedError,
    RunState,
    Tick,
)

PERIODS = {Output.IMU: 4, Output.PRESSURES: 20}
IMU_PERIOD_NS = 2_000_000


class Counter:
    """A simulation that only counts its steps."""

    timestep_s = 0.0005

    def __init__(self) -> None:
        self.steps = 0
        self.resets: list[int] = []

    @property
    def time_s(self) -> float:
        return self.steps * self.timestep_s

    def advance(self, steps: int) -> None:
        self.steps += steps

    def reset(self) -> None:
        self.resets.append(self.steps)


class World:
    """An engine on a counter, and a clock that moves only on command."""

    def __init__(self, speed: float = 1.0, *, start_paused: bool = False) -> None:
        self.now_s = 100.0
        self.simulation = Counter()
        self.engine = Engine(self.simulation, PERIODS, Pacer(speed), lambda: self.now_s, start_paused=start_paused)

    def ticks(self) -> list[Tick]:
        """Everything that is due at this moment."""
        found = []
        while (tick := self.engine.cycle()) is not None:
            found.append(tick)
        return found

    def run(self, real_s: float) -> list[Tick]:
        """Let real time pass in the steps that the engine asks for."""
        end_s = self.now_s + real_s
        found = self.ticks()
        while self.now_s + self.engine.wait_s() <= end_s:
            self.now_s += self.engine.wait_s()
            self.now_s = math.nextafter(self.now_s, math.inf)
            found += self.ticks()
        self.now_s = end_s
        return found


def test_a_start_time_moves_every_stamp_and_nothing_else() -> None:
    """The same outputs at the same pace, each stamped later by the start, which is rounded to a whole step."""
    late = World()
    late.engine.set_start_time(12.00012)
    expected = [Tick(tick.time_ns + 12_000_000_000, tick.outputs) for tick in World().run(0.1)]
    assert not late.engine.begun
    assert late.run(0.1) == expected
    assert late.engine.begun


def test_one_second_gives_each_output_its_number() -> None:
    """A second of real time at speed 1 gives 500 IMU and 100 pressure outputs, stamped on their grid."""
    ticks = World().run(1.0001)
    imu = [tick.time_ns for tick in ticks if Output.IMU in tick.outputs]
    pressures = [tick.time_ns for tick in ticks if Output.PRESSURES in tick.outputs]
    assert imu == [IMU_PERIOD_NS * (index + 1) for index in range(500)]
    assert pressures == [10_000_000 * (index + 1) for index in range(100)]


@settings(deadline=None)  # a long list of sleeps is a lot of work, and the machine may be busy
@given(st.floats(0.05, 20.0), st.lists(st.floats(0.0, 0.3), max_size=20))
def test_simulated_time_stays_behind_real_time(speed: float, sleeps_s: list[float]) -> None:
    """However the process is delayed, simulated time is never ahead of real time x speed."""
    world = World(speed)
    for sleep_s in sleeps_s:
        world.now_s += sleep_s
        world.ticks()
        assert world.simulation.time_s <= (world.now_s - 100.0) * speed * (1 + 1e-9) + 1e-9


def test_nothing_moves_while_paused_and_no_rush_follows() -> None:
    """A pause of a minute is not caught up."""
    world = World()
    world.run(0.01)
    world.engine.pause()
    before = world.simulation.steps
    world.now_s += 60.0
    assert world.ticks() == []
    assert math.isinf(world.engine.wait_s())
    world.engine.resume()
    assert world.ticks() == []
    assert world.simulation.steps == before
    assert len(world.run(0.0101)) == 5


@given(st.integers(1, 200), st.integers(1, 200))
def test_steps_are_exact_and_readings_keep_their_grid(first: int, second: int) -> None:
    """Any number of steps moves time by exactly so much; the last shows the state; readings stay on their grid."""
    world = World(start_paused=True)
    for steps in (first, second):
        before = world.simulation.steps
        world.engine.begin_steps(steps)
        ticks = world.ticks()
        assert world.simulation.steps == before + steps
        assert ticks[-1].time_ns == world.engine.time_ns
        assert set(STATES) <= set(ticks[-1].outputs)
        assert all(tick.time_ns % IMU_PERIOD_NS == 0 for tick in ticks if Output.IMU in tick.outputs)
        assert world.engine.state is RunState.PAUSED


def test_a_reset_restarts_the_schedule_and_not_the_time() -> None:
    """After a reset off the grid, outputs come at the same times after the reset as after the start."""
    world = World(AS_FAST_AS_POSSIBLE, start_paused=True)
    world.engine.begin_steps(7)
    world.ticks()
    world.engine.reset()
    assert world.simulation.resets == [7]
    world.engine.resume()
    ticks = [world.engine.cycle() for _ in range(5)]
    assert [tick.time_ns for tick in ticks if tick] == [7 * 500_000 + IMU_PERIOD_NS * (i + 1) for i in range(5)]
    assert [Output.PRESSURES in tick.outputs for tick in ticks if tick] == [False] * 4 + [True]


def test_a_change_of_speed_makes_no_jump() -> None:
    """At the moment of the change nothing new is due, and then time runs at the new speed."""
    world = World()
    world.run(0.0101)
    world.engine.set_speed(10.0)
    assert world.ticks() == []
    assert len(world.run(0.0101)) in {50, 51}


def test_a_failure_stops_time_until_a_reset() -> None:
    """A failed simulation refuses to run and to step, names why and the way out, and is paused after a reset."""
    world = World()
    world.engine.fail("it blew up")
    world.now_s += 1.0
    assert world.ticks() == []
    for ask in (world.engine.resume, lambda: world.engine.begin_steps(1)):
        with pytest.raises(RefusedError, match="it blew up; call ~/reset"):
            ask()
    world.engine.reset()
    assert world.engine.state is RunState.PAUSED
    world.engine.resume()
    assert world.run(0.0101)


@pytest.mark.parametrize("steps", [0, MAX_STEPS + 1])
def test_a_number_of_steps_out_of_range_is_refused(steps: int) -> None:
    """The message names the number and the limit, and nothing changes."""
    world = World(start_paused=True)
    with pytest.raises(RefusedError, match=rf"steps is {steps}; it must be 1 to {MAX_STEPS}"):
        world.engine.begin_steps(steps)
    assert world.engine.state is RunState.PAUSED


def test_wishes_that_do_not_fit_the_state_are_refused() -> None:
    """Stepping needs a pause, and while steps are taken everything else waits."""
    world = World()
    with pytest.raises(RefusedError, match=r"pause first with ~/set_paused"):
        world.engine.begin_steps(1)
    world.engine.pause()
    world.engine.begin_steps(100)
    for ask in (world.engine.pause, world.engine.resume, world.engine.reset, lambda: world.engine.begin_steps(1)):
        with pytest.raises(RefusedError, match="100 steps are still to take"):
            ask()


def test_the_real_time_factor_is_zero_while_time_stands() -> None:
    """Running at speed 2 it measures 2; paused it is 0."""
    world = World(2.0)
    world.run(1.0)
    assert world.engine.real_time_factor == pytest.approx(2.0, rel=0.02)
    world.engine.pause()
    assert world.engine.real_time_factor == 0.0
