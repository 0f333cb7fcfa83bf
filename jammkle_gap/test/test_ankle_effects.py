"""The library of effects: off they change nothing, on they change what they should and nothing else."""

from __future__ import annotations

import dataclasses
import pickle
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
import pytest

from jammkle_common import names
from jammkle_common.constants import STANDARD_ATMOSPHERE_PA
from jammkle_gap.ankle.corrected import Correction
from jammkle_gap.ankle.effects import AnkleEffect, ankle_library, change_of, try_changes
from jammkle_gap.ankle.inputs import nominal_rig
from jammkle_gap.ankle.problem import ankle_problem
from jammkle_gap.ankle.recording import recording_of_run
from jammkle_gap.ankle.sensors import ACCELERATION, ANGLE, EXTENSION, FORCE, PRESSURE, RATE, SLIDE, TENSION, quantity_of
from jammkle_gap.ankle.simulator import AnkleSimulator
from jammkle_gap.core.constants import Constants
from jammkle_gap.core.effects import BadEffectError, Library
from jammkle_gap.core.signatures import dictionary_of
from jammkle_gap.core.simulate import Runner
from jammkle_sim.rigs.catalogue import RIGS, as_it_is, run_rig
from recorded import bias_of

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from numpy.typing import NDArray

    from jammkle_gap.core.data import Recording
    from jammkle_sim.rigs.rig import Rig

LIBRARY = ankle_library()
SIMULATOR = AnkleSimulator(LIBRARY)
EFFECTS = [effect for effect in LIBRARY if isinstance(effect, AnkleEffect)]
ONE_OF_EACH = list({effect.family: effect for effect in EFFECTS}.values())
ALL = {PRESSURE, ANGLE, SLIDE, EXTENSION, TENSION, FORCE, ACCELERATION, RATE}
MOVED = 0.05
"""Root mean square in noise from which on a signal counts as moved."""
ROUNDING = 2e-3
"""Share of the noise that dividing the same air by another volume may make."""
OWN = {
    "imu_offset": {ACCELERATION},
    "gyro_offset": {RATE},
    "imu_misalignment": {ACCELERATION, RATE},
    "imu_saturation": {ACCELERATION},
    "sensor_delay": ALL,
    "clock_skew": ALL,
    "pressure_delay": {PRESSURE},
    "imu_delay": {ACCELERATION, RATE},
    "joint_delay": {ANGLE, SLIDE, EXTENSION, TENSION},
    "load_cell_delay": {FORCE},
    "load_cell_gain": {FORCE},
    "pressure_sensor_offset": {PRESSURE},
}
"""Quantities that each effect on sensing may touch: it leaves the truth alone."""
FIRST = {
    "pneumatics": PRESSURE,
    "timing": PRESSURE,
    "tendon": TENSION,
    "mechanics": FORCE,
}
"""What an effect upstream of the sensors moves in any case."""


@lru_cache(maxsize=8)
def recorded(rig: str, **options: object) -> Recording:
    """Run a rig without any effect."""
    return recording_of_run(run_rig(rig, RIGS[rig].options(**options), lambda _: None, lambda: False))


def landing() -> Recording:
    """Jammed after touch-down: every effect shows."""
    return recorded("landing")


def well_on(effect: AnkleEffect, share: float = 0.8) -> dict[str, float]:
    """Values at a share of the way from null to the lower bound, or to the upper where null is the lower."""
    values = {}
    for each in effect.parameters:
        far = each.maximum if each.null == each.minimum or effect.subsystem == "timing" else each.minimum
        values[effect.key(each)] = each.null + share * (far - each.null)
    return values


def moves(
    recording: Recording, one: Mapping[str, NDArray[np.float64]], two: Mapping[str, NDArray[np.float64]]
) -> dict[str, float]:
    """Difference of two simulations per signal, root mean square in noise."""
    return {
        signal.name: float(np.sqrt(np.mean(((one[signal.name] - two[signal.name]) / signal.deviation) ** 2)))
        for signal in recording.signals
    }


def gap(recording: Recording, values: Mapping[str, float]) -> float:
    """Difference of measured and simulated over all signals, root mean square in noise, offsets of sensors counted."""
    simulated = SIMULATOR(recording, values)
    squares = []
    for signal in recording.signals:
        noise = np.hypot(signal.deviation, bias_of(signal))
        squares.append(np.mean(((signal.values - simulated[signal.name]) / noise) ** 2))
    return float(np.sqrt(np.mean(squares)))


def test_the_library_is_the_one_of_the_specification() -> None:
    """Every effect that must be there is, with bounds, source and a sentence."""
    families = {effect.family for effect in EFFECTS}
    assert families >= {
        "line_leak", "pump_wear", "valve_dead_time", "line_restriction", "trapped_volume", "pressure_sensor_offset",
        "viscoelasticity", "jamming_friction", "tendon_stiffness", "membrane_stiffness", "pretension", "softening",
        "fibre_loss", "tendon_failure", "payload", "ankle_joint_friction", "floor_friction", "floor_compliance",
        "backlash", "imu_offset", "imu_misalignment", "imu_saturation", "command_delay", "sensor_delay", "clock_skew",
        "load_cell_gain",
    }  # fmt: skip
    for effect in EFFECTS:
        assert effect.sentence.endswith(".")
        assert "{" not in effect.sentence
        assert all(parameter.source for parameter in effect.parameters)


def test_off_is_the_nominal_simulation_bit_for_bit() -> None:
    """Every parameter at its null value gives the very same rig, and so the same numbers."""
    recording = landing()
    null = {effect.key(each): each.null for effect in EFFECTS for each in effect.parameters}
    rig = nominal_rig(recording.inputs)
    assert SIMULATOR.rig(recording, null) is rig
    nominal, off = SIMULATOR(recording, {}), SIMULATOR(recording, null)
    assert all(nominal[name].tobytes() == off[name].tobytes() for name in nominal)


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.name)
def test_an_effect_moves_what_it_should_and_nothing_else(effect: AnkleEffect) -> None:
    """Sensors leave the truth alone; tendons and bodies leave the air alone; air waits for the first command."""
    recording, values = landing(), well_on(effect)
    nominal, simulated = SIMULATOR(recording, {}), SIMULATOR(recording, values)
    moved = moves(recording, simulated, nominal)
    touched = {quantity_of(name) for name, size in moved.items() if size > 0.0}
    shown = {quantity_of(name) for name, size in moved.items() if size > MOVED}
    if effect.family in OWN:
        assert shown
        assert touched <= OWN[effect.family]
        return
    assert FIRST[effect.subsystem] in shown
    if effect.subsystem in ("tendon", "mechanics"):
        assert PRESSURE not in touched
        return
    first_s = min(float(each.time_s[each.values > 0.0].min()) for each in recording.inputs.commands.solenoids.values())
    for signal in recording.signals:
        before = signal.time_s < first_s
        earlier = np.abs(simulated[signal.name][before] - nominal[signal.name][before])
        assert earlier.max(initial=0.0) < ROUNDING * signal.deviation


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.name)
def test_an_effect_begins_small(effect: AnkleEffect) -> None:
    """A thousandth of the way moves air, tendon and their sensors by less than a quarter of the whole way.

    MuJoCo's dry friction begins with a small step, all else in proportion.
    """
    for recording in (
        recorded("pressure", cycles=1),
        recorded("tensile", vacuum_pa=50e3, speed_m_s=0.02, extension_m=0.01),
    ):
        nominal = SIMULATOR(recording, {})
        little, much = (max(moves(recording, SIMULATOR(recording, well_on(effect, share)), nominal).values())
                        for share in (0.001, 1.0))  # fmt: skip
        assert little <= 0.25 * much + ROUNDING


@pytest.mark.parametrize("effect", ONE_OF_EACH, ids=lambda effect: effect.family)
def test_a_rig_with_an_effect_is_run_again_with_it(effect: AnkleEffect) -> None:
    """What `jammkle rig --effects` records, the simulator reproduces to the noise with that effect, and only so."""
    values = well_on(effect, 0.3)
    correction = Correction(LIBRARY, values)
    recording = recording_of_run(
        run_rig("landing", RIGS["landing"].options(), lambda _: None, lambda: False, correction)
    )
    with_effect, without = gap(recording, values), gap(recording, {})
    assert with_effect < 1.0
    assert without > with_effect


def test_a_leak_acts_on_its_own_line() -> None:
    """With one channel drawing, a leak there or in the manifold shows; in a channel that is vented it does nothing."""
    recording = recorded("tensile", vacuum_pa=50e3, speed_m_s=0.02, extension_m=0.01)
    nominal = SIMULATOR(recording, {})

    def size(place: str) -> float:
        leaking = SIMULATOR(recording, {f"line_leak_{place}.conductance_dm3_s_bar": 0.005})
        return max(moves(recording, leaking, nominal).values())

    assert size(names.PERONEAL_LEFT) > 5.0
    assert size("manifold") > 5.0
    assert size(names.ACHILLES) == size(names.PERONEAL_RIGHT) == 0.0


def test_backlash_opens_a_dead_zone_before_a_tendon_pulls() -> None:
    """A tendon with play pulls later by its play, then as a tight one does, and lets go earlier by as much."""
    recording = recorded("tensile", speed_m_s=0.02, extension_m=0.01)
    tension, extension = recording.signal("peroneal_left/tension"), recording.signal("peroneal_left/extension")
    stretched_m = np.interp(tension.time_s, extension.time_s, extension.values)
    tight = SIMULATOR(recording, {"viscoelasticity.gain_scale": 0.0})[tension.name]
    loose = SIMULATOR(recording, {"viscoelasticity.gain_scale": 0.0, "backlash.play_m": 0.003})[tension.name]
    assert loose[stretched_m < 0.0025].max() == 0.0
    pulled = stretched_m > 0.0045
    order = np.argsort(stretched_m)
    earlier = np.interp(stretched_m[pulled] - 0.003, stretched_m[order], tight[order])
    assert np.abs(loose[pulled] - earlier).max() < 0.02 * np.ptp(tight)


def test_a_sensor_that_reads_low_is_no_vacuum_at_the_start() -> None:
    """What a recording begins from is read by the sensors: with their offset in it, the line is vented as it is."""
    recording = recorded("pressure", cycles=1)
    sensor = "manifold/pressure"
    low = dataclasses.replace(
        recording.inputs, start_pa=np.array([STANDARD_ATMOSPHERE_PA - 4000.0, *(3 * [STANDARD_ATMOSPHERE_PA])])
    )
    offset = {"pressure_sensor_offset_manifold.offset_pa": -4000.0}
    found = SIMULATOR(dataclasses.replace(recording, inputs=low), offset)[sensor]
    np.testing.assert_allclose(found, SIMULATOR(recording, offset)[sensor], atol=1.0)


def test_softening_takes_the_force_down_with_every_pull() -> None:
    """Over two pulls the second is weaker than the first, and the more so the larger the loss."""
    recording = recorded("tensile", speed_m_s=0.02, extension_m=0.01)
    name = "load_cell/force_z"
    peaks = [
        float(SIMULATOR(recording, {"softening.loss": loss, "softening.travel_m": 0.005})[name].max())
        for loss in (0.0, 0.2, 0.4)
    ]
    assert peaks[0] > peaks[1] > peaks[2] > 0.6 * peaks[0]


def test_a_crooked_imu_reads_gravity_sideways() -> None:
    """Turned by a small roll it reads about g times the roll on y, and less than g on z."""
    recording = landing()
    still = recording.signal("imu/specific_force_y").time_s < 0.9
    simulated = SIMULATOR(recording, {"imu_misalignment.roll_rad": 0.1})
    assert simulated["imu/specific_force_y"][still] == pytest.approx(9.81 * np.sin(0.1), rel=1e-3)
    assert simulated["imu/specific_force_z"][still] == pytest.approx(9.81 * np.cos(0.1), rel=1e-3)


def test_a_delay_moves_no_sample_by_steps() -> None:
    """A command delay between two time steps gives pressures between those of the two."""
    recording = recorded("pressure", cycles=1)
    name = names.PRESSURES[names.ACHILLES].name
    early, middle, late = (
        SIMULATOR(recording, {"command_delay.delay_s": delay_s})[name] for delay_s in (0.010, 0.01025, 0.0105)
    )
    assert np.abs(middle - 0.5 * (early + late)).max() < 0.1 * np.abs(late - early).max()


def test_the_simulator_travels_between_processes() -> None:
    """Pickled and back, it gives the same numbers."""
    recording = landing()
    simulator, again = pickle.loads(pickle.dumps((SIMULATOR, recording)))  # noqa: S301 - made here
    values = {"payload.mass_kg": 0.2}
    one, two = SIMULATOR(recording, values), simulator(again, values)
    assert all(np.array_equal(one[name], two[name]) for name in one)


def test_an_unknown_parameter_is_refused() -> None:
    """A value that no effect takes is never left out silently."""
    with pytest.raises(BadEffectError, match="line_leek"):
        SIMULATOR(landing(), {"line_leek.conductance_dm3_s_bar": 0.1})


ENTRY = """
extra_mass:
  subsystem: mechanics
  sentence: "Mud sticks to the leg: clean it."
  change: mine.py:add
  parameters:
    mass_kg: {unit: kg, "null": 0, minimum: 0, maximum: 1, source: a bucket}
"""
CHANGE = """
from jammkle_gap.ankle.changes import add_payload

def add(rig, values, place):
    return add_payload(rig, values, place)
"""


def test_a_user_adds_an_effect_without_editing_the_package(tmp_path: Path) -> None:
    """A YAML file with a Python function beside it is as good as an own effect, in other processes too."""
    (tmp_path / "mine.yaml").write_text(ENTRY)
    (tmp_path / "mine.py").write_text(CHANGE)
    simulator = pickle.loads(pickle.dumps(AnkleSimulator(ankle_library(tmp_path / "mine.yaml"))))  # noqa: S301 - as above
    recording = landing()
    mine, own = simulator(recording, {"extra_mass.mass_kg": 0.3}), SIMULATOR(recording, {"payload.mass_kg": 0.3})
    assert all(np.array_equal(mine[name], own[name]) for name in own)


def test_signatures_of_an_effect_whose_function_was_edited_are_made_anew(tmp_path: Path) -> None:
    """What is kept on disk is of the function that was simulated, and is taken as long as that stays the same."""
    (tmp_path / "mine.yaml").write_text(ENTRY)

    def signature(change: str) -> tuple[NDArray[np.float64], int]:
        (tmp_path / "mine.py").write_text(change)
        change_of.cache_clear()
        library = Library((ankle_library(tmp_path / "mine.yaml").effect("extra_mass"),))
        problem = dataclasses.replace(ankle_problem(library), scatter=(), constants=())
        runner = Runner(problem, 1)
        found = dictionary_of(landing(), problem, runner, Constants(), tmp_path / "kept")
        return found.effects["extra_mass"], runner.runs

    heavy, _ = signature(CHANGE)
    again, runs = signature(CHANGE)
    assert runs == 0
    assert np.allclose(again, heavy, rtol=1e-5)
    light, runs = signature(CHANGE.replace("values, place)\n", "{'mass_kg': 0.1 * values['mass_kg']}, place)\n"))
    assert runs > 0
    assert np.abs(light).max() < 0.7 * np.abs(heavy).max()


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        (ENTRY.replace("maximum: 1, ", ""), "lacks 'maximum'"),
        (ENTRY.replace("mine.py:add", "mine.py:subtract"), "subtract"),
        (ENTRY.replace("mine.py:add", "nowhere.py:add"), "nowhere.py"),
        (ENTRY.replace("mine.py:add", "no_such_change"), "no_such_change"),
        (ENTRY.replace("maximum: 1", "maximum: much"), "no number"),
        (ENTRY.replace("maximum: 1", "maximum: .inf"), "no finite bounds"),
        (ENTRY.replace("minimum: 0", "minimum: 0.5"), "outside its bounds"),
        (ENTRY.replace("minimum: 0", "minimum: 2"), "give the smaller number as minimum"),
        (ENTRY.replace("extra_mass", "payload"), "twice"),
        (ENTRY.replace('  sentence: "Mud sticks to the leg: clean it."\n', ""), "sentence"),
        (ENTRY.replace("unit: kg", "unit: ''"), "empty unit"),
        (ENTRY.replace("  change:", "  places: achilles\n  change:"), "write a list"),
        (ENTRY.replace("mine.py:add", "mine.py:NUMBER"), "no function"),
        (ENTRY.replace("mine.py:add", "broken.py:add"), "ZeroDivisionError"),
        ("[1, 2]", "no effects"),
        ("a: b: c", "not YAML"),
        (f"{ENTRY}\n{ENTRY}", "stands in line 2 and again in line"),
    ],
)
def test_a_bad_entry_is_refused_in_one_line(tmp_path: Path, entry: str, said: str) -> None:
    """The message names what is wrong."""
    (tmp_path / "mine.yaml").write_text(entry)
    (tmp_path / "mine.py").write_text(f"{CHANGE}\nNUMBER = 3\n")
    (tmp_path / "broken.py").write_text("1 / 0")
    with pytest.raises(BadEffectError, match=said) as error:
        ankle_library(tmp_path / "mine.yaml")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("body", "said"),
    [
        ("raise KeyError('stifness')", "fails with KeyError: 'stifness'"),
        ("return None", "NoneType instead of a Rig"),
    ],
)
def test_a_change_that_fails_is_told_before_anything_is_fitted(tmp_path: Path, body: str, said: str) -> None:
    """The message names effect, function and file; a change of the package is not tried."""
    (tmp_path / "mine.yaml").write_text(ENTRY)
    (tmp_path / "mine.py").write_text(f"def add(rig, values, place):\n    {body}\n")
    with pytest.raises(BadEffectError, match=said) as error:
        try_changes(ankle_library(tmp_path / "mine.yaml"), nominal_rig(landing().inputs))
    assert "extra_mass" in str(error.value)
    assert str(tmp_path / "mine.py") in str(error.value)
    try_changes(ankle_library(), nominal_rig(landing().inputs))


def test_a_change_that_writes_into_its_rig_leaves_the_nominal_one_alone(tmp_path: Path) -> None:
    """What a user's function does to the rig that it gets stays with its result; a bare `null` is read as one."""
    (tmp_path / "mine.yaml").write_text(ENTRY.replace('"null"', "null"))
    touching = (
        "def add(rig, values, place):\n    rig.model.opt.gravity[0] += 1\n    rig.tendon_laws['free_length_m'] += 1\n"
    )
    (tmp_path / "mine.py").write_text(f"{touching}    return rig\n")
    rig = nominal_rig(landing().inputs)
    gravity, laws = rig.model.opt.gravity.copy(), rig.tendon_laws.copy()
    changed = ankle_library(tmp_path / "mine.yaml").effect("extra_mass").change(rig, {"mass_kg": 0.5})
    assert changed.model.opt.gravity[0] == gravity[0] + 1
    assert np.array_equal(rig.model.opt.gravity, gravity)
    assert np.array_equal(rig.tendon_laws, laws)


def test_a_change_that_is_none_changes_nothing() -> None:
    """The rig itself comes back."""
    rig: Rig = nominal_rig(landing().inputs)
    assert as_it_is(rig) is rig
