"""Pump, manifold, solenoids: times, bounds, and the books of the air."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jammkle_common.names import CHANNELS
from jammkle_sim.physics import pneumatics
from jammkle_sim.physics.kernels import orifice_flow_kg_s
from jammkle_sim.physics.pneumatics import PneumaticParameters
from pump_bench import Pneumatics

Coils = tuple[bool, bool, bool]
DT_S = 0.0005
ALL, NONE = (True, True, True), (False, False, False)
AMBIENT_PA = PneumaticParameters().ambient_pa

commands = st.lists(
    st.tuples(st.floats(0.0, 1.0), st.tuples(st.booleans(), st.booleans(), st.booleans()), st.integers(1, 400)),
    min_size=1,
    max_size=8,
)


def first_below(pressure_pa: np.ndarray, limit_pa: float) -> float:
    """Time at which a pressure first goes below a limit, s."""
    assert (pressure_pa < limit_pa).any()
    return float(np.argmax(pressure_pa < limit_pa)) * DT_S


def test_all_tendons_jam_in_half_a_second_and_vent_in_a_fifth() -> None:
    """-50 kPa on all channels in under 0.5 s; back to -5 kPa in under 0.2 s."""
    air = Pneumatics(PneumaticParameters(), DT_S)
    air.command(1.0, ALL)
    pressure_pa = air.advance(1000)
    assert max(first_below(pressure_pa[:, i], AMBIENT_PA - 50e3) for i in (1, 2, 3)) < 0.5
    air.command(0.0, NONE)
    assert (air.advance(400)[-1, 1:] > AMBIENT_PA - 5e3).all()


@pytest.mark.parametrize(
    ("volume_ml", "evacuated_s", "to_40_kpa_s", "to_50_kpa_s"),
    [(0, 0.0, 0.288, 0.453), (50, 1.2, 0.078, 0.278), (100, 2.1, 0.073, 0.112), (250, 4.9, 0.071, 0.099)],
)
def test_a_reservoir_shares_its_vacuum_in_the_time_of_the_valves(
    volume_ml: int, evacuated_s: float, to_40_kpa_s: float, to_50_kpa_s: float
) -> None:
    """All three channels from 60 kPa in store, as a prototype of this law had them (physics of the Jammkle)."""
    air = Pneumatics(PneumaticParameters(reservoir_volume_m3=1e-6 * volume_ml), DT_S)
    air.command(1.0, NONE)
    steps = 0
    while volume_ml and air.advance(1)[0, 0] > AMBIENT_PA - 60e3:
        steps += 1
    assert DT_S * steps == pytest.approx(evacuated_s, abs=0.05)
    air.command(1.0, ALL)
    pressure_pa = air.advance(1000)
    for vacuum_pa, time_s in ((40e3, to_40_kpa_s), (50e3, to_50_kpa_s)):
        assert max(first_below(pressure_pa[:, i], AMBIENT_PA - vacuum_pa) for i in (1, 2, 3)) == pytest.approx(
            time_s, abs=2e-3
        )


def test_fewer_tendons_jam_faster() -> None:
    """One tendon alone takes less time than all four, and more than none."""
    times_s = []
    for energised in ((True, False, False), ALL):
        air = Pneumatics(PneumaticParameters(), DT_S)
        air.command(1.0, energised)
        times_s.append(first_below(air.advance(1000)[:, 1], AMBIENT_PA - 50e3))
    assert 0.05 < times_s[0] < times_s[1]


def test_without_power_everything_vents() -> None:
    """Solenoids released and pump off: every channel ends at ambient, whatever it was at."""
    air = Pneumatics(PneumaticParameters(), DT_S)
    air.command(1.0, ALL)
    air.advance(800)
    air.command(0.0, NONE)
    assert air.advance(2000)[-1, 1:] == pytest.approx(AMBIENT_PA, abs=1.0)


def test_solenoid_waits_its_dead_time() -> None:
    """A channel keeps its pressure for the dead time, and a pulse shorter than that does nothing."""
    parameters = PneumaticParameters(leak_conductance_dm3_s_bar=0.0, valve_dead_time_s=0.010)
    air = Pneumatics(parameters, DT_S)
    air.command(1.0, NONE)
    air.advance(500)
    air.command(1.0, ALL)
    pressure_pa = air.advance(40)
    moved = np.argmax(pressure_pa[:, 1] < AMBIENT_PA - 1.0)
    assert moved * DT_S == pytest.approx(0.010, abs=2 * DT_S)
    pulsed = Pneumatics(parameters, DT_S)
    pulsed.command(1.0, NONE)
    pulsed.advance(500)
    pulsed.command(1.0, ALL)
    pulsed.advance(15)
    pulsed.command(1.0, NONE)
    assert pulsed.advance(100)[:, 1:] == pytest.approx(AMBIENT_PA, abs=1e-6)


ankles = st.builds(
    PneumaticParameters,
    tendon_volume_m3=st.floats(0.2e-6, 50e-6),
    manifold_volume_m3=st.floats(0.5e-6, 100e-6),
    valve_conductance_dm3_s_bar=st.floats(0.001, 1.0),
    leak_conductance_dm3_s_bar=st.floats(0.0, 0.05),
    pump_free_flow_l_min=st.floats(0.5, 30.0),
    pump_ultimate_vacuum_pa=st.floats(20e3, 100e3),
    valve_dead_time_s=st.floats(0.0, 0.1),
)


@settings(max_examples=40)
@given(program=commands, parameters=ankles)
def test_air_is_conserved(
    program: list[tuple[float, tuple[bool, bool, bool], int]], parameters: PneumaticParameters
) -> None:
    """Whatever ankle, pump and valves, the air inside changes by what came in and went out, to 1e-9 of it."""
    air = Pneumatics(parameters, DT_S)
    start_kg = air.mass_kg
    for duty, energised, steps in program:
        air.command(duty, energised)
        air.advance(steps)
    assert abs(air.mass_kg - start_kg - air.exchanged_kg) <= 1e-9 * start_kg


@settings(max_examples=40)
@given(program=commands, parameters=ankles)
def test_pressures_stay_between_pump_and_atmosphere(
    program: list[tuple[float, tuple[bool, bool, bool], int]], parameters: PneumaticParameters
) -> None:
    """However small the volumes and wide the valves, no pressure overshoots ambient or the pump's ultimate vacuum."""
    air = Pneumatics(parameters, DT_S)
    for duty, energised, steps in program:
        air.command(duty, energised)
        pressure_pa = air.advance(steps)
        assert pressure_pa.max() <= AMBIENT_PA * (1.0 + 1e-9)
        assert pressure_pa.min() >= AMBIENT_PA - parameters.pump_ultimate_vacuum_pa - 1e-6


@settings(max_examples=30)
@given(program=commands)
def test_half_the_step_gives_the_same_pressures(program: list[tuple[float, tuple[bool, bool, bool], int]]) -> None:
    """With the assumed pump and valves half the time step moves no pressure by more than 600 Pa."""
    coarse, fine = Pneumatics(PneumaticParameters(), DT_S), Pneumatics(PneumaticParameters(), DT_S / 2.0)
    for duty, energised, steps in program:
        coarse.command(duty, energised)
        fine.command(duty, energised)
        assert np.abs(coarse.advance(steps) - fine.advance(2 * steps)[1::2]).max() < 600.0


@given(one_pa=st.floats(1e3, 2e5), other_pa=st.floats(1e3, 2e5))
def test_flow_runs_downhill_and_is_odd(one_pa: float, other_pa: float) -> None:
    """Flow has the sign of the pressure difference, changes sign with it, and never exceeds the choked flow."""
    flow = orifice_flow_kg_s(one_pa, other_pa, 1e-9, 0.5, 0.99)
    assert flow == -orifice_flow_kg_s(other_pa, one_pa, 1e-9, 0.5, 0.99)
    assert flow * (one_pa - other_pa) >= 0.0
    assert abs(flow) <= 1e-9 * max(one_pa, other_pa)


def test_orifice_chokes_below_the_critical_ratio() -> None:
    """Below half the upstream pressure the flow does not grow any more: C rho p, by ISO 6358."""
    assert orifice_flow_kg_s(1e5, 4e4, 1e-9, 0.5, 0.99) == pytest.approx(1e-4)
    assert orifice_flow_kg_s(1e5, 1e3, 1e-9, 0.5, 0.99) == pytest.approx(1e-4)
    assert orifice_flow_kg_s(1e5, 7.5e4, 1e-9, 0.5, 0.99) == pytest.approx(1e-4 * np.sqrt(0.75))


def test_a_pump_whose_mass_flow_falls_in_proportion_draws_more_at_depth() -> None:
    """With a filling of 1 the mass flow is linear in the vacuum; the same at none, the same end, more between.

    A diaphragm pump with a dead volume whose air expands again does so; the books of the air still balance.
    """
    flows = []
    for filling in (0.0, 1.0):
        parameters = dataclasses.replace(PneumaticParameters(), pump_filling=filling, leak_conductance_dm3_s_bar=0.0)
        air = Pneumatics(parameters, DT_S)
        air.command(1.0, NONE)
        whole_kg, masses_kg = air.mass_kg, []
        for _ in range(2000):
            air.advance(1)
            masses_kg.append(air.mass_kg)
            assert whole_kg + air.exchanged_kg == pytest.approx(air.mass_kg, rel=1e-9)
        # The channels stay vented: what is drawn is the manifold's.
        drawn_kg = whole_kg - np.array(masses_kg)
        flow_kg_s = np.diff(drawn_kg) / DT_S
        flows.append(np.interp(np.linspace(0.05, 0.9, 10) * drawn_kg[-1], drawn_kg[1:], flow_kg_s))
    assert flows[1][0] == pytest.approx(flows[0][0], rel=0.05)
    assert (flows[1][1:] > flows[0][1:]).all()
    line = np.polyfit(np.arange(10.0), flows[1], 1)
    assert np.abs(np.polyval(line, np.arange(10.0)) - flows[1]).max() < 0.01 * flows[1].max()


@settings(max_examples=30)
@given(program=commands, parameters=ankles, manifold_s=st.floats(1e-3, 1e3), tendon_s=st.floats(1e-3, 1e3))
def test_air_is_conserved_that_is_not_at_the_temperature_of_its_walls(
    program: list[tuple[float, tuple[bool, bool, bool], int]],
    parameters: PneumaticParameters,
    manifold_s: float,
    tendon_s: float,
) -> None:
    """From nearly isothermal to nearly adiabatic its mass is booked, and its pressure stays a number above 0."""
    parameters = dataclasses.replace(parameters, manifold_thermal_time_s=manifold_s, tendon_thermal_time_s=tendon_s)
    air = Pneumatics(parameters, DT_S)
    start_kg = air.mass_kg
    for duty, energised, steps in program:
        air.command(duty, energised)
        assert (air.advance(steps) > 0.0).all()
    assert abs(air.mass_kg - start_kg - air.exchanged_kg) <= 1e-9 * start_kg


@pytest.mark.parametrize("step_s", [DT_S, 0.001])
def test_heat_and_crossover_begin_where_nothing_is(step_s: float) -> None:
    """The least of either moves no pressure: the air is advanced in as many parts with it."""
    courses = []
    for least in (0.0, 1e-9):
        given = PneumaticParameters(valve_crossover_s=least, manifold_thermal_time_s=least, tendon_thermal_time_s=least)
        air = Pneumatics(given, step_s)
        air.command(1.0, ALL)
        courses.append(air.advance(1000))
    assert np.abs(courses[1] - courses[0]).max() < 0.1


@pytest.mark.parametrize(("before", "after"), [(NONE, ALL), (ALL, NONE)])
@pytest.mark.parametrize("pinched", [1.0, 0.3])
def test_valves_that_switch_let_air_past_them(before: Coils, after: Coils, pinched: float) -> None:
    """Both ways, as much as they let through in the time that is given when they are open and choke.

    What is pinched is the line behind them.
    """
    masses_kg = []
    for crossover_s in (0.0, 0.003):
        given = PneumaticParameters(leak_conductance_dm3_s_bar=0.0, valve_crossover_s=crossover_s)
        air = Pneumatics(given, DT_S)
        air.command(1.0, before)
        for channel in CHANNELS:
            air.pinch(channel, pinched)
        air.advance(4000)
        air.command(0.0, after)
        air.advance(round((given.valve_dead_time_s + 0.2) / DT_S))
        masses_kg.append(air.mass_kg)
    through_kg_s = pneumatics.conductance_kg_s_pa(given.valve_conductance_dm3_s_bar) * AMBIENT_PA
    assert masses_kg[1] - masses_kg[0] == pytest.approx(len(CHANNELS) * 0.003 * through_kg_s, rel=0.01)


THERMAL = PneumaticParameters(leak_conductance_dm3_s_bar=0.0, manifold_thermal_time_s=0.3)


def test_air_that_is_drawn_off_follows_the_adiabat_and_then_warms_up() -> None:
    """Without heat p goes as m^1.4, at once as m; shut off, it warms up in the time that is given for as much air."""
    shares = {}
    for time_s in (0.0, 1e9):
        air = Pneumatics(dataclasses.replace(THERMAL, manifold_thermal_time_s=time_s), DT_S)
        rest_kg = air.mass_kg
        air.command(1.0, NONE)
        pressure_pa = air.advance(100)[-1, 0]
        manifold_kg = THERMAL.manifold_volume_m3 / (THERMAL.manifold_volume_m3 + 4 * THERMAL.tendon_volume_m3) * rest_kg
        shares[time_s] = np.log(pressure_pa / AMBIENT_PA) / np.log(1.0 - (rest_kg - air.mass_kg) / manifold_kg)
    assert shares[0.0] == pytest.approx(1.0, rel=1e-6)
    assert shares[1e9] == pytest.approx(1.4, rel=0.01)
    air = Pneumatics(THERMAL, DT_S)
    air.command(1.0, NONE)
    air.advance(200)
    air.command(0.0, NONE)
    missing_pa = -np.diff(np.append(air.advance(6000)[:, 0], 0.0))[:-1]
    assert (missing_pa < 0.0).all()
    warming_s = DT_S / (1.0 - missing_pa[1:200] / missing_pa[:199])
    manifold = air.advance(1)[0, 0] / AMBIENT_PA
    assert warming_s == pytest.approx(THERMAL.manifold_thermal_time_s * manifold, rel=0.02)


def test_air_that_rushes_in_is_warm() -> None:
    """Filled without heat, from well below, a volume holds less air at the pressure of the room (first law)."""
    masses_kg = []
    for time_s in (0.0, 1e9):
        air = Pneumatics(dataclasses.replace(THERMAL, tendon_thermal_time_s=time_s), DT_S)
        air.command(1.0, ALL)
        air.advance(2000)
        air.command(0.0, NONE)
        pressure_pa = air.advance(2000)[-1]
        assert pressure_pa[1:] == pytest.approx([AMBIENT_PA] * 3, rel=1e-4)
        masses_kg.append(air.mass_kg)
    assert masses_kg[1] < 0.97 * masses_kg[0]


def test_a_longer_hose_holds_more_passes_less_and_takes_longer() -> None:
    """None more is no change; each metre of 4/2.5 mm holds 4.9 ml; a metre alone lets through some 0.4 dm3/(s bar)."""
    valve = 0.1e-8
    assert pneumatics.conductance_behind_hose(valve, 0.0) == pytest.approx(valve, rel=1e-12)
    through = [pneumatics.conductance_behind_hose(valve, length_m) for length_m in (0.0, 0.01, 1.0, 3.0, 6.0)]
    assert np.all(np.diff(through) < 0.0)
    assert through[-1] > 0.9 * valve
    # In series with one of no resistance at all, what is left is the hose's own.
    assert 0.3e-8 < pneumatics.conductance_behind_hose(1.0, 1.0) < 0.6e-8
    assert pneumatics.hose_volume_m3(1.0) == pytest.approx(4.9e-6, rel=0.01)
    assert pneumatics.hose_travel_s(3.43) == pytest.approx(0.01)


@pytest.mark.parametrize("thermal_time_s", [0.0, 0.5])
def test_no_pump_draws_more_air_than_there_is(thermal_time_s: float) -> None:
    """At 2100 m the air has less pressure than the vacuum that the pump's data sheet gives."""
    high = dataclasses.replace(
        PneumaticParameters(),
        ambient_pa=78e3,
        pump_ultimate_vacuum_pa=80e3,
        pump_filling=1.0,
        manifold_thermal_time_s=thermal_time_s,
        tendon_thermal_time_s=thermal_time_s,
    )
    air = Pneumatics(high, DT_S)
    air.command(1.0, NONE)
    assert (air.advance(20_000) > 0.0).all()
