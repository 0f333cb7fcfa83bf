"""The reality as the simulator of a diagnosis: without noise, changed by its own faults and constants alone."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from jammkle_common.bags.definitions import MessageDefinitions, share_folders
from jammkle_gap.ankle.effects import ankle_library
from jammkle_gap.ankle.recording import load_recording
from studies.blind.bags import RunWriter
from studies.blind.ceiling import CeilingSimulator, ceiling_problem
from studies.blind.ceiling_machine import CONSTANTS, DAY, PLANNED, built
from studies.blind.reality.machine import STILL, Machine
from studies.blind.reality.record import Plan
from studies.blind.reality.run import run
from studies.blind.reality.specimen import today

if TYPE_CHECKING:
    from pathlib import Path

    from jammkle_gap.core.data import Recording


@pytest.fixture(scope="module")
def pulled(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    """A fast pull of the machine as drawn, as its bag tells it."""
    bag: Path = tmp_path_factory.mktemp("ceiling") / "bag"
    plan = Plan("tensile", {"speed_m_s": 0.1, "extension_m": 0.02})
    RunWriter(MessageDefinitions(share_folders())).write(run(plan, Machine(), [], 3), bag)
    return load_recording(bag)


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
