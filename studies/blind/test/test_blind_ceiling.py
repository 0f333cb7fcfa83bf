"""The second simulator in the diagnosis's terms: as its simulator without noise, and what an ideal detector sees."""

from __future__ import annotations

from functools import cache, lru_cache
from typing import TYPE_CHECKING

import numpy as np
import pytest

from jammkle_gap import ankle_library, load_recordings
from studies.blind.bags import write_run
from studies.blind.ceiling import CONSTANTS, DAY, PLANNED, CeilingSimulator, built, ceiling_problem, recording_of_real
from studies.blind.reality.faults import FaultSetting
from studies.blind.reality.machine import STILL, Machine
from studies.blind.reality.run import run
from studies.blind.reality.sensors import Plan, RealRun
from studies.blind.reality.specimen import today
from studies.blind.size import HEALTHY, NEEDED, IdealDetector, detectable_size

if TYPE_CHECKING:
    from pathlib import Path

    from jammkle_gap import Recording


@pytest.fixture(scope="module")
def pulled(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    """A fast pull of the machine as drawn, as its bag has it."""
    bag: Path = tmp_path_factory.mktemp("ceiling") / "bag"
    plan = Plan("tensile", {"speed_m_s": 0.1, "extension_m": 0.02})
    write_run(run(plan, Machine(), [], 3), bag)
    return load_recordings(bag)[0]


def test_it_reads_what_a_bag_of_the_same_machine_reads(pulled: Recording) -> None:
    """Within the scatter of a day: two per cent of the force, 100 Pa of offsets and weather twice over."""
    made = CeilingSimulator()(pulled, {})
    force = pulled.signal("load_cell/force_z").values
    assert np.abs(made["load_cell/force_z"] - force).mean() < 0.02 * np.abs(force).max()
    pressure = pulled.signal("peroneal_left/pressure").values
    assert np.abs(made["peroneal_left/pressure"] - pressure).mean() < 400.0


def test_nothing_is_left_to_chance(pulled: Recording) -> None:
    """No noise and no day: a still run of the machine as drawn is the same whoever asks."""
    assert today(Machine(), STILL).tendons == Machine().tendons
    made = CeilingSimulator()(pulled, {})
    still = made["manifold/pressure"]
    assert np.ptp(still) < 1.0, "nobody pumps in this pull"


@pytest.mark.parametrize("name", ["load_cell_gain.gain", "machine.late", "day.start", "tendon_stiffness.stiffer"])
def test_faults_constants_and_days_change_what_is_read(pulled: Recording, name: str) -> None:
    """Each by name, and nothing at its null."""
    simulator = CeilingSimulator()
    plain = simulator(pulled, {})["load_cell/force_z"]
    null = 1.0 if name.partition(".")[2] in {"gain", "stiffer"} else 0.0
    changed = simulator(pulled, {name: null + 0.05})["load_cell/force_z"]
    assert np.abs(simulator(pulled, {name: null})["load_cell/force_z"] - plain).max() < 1e-9
    assert np.abs(changed - plain).max() > 0.2


def test_its_library_is_that_of_the_diagnosis() -> None:
    """Every effect has a name that the diagnosis knows; causes outside the library are in neither."""
    assert {effect.name for effect in ceiling_problem().library} <= {effect.name for effect in ankle_library()}


def test_every_constant_and_every_day_means_something() -> None:
    """Each changes the machine as drawn, or is an option of a plan; at null all of them are off."""
    assert built({each.name: each.null for each in (*CONSTANTS, *DAY)}) == Machine()
    for each in (*CONSTANTS, *DAY):
        assert each.name in PLANNED or built({each.name: each.null + each.sigma}) != Machine()


PULL = Plan("tensile", {"speed_m_s": 0.1, "extension_m": 0.02})


@cache
def pull(seed: int, gain: float = 1.0) -> RealRun:
    """Return a fast pull of the machine as drawn, its load cell off by a factor."""
    return run(PULL, Machine(), [FaultSetting("load_cell_gain", {"gain": gain})], seed)


@lru_cache(maxsize=1)
def detector() -> IdealDetector:
    return IdealDetector([pull(seed) for seed in range(HEALTHY)])


def size(gain: float, seeds: range) -> float:
    twins = [detector().difference(pull(seed), pull(seed, gain)) for seed in seeds]
    return detectable_size([detector().gain(twins)], 2, 5)


def test_the_gain_that_is_needed_is_that_of_two_normal_quantiles() -> None:
    """One false alarm in a hundred and one miss in a hundred: twice 2.326 standard deviations."""
    assert pytest.approx((2.0 * 2.3263479) ** 2) == NEEDED
    assert detectable_size([NEEDED, 3.0 * NEEDED], 2, 2) == pytest.approx(2.0)


def test_a_size_grows_with_the_fault_and_is_the_same_for_other_twins() -> None:
    """Twice the error of a load cell is twice as large, whatever the day."""
    one, two = size(1.1, range(20, 22)), size(1.2, range(20, 22))
    assert two == pytest.approx(2.0 * one, rel=0.02)
    assert size(1.1, range(30, 32)) == pytest.approx(one, rel=0.1)
    assert one > 1.0


def test_what_differs_by_chance_has_no_size() -> None:
    """Differences of runs that have nothing in common but the machine cancel in products of different twins."""
    differences = [detector().difference(pull(20 + i), pull(30 + i)) for i in range(3)]
    lengths = [float(each @ each) / each.size for each in differences]
    assert all(0.3 < each < 10.0 for each in lengths)
    assert detector().gain(differences) < 0.1 * detector().gain([differences[0]] * 2)


def test_a_detector_sees_what_a_rig_measures_and_no_tendon() -> None:
    """Tension and extension of a tendon are for instrumented ones alone."""
    names = {signal.name for signal in recording_of_real(pull(1), "").signals}
    assert {"load_cell/force_z", "carriage/position", "manifold/pressure"} <= names
    assert not any(name.endswith(("/tension", "/extension")) for name in names)


def test_a_fault_out_of_sight_has_no_size() -> None:
    """A load cell that reads as it should changes nothing at all."""
    assert np.abs(detector().difference(pull(20), pull(20, 1.0))).max() == 0.0
