"""Recordings of bags are run again to their noise; sensor sets, and runs that a diagnosis may propose."""

from __future__ import annotations

import dataclasses
import itertools
from typing import TYPE_CHECKING

import numpy as np
import pytest

from command_reference import NAME, parse
from jammkle_gap.ankle.bag import Samples
from jammkle_gap.ankle.problem import experiments
from jammkle_gap.ankle.recording import bag_of_run, recording_of
from jammkle_gap.ankle.segmentation import motion_phases
from jammkle_gap.ankle.sensors import SensorSet, headline_set, largest_set, selected
from jammkle_gap.core.data import BadRecordingError, Signal
from jammkle_gap.report.words import times
from recorded import ACHILLES, SIMULATOR, run, worst_gap

if TYPE_CHECKING:
    from jammkle_gap.core.design import Experiment


@pytest.mark.parametrize(
    ("rig", "options"),
    [
        ("tensile", {"vacuum_pa": 50e3, "speed_m_s": 0.02}),
        ("pressure", {"cycles": 2}),
        ("drop", {"foot": "jammed"}),
        ("drop", {"foot": "squash_ball"}),
        ("drop", {"foot": "rigid_ankle"}),
        ("landing", {}),
        ("landing", {"jam": "never"}),
    ],
)
def test_a_nominal_run_lies_at_its_noise(rig: str, options: dict[str, object]) -> None:
    """Played back, commands and driven motion give the measurements again, but for the noise of the instruments."""
    assert 0.5 < worst_gap(recording_of(bag_of_run(run(rig, **options)))) < 1.5


def test_samples_written_in_another_order_are_put_back() -> None:
    """A recorder with several threads swaps neighbours: nothing is lost by it."""
    given = bag_of_run(run("drop", foot="unjammed"))
    swapped = np.arange(len(given.topics["load_cell/wrench"].stamp_s))
    swapped[10:-1:20], swapped[11::20] = swapped[11::20].copy(), swapped[10:-1:20].copy()
    cell = given.topics["load_cell/wrench"]
    columns = {name: values[swapped] for name, values in cell.columns.items()}
    topics = {**given.topics, "load_cell/wrench": Samples(cell.log_s, cell.stamp_s[swapped], columns)}
    put_back = recording_of(dataclasses.replace(given, topics=topics)).signal("load_cell/force_z")
    assert np.array_equal(put_back.values, recording_of(given).signal("load_cell/force_z").values)


def test_what_never_moves_is_kept() -> None:
    """That a signal stands still is a measurement like any other: a vented channel, an angle across the motion."""
    recording = recording_of(bag_of_run(run("drop", foot="unjammed")))
    still = {each.name for each in recording.signals if np.ptp(each.values) < 1e-6}
    assert {"ankle_roll/position", "ankle_yaw/position"} <= still
    assert not any("constant" in note for note in recording.notes)


def test_the_replay_is_the_simulation_itself() -> None:
    """Joints and tendons, which have no noise, come out the same to the last bit."""
    recording = recording_of(bag_of_run(run("landing")))
    simulated = SIMULATOR(recording, {})
    for name in ("carriage/position", "ankle_pitch/position", "achilles_left/extension", "achilles_left/tension"):
        assert np.array_equal(recording.signal(name).values, simulated[name])


def test_phases_follow_commands_and_motion() -> None:
    """Air is evacuated, held and vented; a pull loads, turns and unloads; a leg falls, strikes, rebounds and rests."""

    def found(rig: str, signal: str, **options: object) -> list[str]:
        recording = recording_of(bag_of_run(run(rig, **options)))
        return [phase.name for phase in recording.phases if not phase.signals or signal in phase.signals]

    assert found("pressure", ACHILLES, cycles=1) == ["still", "evacuating", "holding", "venting", "still"]
    pull = found("tensile", "load_cell/force_z", vacuum_pa=50e3, speed_m_s=0.02)
    assert pull == ["still", "loading", "reversal", "unloading", "still"]
    assert found("landing", "imu/specific_force_z") == ["still", "falling", "impact", "rebound", "still"]
    assert "sliding" in found("slip", "load_cell/force_z", foot="unjammed", speed_m_s=0.05)


@pytest.mark.parametrize(("rate_hz", "noise_m"), [(100.0, 0.0), (100.0, 2e-5), (500.0, 2e-5), (1000.0, 1e-5)])
@pytest.mark.parametrize("rest_s", [0.5, 5.0, 100.0])
@pytest.mark.parametrize(
    ("times_s", "places_mm", "expected"),
    [
        ((1.0, 3.0), (0.0, 10.0), ["still", "loading", "still"]),
        ((1.0, 1.2), (0.0, -10.0), ["still", "sliding", "still"]),
        ((1.0, 3.0, 5.0), (0.0, 10.0, 0.0), ["still", "loading", "reversal", "unloading", "still"]),
        ((1.0, 3.0, 6.0, 8.0), (0.0, 10.0, 10.0, 0.0), ["still", "loading", "still", "reversal", "unloading", "still"]),
        ((1.0, 1.5, 21.5), (0.0, 10.0, 0.0), ["still", "loading", "reversal", "unloading", "still"]),
    ],
)
def test_phases_of_a_driven_slide_are_those_of_its_course(
    times_s: tuple[float, ...],
    places_mm: tuple[float, ...],
    expected: list[str],
    rest_s: float,
    rate_hz: float,
    noise_m: float,
) -> None:
    """Neither how long it then rests, nor how often and how noisily it is read, makes another motion of it."""
    time_s = np.arange(0.0, times_s[-1] + rest_s, 1.0 / rate_hz)
    noise = noise_m * np.random.default_rng(1).standard_normal(len(time_s))
    position_m = np.interp(time_s, times_s, 1e-3 * np.array(places_mm)) + noise
    found = motion_phases("tensile", Signal("carriage/position", "m", time_s, position_m), ("load_cell/force_z",))
    assert [each.name for each in found] == expected
    assert found[1].start_s == pytest.approx(times_s[0], abs=0.1)
    assert found[-1].start_s == pytest.approx(times_s[-1], abs=0.1)


@pytest.mark.parametrize(("rig", "options"), [("landing", {}), ("tensile", {"vacuum_pa": 50e3, "speed_m_s": 0.02})])
def test_phases_do_not_overlap(rig: str, options: dict[str, object]) -> None:
    """Each signal is in one phase at a time, throughout."""
    recording = recording_of(bag_of_run(run(rig, **options)))
    for signal in recording.signals:
        own = sorted(
            (phase for phase in recording.phases if not phase.signals or signal.name in phase.signals),
            key=lambda phase: phase.start_s,
        )
        assert own
        assert all(one.end_s == two.start_s for one, two in itertools.pairwise(own))
        assert own[0].start_s <= signal.time_s[0]
        assert own[-1].end_s > signal.time_s[-1]


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


ON_A_RIG = recording_of(bag_of_run(run("pressure", cycles=1)))
ON_A_ROBOT = recording_of(bag_of_run(run("cycle", reservoir_volume_m3=5e-5)))
OFFERED = [*experiments([ON_A_RIG]), *experiments([ON_A_RIG, ON_A_ROBOT])]


@pytest.mark.parametrize("experiment", OFFERED, ids=lambda each: each.name)
def test_every_plan_can_be_run(experiment: Experiment) -> None:
    """Each run on offer has a rig and options that exist, gives signals with a noise, and is named as its command."""
    recording = experiment.plan()
    assert experiment.name.split()[1] == recording.inputs.rig
    assert recording.signals
    assert all(signal.deviation > 0.0 for signal in recording.signals)


@pytest.mark.parametrize("experiment", OFFERED, ids=lambda each: each.name)
def test_every_plan_is_named_by_a_line_that_can_be_typed(experiment: Experiment) -> None:
    """Options and units are those of the command."""
    parse([NAME, *experiment.name.split(), "-o", "runs/next"])


def test_what_is_on_offer_goes_by_the_machine() -> None:
    """A bench is offered its rigs, a robot exercises, with the reservoir that it has."""
    assert {each.name.split()[0] for each in experiments([ON_A_RIG])} == {"rig"}
    assert {each.name.split()[0] for each in experiments([ON_A_RIG, ON_A_ROBOT])} == {"exercise"}
    assert dict(experiments([ON_A_ROBOT])[0].plan().inputs.options)["reservoir_volume_m3"] == 5e-5


def test_a_run_on_offer_has_the_sensors_that_were_recorded() -> None:
    """What no robot measures separates no effects of it; a test rig has its load cell."""
    robot = selected(ON_A_ROBOT, SensorSet.ROBOT)
    sets = {largest_set([each.plan()]) for each in experiments([robot])}
    assert sets == {SensorSet.ROBOT}
    bench = {each.plan().inputs.rig: each for each in experiments([selected(ON_A_RIG, SensorSet.ROBOT)])}
    assert largest_set([bench["tensile"].plan()]) is SensorSet.RIG
    assert largest_set([bench["pressure"].plan()]) is SensorSet.ROBOT


def test_small_gaps_have_no_digits_to_read() -> None:
    """What lies far below the noise is nothing; large gaps are whole numbers."""
    assert [times(gap) for gap in (1e-9, 1.234, 12.34, 123.4)] == ["0.00", "1.23", "12.3", "123"]
