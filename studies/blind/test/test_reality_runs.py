"""Runs of the reality: what is recorded, what scatters, and what each fault does to it."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
import pytest

from jammkle_common import names
from studies.blind.reality.faults import FAULTS, BadFaultError, FaultSetting, with_faults
from studies.blind.reality.machine import Machine
from studies.blind.reality.run import run
from studies.blind.reality.sensors import BadPlanError, Plan, RealRun
from studies.blind.reality.specimen import machine, today

if TYPE_CHECKING:
    from collections.abc import Mapping

TENSILE = Plan("tensile", {"vacuum_pa": 40e3, "speed_m_s": 0.02, "extension_m": 0.015})
PRESSURE = Plan("pressure", {"cycles": 1, "jam_time_s": 0.9, "vent_time_s": 0.4})
CELL, TENDON, JOINTS = names.LOAD_CELL.name, names.TENDON_STATES.name, names.JOINT_STATES.name
MANIFOLD, LEFT = names.MANIFOLD_PRESSURE.name, names.PRESSURES[names.PERONEAL_LEFT].name
RIGHT, ACHILLES = names.PRESSURES[names.PERONEAL_RIGHT].name, names.PRESSURES[names.ACHILLES].name
PLAIN = Machine()


@lru_cache(maxsize=2)
def healthy(rig: str) -> RealRun:
    return run(TENSILE if rig == "tensile" else PRESSURE, PLAIN, (), 3)


def faulty(rig: str, fault: str, **values: float) -> RealRun:
    plan = TENSILE if rig == "tensile" else PRESSURE
    return run(plan, PLAIN, (FaultSetting(fault, values),), 3)


def on_grid(found: RealRun, topic: str, column: int = -1, until_s: float = 1.4) -> np.ndarray:
    """Return a signal at even times, by its stamps."""
    track = found.topics[topic]
    return np.interp(np.arange(0.05, until_s, 0.005), track.stamp_s, track.values[:, column])


def moved(rig: str, topic: str, fault: str, column: int = -1, **values: float) -> float:
    """Return how far a fault moves a signal, root mean square."""
    until_s = 2.9 if rig == "tensile" else 1.4
    change = on_grid(faulty(rig, fault, **values), topic, column, until_s) - on_grid(
        healthy(rig), topic, column, until_s
    )
    return float(np.sqrt((change**2).mean()))


def same(one: RealRun, other: RealRun) -> bool:
    return set(one.topics) == set(other.topics) and all(
        np.array_equal(one.topics[topic].values, other.topics[topic].values)
        and np.array_equal(one.topics[topic].stamp_s, other.topics[topic].stamp_s)
        and np.array_equal(one.topics[topic].log_s, other.topics[topic].log_s)
        for topic in one.topics
    )


@pytest.mark.parametrize("plan", [TENSILE, PRESSURE], ids=lambda plan: plan.rig)
def test_a_run_is_a_complete_recording(plan: Plan) -> None:
    """Every topic of the rig is there, at its rate, with jitter, gaps and rising log times."""
    found = healthy(plan.rig)
    rates_hz = {JOINTS: 500.0, TENDON: 500.0, **dict.fromkeys((MANIFOLD, LEFT, RIGHT, ACHILLES), 100.0)}
    if plan.rig == "tensile":
        rates_hz[CELL] = 500.0
    commands = {names.PUMP_DUTY.name, *(topic.name for topic in names.SOLENOIDS.values())}
    assert set(found.topics) == {*rates_hz, *commands}
    for topic, rate_hz in rates_hz.items():
        track = found.topics[topic]
        steps_s = np.diff(track.stamp_s)
        assert np.median(steps_s) == pytest.approx(1.0 / rate_hz, rel=0.02)
        assert np.all(np.diff(track.log_s) > 0.0)
        assert np.all(steps_s >= 0.0)
        assert track.stamp_s[0] >= 0.0
        assert steps_s.std() > 1e-5
        assert np.all(track.log_s > track.stamp_s - 0.001)
        assert track.values.shape == (track.stamp_s.size, len(track.columns))
        assert np.all(np.isfinite(track.values))
    assert np.diff(found.topics[TENDON].stamp_s).max() > 0.0035
    for topic in commands:
        values = found.topics[topic].values[:, 0]
        assert np.all(np.diff(values) != 0.0)
    cell = found.topics[TENDON].values[:, 2]
    assert np.allclose(cell / 0.02, np.round(cell / 0.02))


def test_the_same_seed_gives_the_same_bits() -> None:
    """A run can be had again; another seed is another day, another specimen another machine."""
    one = run(TENSILE, machine(1), (), 5)
    assert same(one, run(TENSILE, machine(1), (), 5))
    other_day, other_machine = run(TENSILE, machine(1), (), 6), run(TENSILE, machine(2), (), 5)
    assert not same(one, other_day)
    peaks_n = [each.topics[CELL].values[:, 2].max() for each in (one, other_day, other_machine)]
    assert 0.05 < abs(peaks_n[0] - peaks_n[1]) < 8.0
    assert 0.05 < abs(peaks_n[0] - peaks_n[2]) < 8.0


def test_a_fault_of_no_size_is_no_fault() -> None:
    """Null values leave the very same machine, and a run with all such faults the same bits."""
    day = today(PLAIN, 3)
    settings = [
        FaultSetting(name, {key: row.null for key, row in fault.parameters.items()}) for name, fault in FAULTS.items()
    ]
    for setting in settings:
        assert with_faults(day, (setting,)) is day
    assert same(run(TENSILE, PLAIN, settings, 3), healthy("tensile"))
    assert same(run(PRESSURE, PLAIN, settings, 3), healthy("pressure"))


def test_every_fault_changes_the_machine() -> None:
    """No fault's parameter is without effect on the constants, up or down, and its range holds null."""
    for fault in FAULTS.values():
        for name, row in fault.parameters.items():
            assert row.minimum <= row.null <= row.maximum
            for value in {row.minimum, row.maximum} - {row.null}:
                assert fault.applied(PLAIN, {name: value}) != PLAIN


def test_faults_of_the_library_and_others_are_there() -> None:
    """At least six faults have no name in the library; every effect of these rigs has its fault."""
    without = {name.rsplit("_valve", 1)[0] for name, fault in FAULTS.items() if fault.effect is None}
    assert len(without) >= 6
    named = {fault.effect for fault in FAULTS.values() if fault.effect}
    families = ("line_leak_achilles", "pump_wear", "valve_dead_time", "line_restriction_achilles",
                "trapped_volume_manifold", "pressure_sensor_offset_achilles", "viscoelasticity", "jamming_friction",
                "tendon_stiffness", "membrane_stiffness", "pretension_achilles_pair", "softening",
                "fibre_loss_achilles_left", "tendon_failure_peroneal_left", "load_cell_gain", "command_delay",
                "sensor_delay", "pressure_delay", "joint_delay", "load_cell_delay", "clock_skew")  # fmt: skip
    assert set(families) <= named


SHOWS: tuple[tuple[str, str, int, str, Mapping[str, float], float], ...] = (
    ("pressure", LEFT, 0, "leak_peroneal_left", {"diameter_m": 0.2e-3}, 200.0),
    ("pressure", MANIFOLD, 0, "leak_manifold", {"diameter_m": 0.2e-3}, 200.0),
    ("pressure", ACHILLES, 0, "worn_pump", {"flow": 0.6}, 2000.0),
    ("pressure", ACHILLES, 0, "late_valves", {"later_s": 0.03}, 1000.0),
    ("pressure", ACHILLES, 0, "kink_achilles", {"closed": 0.8}, 2000.0),
    ("pressure", RIGHT, 0, "long_hose_peroneal_right", {"volume_m3": 10e-6}, 1000.0),
    ("pressure", RIGHT, 0, "pressure_reads_off_peroneal_right", {"offset_pa": 900.0}, 500.0),
    ("pressure", ACHILLES, 0, "pressure_slope_achilles", {"gain": 1.05}, 500.0),
    ("pressure", LEFT, 0, "late_pressures", {"delay_s": 0.03}, 500.0),
    ("pressure", LEFT, 0, "late_commands", {"delay_s": 0.03}, 500.0),
    ("pressure", ACHILLES, 0, "water_achilles", {"slug_pa": 5e3}, 1000.0),
    ("pressure", LEFT, 0, "slow_valve_peroneal_left", {"longer_s": 0.2}, 1000.0),
    ("pressure", MANIFOLD, 0, "pulsating_pump", {"ripple": 0.8}, 100.0),
    ("pressure", MANIFOLD, 0, "pump_lets_back", {"diameter_m": 0.25e-3}, 500.0),
    ("pressure", MANIFOLD, 0, "hasty_regulator", {"gain": 0.2}, 200.0),
    ("pressure", LEFT, 0, "room_pressure", {"pressure_pa": 1e3}, 500.0),
    ("pressure", TENDON, 2, "clamped_short_peroneal_pair", {"shorter_m": 0.001}, 0.2),
    ("pressure", TENDON, 14, "torn_fibres_achilles_right", {"fibres": 9.0}, 0.1),
    ("pressure", TENDON, 14, "torn_end_achilles_right", {"off": 0.5}, 0.1),
    ("pressure", JOINTS, 1, "clamped_short_achilles_pair", {"shorter_m": 0.001}, 0.002),
    ("tensile", CELL, 2, "recured", {"gain": 0.4}, 0.5),
    ("tensile", CELL, 2, "dusty_fibres", {"friction": 0.5}, 0.5),
    ("tensile", CELL, 2, "stiffer_print", {"stiffer": 1.2}, 0.5),
    ("tensile", CELL, 2, "membrane_pulls", {"membrane_n_m": 100.0}, 0.3),
    ("tensile", CELL, 2, "tired_fibres", {"damage": 0.4, "stretch": 0.5}, 0.5),
    ("tensile", CELL, 2, "torn_fibres_peroneal_left", {"fibres": 3.0}, 0.5),
    ("tensile", CELL, 2, "torn_end_peroneal_left", {"off": 0.3}, 0.5),
    ("tensile", CELL, 2, "warming_tendons", {"warming_k_s": 0.5}, 0.3),
    ("tensile", CELL, 2, "tacky_fibres", {"striction": 1.0}, 0.2),
    ("tensile", CELL, 2, "thick_membrane", {"onset_pa": 1e4}, 0.5),
    ("tensile", CELL, 2, "load_cell_gain", {"gain": 1.1}, 0.5),
    ("tensile", CELL, 2, "load_cell_spikes", {"spike_n": 10.0}, 0.3),
    ("tensile", CELL, 2, "load_cell_creeps", {"creep": 0.2}, 0.2),
    ("tensile", CELL, 2, "late_load_cell", {"delay_s": 0.05}, 0.2),
    ("tensile", JOINTS, 0, "late_joints", {"delay_s": 0.05}, 2e-4),
    ("tensile", JOINTS, 0, "clocks_drift", {"skew": 0.01}, 1e-4),
    ("tensile", CELL, 2, "late_sensors", {"delay_s": 0.05}, 0.2),
)


@pytest.mark.parametrize(("rig", "topic", "column", "fault", "values", "least"), SHOWS, ids=lambda each: str(each)[:40])
def test_a_fault_moves_what_it_should(
    rig: str, topic: str, column: int, fault: str, values: Mapping[str, float], least: float
) -> None:
    """Each fault shows in the signal of its own subsystem, far above the noise."""
    assert moved(rig, topic, fault, column, **values) > least
    assert rig in FAULTS[fault].rigs


def test_a_fault_of_the_tendon_leaves_the_air_alone() -> None:
    """Stiffer fibres change no pressure and no command; a leak in one line, no tendon of another."""
    stiff = faulty("pressure", "stiffer_print", stiffer=1.5)
    for topic in (MANIFOLD, LEFT, RIGHT, ACHILLES, names.PUMP_DUTY.name):
        assert np.array_equal(stiff.topics[topic].values, healthy("pressure").topics[topic].values)
    assert moved("pressure", TENDON, "leak_achilles", 2, diameter_m=0.1e-3) < 0.1


def test_a_sticky_valve_sticks_now_and_then() -> None:
    """Over days, some switches are late by as much as it sticks and others are not."""
    plan = Plan("pressure", {"cycles": 2, "jam_time_s": 0.8, "vent_time_s": 0.4, "channel": "achilles"})
    late = []
    for seed in range(6):
        found = run(plan, PLAIN, (FaultSetting("sticky_valve_achilles", {"stuck_s": 0.2}),), seed)
        track = found.topics[ACHILLES]
        for start_s in (0.2, 1.4):
            read = np.interp(start_s + 0.1, track.stamp_s, track.values[:, 0])
            late.append(bool(read > 99e3))
    assert 0 < sum(late) < len(late)


def test_lost_samples_are_lost() -> None:
    """A link that loses a third of all samples leaves two thirds."""
    found = faulty("tensile", "lost_samples", dropped=0.33)
    share = found.topics[CELL].stamp_s.size / healthy("tensile").topics[CELL].stamp_s.size
    assert 0.6 < share < 0.74


def test_bad_requests_are_refused_in_one_line() -> None:
    """Unknown rigs, settings and faults, and sizes out of range, name value, limit and way out."""
    for plan, faults, words in (
        (Plan("moon", {}), (), "moon"),
        (Plan("tensile", {"colour": "red"}), (), "colour"),
        (Plan("tensile", {"membrane": "no", "vacuum_pa": 1e4}), (), "membrane"),
        (Plan("pressure", {"pump_free_flow_l_min": 9.0}), (), "pump_free_flow_l_min"),
        (Plan("pressure", {"channel": "nose"}), (), "nose"),
        (PRESSURE, (FaultSetting("rust"),), "rust"),
        (PRESSURE, (FaultSetting("worn_pump", {"flow": 9.0}),), "0.25 to 1.25"),
        (PRESSURE, (FaultSetting("worn_pump", {"colour": 9.0}),), "colour"),
    ):
        with pytest.raises((BadPlanError, BadFaultError), match=words):
            run(plan, PLAIN, faults, 0)


def test_settings_of_the_simulator_alone_are_passed_over() -> None:
    """A plan with everything that `jammkle rig` writes down, at its defaults, can be carried out."""
    options = {"seed": 7, "parameter_set": "fitted", "timestep_s": 0.0005, "valve_dead_time_s": 0.01}
    assert same(run(Plan("pressure", {**PRESSURE.options, **options}), PLAIN, (), 3), healthy("pressure"))
