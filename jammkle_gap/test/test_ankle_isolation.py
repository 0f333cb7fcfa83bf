"""Subsystems on their own and restarts from the measured state: where a gap lies, and where it does not."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
import pytest

from jammkle_gap.ankle.corrected import Correction
from jammkle_gap.ankle.effects import ankle_library
from jammkle_gap.ankle.runs import recording_of_run
from jammkle_gap.ankle.simulator import AnkleSimulator
from jammkle_gap.ankle.subsystems import subsystem_simulators
from jammkle_sim.rigs.catalogue import RIGS, run_rig

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from jammkle_gap.november.recording import Recording

LIBRARY = ankle_library()
SIMULATOR = AnkleSimulator(LIBRARY)
SUBSYSTEMS = subsystem_simulators(LIBRARY)
TENSILE = (("speed_m_s", 0.02), ("vacuum_pa", 50e3))


@lru_cache(maxsize=16)
def recorded(rig: str, options: tuple[tuple[str, object], ...], effects: tuple[tuple[str, float], ...]) -> Recording:
    """Run a rig with effects that the recording does not tell."""
    correction = Correction(LIBRARY, dict(effects))
    return recording_of_run(run_rig(rig, RIGS[rig].options(**dict(options)), lambda _: None, lambda: False, correction))


def worst(recording: Recording, simulated: Mapping[str, NDArray[np.float64]]) -> float:
    """Largest gap over signals, in noise, without what sensors may be off by throughout; 0 where there are none."""
    gaps = [0.0]
    for name, values in simulated.items():
        signal = recording.signal(name)
        residual = signal.values - values
        residual -= np.clip(residual.mean(), -3.0 * signal.bias, 3.0 * signal.bias)
        gaps.append(float(np.sqrt(np.mean((residual / signal.noise) ** 2))))
    return max(gaps)


@pytest.mark.parametrize(
    ("rig", "options"),
    [("tensile", TENSILE), ("pressure", (("cycles", 2),)), ("drop", (("foot", "jammed"),)), ("landing", ())],
)
@pytest.mark.parametrize("name", SUBSYSTEMS)
def test_a_subsystem_in_good_order_lies_at_its_noise(name: str, rig: str, options: tuple[tuple[str, object]]) -> None:
    """Fed with measured inputs, each part of a nominal run gives its measured outputs."""
    recording = recorded(rig, options, ())
    assert worst(recording, SUBSYSTEMS[name](recording, {})) < 1.5


@pytest.mark.parametrize(
    ("rig", "options", "effect", "value", "guilty"),
    [
        ("tensile", TENSILE, "line_leak_peroneal_left.conductance_dm3_s_bar", 0.003, "pneumatics"),
        ("landing", (), "pump_wear.flow_scale", 0.6, "pneumatics"),
        ("tensile", TENSILE, "tendon_stiffness.scale", 1.2, "tendon"),
        ("landing", (), "jamming_friction.scale", 1.5, "tendon"),
        ("landing", (), "payload.mass_kg", 0.3, "mechanics"),
        ("landing", (), "ankle_joint_friction.coulomb_n_m", 0.1, "mechanics"),
        ("landing", (), "imu_misalignment.pitch_rad", 0.1, "sensing"),
        ("tensile", TENSILE, "load_cell_gain.gain", 1.1, "sensing"),
    ],
)
def test_the_guilty_subsystem_stands_out(
    rig: str, options: tuple[tuple[str, object]], effect: str, value: float, guilty: str
) -> None:
    """An effect is seen by the part that it is in; with it put in, that part is at its noise.

    A pressure sensor's own offset, which is noise of the input, may carry over into the tension of a sliding tendon.
    """
    recording = recorded(rig, options, ((effect, value),))
    gaps = {name: worst(recording, simulator(recording, {})) for name, simulator in SUBSYSTEMS.items()}
    assert gaps[guilty] > 3.0
    innocent = {"pneumatics", "tendon"} - {guilty}
    assert all(gaps[name] < 1.5 for name in innocent)
    fixed = SUBSYSTEMS[guilty](recording, {effect: value})
    assert worst(recording, fixed) < (2.5 if guilty == "tendon" else 1.5)


def test_a_pressure_sensors_offset_is_taken_off_before_it_drives_a_tendon() -> None:
    """A tendon does not feel what its sensor reads too much: with the offset told, tension is at its noise."""
    offset = {"pressure_sensor_offset_achilles.offset_pa": 4000.0}
    recording = recorded("landing", (), tuple(offset.items()))
    assert worst(recording, SUBSYSTEMS["tendon"](recording, {})) > 3.0
    assert worst(recording, SUBSYSTEMS["tendon"](recording, offset)) < 1.5


def test_missing_inputs_leave_signals_out() -> None:
    """Without extensions there is no tendon on its own, and without tensions no motion."""
    whole = recorded("landing", (), ())
    signals = tuple(each for each in whole.signals if not each.name.endswith(("/extension", "/tension")))
    recording = type(whole)(whole.name, signals, whole.inputs, whole.phases)
    assert SUBSYSTEMS["tendon"](recording, {}) == {}
    assert SUBSYSTEMS["mechanics"](recording, {}) == {}
    assert SUBSYSTEMS["pneumatics"](recording, {})


@pytest.mark.parametrize(("rig", "options"), [("tensile", TENSILE), ("pressure", (("cycles", 1),))])
@pytest.mark.parametrize("horizon_s", [0.0, 0.1, 1.0, 1e9])
def test_restarts_of_a_nominal_run_lie_at_its_noise(
    horizon_s: float, rig: str, options: tuple[tuple[str, object]]
) -> None:
    """Set to the measured state again and again, a simulation in good order stays with what was measured."""
    recording = recorded(rig, options, ())
    assert worst(recording, SIMULATOR.restarted(recording, {}, horizon_s)) < 1.5


def test_a_leak_shows_only_over_a_long_horizon() -> None:
    """Drift: restarted every sample it hides in the noise, over a second it does not."""
    recording = recorded("tensile", TENSILE, (("line_leak_peroneal_left.conductance_dm3_s_bar", 0.001),))
    gaps = [worst(recording, SIMULATOR.restarted(recording, {}, horizon_s)) for horizon_s in (0.0, 0.1, 1.0)]
    assert gaps[0] < 1.5
    assert gaps[0] < gaps[1] < gaps[2]
    assert gaps[2] > 3.0


def test_without_restart_it_is_the_run_itself() -> None:
    """A horizon beyond the end changes nothing."""
    recording = recorded("landing", (), (("payload.mass_kg", 0.2),))
    plain, once = SIMULATOR(recording, {}), SIMULATOR.restarted(recording, {}, 1e9)
    assert set(plain) == set(once)
    assert all(once[name] == pytest.approx(plain[name], abs=1e-9) for name in plain)


def test_a_joint_that_nobody_measures_leaves_the_bodies_out() -> None:
    """The slip rig's ball joint is not in joint_states: only the air can be restarted there."""
    recording = recorded("slip", (("foot", "jammed"), ("speed_m_s", 0.05)), ())
    assert all(name.endswith("/pressure") for name in SIMULATOR.restarted(recording, {}, 0.1))
