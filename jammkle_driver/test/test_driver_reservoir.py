"""A reservoir: evacuated while all valves are shut, shared in the time of the valves, and no cover for faults."""

from __future__ import annotations

import dataclasses

import pytest

from fault_bench import SAMPLE_S, WITHIN_S, FaultBench, run
from jammkle_common.constants import STANDARD_ATMOSPHERE_PA
from jammkle_common.names import CHANNELS
from jammkle_common.parameters import ParameterError
from jammkle_driver.core.channel import ChannelState
from jammkle_driver.core.faults import Reason
from jammkle_driver.core.hardware import MANIFOLD
from jammkle_driver.fake import PLANT_STEP_S, FakeFault, FakePlant
from jammkle_driver.parameters import DriverParameters

RESERVOIR_M3 = 1e-4
FILLED_S = 4.0


def bench_with(reservoir_m3: float, seed: int = 1) -> FaultBench:
    bench = FaultBench(DriverParameters(reservoir_volume_m3=reservoir_m3), seed)
    bench.asks = False
    return bench


def manifold_vacuum_pa(bench: FaultBench) -> float:
    return STANDARD_ATMOSPHERE_PA - bench.plant.pressures_pa[MANIFOLD]


def jam_s(bench: FaultBench, vacuum_pa: float) -> float:
    """How long all three channels take to be within 3 kPa of a vacuum."""
    bench.driver.jam((), vacuum_pa, "test")
    for sample in range(200):
        bench.step()
        vacuums_pa = [channel.vacuum_pa or 0.0 for channel in bench.driver.ankle.channels.values()]
        if min(vacuums_pa) > vacuum_pa - 3e3:
            return sample * SAMPLE_S
    pytest.fail("never jammed")


def test_it_is_evacuated_while_nothing_is_jammed_and_then_the_pump_rests() -> None:
    """To stored_vacuum_pa, with the channels at the atmosphere; without a reservoir the pump stands still."""
    bench = bench_with(RESERVOIR_M3)
    run(bench, FILLED_S)
    assert manifold_vacuum_pa(bench) == pytest.approx(60e3, abs=1.5e3)
    assert bench.driver.command.pump_duty == 0.0
    assert all(channel.state is ChannelState.UNJAMMED for channel in bench.driver.ankle.channels.values())
    without = bench_with(0.0)
    run(without, FILLED_S)
    assert manifold_vacuum_pa(without) < 1e3


def test_what_is_stored_jams_three_times_as_fast() -> None:
    """40 kPa in all three channels; an empty one is slower than none, as it is evacuated first."""
    full, empty, none = bench_with(RESERVOIR_M3), bench_with(RESERVOIR_M3), bench_with(0.0)
    run(full, FILLED_S)
    for bench in (empty, none):
        run(bench, 0.1)
    full_s, empty_s, none_s = (jam_s(bench, 40e3) for bench in (full, empty, none))
    assert 3.0 * full_s < none_s < empty_s


@pytest.mark.parametrize(
    ("volume_ml", "to_40_kpa_s", "to_50_kpa_s"),
    [(0, 0.288, 0.453), (50, 0.078, 0.278), (100, 0.073, 0.112), (250, 0.071, 0.099)],
)
def test_the_times_to_jam_are_those_of_the_simulator(volume_ml: int, to_40_kpa_s: float, to_50_kpa_s: float) -> None:
    """The law that faults are judged by, from 60 kPa in store; its step is a millisecond."""
    air = DriverParameters(reservoir_volume_m3=1e-6 * volume_ml).air()
    plant = FakePlant(air, STANDARD_ATMOSPHERE_PA)
    plant.command({}, 1.0)
    while volume_ml and STANDARD_ATMOSPHERE_PA - plant.pressures_pa[MANIFOLD] < 60e3:
        plant.advance(PLANT_STEP_S)
    begun_s = plant.time_s
    plant.command(dict.fromkeys(CHANNELS, True), 1.0)
    for vacuum_pa, time_s in ((40e3, to_40_kpa_s), (50e3, to_50_kpa_s)):
        while STANDARD_ATMOSPHERE_PA - max(plant.pressures_pa[channel] for channel in CHANNELS) < vacuum_pa:
            plant.advance(PLANT_STEP_S)
        assert plant.time_s - begun_s == pytest.approx(time_s, abs=2.1e-3)


def test_a_leak_is_estimated_with_the_air_of_the_reservoir() -> None:
    """Its rate is that of all the air that is connected: without 100 mL of it the hole would seem a quarter of it."""
    bench = bench_with(RESERVOIR_M3)
    bench.plant.air = dataclasses.replace(bench.plant.air, leak_conductance_m3_s_pa=2e-12)
    bench.plant.heal()
    run(bench, FILLED_S)
    bench.driver.jam((), 40e3, "test")
    run(bench, 6.0)
    seen = bench.driver.ankle.leaks.latest
    assert seen.connected == frozenset(CHANNELS)
    assert seen.conductance_m3_s_pa == pytest.approx(4.0 * 2e-12, rel=0.3)
    assert bench.reported()[0] is Reason.NONE


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_healthy_ankle_with_a_reservoir_raises_no_alarm(seed: int) -> None:
    """Jammed to several vacuums and vented again for 20 s, its parts off by their tolerances."""
    bench = bench_with(RESERVOIR_M3, seed)
    run(bench, 1.0)
    for vacuum_pa in (40e3, 20e3, 50e3, 40e3, 60e3):
        bench.driver.jam((), vacuum_pa, "test")
        run(bench, 2.0)
        bench.driver.unjam((), "test")
        run(bench, 2.0)
    assert bench.reported()[0] is Reason.NONE


@pytest.mark.parametrize("stored_vacuum_pa", [60e3, 76e3])
def test_a_large_reservoir_may_take_as_long_as_its_vacuum_does(stored_vacuum_pa: float) -> None:
    """250 mL, also to more than is ever asked of the channels: no fault of a pump that works as declared."""
    parameters = DriverParameters(reservoir_volume_m3=2.5e-4, stored_vacuum_pa=stored_vacuum_pa)
    bench = FaultBench(parameters, 1, lambda air, _draw, seed: FakePlant(air, STANDARD_ATMOSPHERE_PA, seed=seed))
    run(bench, 20.0)
    assert bench.reported()[0] is Reason.NONE
    assert manifold_vacuum_pa(bench) == pytest.approx(stored_vacuum_pa, abs=1.5e3)


def test_who_gives_the_pump_up_says_what_it_did_and_for_how_long() -> None:
    """Of a spared pump that it was spared; and with a reservoir that its time is in the limit, too."""
    parameters = DriverParameters(
        reservoir_volume_m3=RESERVOIR_M3, pump_rated_duty=0.3, pump_thermal_time_s=3.0, diagnose=False
    )
    bench = FaultBench(parameters, 1)
    bench.asks = False
    bench.plant.inject(FakeFault.LEAK, MANIFOLD, 3e-10)
    run(bench, 10.0)
    said = bench.driver.trouble.why.text
    assert "with the pump at the duty that pump_rated_duty leaves for 6." in said
    assert "(jam_timeout_s, and the time to evacuate the reservoir)" in said


@pytest.mark.parametrize(
    ("reason", "fault", "place", "jammed"),
    [
        (Reason.PUMP_DEAD, FakeFault.PUMP_DEAD, MANIFOLD, False),
        (Reason.VALVE_STUCK_OPEN, FakeFault.STUCK_OPEN, "achilles", False),
        (Reason.LEAK, FakeFault.LEAK, "achilles", True),
    ],
    ids=lambda each: each.name if isinstance(each, Reason) else "",
)
def test_faults_are_found_with_a_reservoir(reason: Reason, fault: FakeFault, place: str, *, jammed: bool) -> None:
    """By the law of the air with its volume in it; a leak later by as much as there is more to fill."""
    bench = bench_with(RESERVOIR_M3)
    run(bench, FILLED_S if jammed else 0.5)
    if jammed:
        bench.driver.jam((), 40e3, "test")
        run(bench, 1.5)
    bench.plant.inject(fault, place, 1e-10)
    run(bench, 4.0 * WITHIN_S[reason])
    assert bench.reported()[0] is reason


def test_nothing_is_pumped_by_a_driver_that_is_stopped_or_inactive() -> None:
    """An emergency stop ends it at once, and so does the end of the node; what is stored stays."""
    bench = bench_with(RESERVOIR_M3)
    run(bench, 0.5)
    assert bench.driver.command.pump_duty > 0.0
    bench.driver.emergency_stop(stop=True, now=bench.now)
    assert bench.driver.command.pump_duty == bench.driver.ankle.command.pump_duty == 0.0
    run(bench, 0.5)
    assert bench.driver.command.pump_duty == 0.0
    assert manifold_vacuum_pa(bench) > 20e3
    other = bench_with(RESERVOIR_M3)
    run(other, 0.5)
    other.driver.deactivate()
    assert other.driver.command.pump_duty == other.driver.ankle.command.pump_duty == 0.0


def test_the_time_that_the_pump_takes_is_that_of_the_law() -> None:
    """In closed form as on the plant that is stepped: 100 mL and the manifold to 50 kPa, from the atmosphere."""
    parameters = DriverParameters(reservoir_volume_m3=RESERVOIR_M3)
    air = parameters.air()
    plant = FakePlant(air, STANDARD_ATMOSPHERE_PA)
    plant.command({}, 1.0)
    expected_s = air.evacuation_s(air.shared_volume_m3, 50e3)
    plant.advance(expected_s)
    assert STANDARD_ATMOSPHERE_PA - plant.pressures_pa[MANIFOLD] == pytest.approx(50e3, rel=0.01)


def test_a_vacuum_that_the_pump_never_stores_is_refused() -> None:
    """Beyond its end, in one line with the way out."""
    with pytest.raises(ParameterError, match="'stored_vacuum_pa' is 80000; it must be below pump_ultimate_vacuum_pa"):
        DriverParameters(reservoir_volume_m3=RESERVOIR_M3, stored_vacuum_pa=80e3)
