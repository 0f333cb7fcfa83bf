"""Faults are found, told apart and acted on, on plants whose parts are off by their tolerances; the healthy go on."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jammkle_driver.core.atmosphere import Atmosphere
from jammkle_driver.core.channel import ChannelState
from jammkle_driver.core.diagnosis import THRESHOLD
from jammkle_driver.core.faults import Reason
from jammkle_driver.core.hardware import MANIFOLD, LinkState, ResetCause, released
from jammkle_driver.core.overload import OverloadWatch
from jammkle_driver.core.regulator import PumpLoad
from jammkle_driver.core.releases import check_carried_out
from jammkle_driver.core.requests import RequestError, Wish
from jammkle_driver.fake.bench import FaultBench, built
from jammkle_driver.fake.faults import FakeFault
from jammkle_driver.fake.plant import FakePlant
from jammkle_driver.fake.script import ScriptError, read_script
from jammkle_driver.fake.sensors import SensorErrors
from jammkle_driver.fake.soak import soak
from jammkle_driver.fake.trial import ELSEWHERE, PLACED, alarms, inject
from jammkle_driver.parameters import DriverParameters
from jammkle_graph.constants import STANDARD_ATMOSPHERE_PA
from jammkle_graph.names import CHANNELS

if TYPE_CHECKING:
    import random
    from collections.abc import Callable

    from jammkle_driver.core.air import AirSettings

SET_POINT_PA = 50e3


def bench_of(seed: int = 1, **parameters: Any) -> FaultBench:
    return FaultBench(DriverParameters(**parameters).settings(), seed)


def run(bench: FaultBench, duration_s: float, watch: Callable[[], None] = lambda: None) -> None:
    end_s = bench.plant.time_s + duration_s
    while bench.plant.time_s < end_s:
        bench.step()
        watch()


def jammed_bench(**parameters: Any) -> FaultBench:
    bench = bench_of(**parameters)
    run(bench, 1.0)
    bench.driver.jam((), SET_POINT_PA, "test")
    run(bench, 1.5)
    assert bench.driver.command != released(CHANNELS)
    return bench


@pytest.mark.parametrize(("seed", "reason"), list(enumerate((*PLACED, *ELSEWHERE))), ids=str)
def test_a_fault_is_told_with_its_reason_and_place(seed: int, reason: Reason) -> None:
    """Each kind of fault, put into a random ankle at a random place, is named; docs/faults.md has 500 of them."""
    outcome = inject(seed, reason)
    assert (outcome.told, outcome.told_place) == (reason, outcome.place)
    assert outcome.delay_s >= 0.0


@dataclass(frozen=True)
class Staged:
    """A fault that matters from the moment on that it is there or that the ankle is asked for something."""

    fault: FakeFault
    size: float = 0.0
    while_jammed: bool = False
    then_asks: bool = True


STAGED = {
    Reason.LEAK: (0.5, Staged(FakeFault.LEAK, 1e-10, while_jammed=True, then_asks=False)),
    Reason.BLOCKED_LINE: (1.5, Staged(FakeFault.BLOCKED, 0.1)),
    Reason.VALVE_STUCK_OPEN: (1.0, Staged(FakeFault.STUCK_OPEN, while_jammed=True)),
    Reason.VALVE_STUCK_CLOSED: (1.5, Staged(FakeFault.STUCK_CLOSED)),
    Reason.PUMP_DEAD: (2.0, Staged(FakeFault.PUMP_DEAD)),
    Reason.PUMP_WEAK: (4.0, Staged(FakeFault.PUMP_WEAK, 0.25)),
    Reason.SENSOR_DEAD: (0.6, Staged(FakeFault.SENSOR_DEAD, while_jammed=True, then_asks=False)),
    Reason.SENSOR_STUCK: (1.0, Staged(FakeFault.SENSOR_STUCK)),
    Reason.SENSOR_DRIFTING: (1.0, Staged(FakeFault.SENSOR_BIAS, 5e3, while_jammed=True, then_asks=False)),
    Reason.SENSOR_OUT_OF_RANGE: (0.06, Staged(FakeFault.SENSOR_OUT_OF_RANGE, 130e3, then_asks=False)),
}
"""Time within which docs/faults.md says that each is told, s, and one of its kind."""


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("reason", STAGED, ids=lambda each: each.name)
def test_a_fault_that_matters_is_told_within_its_time(seed: int, reason: Reason) -> None:
    """From the onset, or from the jam or release that it stands in the way of; by then the outputs are off."""
    within_s, staged = STAGED[reason]
    bench = bench_of(seed)
    run(bench, 2.0)
    if staged.while_jammed:
        bench.driver.jam((), SET_POINT_PA, "test")
        run(bench, 1.5)
    bench.plant.inject(staged.fault, "achilles", staged.size)
    if staged.then_asks:
        run(bench, 0.3)
        assert bench.told()[0] is Reason.NONE
        if staged.while_jammed:
            bench.driver.unjam((), "test")
        else:
            bench.driver.jam((), SET_POINT_PA, "test")
    run(bench, within_s)
    assert bench.told()[0] is reason
    assert bench.board.driven == released(CHANNELS)


def _fall_silent(bench: FaultBench) -> None:
    bench.streams = False


def _become_noisy(bench: FaultBench) -> None:
    bench.noisy = True


ELSEWHERE_WITHIN: dict[Reason, tuple[float, Callable[[FaultBench], None]]] = {
    Reason.BOARD_UNPLUGGED: (0.06, lambda bench: bench.board.unplug()),
    Reason.BOARD_REBOOTED: (0.06, lambda bench: bench.board.reboot()),
    Reason.BROWN_OUT: (0.06, lambda bench: bench.board.sag()),
    Reason.LINE_NOISE: (1.5, _become_noisy),
    Reason.COMMANDS_STALE: (0.6, _fall_silent),
}
"""Time within which docs/faults.md says that each is told, s, and what brings it about."""


@pytest.mark.parametrize("reason", ELSEWHERE_WITHIN, ids=lambda each: each.name)
def test_what_befalls_board_line_and_driver_is_told_within_its_time(reason: Reason) -> None:
    """While a stream of commands holds everything; all but noise lets go."""
    within_s, happen = ELSEWHERE_WITHIN[reason]
    bench = bench_of()
    bench.streams, bench.wish_pa = True, SET_POINT_PA
    run(bench, 2.5)
    assert bench.told()[0] is Reason.NONE
    happen(bench)
    run(bench, within_s)
    assert bench.told()[0] is reason
    assert any(bench.driver.command.solenoids.values()) is (reason is Reason.LINE_NOISE)


def test_a_stall_is_told_at_once() -> None:
    """Of a driver that holds nothing, and so of a board that has let go of nothing."""
    bench = bench_of()
    run(bench, 1.0)
    bench.stand_still(1.5)
    run(bench, 0.06)
    assert bench.told()[0] is Reason.EXECUTOR_OVERLOADED


def test_a_sensor_that_repeats_itself_in_vacuum_is_stuck_though_nothing_moves() -> None:
    """A second of the same digits from a sensor whose noise was seen before, of a jammed ankle at rest."""
    bench = jammed_bench()
    bench.plant.inject(FakeFault.SENSOR_STUCK, "achilles")
    run(bench, 1.0)
    assert bench.told() == (Reason.SENSOR_STUCK, "achilles")


@pytest.mark.parametrize(("step_pa", "noise_pa", "seed"), [(98.0, 10.0, 1), (98.0, 30.0, 1), (25.0, 3.0, 2)])
def test_a_coarse_or_quiet_sensor_that_repeats_itself_is_healthy(step_pa: float, noise_pa: float, seed: int) -> None:
    """Converters of 10 and 12 bits whose step hides the noise: most readings equal the one before, and not a word."""

    def coarse(declared: AirSettings, draw: random.Random, number: int) -> FakePlant:
        return FakePlant(
            CHANNELS, built(declared, draw), STANDARD_ATMOSPHERE_PA, SensorErrors(noise_pa, step_pa), number
        )

    assert alarms(seed, 35.0, coarse) == []


def test_a_sensor_at_the_end_of_its_range_is_no_stuck_one() -> None:
    """One that cannot read above the atmosphere repeats itself as often as its channel is vented: not a word."""
    bench = jammed_bench()
    bench.driver.unjam((), "test")
    run(bench, 0.5)
    bench.plant.inject(FakeFault.SENSOR_STUCK, "achilles")
    run(bench, 3.0)
    assert bench.told()[0] is Reason.NONE


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
        run(bench, 0.5, lambda: gained.append(max(bench.driver.ankle.diagnosis.scores.values())))
    assert max(gained) < 0.5 * THRESHOLD


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


def test_the_set_point_is_held_while_the_pump_mostly_rests() -> None:
    """Steady, each channel's true vacuum is within 1.5 kPa; the pump is off most of the time; the leak comes out."""
    bench = jammed_bench()
    resting = []

    def watch() -> None:
        resting.append(bench.driver.command.pump_duty == 0.0)
        for name in CHANNELS:
            vacuum_pa = bench.driver.ankle.atmosphere.pressure_pa - bench.plant.pressures_pa[name]
            assert vacuum_pa == pytest.approx(SET_POINT_PA, abs=1500.0)

    run(bench, 6.0, watch)
    assert sum(resting) > 0.6 * len(resting)
    air = bench.plant.healthy_air
    told = bench.driver.ankle.leaks.seen["achilles"]
    assert told.conductance_m3_s_pa == pytest.approx(4.0 * air.leak_conductance_m3_s_pa, rel=0.5)
    assert told.rate_pa_s > 0.0


def test_a_pump_that_works_too_long_is_spared() -> None:
    """Full duty is free for a while; the mean duty then stays at what the pump is rated for."""
    settings = replace(DriverParameters().settings().ankle.regulator, rated_duty=0.5, thermal_time_s=10.0)
    load = PumpLoad(settings)
    given_duty = [load.spare(1.0, 0.1) for _ in range(1000)]
    assert given_duty[:60] == [1.0] * 60
    assert load.limited
    assert load.mean_duty <= 0.51
    assert min(given_duty) < 0.5


@pytest.mark.parametrize(("policy", "others_jammed"), [("ankle", False), ("channel", True)])
def test_the_policy_says_what_one_fault_means_for_the_others(policy: str, *, others_jammed: bool) -> None:
    """With ankle, one bad sensor lets all go and refuses jams until it is cleared; with channel, the others hold on."""
    bench = jammed_bench(fault_policy=policy)
    bench.plant.inject(FakeFault.SENSOR_OUT_OF_RANGE, "achilles", 130e3)
    run(bench, 1.5)
    states = {channel.name: channel.state for channel in bench.driver.status.channels}
    assert states.pop("achilles") is ChannelState.FAULT
    wanted = ChannelState.JAMMED if others_jammed else ChannelState.UNJAMMED
    assert set(states.values()) == {wanted}
    if not others_jammed:
        with pytest.raises(RequestError, match="achilles"):
            bench.driver.jam(["peroneal_left"], 0.0, "test")
        bench.plant.heal()
        bench.driver.clear_fault(bench.now)
        run(bench, 0.5)
        bench.driver.jam((), 0.0, "test")
        run(bench, 1.5)
        assert {channel.state for channel in bench.driver.status.channels} == {ChannelState.JAMMED}


@pytest.mark.parametrize("policy", ["ankle", "channel"])
@pytest.mark.parametrize(
    ("diagnose", "reason"), [(True, Reason.SENSOR_STUCK), (False, Reason.NOT_REACHED)], ids=["law", "time-outs"]
)
def test_a_sensor_stuck_at_zero_is_told_and_the_others_do_not_flap(
    reason: Reason, policy: str, *, diagnose: bool
) -> None:
    """One sensor reads the atmosphere while all are jammed: the others stay JAMMED, and are let go once if at all."""
    bench = jammed_bench(diagnose=diagnose, fault_policy=policy)
    bench.plant.inject(FakeFault.SENSOR_OUT_OF_RANGE, "achilles", bench.driver.ankle.atmosphere.pressure_pa)
    others = [name for name in CHANNELS if name != "achilles"]
    passed: dict[str, list[ChannelState]] = {name: [ChannelState.JAMMED] for name in others}

    def watch() -> None:
        for name in others:
            state = bench.driver.ankle.channels[name].state
            if state is not passed[name][-1]:
                passed[name].append(state)

    run(bench, 4.0, watch)
    assert [(channel.name, channel.fault) for channel in bench.driver.ankle.faulty] == [("achilles", reason)]
    assert bench.driver.status.trouble.reason is reason
    let_go = [] if policy == "channel" else [ChannelState.VENTING, ChannelState.UNJAMMED]
    assert passed == {name: [ChannelState.JAMMED, *let_go] for name in others}


def torn_under_a_wrong_sensor(channels: tuple[str, ...], *, diagnose: bool, while_jammed: bool) -> FaultBench:
    """Run an ankle whose membrane tears, by two valves' conductance, under a sensor that reads the set point alone."""
    bench = bench_of(diagnose=diagnose)
    run(bench, 2.0)
    if while_jammed:
        bench.driver.jam(channels, SET_POINT_PA, "test")
        run(bench, 1.5)
    bench.plant.inject(FakeFault.LEAK, "achilles", 2e-9)
    bench.plant.inject(FakeFault.SENSOR_BIAS, "achilles", 2e3 - SET_POINT_PA)  # the pump comes to some 2 kPa there
    if not while_jammed:
        run(bench, 0.1)  # nothing is told sooner than in a quarter of a second
        bench.driver.jam(channels, SET_POINT_PA, "test")
    working = []
    run(bench, 6.0, lambda: working.append(bench.driver.command.pump_duty > 0.9))
    longest_s = 1.0 if diagnose else 3.5
    assert sum(working) * 0.01 <= longest_s
    assert bench.driver.command == released(CHANNELS)
    return bench


@pytest.mark.parametrize("channels", [(), ("achilles",)], ids=["all", "alone"])
def test_a_sensor_off_by_the_set_point_does_not_hide_a_leak(channels: tuple[str, ...]) -> None:
    """The sensor is blamed where it is off before the jam; both failing while jammed is told, if as one of several."""
    bench = torn_under_a_wrong_sensor(channels, diagnose=True, while_jammed=False)
    faulty = {channel.name: channel.fault for channel in bench.driver.ankle.faulty}
    assert faulty == {"achilles": Reason.SENSOR_DRIFTING}
    bench = torn_under_a_wrong_sensor(channels, diagnose=True, while_jammed=True)
    assert bench.driver.status.trouble.reason in {Reason.LEAK, Reason.BLOCKED_LINE, Reason.SENSOR_DRIFTING}


@pytest.mark.parametrize("while_jammed", [False, True], ids=["before", "jammed"])
@pytest.mark.parametrize("channels", [(), ("achilles",)], ids=["all", "alone"])
def test_a_pump_at_full_duty_is_not_jammed_for_ever(channels: tuple[str, ...], *, while_jammed: bool) -> None:
    """By time-outs alone, a pump that does not come to the set point is given up, even within the tolerance of it."""
    bench = torn_under_a_wrong_sensor(channels, diagnose=False, while_jammed=while_jammed)
    trouble = bench.driver.status.trouble
    assert trouble.reason is Reason.NOT_REACHED
    assert "jam_timeout_s" in trouble.text
    assert channels or bench.driver.ankle.faulty[0].name != "achilles"  # the others, which read the truth


@pytest.mark.parametrize("cause", ["stop", "fault", "stale"])
def test_the_safe_state_hold_keeps_the_solenoids_without_the_pump(cause: str) -> None:
    """With hold, a stop, a fault or silence leaves everything connected, pump off; ~/unjam and clearing vent it."""
    bench = jammed_bench(safe_state="hold")
    if cause == "stop":
        bench.driver.emergency_stop(stop=True, now=bench.now)
        bench.driver.emergency_stop(stop=False, now=bench.now)
    elif cause == "fault":
        bench.plant.inject(FakeFault.SENSOR_OUT_OF_RANGE, "achilles", 130e3)
    else:
        bench.streams, bench.wish_pa = True, 40e3
        run(bench, 0.5)
        bench.streams = False
    run(bench, 6.0)
    command = bench.driver.command
    assert command.pump_duty == 0.0
    assert all(command.solenoids.values())
    assert bench.plant.pressures_pa["peroneal_left"] < 75e3
    if cause == "stale":
        bench.driver.unjam((), "test")
    else:
        bench.driver.clear_fault(bench.now)
    run(bench, 1.0)
    assert bench.driver.command == released(CHANNELS)


def test_a_brown_out_that_keeps_the_board_away_is_told_as_one() -> None:
    """For half a second it does not answer, and counts as unplugged; then it says what it was. FAULT all the while."""
    bench = jammed_bench()
    bench.board.unplug()
    run(bench, 0.5)
    assert bench.told()[0] is Reason.BOARD_UNPLUGGED
    bench.board.reboot(ResetCause.BROWN_OUT)
    bench.board.plug()
    run(bench, 0.2)
    assert bench.told()[0] is Reason.BROWN_OUT
    assert len(bench.driver.ankle.faulty) == len(CHANNELS)


def test_a_driver_that_stood_still_faults_nobody_and_jams_again() -> None:
    """After a stall of 1.5 s in which the board let go, a stream that goes on jams again; nothing is in FAULT."""
    bench = bench_of()
    bench.streams, bench.wish_pa = True, SET_POINT_PA
    run(bench, 2.5)
    bench.stand_still(1.5)
    run(bench, 1.5)
    assert {channel.state for channel in bench.driver.status.channels} == {ChannelState.JAMMED}
    assert bench.driver.status.trouble.reason is Reason.EXECUTOR_OVERLOADED


@pytest.mark.parametrize("seed", range(4))
def test_an_ankle_that_jams_again_after_its_board_let_go_is_healthy(seed: int) -> None:
    """Hangs of a quarter to two seconds, whose readings wait and were not as commanded: no fault, and it jams again."""
    bench = bench_of(seed)
    bench.streams, bench.wish_pa = True, SET_POINT_PA
    run(bench, 2.5)
    for hang_s in (0.25, 0.4, 1.0, 2.0):
        bench.hang(hang_s)
        run(bench, 2.0)
        assert bench.driver.ankle.findings == ()
        assert {channel.state for channel in bench.driver.status.channels} == {ChannelState.JAMMED}


def test_nothing_jams_before_a_board_that_let_go_has_taken_the_release() -> None:
    """Until then a service is refused and a stream waits; afterwards the stream's wish counts as new."""
    bench = bench_of()
    run(bench, 0.5)
    bench.driver.wait_for_board(bench.now, wait=True)
    with pytest.raises(RequestError, match="release"):
        bench.driver.jam((), 0.0, "test")
    wishes = [Wish(name, SET_POINT_PA) for name in CHANNELS]
    bench.driver.follow(wishes, bench.now, "jam_command")
    assert bench.driver.command == released(CHANNELS)
    bench.driver.wait_for_board(bench.now, wait=False)
    bench.driver.follow(wishes, bench.now, "jam_command")
    assert all(bench.driver.command.solenoids.values())


def test_nonsense_about_the_atmosphere_moves_nothing() -> None:
    """A parameter far off changes neither the true vacuum nor what is measured, and is doubted."""
    for declared_pa in (60e3, 109e3):
        bench = jammed_bench()
        bench.driver.declare_ambient(declared_pa)
        run(bench, 2.0)
        vacuum_pa = bench.driver.ankle.atmosphere.pressure_pa - bench.plant.pressures_pa["achilles"]
        assert vacuum_pa == pytest.approx(SET_POINT_PA, abs=1500.0)
        assert bench.driver.status.atmosphere.doubtful


@settings(max_examples=25)
@given(readings=st.lists(st.floats(80e3, 110e3), min_size=3, max_size=3), declared_pa=st.floats(50e3, 110e3))
def test_two_vented_channels_outweigh_a_parameter_and_a_third(readings: list[float], declared_pa: float) -> None:
    """The estimate is the parameter, or lies among readings of which at least two agree."""
    air = Atmosphere(CHANNELS, declared_pa)
    for _ in range(100):
        for name, reading_pa in zip(CHANNELS, readings, strict=True):
            air.read(name, reading_pa, 0.01, vented=True)
    ordered = sorted(readings)
    agree = min(ordered[1] - ordered[0], ordered[2] - ordered[1]) <= 1500.0
    assert air.status.measured is agree
    assert ordered[0] <= air.pressure_pa <= ordered[2] if agree else air.pressure_pa == declared_pa


def test_a_release_that_cannot_take_place_says_so() -> None:
    """Where nobody answers, or a valve stays open, a stop is no success."""
    bench = jammed_bench()
    bench.driver.unjam((), "test")
    check_carried_out(bench.driver.status, (), bench.link)
    with pytest.raises(RequestError, match="board"):
        check_carried_out(bench.driver.status, (), replace(bench.link, state=LinkState.LOST))
    bench.driver.jam((), 0.0, "test")
    run(bench, 1.0)
    bench.plant.inject(FakeFault.STUCK_OPEN, "achilles")
    bench.driver.unjam((), "test")
    run(bench, 2.0)
    with pytest.raises(RequestError, match="achilles does not vent"):
        check_carried_out(bench.driver.status, ("achilles",), bench.link)
    check_carried_out(bench.driver.status, ("peroneal_left",), bench.link)


def test_late_work_is_told() -> None:
    """Work that always comes at half its rate is overload; one long gap is a standstill of that length."""
    watch = OverloadWatch(0.05)
    for count in range(100):
        assert watch.tick(count * 0.05) == 0.0
    assert not watch.status(5.0).overloaded
    assert watch.tick(4.95 + 1.5) == pytest.approx(1.5)
    assert watch.status(6.5).overloaded
    for count in range(100):
        watch.tick(6.45 + count * 0.1)
    assert watch.status(20.0).overloaded
    assert watch.status(20.0).late_s == pytest.approx(0.05, abs=0.005)


def test_random_faults_leave_everything_safe() -> None:
    """Some of `make soak`: no missed safe state at the board's outputs, no channel that does not come back."""
    result = soak(40.0, 3)
    assert result.faults > 0
    assert result.missed == ()


def test_the_soak_sees_a_board_that_does_not_let_go(monkeypatch: pytest.MonkeyPatch) -> None:
    """A board without its watchdog keeps jamming while the driver stands still: that is what a soak is to find."""
    monkeypatch.setattr("jammkle_driver.fake.board.WATCHDOG_S", math.inf)
    monkeypatch.setattr("jammkle_driver.fake.soak._OF_THE_PLANT", 0.0)
    assert any("stall" in line for line in soak(15.0, 1).missed)


def test_a_script_of_faults_is_read_or_refused_in_one_line() -> None:
    """Times are put in order, comments left out; what is wrong is named with what would be right."""
    script = read_script("5 heal\n1.5 leak achilles 2e-10 # a hole\n\n2 pump_dead; 3 sensor_stuck manifold")
    assert [entry.time_s for entry in script] == [1.5, 2.0, 3.0, 5.0]
    assert script[0].fault is FakeFault.LEAK
    assert script[0].size == pytest.approx(2e-10)
    assert script[1].place == MANIFOLD
    for text, words in (
        ("1 explode", "explode.*leak"),
        ("1 leak knee", "knee.*achilles"),
        ("x leak", "could not convert"),
        ("1 blocked", "needs a channel"),
    ):
        with pytest.raises(ScriptError, match=words):
            read_script(text)


def test_a_reading_that_is_no_number_never_reaches_the_filters() -> None:
    """NaN and infinity count as no reading, and leave the estimates finite."""
    bench = jammed_bench()
    for value in (math.nan, math.inf):
        bench.plant.inject(FakeFault.SENSOR_OUT_OF_RANGE, "achilles", value)
        run(bench, 0.2)
    assert all(math.isfinite(pressure_pa) for pressure_pa in bench.driver.ankle.diagnosis.estimate.pressures_pa)
