"""What the driver does about faults, stalls, nonsense and a board that let go; policies, safe state, regulation."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fault_bench import SET_POINT_PA, bench_of, jammed_bench, run
from jammkle_common.command.errors import InputError
from jammkle_common.constants import STANDARD_ATMOSPHERE_PA
from jammkle_common.names import CHANNELS
from jammkle_driver.core.air import Atmosphere
from jammkle_driver.core.ankle import PumpLoad
from jammkle_driver.core.channel import ChannelState
from jammkle_driver.core.driver import Driver
from jammkle_driver.core.faults import Reason
from jammkle_driver.core.hardware import (
    MANIFOLD,
    ActuatorCommand,
    LinkState,
    PressureSample,
    ResetCause,
    SafeCause,
    released,
)
from jammkle_driver.core.requests import RequestError, SetPoint
from jammkle_driver.core.watch import Instant, OverloadWatch
from jammkle_driver.fake import FakeFault, LinkFault, read_script
from jammkle_driver.parameters import DriverParameters

if TYPE_CHECKING:
    from fault_bench import FaultBench


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
    air = bench.plant.air
    reported = bench.driver.ankle.leaks.latest
    assert reported.connected == set(CHANNELS)
    assert bench.driver.ankle.leaks.alone == {}
    assert reported.conductance_m3_s_pa == pytest.approx(4.0 * air.leak_conductance_m3_s_pa, rel=0.5)
    assert reported.rate_pa_s > 0.0


def test_the_leak_of_a_channel_is_reported_once_it_is_connected_alone() -> None:
    """One channel leaks more than the others, and less than a fault: each has its own rate, and its conductance."""
    bench = bench_of()
    bench.plant.inject(FakeFault.LEAK, "achilles", 2e-12)
    run(bench, 1.0)
    for channel in CHANNELS:
        bench.driver.jam((channel,), SET_POINT_PA, "test")
        run(bench, 3.0)
        bench.driver.unjam((), "test")
        run(bench, 1.0)
    alone = bench.driver.ankle.leaks.alone
    healthy = bench.plant.air.leak_conductance_m3_s_pa
    assert alone["achilles"].conductance_m3_s_pa == pytest.approx(2e-12 + 2.0 * healthy, rel=0.1)
    for channel in ("peroneal_left", "peroneal_right"):
        assert alone[channel].conductance_m3_s_pa == pytest.approx(2.0 * healthy, rel=0.1)


def test_a_pump_that_works_too_long_is_spared() -> None:
    """Full duty is free for a while; the mean duty then stays at what the pump is rated for."""
    load = PumpLoad(DriverParameters(pump_rated_duty=0.5, pump_thermal_time_s=10.0))
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
    states = {channel.name: channel.state for channel in bench.driver.ankle.channels.values()}
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
        assert {channel.state for channel in bench.driver.ankle.channels.values()} == {ChannelState.JAMMED}


@pytest.mark.parametrize("policy", ["ankle", "channel"])
@pytest.mark.parametrize(
    ("diagnose", "reason"), [(True, Reason.SENSOR_STUCK), (False, Reason.NOT_REACHED)], ids=["law", "time-outs"]
)
def test_a_sensor_stuck_at_zero_is_reported_and_the_others_do_not_flap(
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
    assert [(channel.name, channel.why.reason) for channel in bench.driver.ankle.faulty] == [("achilles", reason)]
    assert bench.driver.trouble.why.reason is reason
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
        run(bench, 0.1)  # nothing is reported sooner than in a quarter of a second
        bench.driver.jam(channels, SET_POINT_PA, "test")
    working = []
    run(bench, 6.0, lambda: working.append(bench.driver.command.pump_duty > 0.9))
    longest_s = 1.0 if diagnose else 3.5
    assert sum(working) * 0.01 <= longest_s
    assert bench.driver.command == released(CHANNELS)
    return bench


@pytest.mark.parametrize("channels", [(), ("achilles",)], ids=["all", "alone"])
def test_a_sensor_off_by_the_set_point_does_not_hide_a_leak(channels: tuple[str, ...]) -> None:
    """The sensor is blamed where it is off before the jam; both failing while jammed is reported, as one of several."""
    bench = torn_under_a_wrong_sensor(channels, diagnose=True, while_jammed=False)
    faulty = {channel.name: channel.why.reason for channel in bench.driver.ankle.faulty}
    assert faulty == {"achilles": Reason.SENSOR_DRIFTING}
    bench = torn_under_a_wrong_sensor(channels, diagnose=True, while_jammed=True)
    assert bench.driver.trouble.why.reason in {Reason.LEAK, Reason.BLOCKED_LINE, Reason.SENSOR_DRIFTING}


@pytest.mark.parametrize("while_jammed", [False, True], ids=["before", "jammed"])
@pytest.mark.parametrize("channels", [(), ("achilles",)], ids=["all", "alone"])
def test_a_pump_at_full_duty_is_not_jammed_for_ever(channels: tuple[str, ...], *, while_jammed: bool) -> None:
    """By time-outs alone, a pump that does not come to the set point is given up, even within the tolerance of it."""
    bench = torn_under_a_wrong_sensor(channels, diagnose=False, while_jammed=while_jammed)
    trouble = bench.driver.trouble
    assert trouble.why.reason is Reason.NOT_REACHED
    assert "jam_timeout_s" in trouble.why.text
    assert channels or bench.driver.ankle.faulty[0].name != "achilles"  # the others, which read the truth


@pytest.mark.parametrize("cause", ["stop", "stop in a pulse", "fault", "silent sensor", "time-out", "stale"])
def test_the_safe_state_hold_keeps_the_solenoids_without_the_pump(cause: str) -> None:
    """With hold, a stop, a fault or silence leaves everything connected, pump off; ~/unjam and clearing vent it."""
    bench = jammed_bench(safe_state="hold", diagnose=cause != "time-out")
    if cause == "stop in a pulse":  # of a valve, after a lower set point: all are asked to stay connected
        bench.driver.jam((), 30e3, "test")
        while all(bench.driver.command.solenoids.values()):
            bench.step()
    if cause.startswith("stop"):
        bench.driver.emergency_stop(stop=True, now=bench.now)
        bench.driver.emergency_stop(stop=False, now=bench.now)
    elif cause == "fault":
        bench.plant.inject(FakeFault.SENSOR_OUT_OF_RANGE, "achilles", 130e3)
    elif cause == "silent sensor":
        bench.plant.inject(FakeFault.SENSOR_DEAD, "achilles")
    elif cause == "time-out":
        bench.plant.inject(FakeFault.STUCK_CLOSED, "achilles")
    else:
        bench.streams, bench.set_point_pa = True, 40e3
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


def test_hold_of_a_channel_whose_commands_are_stale_leaves_the_pump_to_the_others() -> None:
    """It stays connected; what a service jammed is regulated on against its leak, and nothing fails of it."""
    bench = jammed_bench(safe_state="hold", diagnose=False)
    bench.driver.follow([SetPoint("achilles", SET_POINT_PA)], bench.now, "jam_command")
    bench.plant.inject(FakeFault.LEAK, "peroneal_left", 2e-11)
    run(bench, 8.0)
    trouble = bench.driver.trouble
    assert (trouble.why.reason, trouble.action) == (Reason.COMMANDS_STALE, "achilles kept as it was until asked anew")
    assert all(bench.driver.command.solenoids.values())
    vacuum_pa = bench.driver.ankle.atmosphere.pressure_pa - bench.plant.pressures_pa["peroneal_left"]
    assert vacuum_pa == pytest.approx(SET_POINT_PA, abs=1500.0)
    bench.driver.emergency_stop(stop=True, now=bench.now)
    assert bench.driver.command == ActuatorCommand(dict.fromkeys(CHANNELS, True), 0.0)
    bench.driver.unjam((), "test")
    assert bench.driver.command == released(CHANNELS)


def test_a_fault_of_one_channel_does_not_end_what_a_stop_holds() -> None:
    """Where a fault is of the channel alone the others go on, but not from a stop: all was let go before."""
    bench = jammed_bench(safe_state="hold", fault_policy="channel")
    bench.driver.emergency_stop(stop=True, now=bench.now)
    bench.plant.inject(FakeFault.SENSOR_DEAD, "achilles")
    run(bench, 1.0)
    assert [channel.name for channel in bench.driver.ankle.faulty] == ["achilles"]
    assert bench.driver.command == ActuatorCommand(dict.fromkeys(CHANNELS, True), 0.0)


@pytest.mark.parametrize(
    "odd", [ActuatorCommand({}, 0.0), replace(released(CHANNELS), pump_duty=math.nan)], ids=["no channels", "no duty"]
)
def test_what_no_outputs_do_is_no_evidence(odd: ActuatorCommand) -> None:
    """A message that nobody has filled in, beside those of the hardware: nothing ends, and a leak is still found."""
    bench = jammed_bench()
    bench.plant.inject(FakeFault.LEAK, "achilles", 2e-10)
    run(bench, 3.0, lambda: bench.driver.take_driven(odd, bench.now.graph_s))
    assert bench.reported() == (Reason.LEAK, "achilles")


def test_a_brown_out_that_keeps_the_board_away_is_reported_as_one() -> None:
    """For half a second it does not answer, and counts as unplugged; then it says what it was. FAULT all the while."""
    bench = jammed_bench()
    bench.board.inject(LinkFault.UNPLUGGED)
    run(bench, 0.5)
    assert bench.reported()[0] is Reason.BOARD_UNPLUGGED
    bench.board.reboot(ResetCause.BROWN_OUT)
    bench.board.plug()
    run(bench, 0.2)
    assert bench.reported()[0] is Reason.BROWN_OUT
    assert len(bench.driver.ankle.faulty) == len(CHANNELS)


def test_a_driver_that_stood_still_faults_nobody_and_jams_again() -> None:
    """After a stall of 1.5 s in which the board let go, a stream that goes on jams again; nothing is in FAULT."""
    bench = bench_of()
    bench.streams, bench.set_point_pa = True, SET_POINT_PA
    run(bench, 2.5)
    bench.stand_still(1.5)
    run(bench, 1.5)
    assert {channel.state for channel in bench.driver.ankle.channels.values()} == {ChannelState.JAMMED}
    assert bench.driver.trouble.why.reason is Reason.EXECUTOR_OVERLOADED


@pytest.mark.parametrize("seed", range(4))
def test_an_ankle_that_jams_again_after_its_board_let_go_is_healthy(seed: int) -> None:
    """Hangs of a quarter to two seconds, whose readings wait and were not as commanded: no fault, and it jams again."""
    bench = bench_of(seed)
    bench.streams, bench.set_point_pa = True, SET_POINT_PA
    run(bench, 2.5)
    for hang_s in (0.25, 0.4, 1.0, 2.0):
        bench.hang(hang_s)
        run(bench, 2.0)
        assert bench.driver.ankle.findings == ()
        assert {channel.state for channel in bench.driver.ankle.channels.values()} == {ChannelState.JAMMED}


def test_nothing_jams_before_a_board_that_let_go_has_taken_the_release() -> None:
    """Until then a service is refused and a stream waits; afterwards the stream's set point counts as new."""
    bench = bench_of()
    run(bench, 0.5)
    let_go = replace(bench.link, latched=frozenset({SafeCause.HOST_SILENT}))
    assert bench.driver.look_at_link(let_go, bench.now)
    with pytest.raises(RequestError, match="release"):
        bench.driver.jam((), 0.0, "test")
    set_points = [SetPoint(name, SET_POINT_PA) for name in CHANNELS]
    bench.driver.follow(set_points, bench.now, "jam_command")
    assert bench.driver.command == released(CHANNELS)
    bench.driver.look_at_link(bench.link, bench.now)
    bench.driver.follow(set_points, bench.now, "jam_command")
    assert all(bench.driver.command.solenoids.values())


def test_nonsense_about_the_atmosphere_before_it_was_measured_is_named() -> None:
    """A jam before vented channels have shown better fails, names the parameter, and works once that is cleared."""
    bench = bench_of(ambient_pressure_pa=50e3)
    run(bench, 0.02)
    bench.driver.jam((), SET_POINT_PA, "test")
    run(bench, 0.2)
    faulty = bench.driver.ankle.faulty
    assert {channel.why.reason for channel in faulty} == {Reason.SENSOR_OUT_OF_RANGE}
    assert "if ambient_pressure_pa is right, which no vented channel has confirmed yet" in faulty[0].why.text
    run(bench, 1.0)
    bench.driver.clear_fault(bench.now)
    bench.driver.jam((), SET_POINT_PA, "test")
    run(bench, 1.5)
    assert {channel.state for channel in bench.driver.ankle.channels.values()} == {ChannelState.JAMMED}


def test_nonsense_about_the_atmosphere_moves_nothing() -> None:
    """A parameter far off changes neither the true vacuum nor what is measured, and is doubted."""
    for declared_pa in (60e3, 109e3):
        bench = jammed_bench()
        bench.driver.ankle.atmosphere.declare(declared_pa)
        run(bench, 2.0)
        vacuum_pa = bench.driver.ankle.atmosphere.pressure_pa - bench.plant.pressures_pa["achilles"]
        assert vacuum_pa == pytest.approx(SET_POINT_PA, abs=1500.0)
        assert bench.driver.ankle.atmosphere.doubtful


def test_sensors_of_vacuum_go_with_the_parameter(monkeypatch: pytest.MonkeyPatch) -> None:
    """They know nothing of the atmosphere: a jam goes on through a change of what they count from, undoubted."""
    bench = bench_of()
    true_pa, measure, air = bench.plant.pressures_pa["achilles"], bench.driver.measure, bench.driver.ankle.atmosphere

    def measured(sample: PressureSample, now: Instant) -> None:
        counted_pa = air.declared_pa - (true_pa - sample.pressure_pa)
        measure(replace(sample, pressure_pa=counted_pa, counted=True), now)

    def jammed() -> None:
        assert {channel.state for channel in bench.driver.ankle.channels.values()} == {ChannelState.JAMMED}

    monkeypatch.setattr(bench.driver, "measure", measured)
    run(bench, 1.0)
    bench.driver.jam((), SET_POINT_PA, "test")
    run(bench, 1.5)
    for declared_pa in (95e3, 79e3, 109e3):
        bench.driver.ankle.declare_atmosphere(declared_pa, bench.now)
        run(bench, 2.0, jammed)
        assert true_pa - bench.plant.pressures_pa["achilles"] == pytest.approx(SET_POINT_PA, abs=1500.0)
        assert air.pressure_pa == pytest.approx(declared_pa, abs=500.0)
        assert not air.doubtful
    bench.driver.unjam((), "test")
    bench.driver.ankle.declare_atmosphere(101e3, bench.now)
    run(bench, 2.0)
    assert {channel.state for channel in bench.driver.ankle.channels.values()} == {ChannelState.UNJAMMED}


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
    assert air.measured is agree
    assert ordered[0] <= air.pressure_pa <= ordered[2] if agree else air.pressure_pa == declared_pa


def test_a_release_that_cannot_take_place_says_so() -> None:
    """Where nobody answers, or a valve stays open, a stop is no success."""
    bench = jammed_bench()
    bench.driver.unjam((), "test")
    bench.driver.check_carried_out((), bench.link)
    with pytest.raises(RequestError, match="board"):
        bench.driver.check_carried_out((), replace(bench.link, state=LinkState.LOST))
    bench.driver.jam((), 0.0, "test")
    run(bench, 1.0)
    bench.plant.inject(FakeFault.STUCK_OPEN, "achilles")
    bench.driver.unjam((), "test")
    run(bench, 2.0)
    with pytest.raises(RequestError, match="achilles does not vent"):
        bench.driver.check_carried_out(("achilles",), bench.link)
    bench.driver.check_carried_out(("peroneal_left",), bench.link)


def test_late_work_is_reported() -> None:
    """Work that always comes at half its rate is overload; one long gap is a standstill of that length."""
    watch = OverloadWatch(0.05)
    for count in range(100):
        assert watch.tick(count * 0.05) == 0.0
    assert not watch.overloaded
    assert watch.tick(4.95 + 1.5) == pytest.approx(1.5)
    assert watch.overloaded
    for count in range(100):
        watch.tick(6.45 + count * 0.1)
    assert watch.overloaded
    assert watch.late_s == pytest.approx(0.05, abs=0.005)


def test_a_change_of_clocks_is_no_standstill() -> None:
    """A simulation is replaced: in step with it, on the machine's own clock until the next one asks, in step again."""
    driver = Driver(CHANNELS, DriverParameters())
    for steady_s in ((8.05, 8.1), (50000.0, 50000.05), (0.1, 0.15)):
        driver.follow_another_clock()
        for each in steady_s:
            driver.tick(Instant(each, each % 50000.0))
    assert driver.own_pace.stalls == 0
    assert not driver.own_pace.overloaded
    driver.tick(Instant(50000.0, 0.2))
    assert driver.own_pace.stalls == 1


def test_to_be_unconfigured_is_no_standstill() -> None:
    """Nobody ticks between cleanup and the next configure; nobody who listens is excused for that time."""
    driver = Driver(CHANNELS, DriverParameters())
    for steady_s in (8.0, 8.05):
        driver.tick(Instant(steady_s, steady_s))
    driver.reset()
    for steady_s in (14.5, 14.55):
        driver.tick(Instant(steady_s, steady_s))
    assert driver.own_pace.stalls == 0
    assert not driver.own_pace.overloaded


def test_a_script_of_faults_is_read_or_refused_in_one_line() -> None:
    """Times are put in order, comments left out; what is wrong is named with what would be right."""
    script = read_script("5 heal\n1.5 leak achilles 2e-10 # a hole\n\n2 pump_dead; 3 sensor_stuck manifold")
    assert [entry.time_s for entry in script] == [1.5, 2.0, 3.0, 5.0]
    assert script[0].fault is FakeFault.LEAK
    assert script[0].size == pytest.approx(2e-10)
    assert script[1].place == MANIFOLD
    noise = read_script("4 line_noise 0.1")[0]
    assert (noise.fault, noise.size) == (LinkFault.LINE_NOISE, 0.1)
    for text, words in (
        ("1 explode", "explode.*leak"),
        ("1 leak knee", "knee.*achilles"),
        ("x leak", "could not convert"),
        ("1 blocked", "needs a channel"),
        ("1 unplugged achilles", "could not convert"),
    ):
        with pytest.raises(InputError, match=words):
            read_script(text)


def test_a_reading_that_is_no_number_never_reaches_the_filters() -> None:
    """NaN and infinity count as no reading, and leave the estimates finite."""
    bench = jammed_bench()
    for value in (math.nan, math.inf):
        bench.plant.inject(FakeFault.SENSOR_OUT_OF_RANGE, "achilles", value)
        run(bench, 0.2)
    assert all(math.isfinite(pressure_pa) for pressure_pa in bench.driver.ankle.diagnosis.estimate.pressures_pa)


def test_one_absurd_reading_ends_nothing() -> None:
    """A finite pressure that no sensor means is no reason to die with the ankle jammed."""
    driver = Driver(CHANNELS, DriverParameters())
    driver.activate(Instant(10.0, 10.0))
    for k in range(100):
        at_s = 10.0 + 0.01 * k
        for place in (MANIFOLD, *CHANNELS):
            pressure_pa = 1e160 if (k, place) == (60, CHANNELS[0]) else STANDARD_ATMOSPHERE_PA + k % 7
            driver.measure(PressureSample(place, pressure_pa, at_s), Instant(at_s, at_s))
    assert not driver.ankle.faulty


def test_memory_does_not_grow_where_nothing_is_diagnosed() -> None:
    """What the hardware drove is forgotten though nobody asks for evidence."""
    driver = Driver(CHANNELS, DriverParameters(diagnose=False))
    for k in range(6000):
        driver.take_driven(ActuatorCommand(dict.fromkeys(CHANNELS, False), (k % 97) / 255.0), 0.01 * k)
    assert len(driver.ankle.evidence._driven) < 1100
