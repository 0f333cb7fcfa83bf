"""Which signals a diagnosis may use."""

from __future__ import annotations

import pytest

from jammkle_gap.ankle.recording import bag_of_run, recording_of
from jammkle_gap.ankle.sensors import SensorSet, headline_set, selected
from jammkle_gap.core.data import BadRecordingError
from recorded import run

RUNS = (("drop", {"foot": "jammed"}), ("slip", {"foot": "unjammed", "speed_m_s": 0.05}), ("pressure", {"cycles": 1}))


@pytest.mark.parametrize(("rig", "options"), RUNS)
def test_sets_grow_and_a_robot_measures_no_tendon(rig: str, options: dict[str, object]) -> None:
    """Each set has what the one before has; commands and driven motion are inputs and stay."""
    recording = recording_of(bag_of_run(run(rig, **options)))
    found = {each: {signal.name for signal in selected(recording, each).signals} for each in SensorSet}
    robot, rig_set, instrumented = (found[each] for each in SensorSet)
    assert robot < instrumented
    assert robot <= rig_set <= instrumented == {signal.name for signal in recording.signals}
    kinds = {name.split("/")[-1].split("_")[0] for name in robot}
    assert kinds <= {"pressure", "specific", "angular", "position"}
    assert not any(name.startswith("carriage") for name in robot)
    tendons = {name for name in instrumented if name.endswith(("/tension", "/extension"))}
    assert instrumented - rig_set == tendons
    assert selected(recording, SensorSet.ROBOT).inputs is recording.inputs
    assert ("carriage/position" in rig_set) == (rig != "slip")


def test_the_headline_is_a_rigs_where_its_load_cell_was_recorded() -> None:
    """Else a robot's."""
    drop = bag_of_run(run("drop", foot="jammed"))
    assert headline_set(recording_of(drop)) is SensorSet.RIG
    assert headline_set(recording_of(bag_of_run(run("pressure", cycles=1)))) is SensorSet.ROBOT


def test_a_recording_without_any_signal_of_a_set_is_refused() -> None:
    """One line that names the set, what there is, and the way out."""
    pull = recording_of(bag_of_run(run("tensile", vacuum_pa=50e3, speed_m_s=0.02)))
    cell = tuple(signal for signal in pull.signals if signal.name.startswith("load_cell"))
    alone = type(pull)(pull.name, cell, pull.inputs)
    with pytest.raises(BadRecordingError, match="no signal of the sensor set 'robot', only of rig; record pressures"):
        selected(alone, SensorSet.ROBOT)
