"""The landing rig: physics of a fall and a landing, determinism, reset, clear errors."""

from __future__ import annotations

import dataclasses
import json
import math

import numpy as np
import pytest

from jammkle_common.constants import STANDARD_ATMOSPHERE_PA, STANDARD_GRAVITY_M_S2
from jammkle_common.names import CHANNELS, TENDONS
from jammkle_common.parameters import ParameterError
from jammkle_sim.physics.ankle import AnkleParameters
from jammkle_sim.rigs.landing import LandingOptions, landing_built
from jammkle_sim.rigs.options import checked
from jammkle_sim.rigs.simulation import Simulation, UnstableSimulationError

RELEASE_S = 0.6
OPTIONS = LandingOptions(release_time_s=RELEASE_S)


@dataclasses.dataclass(frozen=True)
class Record:
    """A run, one row per time step."""

    time_s: np.ndarray
    net_up_m_s2: np.ndarray
    pitch_rad: np.ndarray
    height_m: np.ndarray
    load_cell_n: np.ndarray
    extension_m: np.ndarray


def snapshot(simulation: Simulation) -> tuple[object, ...]:
    """Everything that the sensors and the state show now."""
    return (
        simulation.ankle.imu(),
        simulation.ankle.channel_pressures_pa(),
        simulation.ankle.manifold_pressure_pa(),
        simulation.ankle.joint_positions(),
        simulation.ankle.joint_velocities(),
        simulation.ankle.tendons(),
        simulation.ankle.load_cell_force_n(),
    )


def jam(simulation: Simulation, vacuum_pa: float) -> None:
    """Hold all channels near a vacuum with the pump on or off, as a driver would; one time step."""
    for channel in CHANNELS:
        simulation.ankle.set_solenoid(channel, energised=True)
    simulation.ankle.set_pump_duty(
        1.0 if simulation.ankle.manifold_pressure_pa() > STANDARD_ATMOSPHERE_PA - vacuum_pa else 0.0
    )


def land(options: LandingOptions, duration_s: float, vacuum_pa: float = 0.0) -> Record:
    """Run a landing and record every step."""
    simulation = Simulation(landing_built(options))
    rows = []
    for _ in range(round(duration_s / options.timestep_s)):
        if vacuum_pa > 0.0:
            jam(simulation, vacuum_pa)
        simulation.advance(1)
        joints = simulation.ankle.joint_positions()
        rows.append(
            (
                simulation.time_s,
                simulation.ankle.imu().specific_force_m_s2[2] - STANDARD_GRAVITY_M_S2,
                joints["ankle_pitch"],
                joints["carriage"],
                simulation.ankle.load_cell_force_n()[2],
                max(tendon.extension_m for tendon in simulation.ankle.tendons()),
            )
        )
    return Record(*np.array(rows).T)


@pytest.fixture(scope="module")
def unjammed() -> Record:
    """A soft landing and two seconds after it."""
    return land(OPTIONS, 2.6)


@pytest.fixture(scope="module")
def jammed() -> Record:
    """A landing at -50 kPa and two seconds after it."""
    return land(OPTIONS, 2.6, vacuum_pa=50e3)


def touch_down_s(record: Record) -> float:
    """When the load cell is first pushed, by more than its noise."""
    return float(record.time_s[np.argmax(record.load_cell_n < -1.0)])


def test_held_carriage_hangs_the_ankle_on_the_load_cell(unjammed: Record) -> None:
    """Before the release nothing moves, the IMU reads gravity alone, and the load cell the ankle's weight, pulling."""
    held = unjammed.time_s < RELEASE_S
    assert np.abs(unjammed.net_up_m_s2[held]).max() < 0.1
    assert np.ptp(unjammed.height_m[held]) < 1e-5
    assert unjammed.load_cell_n[held].mean() == pytest.approx(
        AnkleParameters().mass_kg * STANDARD_GRAVITY_M_S2, abs=0.02
    )


@pytest.mark.parametrize("height_m", [0.02, 0.05, 0.1])
def test_free_fall_takes_as_long_as_it_must(height_m: float) -> None:
    """From release to touch-down it takes sqrt(2 h / g), within two steps and the droop of the foot."""
    options = LandingOptions(drop_height_m=height_m, release_time_s=0.1)
    record = land(options, 0.4)
    assert touch_down_s(record) - 0.1 == pytest.approx(math.sqrt(2.0 * height_m / STANDARD_GRAVITY_M_S2), abs=0.002)


def test_falls_weightless(unjammed: Record) -> None:
    """While it falls the IMU reads nothing and the load cell carries nothing."""
    falling = (unjammed.time_s > RELEASE_S + 0.02) & (unjammed.time_s < RELEASE_S + 0.095)
    assert unjammed.net_up_m_s2[falling] == pytest.approx(-STANDARD_GRAVITY_M_S2, abs=0.3)
    assert unjammed.load_cell_n[falling] == pytest.approx(0.0, abs=0.5)


def test_soft_ankle_takes_the_landing(unjammed: Record) -> None:
    """The foot turns most of the way to the slope, no tendon breaks, the shock stays within 25 to 60 m/s^2."""
    assert 25.0 < unjammed.net_up_m_s2.max() < 60.0
    assert math.radians(-41.0) < unjammed.pitch_rad.min() < math.radians(-25.0)
    assert unjammed.extension_m.max() < 0.045


def test_foot_settles_on_the_slope(unjammed: Record) -> None:
    """In the end the foot stands toe-up, the load cell carries the carriage, and little moves."""
    late = unjammed.time_s > 2.4
    assert unjammed.pitch_rad[late].max() < math.radians(-10.0)
    assert np.ptp(unjammed.height_m[late]) < 5e-4
    carriage_n = (OPTIONS.mass_kg - AnkleParameters().mass_kg) * STANDARD_GRAVITY_M_S2
    assert unjammed.load_cell_n[late].mean() == pytest.approx(-carriage_n, rel=0.02)


def test_jammed_ankle_is_stiffer(unjammed: Record, jammed: Record) -> None:
    """At -50 kPa the foot turns less, the leg sinks less and ends up higher."""
    assert jammed.pitch_rad.min() > 0.75 * unjammed.pitch_rad.min()
    assert jammed.height_m.min() > unjammed.height_m.min() + 0.01
    assert jammed.height_m[-1] > unjammed.height_m[-1] + 0.01


def test_half_the_time_step_changes_little(unjammed: Record) -> None:
    """Peak deceleration and deepest point move by less than 3 %."""
    fine = land(dataclasses.replace(OPTIONS, timestep_s=0.00025), 0.85)
    assert fine.net_up_m_s2.max() == pytest.approx(unjammed.net_up_m_s2.max(), rel=0.03)
    assert fine.height_m.min() == pytest.approx(unjammed.height_m.min(), rel=0.03)


def test_a_landing_from_a_little_higher_is_another_by_a_little() -> None:
    """Whatever part of a time step the blow falls into, a twentieth of a millimetre does no more than ten of them.

    Half a millimetre is how far runs scatter. Compared are means over 20 ms, as a diagnosis does.
    """
    pitches = []
    for i in range(11):
        options = dataclasses.replace(OPTIONS, drop_height_m=OPTIONS.drop_height_m + 5e-5 * i)
        pitch_rad = land(options, RELEASE_S + 0.4).pitch_rad[round(RELEASE_S / OPTIONS.timestep_s) :]
        pitches.append(pitch_rad.reshape(20, 40).mean(axis=1))
    steps = np.diff(pitches, axis=0)
    whole = float(np.sqrt((steps.sum(axis=0) ** 2).mean()))
    rough = float(np.sqrt(((steps - steps.mean(axis=0)) ** 2).mean()))
    assert rough < whole / 3.0
    assert np.sqrt((steps**2).mean(axis=1)).max() < whole


def test_same_seed_same_bytes_however_it_is_cut() -> None:
    """Two runs of a seed agree to the last bit, in one piece or step by step, read often or once."""
    whole, pieces = Simulation(landing_built(OPTIONS)), Simulation(landing_built(OPTIONS))
    whole.ankle.set_pump_duty(1.0)
    pieces.ankle.set_pump_duty(1.0)
    whole.advance(1500)
    for steps in (1, 699, 0, 600, 200):
        pieces.advance(steps)
        pieces.ankle.imu()
        pieces.ankle.channel_pressures_pa()
    assert snapshot(whole) == snapshot(pieces)


def test_another_seed_changes_noise_only() -> None:
    """Another seed gives other readings of the same motion."""
    one, other = Simulation(landing_built(OPTIONS)), Simulation(landing_built(dataclasses.replace(OPTIONS, seed=1)))
    one.advance(1400)
    other.advance(1400)
    assert one.ankle.joint_positions() == other.ankle.joint_positions()
    assert one.ankle.tendons() == other.ankle.tendons()
    assert one.ankle.imu() != other.ankle.imu()
    assert one.ankle.manifold_pressure_pa() != other.ankle.manifold_pressure_pa()


def test_reset_brings_the_same_run_back_while_time_goes_on() -> None:
    """After a reset in mid-landing, jammed, everything repeats bit by bit; the time is not set back."""
    simulation = Simulation(landing_built(OPTIONS))
    first = []
    for _ in range(14):
        simulation.advance(100)
        first.append(snapshot(simulation))
    for channel in CHANNELS:
        simulation.ankle.set_solenoid(channel, energised=True)
    simulation.ankle.set_pump_duty(1.0)
    simulation.advance(333)
    before_s = simulation.time_s
    simulation.reset()
    assert simulation.time_s == before_s
    for expected in first:
        simulation.advance(100)
        assert snapshot(simulation) == expected
    assert simulation.time_s == pytest.approx(before_s + 0.7)


def test_slow_path_does_the_same_as_the_compiled_one() -> None:
    """Where MuJoCo's library cannot be called directly, stepping from Python gives the same bytes."""
    fast, slow = Simulation(landing_built(OPTIONS)), Simulation(landing_built(OPTIONS))
    slow._parts[0].body.addresses[0] = 0
    fast.advance(1500)
    slow.advance(1500)
    assert snapshot(fast) == snapshot(slow)


def test_solenoids_pull_the_right_tendons_down() -> None:
    """Energising one channel lowers its pressure alone; releasing it brings it back."""
    simulation = Simulation(landing_built(OPTIONS))
    simulation.ankle.set_pump_duty(1.0)
    simulation.ankle.set_solenoid("achilles", energised=True)
    simulation.advance(800)
    pressures_pa = simulation.ankle.channel_pressures_pa()
    assert pressures_pa["achilles"] < 60e3
    assert min(pressures_pa["peroneal_left"], pressures_pa["peroneal_right"]) > 100e3
    assert [tendon.name for tendon in simulation.ankle.tendons()] == list(TENDONS)
    simulation.ankle.set_solenoid("achilles", energised=False)
    simulation.advance(800)
    assert simulation.ankle.channel_pressures_pa()["achilles"] > 100e3


@pytest.mark.parametrize("advance_in_python", [False, True])
def test_blow_up_is_reported_with_what_was_simulated(*, advance_in_python: bool) -> None:
    """A state beyond all bounds raises one line with rig, options, time and speed; a reset makes it whole again."""
    simulation = Simulation(landing_built(dataclasses.replace(OPTIONS, slope_deg=45.0)))
    if advance_in_python:
        simulation._parts[0].body.addresses[:] = 0
    simulation.advance(10)
    simulation._parts[0].body.speed[1] = 1e6
    with pytest.raises(UnstableSimulationError) as caught:
        simulation.advance(100)
    assert str(caught.value) == (
        "simulation of rig 'landing' (options: slope_deg=45.0, release_time_s=0.6) became unstable 0.005 s after its "
        "start: a joint moves at 1e+06 rad/s or m/s, the limit is 1000; try a smaller timestep_s or milder options"
    )
    simulation.reset()
    simulation.advance(100)
    assert simulation.ankle.joint_positions()["carriage"] > 0.1


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("slope_deg", 60.0, "'slope_deg' is 60; it must be 0 to 50 deg"),
        ("drop_height_m", -0.1, "'drop_height_m' is -0.1"),
        ("mass_kg", float("nan"), "'mass_kg' is nan"),
        ("friction", float("inf"), "'friction' is inf"),
        ("release_time_s", -1.0, "'release_time_s' is -1"),
        ("seed", -1, "'seed' is -1"),
        ("seed", 1.5, "'seed' is 1.5; it must be a whole number"),
        ("timestep_s", 0.1, "'timestep_s' is 0.1"),
        ("parameter_set", "best", "'parameter_set' is 'best'.*fitted, as_printed"),
    ],
)
def test_bad_options_are_named(name: str, value: object, words: str) -> None:
    """An option out of range is refused with its name, its value and what would be right."""
    with pytest.raises(ParameterError, match=words):
        checked(dataclasses.replace(OPTIONS, **{name: value}))


def test_bad_commands_are_named_and_change_nothing() -> None:
    """A duty out of range, an unknown channel or a negative step count is refused; the run is not disturbed."""
    simulation, untouched = Simulation(landing_built(OPTIONS)), Simulation(landing_built(OPTIONS))
    for duty in (1.5, -0.1, float("nan")):
        with pytest.raises(ValueError, match="it must be 0 to 1"):
            simulation.ankle.set_pump_duty(duty)
    with pytest.raises(ValueError, match=r"'heel'.*peroneal_left"):
        simulation.ankle.set_solenoid("heel", energised=True)
    with pytest.raises(ValueError, match="steps is -1"):
        simulation.advance(-1)
    simulation.advance(200)
    untouched.advance(200)
    assert snapshot(simulation) == snapshot(untouched)


@pytest.mark.parametrize("parameter_set", ["fitted", "as_printed"])
def test_description_says_everything_in_plain_types(parameter_set: str) -> None:
    """Rig, options and every constant are in the description, and it can be written as text."""
    description = landing_built(dataclasses.replace(OPTIONS, parameter_set=parameter_set)).description()
    text = json.dumps(description)
    assert description["rig"] == "landing"
    for word in (parameter_set, "slope_deg", "c1_pa", "pump_free_flow_l_min", "achilles_arm_m", "imu_bandwidth_hz"):
        assert word in text


def test_flat_ground_and_level_foot_touch_with_all_four_corners() -> None:
    """On level ground the foot stays nearly level and carries the whole weight."""
    record = land(dataclasses.replace(OPTIONS, slope_deg=0.0, drop_height_m=0.002), 1.6)
    assert abs(record.pitch_rad[-1]) < math.radians(2.0)
    assert record.load_cell_n[-200:].mean() == pytest.approx(-(1.8 - 0.352) * STANDARD_GRAVITY_M_S2, rel=0.02)
