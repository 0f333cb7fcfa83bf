"""Constants of the machine and scatter of a run: at null nothing changes, and each does what a rig set so would do."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
import pytest

from jammkle_common import names
from jammkle_common.constants import STANDARD_ATMOSPHERE_PA
from jammkle_gap.ankle.effects import AnkleEffect, PriorParameter, ankle_library, machine_constants, run_scatter
from jammkle_gap.ankle.inputs import nominal_rig
from jammkle_gap.ankle.recording import recording_of_run
from jammkle_gap.ankle.simulator import AnkleSimulator
from jammkle_gap.core.effects import BadEffectError
from jammkle_sim.rigs.catalogue import RIGS, run_rig
from jammkle_sim.rigs.rig import GROUND, assembled

if TYPE_CHECKING:
    from jammkle_gap.core.data import Recording

SIMULATOR = AnkleSimulator(ankle_library())
ENTRIES = [each for each in (*machine_constants(), *run_scatter()) if isinstance(each, AnkleEffect)]
SHORT = {
    "landing": {},
    "pressure": {"cycles": 1},
    "tensile": {"vacuum_pa": 50e3, "speed_m_s": 0.02, "extension_m": 0.01},
    "slip": {"foot": "jammed", "speed_m_s": 0.05},
}
"""Runs in which every entry shows somewhere."""


@lru_cache(maxsize=8)
def recorded(rig: str, **options: object) -> Recording:
    """Run a rig without any effect."""
    given = {**SHORT.get(rig, {}), **options}
    return recording_of_run(run_rig(rig, RIGS[rig].options(**given), lambda _: None, lambda: False))


def differs(recording: Recording, values: dict[str, float]) -> bool:
    """Whether any reading is another with these values."""
    nominal, changed = SIMULATOR(recording, {}), SIMULATOR(recording, values)
    return any(not np.array_equal(nominal[name], changed[name]) for name in nominal)


def test_at_null_nothing_changes_bit_for_bit() -> None:
    """The very same recording is run on the very same rig."""
    recording = recorded("landing")
    null = {entry.key(each): each.null for entry in ENTRIES for each in entry.parameters}
    assert SIMULATOR.recording(recording, null) is recording
    assert SIMULATOR.rig(recording, null) is nominal_rig(recording.inputs)
    assert not differs(recording, null)


@pytest.mark.parametrize("entry", ENTRIES, ids=lambda entry: entry.name)
def test_an_entry_has_a_prior_and_shows(entry: AnkleEffect) -> None:
    """Each number has a deviation with its source, within its bounds; one deviation shows on some rig."""
    assert entry.sentence.endswith(".")
    assert "{" not in entry.sentence
    for each in entry.parameters:
        assert isinstance(each, PriorParameter)
        assert each.source
        assert each.minimum <= each.null < each.null + each.deviation <= each.maximum
        values = {entry.key(each): each.null + each.deviation}
        assert any(differs(recorded(rig), values) for rig in SHORT)


def test_names_of_effects_constants_and_scatter_are_apart() -> None:
    """One call can hold all three, as no two parameters are called the same."""
    keys = [
        effect.key(each)
        for library in (ankle_library(), machine_constants(), run_scatter())
        for effect in library
        for each in effect.parameters
    ]
    assert len(keys) == len(set(keys))
    recording = recorded("landing")
    together = {"payload.mass_kg": 0.1, "lever_toe.scale": 1.05, "run_height.extra_m": 0.001}
    rig = SIMULATOR.rig(recording, together)
    nominal = nominal_rig(recording.inputs)
    assert rig.model.body_mass.sum() == pytest.approx(nominal.model.body_mass.sum() + 0.1)
    assert rig.model.geom("toe_left").pos[0] == pytest.approx(1.05 * nominal.model.geom("toe_left").pos[0])
    with pytest.raises(BadEffectError, match="lever_toe"):
        SIMULATOR.rig(recording, {"lever_toe.length": 1.0})


@pytest.mark.parametrize("rig", ["drop", "landing"])
@pytest.mark.parametrize(
    "values", [{"lever_toe.scale": 1.2}, {"lever_heel.scale": 1.3}, {"lever_sole.scale": 0.8}, {"pose.extra_deg": 7.0},
               {"pose.extra_deg": -7.0}, {"run_slope.extra_deg": 2.0}],
    ids=lambda values: next(iter(values)) + f"={next(iter(values.values())):g}",
)  # fmt: skip
def test_a_machine_of_other_size_falls_as_far(rig: str, values: dict[str, float]) -> None:
    """Whatever foot, pose and slope, its lowest point starts at the drop height above the ground."""
    recording = recorded(rig)
    parts = assembled(SIMULATOR.rig(recording, values))
    model, data = parts.data.model, parts.data
    height_m = float(dict(recording.inputs.options)["drop_height_m"])
    slope = math.radians(float(dict(recording.inputs.options).get("slope_deg", 0.0)))
    slope += math.radians(values.get("run_slope.extra_deg", 0.0)) if rig == "landing" else 0.0
    normal = data.geom(GROUND).xmat.reshape(3, 3)[:, 2]
    corners = [f"{end}_{side}" for end in ("toe", "heel") for side in ("left", "right")]
    clearances_m = [float(normal @ data.geom(each).xpos) - float(model.geom(each).size[0]) for each in corners]
    assert min(clearances_m) == pytest.approx(height_m * math.cos(slope), abs=1e-9)


@pytest.mark.parametrize("extra_deg", [-6.0, 6.0])
def test_a_foot_that_hangs_pitched_stays_so(extra_deg: float) -> None:
    """Its tendons are as long as the pose asks: until the release it turns by less than a degree."""
    recording = recorded("landing", jam="never")
    pitch = recording.signal("ankle_pitch/position")
    turned = SIMULATOR(recording, {"pose.extra_deg": extra_deg})[pitch.name][pitch.time_s < 1.0]
    level = SIMULATOR(recording, {})[pitch.name][pitch.time_s < 1.0]
    assert np.abs(np.degrees(turned - level) - extra_deg).max() < 1.0


def test_a_later_start_is_that_of_a_rig_released_later() -> None:
    """Ten steps later by the entry is what the option of the rig does, its clock being that of the commands."""
    late_s = 0.005
    recording = recorded("landing")
    options = dict(recording.inputs.options)
    later = recorded("landing", release_time_s=float(options["release_time_s"]) + late_s)
    slide = recording.signal("carriage/position")
    by_entry = SIMULATOR(recording, {"run_start.late_s": late_s})
    falling = (slide.time_s > 1.0) & (slide.time_s < 1.1)
    by_option = np.interp(slide.time_s, later.signal(slide.name).time_s, SIMULATOR(later, {})[slide.name])
    assert np.abs(by_entry[slide.name] - by_option)[falling].max() < 1e-5
    pressure = recording.signal("manifold/pressure")
    moved = by_entry[pressure.name] - SIMULATOR(recording, {})[pressure.name]
    assert np.abs(moved).max() < pressure.noise


def test_the_atmosphere_is_where_pressures_begin() -> None:
    """A vented channel reads the weather."""
    recording = recorded("pressure")
    found = SIMULATOR(recording, {"run_ambient.extra_pa": 300.0})
    for channel in names.CHANNELS:
        assert found[names.PRESSURES[channel].name][0] == pytest.approx(STANDARD_ATMOSPHERE_PA + 300.0)


def test_a_valve_that_is_told_later_answers_later_alone() -> None:
    """A shift of one channel's commands leaves the other solenoids as they are."""
    recording = recorded("pressure")
    changed = SIMULATOR.recording(recording, {"run_switching_achilles.late_s": 0.003}).inputs.commands
    given = recording.inputs.commands
    for channel, line in given.solenoids.items():
        shift_s = 0.003 if channel == "achilles" else 0.0
        assert np.array_equal(changed.solenoids[channel].time_s, line.time_s + shift_s)
    assert np.array_equal(changed.duty.time_s, given.duty.time_s)


@pytest.mark.parametrize("entry", ENTRIES, ids=lambda entry: entry.name)
def test_an_entry_begins_small(entry: AnkleEffect) -> None:
    """A hundredth of a deviation moves air and tendon by a twentieth of what a whole one does, at most."""
    for rig in ("pressure", "tensile"):
        recording = recorded(rig)
        nominal = SIMULATOR(recording, {})
        for each in entry.parameters:

            def size(share: float, key: str = entry.key(each), each: PriorParameter = each) -> float:
                changed = SIMULATOR(recording, {key: each.null + share * each.deviation})  # noqa: B023
                moved = [(changed[s.name] - nominal[s.name]) / s.deviation for s in recording.signals]  # noqa: B023
                return float(np.sqrt(np.mean(np.concatenate(moved) ** 2)))

            assert size(0.01) <= 0.05 * size(1.0) + 1e-3
