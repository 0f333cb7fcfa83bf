"""Faults are found and distinguished, each within its time, on plants off by their tolerances; healthy ones are not."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import pytest

from fault_bench import (
    SAMPLE_S,
    SET_POINT_PA,
    WITHIN_S,
    FaultBench,
    alarms,
    bench_of,
    built,
    jammed_bench,
    run,
)
from jammkle_common.constants import STANDARD_ATMOSPHERE_PA
from jammkle_common.names import CHANNELS
from jammkle_driver.core.diagnosis import THRESHOLD
from jammkle_driver.core.faults import Reason
from jammkle_driver.core.hardware import MANIFOLD, released
from jammkle_driver.fake import FakeFault, FakePlant, LinkFault, SensorErrors
from jammkle_driver.parameters import DriverParameters

if TYPE_CHECKING:
    import random
    from collections.abc import Callable

    from jammkle_driver.core.air import AirSettings


@dataclass(frozen=True)
class Staged:
    """A fault that matters from the moment on that it is there or that the ankle is asked for something."""

    fault: FakeFault
    size: float = 0.0
    while_jammed: bool = False
    then_asks: bool = True


STAGED = {
    Reason.LEAK: Staged(FakeFault.LEAK, 1e-10, while_jammed=True, then_asks=False),
    Reason.BLOCKED_LINE: Staged(FakeFault.BLOCKED, 0.1),
    Reason.VALVE_STUCK_OPEN: Staged(FakeFault.STUCK_OPEN, while_jammed=True),
    Reason.VALVE_STUCK_CLOSED: Staged(FakeFault.STUCK_CLOSED),
    Reason.PUMP_DEAD: Staged(FakeFault.PUMP_DEAD),
    Reason.PUMP_WEAK: Staged(FakeFault.PUMP_WEAK, 0.25),
    Reason.SENSOR_DEAD: Staged(FakeFault.SENSOR_DEAD, while_jammed=True, then_asks=False),
    Reason.SENSOR_STUCK: Staged(FakeFault.SENSOR_STUCK),
    Reason.SENSOR_DRIFTING: Staged(FakeFault.SENSOR_BIAS, 5e3, while_jammed=True, then_asks=False),
    Reason.SENSOR_OUT_OF_RANGE: Staged(FakeFault.SENSOR_OUT_OF_RANGE, 130e3, then_asks=False),
}
"""One clear fault of each kind."""


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("reason", STAGED, ids=lambda each: each.name)
def test_a_fault_that_matters_is_reported_within_its_time(seed: int, reason: Reason) -> None:
    """From the onset, or from the jam or release that it stands in the way of; by then the outputs are off."""
    within_s, staged = WITHIN_S[reason], STAGED[reason]
    bench = bench_of(seed)
    run(bench, 2.0)
    if staged.while_jammed:
        bench.driver.jam((), SET_POINT_PA, "test")
        run(bench, 1.5)
    bench.plant.inject(staged.fault, "achilles", staged.size)
    if staged.then_asks:
        run(bench, 0.3)
        assert bench.reported()[0] is Reason.NONE
        if staged.while_jammed:
            bench.driver.unjam((), "test")
        else:
            bench.driver.jam((), SET_POINT_PA, "test")
    run(bench, within_s)
    assert bench.reported()[0] is reason
    assert bench.board.driven == released(CHANNELS)


def _fall_silent(bench: FaultBench) -> None:
    bench.streams = False


def _become_noisy(bench: FaultBench) -> None:
    bench.noisy = True


BEFALLS: dict[Reason, Callable[[FaultBench], None]] = {
    Reason.BOARD_UNPLUGGED: lambda bench: bench.board.inject(LinkFault.UNPLUGGED),
    Reason.BOARD_REBOOTED: lambda bench: bench.board.reboot(),
    Reason.BROWN_OUT: lambda bench: bench.board.inject(LinkFault.BROWN_OUT),
    Reason.LINE_NOISE: _become_noisy,
    Reason.COMMANDS_STALE: _fall_silent,
}
"""What brings each about."""


@pytest.mark.parametrize("reason", BEFALLS, ids=lambda each: each.name)
def test_what_befalls_board_line_and_driver_is_reported_within_its_time(reason: Reason) -> None:
    """While a stream of commands holds everything; all but noise lets go."""
    within_s, happen = WITHIN_S[reason], BEFALLS[reason]
    bench = bench_of()
    bench.streams, bench.set_point_pa = True, SET_POINT_PA
    run(bench, 2.5)
    assert bench.reported()[0] is Reason.NONE
    happen(bench)
    run(bench, within_s)
    assert bench.reported()[0] is reason
    assert any(bench.driver.command.solenoids.values()) is (reason is Reason.LINE_NOISE)


def test_a_leak_that_begins_as_a_jam_is_reached_is_no_dead_pump() -> None:
    """Air that comes in while the pump comes to rest is not a pump that blows; but in one of six at the most."""
    reported = []
    for seed in range(6):
        bench = bench_of(seed)
        run(bench, 1.0)
        bench.driver.jam((), SET_POINT_PA, "test")
        run(bench, 0.1)
        while bench.driver.command.pump_duty > 0.0:
            bench.step()
        bench.plant.inject(FakeFault.LEAK, MANIFOLD, 3e-10)
        run(bench, 2.0)
        reported.append(bench.reported())
    assert reported.count((Reason.LEAK, MANIFOLD)) >= len(reported) - 1


@pytest.mark.parametrize("end_pa", [64e3, 67e3, 96e3])
def test_a_pump_that_ends_at_another_vacuum_than_declared_is_healthy(end_pa: float) -> None:
    """80 kPa are declared; one that ends 20 % lower comes to 60 kPa, late, and is neither weak nor anything else."""

    def lower(declared: AirSettings, _draw: random.Random, number: int) -> FakePlant:
        air = replace(declared, pump_ultimate_vacuum_pa=end_pa)
        return FakePlant(air, STANDARD_ATMOSPHERE_PA, SensorErrors(), number)

    bench = FaultBench(DriverParameters(), 1, lower)
    for vacuum_pa in (60e3, 40e3, 60e3):
        run(bench, 1.0)
        bench.driver.jam((), vacuum_pa, "test")
        run(bench, 3.0)
        assert bench.reported()[0] is Reason.NONE
        bench.driver.unjam((), "test")


@pytest.mark.parametrize("still_s", [0.05, 0.2, 0.4, 1.0])
def test_hardware_that_stands_still_for_a_moment_is_no_fault(still_s: float) -> None:
    """Time and commands go on, every reading repeats the last one, the air goes on from there: not a word."""
    bench = bench_of()
    for _ in range(5):
        for _ in range(round(bench.draw.uniform(0.5, 1.5) / SAMPLE_S)):
            bench.wander()
            bench.step()
        bench.stands_still = True
        for _ in range(round(still_s / SAMPLE_S)):
            bench.wander()
            bench.step()
        bench.stands_still = False
        assert bench.driver.ankle.findings == ()


@pytest.mark.parametrize("while_jammed", [False, True], ids=["vented", "jammed"])
def test_sensors_that_all_stand_still_for_good_are_reported_in_vacuum(*, while_jammed: bool) -> None:
    """Within 2 s of a jammed ankle that nobody measures any more."""
    bench = jammed_bench() if while_jammed else bench_of()
    run(bench, 0.0 if while_jammed else 2.0)
    bench.stands_still = True
    for _ in range(round(2.0 / SAMPLE_S)):
        bench.step()
    assert (bench.reported() == (Reason.SENSOR_STUCK, MANIFOLD)) is while_jammed


@pytest.mark.parametrize(
    ("fault", "size"),
    [(FakeFault.LEAK, 3e-10), (FakeFault.STUCK_OPEN, 0.0), (FakeFault.SENSOR_BIAS, 5e3)],
    ids=["leak", "stuck_open", "bias"],
)
def test_a_second_fault_is_reported_while_the_first_stands(fault: FakeFault, size: float) -> None:
    """With the policy channel the others go on, healthy, and then one of them leaks, and the pump dies."""
    bench = jammed_bench(fault_policy="channel")
    others = ("peroneal_left", "peroneal_right")
    bench.plant.inject(fault, "achilles", size)
    run(bench, 0.5)
    bench.driver.unjam((), "test")
    run(bench, 1.0)
    assert [found.place for found in bench.driver.ankle.findings] == ["achilles"]
    bench.driver.jam(others, SET_POINT_PA, "test")
    run(bench, 2.0)
    assert len(bench.driver.ankle.findings) == 1
    bench.plant.inject(FakeFault.LEAK, "peroneal_left", 2e-10)
    run(bench, 1.0)
    found = bench.driver.ankle.findings[-1]
    assert (found.reason, found.place) == (Reason.LEAK, "peroneal_left")
    states = {channel.name: channel.state.name for channel in bench.driver.ankle.channels.values()}
    assert states == {"achilles": "FAULT", "peroneal_left": "FAULT", "peroneal_right": "JAMMED"}
    bench.driver.unjam(("peroneal_right",), "test")
    run(bench, 0.5)
    bench.plant.inject(FakeFault.PUMP_DEAD, MANIFOLD)
    bench.driver.jam(("peroneal_right",), SET_POINT_PA, "test")
    run(bench, 2.0)
    assert bench.driver.ankle.findings[-1].reason is Reason.PUMP_DEAD


def test_a_stall_is_reported_at_once() -> None:
    """Of a driver that holds nothing, and so of a board that has let go of nothing."""
    bench = bench_of()
    run(bench, 1.0)
    bench.stand_still(1.5)
    run(bench, 0.06)
    assert bench.reported()[0] is Reason.EXECUTOR_OVERLOADED


def test_a_sensor_that_repeats_itself_in_vacuum_is_stuck_though_nothing_moves() -> None:
    """A second of the same digits from a sensor whose noise was seen before, of a jammed ankle at rest."""
    bench = jammed_bench()
    bench.plant.inject(FakeFault.SENSOR_STUCK, "achilles")
    run(bench, 1.0)
    assert bench.reported() == (Reason.SENSOR_STUCK, "achilles")


@pytest.mark.parametrize(("seed", "before_s"), [(0, 0.1), (3, 0.2), (6, 0.2)])
def test_a_coarse_sensor_that_sticks_just_before_the_release_is_no_blocked_line(seed: int, before_s: float) -> None:
    """Its runs of equal readings are long at the best of times, so that a line which lets nothing through leads."""

    def coarse(declared: AirSettings, draw: random.Random, number: int) -> FakePlant:
        return FakePlant(built(declared, draw), STANDARD_ATMOSPHERE_PA, SensorErrors(step_pa=98.0), number)

    bench = FaultBench(DriverParameters(), seed, coarse)
    run(bench, 1.5)
    bench.driver.jam((), SET_POINT_PA, "test")
    run(bench, 2.3)
    bench.plant.inject(FakeFault.SENSOR_STUCK, "peroneal_right")
    run(bench, before_s)
    bench.driver.unjam((), "test")
    run(bench, 1.5)
    assert bench.reported() == (Reason.SENSOR_STUCK, "peroneal_right")


@pytest.mark.parametrize("flow_share", [0.65, 1.0])
def test_a_valve_that_stays_closed_is_no_stuck_sensor(flow_share: float) -> None:
    """A pump of less flow draws two channels as a declared one draws three; but the vented sensor is still noisy."""

    def weaker(declared: AirSettings, _draw: random.Random, number: int) -> FakePlant:
        air = replace(declared, pump_free_flow_m3_s=flow_share * declared.pump_free_flow_m3_s)
        return FakePlant(air, STANDARD_ATMOSPHERE_PA, SensorErrors(), number)

    bench = FaultBench(DriverParameters(), 0, weaker)
    run(bench, 1.0)
    bench.plant.inject(FakeFault.STUCK_CLOSED, "achilles")
    bench.driver.jam((), SET_POINT_PA, "test")
    run(bench, 0.8)
    assert bench.reported() == (Reason.VALVE_STUCK_CLOSED, "achilles")


@pytest.mark.parametrize(("step_pa", "noise_pa", "seed"), [(98.0, 10.0, 1), (98.0, 30.0, 1), (25.0, 3.0, 2)])
def test_a_coarse_or_quiet_sensor_that_repeats_itself_is_healthy(step_pa: float, noise_pa: float, seed: int) -> None:
    """Converters of 10 and 12 bits whose step hides the noise: most readings equal the one before, and not a word."""

    def coarse(declared: AirSettings, draw: random.Random, number: int) -> FakePlant:
        return FakePlant(built(declared, draw), STANDARD_ATMOSPHERE_PA, SensorErrors(noise_pa, step_pa), number)

    assert alarms(seed, 35.0, coarse) == []


def test_a_sensor_at_the_end_of_its_range_is_no_stuck_one() -> None:
    """One that cannot read above the atmosphere repeats itself as often as its channel is vented: not a word."""
    bench = jammed_bench()
    bench.driver.unjam((), "test")
    run(bench, 0.5)
    bench.plant.inject(FakeFault.SENSOR_STUCK, "achilles")
    run(bench, 3.0)
    assert bench.reported()[0] is Reason.NONE


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("while_jammed", [False, True], ids=["vented", "jammed"])
def test_a_small_drift_that_is_put_right_is_no_fault(seed: int, *, while_jammed: bool) -> None:
    """A sensor that is off by less than counts, and then right from one reading to the next: not a word."""
    bench = bench_of(seed)
    run(bench, 1.0)
    if while_jammed:
        bench.driver.jam((), SET_POINT_PA, "test")
        run(bench, 1.5)
    bench.plant.inject(FakeFault.SENSOR_DRIFT, "achilles", 300.0)
    run(bench, 3.3)
    bench.plant.heal()
    run(bench, 4.0)
    assert bench.driver.ankle.findings == ()


@pytest.mark.parametrize("rate_pa_s", [-900.0, 500.0])
def test_a_sensor_that_drifts_while_nothing_moves_is_no_blocked_line(rate_pa_s: float) -> None:
    """Of a vented channel, whose line could be anything: reported once the sensor is off by what counts."""
    bench = jammed_bench()
    bench.driver.unjam((), "test")
    run(bench, 0.5)
    bench.plant.inject(FakeFault.SENSOR_DRIFT, "achilles", rate_pa_s)
    run(bench, 1200.0 / abs(rate_pa_s) + 2.0)
    assert bench.reported() == (Reason.SENSOR_DRIFTING, "achilles")


def test_a_healthy_ankle_raises_no_alarm() -> None:
    """Half a minute of jamming and resting, with parts off by their tolerances: not a word."""
    assert alarms(5, 30.0) == []


def test_a_release_between_two_readings_is_no_fault() -> None:
    """A jam that is taken back and asked again at once, which the board followed for a cycle, is known of."""
    bench, gained = jammed_bench(), [0.0]
    for _ in range(3):
        bench.driver.unjam((), "test")
        bench.hand_over()
        bench.driver.jam((), SET_POINT_PA, "test")
        bench.hand_over(late_s=0.04)
        run(bench, 0.5, lambda: gained.append(max(bench.driver.ankle.diagnosis._bank.scores)))
    assert max(gained) < 0.5 * THRESHOLD


@pytest.mark.parametrize("lasts_s", [0.004, 0.009, 0.014, 0.018])
def test_a_jam_between_two_readings_is_no_fault(lasts_s: float) -> None:
    """One that is taken back at once, from a manifold in vacuum: what it drew is not taken for the atmosphere."""
    bench, gained, off_pa = jammed_bench(), [0.0], [0.0]
    bench.driver.unjam((), "test")
    run(bench, 1.5)
    atmosphere, bank = bench.driver.ankle.atmosphere, bench.driver.ankle.diagnosis._bank
    vented_pa = atmosphere.pressure_pa

    def watch() -> None:
        gained.append(max(bank.scores))
        off_pa.append(abs(atmosphere.pressure_pa - vented_pa))

    for _ in range(3):
        bench.driver.jam((), SET_POINT_PA, "test")
        bench.hand_over()
        bench.driver.unjam((), "test")
        bench.hand_over(late_s=lasts_s)
        run(bench, 1.2, watch)
    assert max(off_pa) < 50.0  # noise of one reading
    assert max(gained) < 0.5 * THRESHOLD
    assert bench.driver.ankle.findings == ()


@pytest.mark.parametrize("seed", [5, 9])
def test_readings_that_come_late_are_no_fault(seed: int) -> None:
    """A host that hands readings over up to 40 ms late, while an ankle jams and vents all the time: not a word."""
    bench = bench_of(seed)
    bench.late_samples = 4
    for _ in range(4):
        run(bench, 0.5)
        bench.driver.jam((), 40e3, "test")
        run(bench, 1.0)
        assert bench.driver.ankle.findings == ()
        bench.driver.unjam((), "test")
